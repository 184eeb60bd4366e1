"""States of tracks and of targets, frame by frame."""

from functools import lru_cache

import numpy as np
import xarray as xr

from dechirp.evaluation.identity import track_identities
from dechirp.evaluation.trial import TrialContext, TrialResult

STATE_NAMES = ("x", "vx", "y", "vy")
"""Components of the state of a track and of a target."""


@lru_cache(maxsize=4)
def true_target_states(context: TrialContext) -> xr.Dataset:
    """Return `STATE_NAMES` of each target over (target, frame), m and m/s, in radar coordinates.

    Bodies have the state of their origin.
    """
    position_m = context.scene.target_positions_m(context.times_s)
    velocity = context.scene.target_velocities_m_per_s(context.times_s)
    columns = (position_m[..., 0], velocity[..., 0], position_m[..., 1], velocity[..., 1])
    return xr.Dataset(
        {
            name: (("target", "frame"), column.T)
            for name, column in zip(STATE_NAMES, columns, strict=True)
        },
        coords={"target": list(context.target_names), "frame": context.truth["frame"].values},
    )


@lru_cache(maxsize=1)
def cached_track_assignment(
    result: TrialResult, context: TrialContext, cutoff_m: float
) -> xr.Dataset:
    """Return the assignment of tracks to targets (`track_identities`), cached for other scores."""
    assert result.tracks is not None
    return track_identities(result.tracks, true_target_states(context), cutoff_m=cutoff_m)


def confirmed_track_states(result: TrialResult) -> np.ndarray:
    """Return `STATE_NAMES` of each confirmed track, (track, frame, 4), NaN while not confirmed."""
    assert result.tracks is not None
    tracks = result.tracks.transpose("track", "frame", ...)
    states = np.stack([tracks[name].values for name in STATE_NAMES], axis=-1)
    return np.where(tracks["status"].values[..., None] == "confirmed", states, np.nan)


def track_and_target_positions_m(
    result: TrialResult, context: TrialContext
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the positions of confirmed tracks, (n, 2), and of targets, (m, 2), in each frame."""
    tracks_m = confirmed_track_states(result)[..., ::2]
    truth = true_target_states(context)
    targets_m = np.stack([truth[name].values for name in "xy"], axis=-1)
    is_confirmed = np.isfinite(tracks_m).all(axis=-1)
    return [
        (tracks_m[is_confirmed[:, frame], frame], targets_m[:, frame])
        for frame in range(targets_m.shape[1])
    ]
