"""Where a target has to start, so that it is where somebody put it."""

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.scene.rotations import into, out_of
from dechirp.scene.scene import Scene


def start_m(
    scene: Scene, name: str, place_m: tuple[float, float], time_s: float
) -> tuple[float, float, float]:
    """Position at time zero, in coordinates of the scene, of a target that is at a place later.

    Parameters
    ----------
    place_m : (2,)
        x and y at the time, seen from the radar then; the height over the radar's plane stays.
    time_s : float
        Of the frame that is shown.

    Raises
    ------
    InvalidSetting
        If the target goes through waypoints: with its start alone, its way would bend.
    """
    target = scene.target(name)
    if target.waypoints:
        raise InvalidSetting(
            f"scene.targets.{name}.position",
            got="dragged, of a target that goes through waypoints",
            need="a target that goes on by its velocity",
            fix="Change its waypoints in the settings file, or take them out.",
        )
    at_s = np.array([time_s])
    axes = scene.ego.axes(at_s)
    from_radar_m = scene.from_radar_m(at_s, np.array([scene.names.index(name)]))
    seen_m = into(axes, from_radar_m)
    put_m = np.array([[[*place_m, seen_m[0, 0, 2]]]])
    moved_m = out_of(axes, put_m - seen_m)[0, 0]
    x, y, z = (np.array(target.position_m) + moved_m).tolist()
    return x, y, z


def written(position_m: tuple[float, float, float]) -> str:
    """A position as settings have it, to a tenth of a millimetre."""
    return f"[{', '.join(f'{one:.4f} m' for one in position_m)}]"
