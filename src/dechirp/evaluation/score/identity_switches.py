"""Identity switches of a target between tracks."""

from typing import ClassVar

import numpy as np

from dechirp.core.values import frozen_dataclass
from dechirp.evaluation.score.base import Better, Estimate
from dechirp.evaluation.score.track_score import TrackScore
from dechirp.evaluation.track_states import track_assignment
from dechirp.evaluation.trial import TrialContext, TrialResult
from dechirp.evaluation.trial_statistics import estimate_rate


@frozen_dataclass
class IdentitySwitches(TrackScore):
    """Number of changes of the track of a target, in a trial."""

    better: ClassVar[Better] = "less"
    n_sums: ClassVar[int] = 2

    def trial_sums(self, result: TrialResult, context: TrialContext) -> np.ndarray:
        """Return the changes of each target, and the number of trials, 1."""
        n_swaps = track_assignment(result, context, self.cutoff_m)["n_swaps"].values
        return np.stack([n_swaps, np.ones(len(n_swaps))], axis=1)

    def estimate(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        return estimate_rate(*sums.T, confidence=confidence)
