"""Validity checks of a scene before it is simulated."""

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.core.text import format_si
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.scene.screens import check_radar_outside_bodies
from dechirp.scene.speed_limit import check_speed_limit

_MAX_FRAMES = 33
# The power of an echo overflows nearer to an antenna.
_MIN_DISTANCE_M = 1e-6
# Positions computed together: of a pedestrian, in a tenth of the time.
_BLOCK_POSITIONS = 2**16


def frames_to_check(scene: Scene, n_frames: int) -> list[int]:
    """Return the frames to check before a scene is simulated.

    These are the first and the last if the radar and all targets move on straight lines at constant
    speed: range and radial speed are largest at the ends. Otherwise at most 33, spread over all
    frames.
    """
    n_checked = 2 if scene.has_uniform_motion else _MAX_FRAMES
    positions = np.linspace(0, n_frames - 1, min(n_checked, n_frames))
    return [int(frame) for frame in np.unique(np.round(positions))]


def check_scene_echoes_finite(scene: Scene, radar: Radar, *, n_frames: int = 1) -> None:
    """Raise `InvalidSetting`, with the target, for a scene without a finite echo.

    Causes are a scatterer within a micrometre of an antenna or of the radar's origin, at the start
    or in the middle of the frames of `frames_to_check`; a radar inside a body that shadows; a
    target accelerated to a thousandth of the speed of light; a body that is not finite.
    """
    if not scene.targets:
        return
    antennas_m = {"the radar": (0.0, 0.0, 0.0)}
    for kind, side_positions_m in (
        ("transmitter", radar.array.tx_m),
        ("receiver", radar.array.rx_m),
    ):
        antennas_m |= {
            f"{kind} {number}": element_m for number, element_m in enumerate(side_positions_m)
        }
    check_radius_m = np.linalg.norm(list(antennas_m.values()), axis=-1).max() + _MIN_DISTANCE_M
    times_s = [
        radar.frame.frame_start_s(frame) + after_s
        for frame in frames_to_check(scene, n_frames)
        for after_s in (0.0, radar.frame.for_frame(frame).mid_frame_s)
    ]
    check_radar_outside_bodies(scene, np.array(times_s))
    step = max(_BLOCK_POSITIONS // len(scene.target_index_of_scatterer), 1)
    for first in range(0, len(times_s), step):
        block_times_s = times_s[first : first + step]
        positions_m = scene.scatterer_positions_m(block_times_s)
        is_near = np.linalg.norm(positions_m, axis=-1) < check_radius_m
        near = np.argwhere(is_near)
        for name, antenna_m in antennas_m.items():
            distances_m = np.linalg.norm(positions_m[is_near] - antenna_m, axis=-1)
            for time, scatterer in near[distances_m < _MIN_DISTANCE_M]:
                raise InvalidSetting(
                    f"scene.targets.{scene.names[scene.target_index_of_scatterer[scatterer]]}.position",
                    value=f"at {name} after {format_si(block_times_s[time], 's', 4)}",
                    expected="another position: the echo would be infinite",
                    fix="move the target",
                )
    end_s = radar.frame.frame_start_s(n_frames - 1) + radar.frame.for_frame(n_frames - 1).duration_s
    speeds = np.linalg.norm(scene.target_velocities_m_per_s([end_s])[0], axis=-1)
    for target_index in np.flatnonzero(scene.accelerating_target_mask):
        setting = f"scene.targets.{scene.names[target_index]}.acceleration"
        check_speed_limit(
            setting, speeds[target_index], context=f" after {format_si(end_s, 's', 4)}"
        )
