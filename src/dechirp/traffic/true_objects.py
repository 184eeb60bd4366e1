"""True objects in the view of a radar, with their measurable states, frame by frame."""

from collections.abc import Iterable

import numpy as np
import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.traffic.frame_scenes import FrameScenes, ObjectInView
from dechirp.traffic.outlines import QUARTER_TURN, nearest_point_m, rotation, visible_shares
from dechirp.traffic.radar_scene import RadarMotion

_CAR_HEIGHT_M = 1.5
_UNITS = {
    "x": "m",
    "y": "m",
    "vx": "m/s",
    "vy": "m/s",
    "range": "m",
    "velocity": "m/s",
    "azimuth": "rad",
    "centre_x": "m",
    "centre_y": "m",
    "heading": "rad",
    "turn_rate": "rad/s",
    "visible_share": "1",
}


@check_argument_types
def find_true_objects(scenes: FrameScenes, numbers: Iterable[int]) -> xr.Dataset:
    """Return the true objects of frames, in coordinates of the radar at mid-frame.

    Positions and velocities are those of the point of the outline that is nearest to the radar,
    seen from above: a radar measures surfaces, not centres. Structures (walls, buildings, guard
    rails, poles, trees, hedges, bridges) are left out. Walls and buildings of at least 1.5 m hide
    what is behind them.

    Returns
    -------
    Dataset over (target, frame)
        NaN while an object is out of view. `x y` (m), `vx vy` (m/s, in axes that turn with the
        radar), `range` (m), `velocity` (m/s, its rate of change) and `azimuth` (rad) of the nearest
        point; `centre_x centre_y` (m), `heading` (rad) of the object and its `turn_rate` (rad/s);
        `visible_share` of the angle under which the object appears that no nearer one hides. Over
        target: `length`, `width` (m). Over frame: `time` (s) since the start of the first frame.
    """
    numbers = list(numbers)
    in_view = [scenes.objects_in_view(number) for number in numbers]
    objects = [[item for item in items if not item.is_structure] for items in in_view]
    indices = sorted({item.number for in_frame in objects for item in in_frame})
    row_of_object = {index: row for row, index in enumerate(indices)}
    cells = {name: np.full((len(indices), len(numbers)), np.nan) for name in _UNITS}
    sizes = {item.number: item.size for in_frame in objects for item in in_frame}
    for column, (number, in_frame) in enumerate(zip(numbers, objects, strict=True)):
        radar = scenes.radar_motion(number)
        hiding = [item for item in in_view[column] if _hides_vehicles(item)]
        shares = visible_shares(np.array([item.corners_m for item in (*in_frame, *hiding)]))
        for item, share in zip(in_frame, shares[: len(in_frame)].tolist(), strict=True):
            values = (*_measurable_state(item, radar), share)
            for name, value in zip(_UNITS, values, strict=True):
                cells[name][row_of_object[item.number], column] = value
    names = [scenes.names[index] for index in indices]
    times_s = [scenes.mid_frame_s(number) - scenes.start_s for number in numbers]
    return xr.Dataset(
        {name: (("target", "frame"), cells[name], {"units": unit}) for name, unit in _UNITS.items()}
        | {
            name: ("target", [getattr(sizes[i], f"{name}_m") for i in indices], {"units": "m"})
            for name in ("length", "width")
        },
        coords={
            "target": np.array(names, dtype=str),
            "frame": numbers,
            "time": ("frame", times_s, {"units": "s"}),
        },
    )


def _hides_vehicles(item: ObjectInView) -> bool:
    return item.kind in ("wall", "building") and item.size.height_m >= _CAR_HEIGHT_M


def _measurable_state(item: ObjectInView, radar: RadarMotion) -> tuple[float, ...]:
    """Return the values of one object in the order of `_UNITS`, without its visible share."""
    to_radar = rotation(-radar.yaw_rad)
    nearest_m, centre_m = nearest_point_m(item.corners_m), item.corners_m.mean(axis=0)
    velocity = to_radar @ (item.motion.velocity_m_per_s - radar.velocity_m_per_s)
    velocity += item.motion.turn_rate_rad_per_s * QUARTER_TURN @ (nearest_m - centre_m)
    range_m = float(np.linalg.norm(nearest_m))
    vx, vy = velocity - radar.turn_rate_rad_per_s * QUARTER_TURN @ nearest_m
    heading_rad = item.motion.heading_rad - radar.yaw_rad
    return (
        *nearest_m,
        vx,
        vy,
        range_m,
        float(nearest_m @ velocity) / range_m,
        float(np.arctan2(nearest_m[1], nearest_m[0])),
        *centre_m,
        float((heading_rad + np.pi) % (2 * np.pi) - np.pi),
        item.motion.turn_rate_rad_per_s - radar.turn_rate_rad_per_s,
    )
