"""Consistency of tracks: their NEES."""

from typing import ClassVar

import numpy as np

from dechirp.core.values import frozen_dataclass
from dechirp.evaluation.identity import NO_TRACK
from dechirp.evaluation.nees import nees
from dechirp.evaluation.score.base import Estimate
from dechirp.evaluation.score.track_score import TrackScore
from dechirp.evaluation.track_states import (
    STATE_NAMES,
    confirmed_states,
    target_states,
    track_assignment,
)
from dechirp.evaluation.trial import TrialContext, TrialResult
from dechirp.evaluation.trial_statistics import estimate_mean


@frozen_dataclass
class TrackNees(TrackScore):
    """Normalised estimation error squared of assigned tracks, averaged over frames.

    4, the number of states, for a consistent filter, whose interval then contains it. Larger: the
    filter
    underestimates its errors. A cut-off within a few standard errors excludes the largest errors.
    A body is tracked at its reflections, not at its origin.
    """

    n_sums: ClassVar[int] = 2

    def trial_sums(self, result: TrialResult, context: TrialContext) -> np.ndarray:
        """Return the sum over frames with a track, and those frames."""
        assert result.tracks is not None
        holder = (
            track_assignment(result, context, self.cutoff_m)["holder"]
            .transpose("target", "frame")
            .values
        )
        target, frame = np.nonzero(holder != NO_TRACK)
        track, truth = holder[target, frame], target_states(context)
        true_states = np.stack([truth[name].values[target, frame] for name in STATE_NAMES], axis=-1)
        axes = {"state": list(STATE_NAMES), "other_state": list(STATE_NAMES)}
        covariance = result.tracks["covariance"].sel(axes).transpose("track", "frame", *axes).values
        sums = np.zeros((len(holder), self.n_sums))
        if target.size:
            errors = confirmed_states(result)[track, frame] - true_states
            np.add.at(sums[:, 0], target, nees(errors, covariance[track, frame]))
            np.add.at(sums[:, 1], target, 1)
        return sums

    def estimate(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        return estimate_mean(*sums.T, confidence=confidence)

    def theory(self, context: TrialContext) -> np.ndarray:
        """Return the number of states, the value of a consistent filter."""
        return np.full(len(context.names), float(len(STATE_NAMES)))
