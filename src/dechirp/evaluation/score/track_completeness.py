"""Track completeness: fraction of time in which a target has a track."""

from typing import ClassVar

import numpy as np

from dechirp.core.values import frozen_dataclass
from dechirp.evaluation.identity import NO_TRACK
from dechirp.evaluation.proportions import estimate_proportion
from dechirp.evaluation.score.base import Better, Estimate
from dechirp.evaluation.score.track_score import TrackScore
from dechirp.evaluation.track_states import track_assignment
from dechirp.evaluation.trial import TrialContext, TrialResult


@frozen_dataclass
class TrackCompleteness(TrackScore):
    """Fraction of frames in which a target has a confirmed track, from the first frame on."""

    better: ClassVar[Better] = "more"
    n_sums: ClassVar[int] = 2

    def trial_sums(self, result: TrialResult, context: TrialContext) -> np.ndarray:
        """Return frames with a track, and frames."""
        holder = (
            track_assignment(result, context, self.cutoff_m)["holder"]
            .transpose("target", "frame")
            .values
        )
        n_frames = np.full(len(holder), holder.shape[1])
        return np.stack([np.sum(holder != NO_TRACK, axis=1), n_frames], axis=1).astype(float)

    def estimate(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        return estimate_proportion(*sums.T, confidence=confidence)
