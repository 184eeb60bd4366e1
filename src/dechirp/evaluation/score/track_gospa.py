"""GOSPA of the tracks of a frame: position errors, missed targets and false tracks."""

from typing import ClassVar

import numpy as np

from dechirp.core.values import frozen_dataclass
from dechirp.evaluation.gospa import gospa
from dechirp.evaluation.score.base import Better, Estimate
from dechirp.evaluation.score.track_score import TrackScore
from dechirp.evaluation.track_states import position_pairs_m
from dechirp.evaluation.trial import TrialContext, TrialResult
from dechirp.evaluation.trial_statistics import estimate_mean


@frozen_dataclass
class TrackGospa(TrackScore):
    """GOSPA of order 2 in the plane, averaged over frames.

    A missed target or a false track each adds half the squared cut-off.
    """

    better: ClassVar[Better] = "less"
    unit: ClassVar[str | None] = "m"
    n_sums: ClassVar[int] = 2

    def subjects(self, context: TrialContext) -> tuple[str, ...]:
        return ()

    def trial_sums(self, result: TrialResult, context: TrialContext) -> np.ndarray:
        """Return the errors of all frames, and frames."""
        pairs = position_pairs_m(result, context)
        errors = [gospa(*pair, cutoff_m=self.cutoff_m).error_m for pair in pairs]
        return np.array([[sum(errors), len(errors)]], float)

    def estimate(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        return estimate_mean(*sums.T, confidence=confidence)
