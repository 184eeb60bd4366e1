"""How often noise exceeds the threshold of a cell."""

from typing import ClassVar

import numpy as np

from dechirp.core.values import value
from dechirp.evaluate import false_alarms
from dechirp.evaluate.independent import rate
from dechirp.evaluate.look import Case, Look
from dechirp.evaluate.score.base import Better, Estimate, Need, Score


@value
class FalseAlarmProbability(Score):
    """Cells over threshold, over cells tested, in maps of the scenario without its targets.

    In theory what the detector is designed for, or what its offset gives in white noise.
    """

    better: ClassVar[Better] = "less"
    needs: ClassVar[frozenset[Need]] = frozenset({"noise"})
    n_sums: ClassVar[int] = 2

    def subjects(self, case: Case) -> tuple[str, ...]:
        """Only the whole."""
        return ()

    def sums(self, look: Look, case: Case) -> np.ndarray:
        """Cells over threshold, and cells tested."""
        assert look.noise is not None
        return np.array([[look.noise.n_over, look.noise.n_tested]], float)

    def estimate(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        """Alarms come in clusters: by how maps scatter, see `independent.rate`."""
        return rate(*sums.T, confidence=confidence)

    def theory(self, case: Case) -> np.ndarray:
        """By the law of the detector, NaN where an offset has none."""
        return np.array([false_alarms.in_a_cell(case.radar, case.chain)])
