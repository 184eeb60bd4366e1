"""Scores of tracks: completeness, identity switches, false tracks, GOSPA, OSPA and NEES."""

from typing import ClassVar

import numpy as np

from dechirp.core.checks import check_positive_fields
from dechirp.core.values import frozen_dataclass
from dechirp.evaluation.gospa import gospa
from dechirp.evaluation.identity import NO_TRACK
from dechirp.evaluation.nees import nees
from dechirp.evaluation.ospa import ospa_m
from dechirp.evaluation.preconditions import check_scene_has_targets
from dechirp.evaluation.proportions import estimate_proportion
from dechirp.evaluation.score.base import Better, Estimate, Need, Score
from dechirp.evaluation.track_states import (
    STATE_NAMES,
    cached_track_assignment,
    confirmed_track_states,
    track_and_target_positions_m,
    true_target_states,
)
from dechirp.evaluation.trial import TrialContext, TrialResult
from dechirp.evaluation.trial_statistics import estimate_mean, estimate_rate


@frozen_dataclass
class TrackScore(Score):
    """Score of confirmed tracks with respect to targets; bodies by their origins."""

    needs: ClassVar[frozenset[Need]] = frozenset({"tracks"})
    cutoff_m: float = 3.0
    """Largest distance of a track from its target; for bodies at least half their length."""

    def __post_init__(self) -> None:
        check_positive_fields(self, "cutoff_m")

    def check_score_defined(self, context: TrialContext) -> None:
        check_scene_has_targets(context, self.kind())


@frozen_dataclass
class TrackCompleteness(TrackScore):
    """Fraction of frames in which a target has a confirmed track, from the first frame on."""

    better: ClassVar[Better] = "more"
    n_sums: ClassVar[int] = 2

    def trial_sums(self, result: TrialResult, context: TrialContext) -> np.ndarray:
        """Return frames with a track, and frames."""
        holder = (
            cached_track_assignment(result, context, self.cutoff_m)["holder"]
            .transpose("target", "frame")
            .values
        )
        n_frames = np.full(len(holder), holder.shape[1])
        return np.stack([np.sum(holder != NO_TRACK, axis=1), n_frames], axis=1).astype(float)

    def estimate_with_interval(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        return estimate_proportion(*sums.T, confidence=confidence)


@frozen_dataclass
class IdentitySwitches(TrackScore):
    """Number of changes of the track of a target, in a trial."""

    better: ClassVar[Better] = "less"
    n_sums: ClassVar[int] = 2

    def trial_sums(self, result: TrialResult, context: TrialContext) -> np.ndarray:
        """Return the changes of each target, and the number of trials, 1."""
        n_swaps = cached_track_assignment(result, context, self.cutoff_m)["n_swaps"].values
        return np.stack([n_swaps, np.ones(len(n_swaps))], axis=1)

    def estimate_with_interval(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        return estimate_rate(*sums.T, confidence=confidence)


@frozen_dataclass
class FalseTracks(TrackScore):
    """Mean number of confirmed tracks without a target, for each frame."""

    better: ClassVar[Better] = "less"
    n_sums: ClassVar[int] = 2

    def scored_target_names(self, context: TrialContext) -> tuple[str, ...]:
        return ()

    def check_score_defined(self, context: TrialContext) -> None:
        """Accept any context: without targets all tracks are false."""

    def trial_sums(self, result: TrialResult, context: TrialContext) -> np.ndarray:
        """Return false tracks of all frames, and frames."""
        n_false = cached_track_assignment(result, context, self.cutoff_m)["n_false"].values
        return np.array([[n_false.sum(), n_false.size]], float)

    def estimate_with_interval(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        """Estimate from the scatter of trials, since a false track lasts several frames."""
        return estimate_rate(*sums.T, confidence=confidence)


@frozen_dataclass
class TrackGospa(TrackScore):
    """GOSPA of order 2 in the plane, averaged over frames.

    A missed target or a false track each adds half the squared cut-off.
    """

    better: ClassVar[Better] = "less"
    unit: ClassVar[str | None] = "m"
    n_sums: ClassVar[int] = 2

    def scored_target_names(self, context: TrialContext) -> tuple[str, ...]:
        return ()

    def trial_sums(self, result: TrialResult, context: TrialContext) -> np.ndarray:
        """Return the errors of all frames, and frames."""
        pairs = track_and_target_positions_m(result, context)
        errors = [gospa(*pair, cutoff_m=self.cutoff_m).error_m for pair in pairs]
        return np.array([[sum(errors), len(errors)]], float)

    def estimate_with_interval(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        return estimate_mean(*sums.T, confidence=confidence)


@frozen_dataclass
class TrackOspa(TrackScore):
    """OSPA of order 1 in the plane, averaged over frames: an error per target.

    A missing or a false track counts as an error of the cut-off.
    """

    better: ClassVar[Better] = "less"
    unit: ClassVar[str | None] = "m"
    n_sums: ClassVar[int] = 2

    def scored_target_names(self, context: TrialContext) -> tuple[str, ...]:
        return ()

    def trial_sums(self, result: TrialResult, context: TrialContext) -> np.ndarray:
        """Return the errors of all frames, and frames."""
        errors = [
            ospa_m(*pair, cutoff_m=self.cutoff_m)
            for pair in track_and_target_positions_m(result, context)
        ]
        return np.array([[sum(errors), len(errors)]], float)

    def estimate_with_interval(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        return estimate_mean(*sums.T, confidence=confidence)


@frozen_dataclass
class TrackNees(TrackScore):
    """Normalised estimation error squared of assigned tracks, averaged over frames.

    4, the number of states, for a consistent filter, whose interval then contains it. Larger: the
    filter underestimates its errors. A cut-off within a few standard errors excludes the largest
    errors. A body is tracked at its reflections, not at its origin.
    """

    n_sums: ClassVar[int] = 2

    def trial_sums(self, result: TrialResult, context: TrialContext) -> np.ndarray:
        """Return the sum over frames with a track, and those frames."""
        assert result.tracks is not None
        holder = (
            cached_track_assignment(result, context, self.cutoff_m)["holder"]
            .transpose("target", "frame")
            .values
        )
        target, frame = np.nonzero(holder != NO_TRACK)
        track, truth = holder[target, frame], true_target_states(context)
        true_states = np.stack([truth[name].values[target, frame] for name in STATE_NAMES], axis=-1)
        axes = {"state": list(STATE_NAMES), "other_state": list(STATE_NAMES)}
        covariance = result.tracks["covariance"].sel(axes).transpose("track", "frame", *axes).values
        sums = np.zeros((len(holder), self.n_sums))
        if target.size:
            errors = confirmed_track_states(result)[track, frame] - true_states
            np.add.at(sums[:, 0], target, nees(errors, covariance[track, frame]))
            np.add.at(sums[:, 1], target, 1)
        return sums

    def estimate_with_interval(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        return estimate_mean(*sums.T, confidence=confidence)

    def theoretical_values(self, context: TrialContext) -> np.ndarray:
        """Return the number of states, the value of a consistent filter."""
        return np.full(len(context.target_names), float(len(STATE_NAMES)))
