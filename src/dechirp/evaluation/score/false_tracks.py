"""Number of false tracks in a frame."""

from typing import ClassVar

import numpy as np

from dechirp.core.values import frozen_dataclass
from dechirp.evaluation.score.base import Better, Estimate
from dechirp.evaluation.score.track_score import TrackScore
from dechirp.evaluation.track_states import track_assignment
from dechirp.evaluation.trial import TrialContext, TrialResult
from dechirp.evaluation.trial_statistics import estimate_rate


@frozen_dataclass
class FalseTracks(TrackScore):
    """Mean number of confirmed tracks without a target, for each frame."""

    better: ClassVar[Better] = "less"
    n_sums: ClassVar[int] = 2

    def subjects(self, context: TrialContext) -> tuple[str, ...]:
        return ()

    def check_context(self, context: TrialContext) -> None:
        """Accept any context: without targets all tracks are false."""

    def trial_sums(self, result: TrialResult, context: TrialContext) -> np.ndarray:
        """Return false tracks of all frames, and frames."""
        n_false = track_assignment(result, context, self.cutoff_m)["n_false"].values
        return np.array([[n_false.sum(), n_false.size]], float)

    def estimate(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        """Estimate from the scatter of trials, since a false track lasts several frames."""
        return estimate_rate(*sums.T, confidence=confidence)
