"""How long processing takes."""

from typing import ClassVar

import numpy as np
from scipy.special import bdtr

from dechirp.core.values import value
from dechirp.evaluate.look import Case, Look
from dechirp.evaluate.score.base import NOTHING, Better, Estimate, Score


@value
class ProcessingTime(Score):
    """Time from samples to the last table, all frames of a trial together: the median.

    Of the machine that the study runs on, with whatever else it does.
    """

    better: ClassVar[Better] = "less"
    unit: ClassVar[str | None] = "s"
    repeatable: ClassVar[bool] = False
    n_sums: ClassVar[int] = 1

    def subjects(self, case: Case) -> tuple[str, ...]:
        """Only the whole."""
        return ()

    def sums(self, look: Look, case: Case) -> np.ndarray:
        """Seconds."""
        return np.array([[look.processing_s]])

    def estimate(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        """Median, between those of the times in order that hold it, whatever their distribution.

        As many lie below it as heads of a fair coin (H. A. David and H. N. Nagaraja, Order
        Statistics, 2003, 7.1). NaN for too few trials: five, at a confidence of 0.95.
        """
        times = np.sort(sums[np.isfinite(sums[:, 0]), 0])
        n = times.size
        if not n:
            return NOTHING
        rank = int(np.count_nonzero(bdtr(np.arange(n // 2), n, 0.5) <= (1 - confidence) / 2))
        low, high = (times[rank - 1], times[n - rank]) if rank else (np.nan, np.nan)
        return Estimate(float(np.median(times)), float(low), float(high))
