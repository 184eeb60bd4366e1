"""Processing time of a trial."""

from typing import ClassVar

import numpy as np
import scipy

from dechirp.core.values import frozen_dataclass
from dechirp.evaluation.score.base import NO_ESTIMATE, Better, Estimate, Score
from dechirp.evaluation.trial import TrialContext, TrialResult


@frozen_dataclass
class ProcessingTime(Score):
    """Median time from samples to the last table, for all frames of a trial.

    It depends on the machine of the study and its other load.
    """

    better: ClassVar[Better] = "less"
    unit: ClassVar[str | None] = "s"
    is_repeatable: ClassVar[bool] = False
    n_sums: ClassVar[int] = 1

    def scored_target_names(self, context: TrialContext) -> tuple[str, ...]:
        return ()

    def trial_sums(self, result: TrialResult, context: TrialContext) -> np.ndarray:
        """Return the time in seconds."""
        return np.array([[result.processing_s]])

    def estimate_with_interval(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        """Estimate the median, with an interval of order statistics for any distribution.

        The number of times below the median has the distribution of heads of a fair coin (H. A.
        David and H. N. Nagaraja, Order Statistics, 2003, 7.1). NaN for too few trials: five, at a
        confidence of 0.95.
        """
        times = np.sort(sums[np.isfinite(sums[:, 0]), 0])
        n = times.size
        if not n:
            return NO_ESTIMATE
        rank = int(
            np.count_nonzero(scipy.special.bdtr(np.arange(n // 2), n, 0.5) <= (1 - confidence) / 2)
        )
        low, high = (times[rank - 1], times[n - rank]) if rank else (np.nan, np.nan)
        return Estimate(float(np.median(times)), float(low), float(high))
