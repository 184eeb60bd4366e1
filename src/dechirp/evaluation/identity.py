"""Track identity: the assignment of tracks to targets, frame by frame."""

from collections.abc import Callable

import numpy as np
import scipy
import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_number
from dechirp.core.errors import InvalidSetting
from dechirp.evaluation.ospa import pairwise_distances_m

NO_TRACK = -1


@check_argument_types
def track_identities(tracks: xr.Dataset, truth: xr.Dataset, *, cutoff_m: float) -> xr.Dataset:
    """Assign confirmed tracks to targets, and count the changes.

    A track keeps its target while the two are within the cut-off; the others are assigned to the
    remaining targets by the least sum of distances. So crossing tracks do not swap when the other
    is briefly nearer, but a track that continues with the other's target does.

    Parameters
    ----------
    tracks : Dataset over (track, frame)
        As `track` returns them.
    truth : Dataset over (target, frame)
        `x` and `y`, in m, of the same frames; NaN while a target is absent.
    cutoff_m : float
        Largest distance of a track from its target.

    Returns
    -------
    Dataset over (target, frame)
        holder : the track, -1 for none, (target, frame)
        first_held : index of the first frame with a track, -1 if never, (target)
        n_lost : later frames in which the target is present without a track, (target)
        n_swaps : number of changes to another track, (target)
        n_false : confirmed tracks without a target, (frame)

    Raises
    ------
    InvalidSetting
        If frames differ, or the cut-off is out of range.

    References
    ----------
    K. Bernardin, R. Stiefelhagen, Evaluating Multiple Object Tracking Performance: The CLEAR MOT
    Metrics, EURASIP J. Image and Video Processing, 2008 (continuation of assignments).
    """
    cutoff_m = check_number("cutoff_m", cutoff_m, above=0)
    for argument, dataset, names in (
        ("tracks", tracks, ("x", "y", "status")),
        ("truth", truth, ("x", "y")),
    ):
        missing = [name for name in names if name not in dataset.variables]
        if missing:
            raise InvalidSetting(
                argument,
                value=f"a dataset without {', '.join(missing)}",
                expected=f"{', '.join(names)}",
                fix="pass what dechirp.track returns, and x and y of the targets over the frames",
            )
    if not np.array_equal(tracks["frame"].values, truth["frame"].values):
        raise InvalidSetting(
            "truth",
            value="other frames than those of the tracks",
            expected="one column for each frame of the tracks",
            fix="compute both for the same frames",
        )
    track_m, truth_m = _xy_positions_m(tracks, "track"), _xy_positions_m(truth, "target")
    return identities_from_distances(
        tracks,
        np.isfinite(truth_m).all(axis=-1),
        lambda frame, rows, targets: pairwise_distances_m(
            track_m[rows, frame], truth_m[targets, frame]
        ),
        cutoff_m=cutoff_m,
    )


PairDistances = Callable[[int, np.ndarray, np.ndarray], np.ndarray]
"""Function of the index of a frame, indices of tracks (t,) and of targets (n,), which returns the
distances of all pairs, (t, n)."""


def identities_from_distances(
    tracks: xr.Dataset, is_present: np.ndarray, distances_m: PairDistances, *, cutoff_m: float
) -> xr.Dataset:
    """Assign confirmed tracks to targets as `track_identities`, by distances of any kind.

    `is_present` is True for the targets of each frame, (target, frame).
    """
    confirmed = _confirmed_track_mask(tracks)
    holder = np.full(is_present.shape, NO_TRACK)
    current = np.full(len(is_present), NO_TRACK)
    for frame in range(is_present.shape[1]):
        rows, targets = np.flatnonzero(confirmed[:, frame]), np.flatnonzero(is_present[:, frame])
        of_all_m = np.full((len(confirmed), len(is_present)), np.inf)
        of_all_m[np.ix_(rows, targets)] = distances_m(frame, rows, targets)
        current = _assign_tracks_keeping_previous(current, rows, targets, of_all_m, cutoff_m)
        holder[:, frame] = current
    is_held = holder != NO_TRACK
    has_started = np.logical_or.accumulate(is_held, axis=1)
    return xr.Dataset(
        {
            "holder": (("target", "frame"), holder),
            "first_held": ("target", np.where(is_held.any(1), is_held.argmax(1), NO_TRACK)),
            "n_lost": ("target", np.sum(has_started & is_present & ~is_held, axis=1)),
            "n_swaps": ("target", [_count_track_changes(row[row != NO_TRACK]) for row in holder]),
            "n_false": ("frame", confirmed.sum(0) - is_held.sum(0)),
        },
        coords={"frame": tracks["frame"]},
    )


def _assign_tracks_keeping_previous(
    previous: np.ndarray,
    tracks: np.ndarray,
    targets: np.ndarray,
    distances_m: np.ndarray,
    cutoff_m: float,
) -> np.ndarray:
    """Return the track of each target in a frame, given those of the previous frame."""
    assignment = np.full_like(previous, NO_TRACK)
    is_near = distances_m <= cutoff_m
    for target in targets:
        if previous[target] != NO_TRACK and is_near[previous[target], target]:
            assignment[target] = previous[target]
    free_tracks = np.setdiff1d(tracks, assignment)
    open_targets = targets[assignment[targets] == NO_TRACK]
    # A pair beyond the cut-off costs more than all near pairs together, so it is assigned last.
    too_far_m = cutoff_m * (1 + min(len(free_tracks), len(open_targets)))
    cost = np.where(is_near, distances_m, too_far_m)[np.ix_(free_tracks, open_targets)]
    for i, j in zip(*scipy.optimize.linear_sum_assignment(cost), strict=True):
        if is_near[free_tracks[i], open_targets[j]]:
            assignment[open_targets[j]] = free_tracks[i]
    return assignment


def _xy_positions_m(states: xr.Dataset, axis: str) -> np.ndarray:
    return np.stack([states[name].transpose(axis, "frame").values for name in "xy"], axis=-1)


def _confirmed_track_mask(tracks: xr.Dataset) -> np.ndarray:
    return tracks["status"].transpose("track", "frame").values == "confirmed"


def _count_track_changes(track_of_frame: np.ndarray) -> int:
    return int(np.sum(track_of_frame[1:] != track_of_frame[:-1]))
