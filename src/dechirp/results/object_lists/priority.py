"""Priority of objects, used when a list is too long for its bus."""

import warnings

import numpy as np
import xarray as xr

from dechirp.core.display import format_count_with_noun
from dechirp.core.findings import Finding, PhysicsWarning
from dechirp.results.object_lists.list_columns import STATUSES, status_codes

_MIN_CLOSING_SPEED_M_PER_S = 1.0
"""Smallest closing speed, so that a stationary object ahead stays urgent."""


def time_to_reach_radar_s(objects: xr.Dataset) -> np.ndarray:
    """Return the time in which each object could reach the radar: range over closing speed.

    Objects that approach by less than 1 m/s, stand still or recede are assumed to approach at that
    speed, so the nearer of them is more important. Infinite if the position is unknown.
    """
    x, y, vx, vy = (objects[name].values for name in ("x", "y", "vx", "vy"))
    x, y = np.where(np.isnan(x), 0.0, x), np.where(np.isnan(y), 0.0, y)
    range_m = np.hypot(x, y)
    away_x, away_y = (component / np.maximum(range_m, 1e-9) for component in (x, y))
    closing = -(away_x * np.nan_to_num(vx) + away_y * np.nan_to_num(vy))
    duration_s = range_m / np.maximum(closing, _MIN_CLOSING_SPEED_M_PER_S)
    is_unknown = np.isnan(objects["x"].values) & np.isnan(objects["y"].values)
    return np.where(is_unknown, np.inf, duration_s)


def priority_ranks(objects: xr.Dataset) -> np.ndarray:
    """Return the rank of each object within its frame, 0 the most important.

    Confirmed tracks rank before tentative ones, those before detections; objects of equal status by
    the time to reach the radar (`time_to_reach_radar_s`).
    """
    frame = objects["frame"].values
    order = np.lexsort((time_to_reach_radar_s(objects), -status_codes(objects), frame))
    rank = np.empty(len(order), int)
    rank[order] = np.arange(len(order)) - np.searchsorted(frame[order], frame[order])
    return rank


def sort_by_priority(objects: xr.Dataset) -> xr.Dataset:
    """Sort a list by frame and priority, the most important object first."""
    return objects.isel(object=np.lexsort((priority_ranks(objects), objects["frame"].values)))


def keep_most_important(objects: xr.Dataset, at_most: int, *, reason: str, fix: str) -> xr.Dataset:
    """Keep at most `at_most` objects of each frame, by priority, in their present order.

    Warns
    -----
    PhysicsWarning
        If some are left out: their number, status, and smallest distance.
    """
    is_kept = priority_ranks(objects) < at_most
    left_out = objects.isel(object=~is_kept)
    if left_out.sizes["object"]:
        _warn_objects_left_out(left_out, at_most, reason, fix)
    return objects.isel(object=is_kept)


def _warn_objects_left_out(left_out: xr.Dataset, at_most: int, reason: str, fix: str) -> None:
    status = left_out["status"].values
    counts = [f"{(status == name).sum()} {name}" for name in STATUSES if (status == name).any()]
    nearest_m = np.hypot(left_out["x"].values, left_out["y"].values)
    known_m = nearest_m[np.isfinite(nearest_m)]
    nearest = f", the nearest at {known_m.min():.4g} m" if known_m.size else ""
    n_frames = len(np.unique(left_out["frame"].values))
    finding = Finding(
        level="warning",
        setting="objects",
        value=f"{format_count_with_noun(len(status), 'object')} left out of"
        f" {format_count_with_noun(n_frames, 'list')} ({', '.join(counts)}{nearest})",
        expected=f"at most {at_most} in a list: {reason}",
        fix=fix,
    )
    warnings.warn(PhysicsWarning(finding), stacklevel=4)
