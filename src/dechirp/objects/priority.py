"""Who is left out when a list is too long for its bus."""

import warnings

import numpy as np
import xarray as xr

from dechirp.core.findings import Finding, PhysicsWarning
from dechirp.objects.rows import STATUSES, status_codes

_SLOWEST_M_PER_S = 1.0
"""So that what stands still before the radar is not less urgent than all that moves."""


def reach_s(objects: xr.Dataset) -> np.ndarray:
    """Time in which each object would be at the radar: range over closing speed.

    Objects that close in by less than 1 m/s, stand still or recede count as closing in by that,
    so that among them the nearer is the more important. Infinite where the place is not told.
    """
    x, y, vx, vy = (objects[name].values for name in ("x", "y", "vx", "vy"))
    x, y = np.where(np.isnan(x), 0.0, x), np.where(np.isnan(y), 0.0, y)
    range_m = np.hypot(x, y)
    closing = -(x * np.nan_to_num(vx) + y * np.nan_to_num(vy)) / np.maximum(range_m, 1e-9)
    reach = range_m / np.maximum(closing, _SLOWEST_M_PER_S)
    untold = np.isnan(objects["x"].values) & np.isnan(objects["y"].values)
    return np.where(untold, np.inf, reach)


def priority(objects: xr.Dataset) -> np.ndarray:
    """Rank of each object within its frame, 0 the most important.

    Confirmed tracks come before tentative ones, those before detections; among equals the one
    that could be at the radar first (`reach_s`).
    """
    frame = objects["frame"].values
    order = np.lexsort((reach_s(objects), -status_codes(objects), frame))
    rank = np.empty(len(order), int)
    rank[order] = np.arange(len(order)) - np.searchsorted(frame[order], frame[order])
    return rank


def in_order(objects: xr.Dataset) -> xr.Dataset:
    """The same list by frame, and in each by `priority`: the most important object first."""
    return objects.isel(object=np.lexsort((priority(objects), objects["frame"].values)))


def most_important(objects: xr.Dataset, at_most: int, *, why: str, fix: str) -> xr.Dataset:
    """Keep at most so many objects of each frame, by `priority`, in the order they have.

    Warns
    -----
    PhysicsWarning
        If some are left out: how many, of what status, and how near.
    """
    kept = priority(objects) < at_most
    left_out = objects.isel(object=~kept)
    if left_out.sizes["object"]:
        _say_left_out(left_out, at_most, why, fix)
    return objects.isel(object=kept)


def _say_left_out(left_out: xr.Dataset, at_most: int, why: str, fix: str) -> None:
    status = left_out["status"].values
    counts = [f"{(status == name).sum()} {name}" for name in STATUSES if (status == name).any()]
    nearest_m = np.hypot(left_out["x"].values, left_out["y"].values)
    told = nearest_m[np.isfinite(nearest_m)]
    near = f", the nearest at {told.min():.4g} m" if told.size else ""
    n_frames = len(np.unique(left_out["frame"].values))
    finding = Finding(
        level="warning",
        setting="objects",
        got=f"{len(status)} objects left out of {n_frames} lists ({', '.join(counts)}{near})",
        need=f"at most {at_most} in a list: {why}",
        fix=fix,
    )
    warnings.warn(PhysicsWarning(finding), stacklevel=4)
