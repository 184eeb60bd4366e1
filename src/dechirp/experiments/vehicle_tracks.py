"""Fused tracks of several radars in the axes of their vehicle, as a bus transmits them."""

import numpy as np
import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.errors import InvalidSetting
from dechirp.experiments.run_radars import RadarsResult
from dechirp.tracking.poses import RadarPose
from dechirp.traffic.mounting import Mounting
from dechirp.traffic.object_steps import SAME_TIME_S
from dechirp.traffic.outlines import QUARTER_TURN, rotation

_STATE = ["x", "y", "vx", "vy"]


@check_argument_types
def convert_tracks_to_vehicle_axes(result: RadarsResult) -> xr.Dataset:
    """Convert fused tracks over the ground to the axes of the vehicle, for its bus.

    Parameters
    ----------
    result : RadarsResult
        Result of `run_radars`, with tracks.

    Returns
    -------
    Dataset over (track, frame)
        As `result.tracks`: x forward and y left of the centre of the vehicle, velocities relative
        to it, in axes that turn with it, and covariances. Of frames of several radars at one time,
        the last, which contains all of their detections.

    Raises
    ------
    InvalidSetting
        If the result has no tracks.
    """
    tracks = result.tracks
    if tracks is None:
        raise InvalidSetting(
            "result.tracks",
            value="none",
            expected="fused tracks",
            fix="add a tracker to the scenario of the radars",
        )
    maps = {
        name: _maps_to_vehicle(
            result.poses[name], result.mountings[name], tracks["time"].values[is_own]
        )
        for name in result.radars
        if (is_own := tracks["radar"].values == name).any()
    }
    to_vehicle, offsets = (
        np.array(
            [
                maps[name][part][number]
                for name, number in zip(
                    tracks["radar"].values.tolist(),
                    tracks["radar_frame"].values.tolist(),
                    strict=True,
                )
            ]
        )
        for part in (0, 1)
    )
    state = np.stack([tracks[name].transpose("track", "frame").values for name in _STATE], axis=-1)
    state = np.einsum("fij,tfj->tfi", to_vehicle, state - offsets)
    covariance = (
        tracks["covariance"]
        .sel(state=_STATE, other_state=_STATE)
        .transpose("track", "frame", "state", "other_state")
    )
    turned = np.einsum("fij,tfjk,flk->tfil", to_vehicle, covariance.values, to_vehicle)
    columns = {
        name: (("track", "frame"), state[..., index], tracks[name].attrs)
        for index, name in enumerate(_STATE)
    }
    turned_covariance = covariance.copy(data=turned).sel(
        state=tracks["state"], other_state=tracks["other_state"]
    )
    converted = tracks.assign({**columns, "covariance": turned_covariance})
    is_last = np.append(np.diff(tracks["time"].values) > SAME_TIME_S, True)
    return converted.isel(frame=np.flatnonzero(is_last))


def _maps_to_vehicle(
    poses: tuple[RadarPose, ...], mounting: Mounting, times_s: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return matrices (n, 4, 4) to the axes of the vehicle, and its state over the ground (n, 4).

    The matrices map differences of states.
    """
    yaw_rad = np.unwrap([pose.yaw_rad - mounting.yaw_rad for pose in poses])
    turn_rates = np.gradient(yaw_rad, times_s) if len(poses) > 1 else np.zeros(1)
    matrices, states = [], []
    for pose, angle_rad, turn_rate in zip(poses, yaw_rad, turn_rates, strict=True):
        arm_m = rotation(angle_rad) @ mounting.position_m[:2]
        velocity = pose.velocity_m_per_s - turn_rate * QUARTER_TURN @ arm_m
        states.append([*(pose.position_m - arm_m), *velocity])
        turn = rotation(-angle_rad)
        matrices.append(
            np.block([[turn, np.zeros((2, 2))], [-turn_rate * QUARTER_TURN @ turn, turn]])
        )
    return np.array(matrices), np.array(states)
