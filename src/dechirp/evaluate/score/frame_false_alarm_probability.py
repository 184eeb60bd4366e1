"""How often a frame without targets has a detection."""

from typing import ClassVar

import numpy as np

from dechirp.core.values import value
from dechirp.evaluate import false_alarms
from dechirp.evaluate.look import Case, Look
from dechirp.evaluate.needed import must_rise
from dechirp.evaluate.score.base import Better, Estimate, Need, Score
from dechirp.evaluate.shares import share


@value
class FrameFalseAlarmProbability(Score):
    """Share of frames of the scenario without its targets that have a detection, or more.

    Theory is that of white noise, see `evaluate.false_alarms`.
    """

    better: ClassVar[Better] = "less"
    needs: ClassVar[frozenset[Need]] = frozenset({"noise"})
    n_sums: ClassVar[int] = 2

    def subjects(self, case: Case) -> tuple[str, ...]:
        """Only the whole."""
        return ()

    def check(self, case: Case) -> None:
        """Ramps must rise."""
        must_rise(case, self.label())

    def sums(self, look: Look, case: Case) -> np.ndarray:
        """Whether the frame has a detection, and that it is one."""
        assert look.noise is not None
        return np.array([[look.noise.n_peaks > 0, 1]], float)

    def estimate(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        """One frame a trial: Clopper and Pearson's interval."""
        return share(*sums.T, confidence=confidence)

    def theory(self, case: Case) -> np.ndarray:
        """NaN where false alarms of a frame come together."""
        return np.array([false_alarms.in_a_frame(case.radar, case.chain)])
