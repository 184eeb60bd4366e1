"""Probability of a detection in a frame without targets."""

from typing import ClassVar

import numpy as np

from dechirp.core.values import frozen_dataclass
from dechirp.evaluation import false_alarms
from dechirp.evaluation.preconditions import check_rising_ramps
from dechirp.evaluation.proportions import estimate_proportion
from dechirp.evaluation.score.base import Better, Estimate, Need, Score
from dechirp.evaluation.trial import TrialContext, TrialResult


@frozen_dataclass
class FrameFalseAlarmProbability(Score):
    """Fraction of frames of the scenario without its targets that have a detection.

    Theory is for white noise, see `evaluation.false_alarms`.
    """

    better: ClassVar[Better] = "less"
    needs: ClassVar[frozenset[Need]] = frozenset({"noise"})
    n_sums: ClassVar[int] = 2

    def subjects(self, context: TrialContext) -> tuple[str, ...]:
        return ()

    def check_context(self, context: TrialContext) -> None:
        check_rising_ramps(context, self.label())

    def trial_sums(self, result: TrialResult, context: TrialContext) -> np.ndarray:
        """Return 1 for a frame with a detection, and the number of frames, 1."""
        assert result.noise is not None
        return np.array([[result.noise.n_peaks > 0, 1]], float)

    def estimate(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        return estimate_proportion(*sums.T, confidence=confidence)

    def theory(self, context: TrialContext) -> np.ndarray:
        """Return the law, NaN if false alarms of a frame are clustered."""
        return np.array([false_alarms.frame_false_alarm_probability(context.radar, context.chain)])
