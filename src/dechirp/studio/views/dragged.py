"""Initial position of a dragged target."""

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.scene.rotations import from_local_axes, to_local_axes
from dechirp.scene.scene import Scene


def initial_position_m(
    scene: Scene, name: str, position_m: tuple[float, float], time_s: float
) -> tuple[float, float, float]:
    """Return the position at time zero of a target that is at a given position later.

    Parameters
    ----------
    position_m : (2,)
        x and y at that time in coordinates of the radar; the height above the radar is kept.
    time_s : float
        Time of the shown frame.

    Raises
    ------
    InvalidSetting
        If the target has waypoints: moving only the first one would bend its trajectory.
    """
    target = scene.find_target(name)
    if target.waypoints:
        raise InvalidSetting(
            f"scene.targets.{name}.position",
            value="dragged, of a target with waypoints",
            expected="a target with constant velocity",
            fix="change its waypoints in the settings file, or remove them",
        )
    at_s = np.array([time_s])
    axes = scene.ego.axes(at_s)
    from_radar_m = scene.offsets_from_radar_m(at_s, np.array([scene.names.index(name)]))
    old_m = to_local_axes(axes, from_radar_m)
    new_m = np.array([[[*position_m, old_m[0, 0, 2]]]])
    displacement_m = from_local_axes(axes, new_m - old_m)[0, 0]
    x, y, z = (np.array(target.position_m) + displacement_m).tolist()
    return x, y, z


def format_position(position_m: tuple[float, float, float]) -> str:
    """Format a position for settings, to a tenth of a millimetre."""
    return f"[{', '.join(f'{coordinate:.4f} m' for coordinate in position_m)}]"
