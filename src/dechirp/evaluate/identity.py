"""Whose track is whose: which track holds each target, frame by frame."""

import numpy as np
import xarray as xr
from scipy.optimize import linear_sum_assignment

from dechirp.core.checks import number
from dechirp.core.errors import InvalidSetting
from dechirp.evaluate.points import distances_m

NOBODY = -1


def identities(tracks: xr.Dataset, truth: xr.Dataset, *, cutoff_m: float) -> xr.Dataset:
    """Which confirmed track holds each target, and how often that changed.

    A track goes on holding its target while the two are within the cut-off; the others are
    assigned to the targets left over, by the least sum of distances. So tracks that meet and
    part are not swapped by a moment at which the other is nearer; one that goes off with the
    other's target is.

    Parameters
    ----------
    tracks : Dataset over (track, frame)
        As `track` gives them.
    truth : Dataset over (target, frame)
        `x` and `y`, in m, of the same frames; NaN while a target is not there.
    cutoff_m : float
        Distance up to which a track may hold a target.

    Returns
    -------
    Dataset over (target, frame)
        holder : the track, -1 while there is none, (target, frame)
        first_held : place of the first frame in which there is one, -1 if never, (target)
        n_lost : frames after that in which the target is there and none holds it, (target)
        n_swaps : how often another track than the last holds it, (target)
        n_false : confirmed tracks that hold none, (frame)

    Raises
    ------
    InvalidSetting
        If frames differ, or the cut-off cannot be.

    References
    ----------
    K. Bernardin, R. Stiefelhagen, Evaluating Multiple Object Tracking Performance: The CLEAR MOT
    Metrics, EURASIP J. Image and Video Processing, 2008 (how assignments go on).
    """
    cutoff_m = number("cutoff_m", cutoff_m, above=0)
    if not np.array_equal(tracks["frame"].values, truth["frame"].values):
        raise InvalidSetting(
            "truth",
            got="of other frames than the tracks",
            need="one column for each frame of the tracks",
            fix="Make both of the same frames.",
        )
    found_m, confirmed = _positions_m(tracks, "track"), _confirmed(tracks)
    truth_m = _positions_m(truth, "target")
    there = np.isfinite(truth_m).all(axis=-1)
    holder = np.full(there.shape, NOBODY)
    held = np.full(len(there), NOBODY)
    for frame in range(there.shape[1]):
        held = _assigned(
            held,
            found_m[:, frame],
            np.flatnonzero(confirmed[:, frame]),
            truth_m[:, frame],
            np.flatnonzero(there[:, frame]),
            cutoff_m,
        )
        holder[:, frame] = held
    is_held = holder != NOBODY
    begun = np.logical_or.accumulate(is_held, axis=1)
    return xr.Dataset(
        {
            "holder": (("target", "frame"), holder),
            "first_held": ("target", np.where(is_held.any(1), is_held.argmax(1), NOBODY)),
            "n_lost": ("target", np.sum(begun & there & ~is_held, axis=1)),
            "n_swaps": ("target", [_n_changes(row[row != NOBODY]) for row in holder]),
            "n_false": ("frame", confirmed.sum(0) - is_held.sum(0)),
        },
        coords={"frame": truth["frame"]},
    )


def _assigned(
    held: np.ndarray,
    found_m: np.ndarray,
    tracks: np.ndarray,
    truth_m: np.ndarray,
    targets: np.ndarray,
    cutoff_m: float,
) -> np.ndarray:
    """Track of each target in a frame, given those of the frame before."""
    now = np.full_like(held, NOBODY)
    apart_m = np.full((len(found_m), len(truth_m)), np.inf)
    apart_m[np.ix_(tracks, targets)] = distances_m(found_m[tracks], truth_m[targets])
    near = apart_m <= cutoff_m
    for target in targets:
        if held[target] != NOBODY and near[held[target], target]:
            now[target] = held[target]
    free = np.setdiff1d(tracks, now)
    open_targets = targets[now[targets] == NOBODY]
    # One that is too far costs more than all that are near together: it is taken last.
    too_far_m = cutoff_m * (1 + min(len(free), len(open_targets)))
    cost = np.where(near, apart_m, too_far_m)[np.ix_(free, open_targets)]
    for i, j in zip(*linear_sum_assignment(cost), strict=True):
        if near[free[i], open_targets[j]]:
            now[open_targets[j]] = free[i]
    return now


def _positions_m(states: xr.Dataset, over: str) -> np.ndarray:
    return np.stack([states[name].transpose(over, "frame").values for name in "xy"], axis=-1)


def _confirmed(tracks: xr.Dataset) -> np.ndarray:
    return tracks["status"].transpose("track", "frame").values == "confirmed"


def _n_changes(row: np.ndarray) -> int:
    return int(np.sum(row[1:] != row[:-1]))
