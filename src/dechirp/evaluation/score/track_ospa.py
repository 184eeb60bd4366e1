"""OSPA of the tracks of a frame: mean error per target, with missing and false tracks."""

from typing import ClassVar

import numpy as np

from dechirp.core.values import frozen_dataclass
from dechirp.evaluation.ospa import ospa_m
from dechirp.evaluation.score.base import Better, Estimate
from dechirp.evaluation.score.track_score import TrackScore
from dechirp.evaluation.track_states import position_pairs_m
from dechirp.evaluation.trial import TrialContext, TrialResult
from dechirp.evaluation.trial_statistics import estimate_mean


@frozen_dataclass
class TrackOspa(TrackScore):
    """OSPA of order 1 in the plane, averaged over frames: an error per target.

    A missing or a false track counts as an error of the cut-off.
    """

    better: ClassVar[Better] = "less"
    unit: ClassVar[str | None] = "m"
    n_sums: ClassVar[int] = 2

    def subjects(self, context: TrialContext) -> tuple[str, ...]:
        return ()

    def trial_sums(self, result: TrialResult, context: TrialContext) -> np.ndarray:
        """Return the errors of all frames, and frames."""
        errors = [
            ospa_m(*pair, cutoff_m=self.cutoff_m) for pair in position_pairs_m(result, context)
        ]
        return np.array([[sum(errors), len(errors)]], float)

    def estimate(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        return estimate_mean(*sums.T, confidence=confidence)
