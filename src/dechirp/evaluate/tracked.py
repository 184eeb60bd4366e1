"""Tracks beside the truth, frame by frame."""

from functools import lru_cache

import numpy as np
import xarray as xr

from dechirp.evaluate.identity import identities
from dechirp.evaluate.look import Case, Look

STATE = ("x", "vx", "y", "vy")
"""What a track tells, and the truth beside it."""


@lru_cache(maxsize=4)
def states(case: Case) -> xr.Dataset:
    """`STATE` of each target, over (target, frame), m and m/s, in coordinates of the radar.

    Of bodies that of their origins.
    """
    place_m = case.scene.target_positions_m(case.times_s)
    velocity = case.scene.target_velocities_m_per_s(case.times_s)
    columns = (place_m[..., 0], velocity[..., 0], place_m[..., 1], velocity[..., 1])
    return xr.Dataset(
        {name: (("target", "frame"), of.T) for name, of in zip(STATE, columns, strict=True)},
        coords={"target": list(case.names), "frame": case.truth["frame"].values},
    )


@lru_cache(maxsize=1)
def held(look: Look, case: Case, cutoff_m: float) -> xr.Dataset:
    """Which track holds which target, see `identities`; kept for the next score of the look."""
    assert look.tracks is not None
    return identities(look.tracks, states(case), cutoff_m=cutoff_m)


def of_tracks(look: Look) -> np.ndarray:
    """`STATE` of each track while it is confirmed, (track, frame, 4), NaN elsewhere."""
    assert look.tracks is not None
    tracks = look.tracks.transpose("track", "frame", ...)
    found = np.stack([tracks[name].values for name in STATE], axis=-1)
    return np.where(tracks["status"].values[..., None] == "confirmed", found, np.nan)


def pairs_m(look: Look, case: Case) -> list[tuple[np.ndarray, np.ndarray]]:
    """Places of confirmed tracks, (n, 2), and of targets, (m, 2), in each frame."""
    found = of_tracks(look)[..., ::2]
    truth = states(case)
    there = np.stack([truth[name].values for name in "xy"], axis=-1)
    told = np.isfinite(found).all(axis=-1)
    return [(found[told[:, f], f], there[:, f]) for f in range(there.shape[1])]
