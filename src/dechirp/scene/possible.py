"""Scenes that cannot be simulated, refused before they are."""

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.scene.slow import must_be_slow

_MOST_FRAMES = 33
# Nearer to an antenna, the power of an echo overflows.
_APART_M = 1e-6
# Places of scatterers that are found together: of a walker, in a tenth of the time.
_AT_A_TIME = 2**16


def looked_at(scene: Scene, n_frames: int) -> list[int]:
    """Frames that are looked at before a scene is simulated.

    The first and the last where the radar and all targets go on straight lines at constant
    speed: range and speed along the line of sight are largest at the ends. Else 33 at most,
    spread over all.
    """
    number = 2 if scene.is_uniform else _MOST_FRAMES
    spread = np.linspace(0, n_frames - 1, min(number, n_frames))
    return [int(frame) for frame in np.unique(np.round(spread))]


def must_be_possible(scene: Scene, radar: Radar, *, n_frames: int = 1) -> None:
    """Raise `InvalidSetting`, naming the target, for a scene that has no finite echo.

    That is a scatterer within a micrometre of an antenna or of the radar's origin, at the
    start or in the middle of the frames of `looked_at`; a target that is accelerated to a
    thousandth of the speed of light; a body that is not finite.
    """
    if not scene.targets:
        return
    antennas_m = {"the radar": (0.0, 0.0, 0.0)}
    for kind, at_m in (("transmitter", radar.array.tx_m), ("receiver", radar.array.rx_m)):
        antennas_m |= {f"{kind} {number}": one_m for number, one_m in enumerate(at_m)}
    reach_m = np.linalg.norm(list(antennas_m.values()), axis=-1).max() + _APART_M
    times_s = [
        radar.frame.start_s(frame) + after_s
        for frame in looked_at(scene, n_frames)
        for after_s in (0.0, radar.frame.at(frame).mid_frame_s)
    ]
    step = max(_AT_A_TIME // len(scene.owners), 1)
    for first in range(0, len(times_s), step):
        some_s = times_s[first : first + step]
        for time_s, position_m in zip(some_s, scene.positions_m(some_s), strict=True):
            near = np.flatnonzero(np.linalg.norm(position_m, axis=-1) < reach_m)
            for name, antenna_m in antennas_m.items():
                apart_m = np.linalg.norm(position_m[near] - antenna_m, axis=-1)
                for scatterer in near[apart_m < _APART_M]:
                    raise InvalidSetting(
                        f"scene.targets.{scene.names[scene.owners[scatterer]]}.position",
                        got=f"on {name} after {time_s:.4g} s",
                        need="away from it: the echo would be infinite",
                        fix="Move the target.",
                    )
    end_s = radar.frame.start_s(n_frames - 1) + radar.frame.at(n_frames - 1).duration_s
    speeds = np.linalg.norm(scene.target_velocities_m_per_s([end_s])[0], axis=-1)
    for place in np.flatnonzero(scene.accelerates):
        setting = f"scene.targets.{scene.names[place]}.acceleration"
        must_be_slow(setting, speeds[place], of=f" after {end_s:.4g} s")
