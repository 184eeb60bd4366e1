"""True objects in the view of a radar, with their measurable states, frame by frame."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.traffic.frame_scenes import FrameScenes, ObjectInView
from dechirp.traffic.outlines import QUARTER_TURN, nearest_point_m, rotation, visible_shares
from dechirp.traffic.radar_scene import RadarMotion
from dechirp.traffic.road_bodies import Size

_CAR_HEIGHT_M = 1.5


class ObjectState(NamedTuple):
    """True state of an object in one frame, see `find_true_objects`."""

    x: float
    y: float
    vx: float
    vy: float
    range: float
    velocity: float
    azimuth: float
    centre_x: float
    centre_y: float
    heading: float
    turn_rate: float
    visible_share: float


_UNITS = dict(
    zip(
        ObjectState._fields,
        ("m", "m", "m/s", "m/s", "m", "m/s", "rad", "m", "m", "rad", "rad/s", "1"),
        strict=True,
    )
)


class TrueObjects:
    """True objects in the view of a radar, collected frame by frame."""

    def __init__(self, scenes: FrameScenes) -> None:
        self._scenes = scenes
        self._numbers: list[int] = []
        self._states: list[dict[int, ObjectState]] = []
        self._sizes: dict[int, Size] = {}

    def add_frame(self, number: int) -> dict[str, tuple[ObjectState, Size]]:
        """Add a frame; return the states and sizes of its objects by their names."""
        in_view = self._scenes.objects_in_view(number)
        items = [item for item in in_view if not item.is_structure]
        hiding = [item for item in in_view if _hides_vehicles(item)]
        radar = self._scenes.radar_motion(number)
        shares = visible_shares(np.array([item.corners_m for item in (*items, *hiding)]))
        states = {
            item.number: _measurable_state(item, radar, share)
            for item, share in zip(items, shares.tolist(), strict=False)
        }
        self._numbers.append(number)
        self._states.append(states)
        self._sizes |= {item.number: item.size for item in items}
        return {item.name: (states[item.number], item.size) for item in items}

    def to_dataset(self) -> xr.Dataset:
        """Return all frames as `find_true_objects` does."""
        indices = sorted(self._sizes)
        row_of_object = {index: row for row, index in enumerate(indices)}
        values = np.full((len(indices), len(self._numbers), len(_UNITS)), np.nan)
        for column, states in enumerate(self._states):
            for index, state in states.items():
                values[row_of_object[index], column] = state
        times_s = [
            self._scenes.mid_frame_s(number) - self._scenes.start_s for number in self._numbers
        ]
        return xr.Dataset(
            {
                name: (("target", "frame"), values[..., position].copy(), {"units": unit})
                for position, (name, unit) in enumerate(_UNITS.items())
            }
            | {
                name: (
                    "target",
                    [getattr(self._sizes[index], f"{name}_m") for index in indices],
                    {"units": "m"},
                )
                for name in ("length", "width")
            },
            coords={
                "target": np.array([self._scenes.names[index] for index in indices], dtype=str),
                "frame": self._numbers,
                "time": ("frame", times_s, {"units": "s"}),
            },
        )


@check_argument_types
def find_true_objects(scenes: FrameScenes, numbers: Iterable[int]) -> xr.Dataset:
    """Return the true objects of frames, in coordinates of the radar at mid-frame.

    Positions and velocities are those of the point of the outline that is nearest to the radar,
    seen from above: a radar measures surfaces, not centres. Structures (walls, buildings, guard
    rails, poles, trees, hedges, bridges) are left out. Walls and buildings of at least 1.5 m hide
    what is behind them.

    Parameters
    ----------
    scenes : FrameScenes
        Scenes of the frames.
    numbers : iterable of int
        Numbers of the frames, from 0.

    Returns
    -------
    Dataset over (target, frame)
        NaN while an object is out of view. `x y` (m), `vx vy` (m/s, in axes that turn with the
        radar), `range` (m), `velocity` (m/s, its rate of change) and `azimuth` (rad) of the nearest
        point; `centre_x centre_y` (m), `heading` (rad) of the object and its `turn_rate` (rad/s);
        `visible_share` of the angle under which the object appears that no nearer one hides. Over
        target: `length`, `width` (m). Over frame: `time` (s) since the start of the first frame.
    """
    objects = TrueObjects(scenes)
    for number in numbers:
        objects.add_frame(number)
    return objects.to_dataset()


def _hides_vehicles(item: ObjectInView) -> bool:
    return item.kind in ("wall", "building") and item.size.height_m >= _CAR_HEIGHT_M


def _measurable_state(item: ObjectInView, radar: RadarMotion, visible_share: float) -> ObjectState:
    to_radar = rotation(-radar.yaw_rad)
    nearest_m, centre_m = nearest_point_m(item.corners_m), item.corners_m.mean(axis=0)
    velocity = to_radar @ (item.motion.velocity_m_per_s - radar.velocity_m_per_s)
    velocity += item.motion.turn_rate_rad_per_s * QUARTER_TURN @ (nearest_m - centre_m)
    range_m = float(np.linalg.norm(nearest_m))
    vx, vy = velocity - radar.turn_rate_rad_per_s * QUARTER_TURN @ nearest_m
    heading_rad = item.motion.heading_rad - radar.yaw_rad
    x, y = map(float, nearest_m)
    centre_x, centre_y = map(float, centre_m)
    return ObjectState(
        x=x,
        y=y,
        vx=float(vx),
        vy=float(vy),
        range=range_m,
        velocity=float(nearest_m @ velocity) / range_m,
        azimuth=float(np.arctan2(y, x)),
        centre_x=centre_x,
        centre_y=centre_y,
        heading=float((heading_rad + np.pi) % (2 * np.pi) - np.pi),
        turn_rate=item.motion.turn_rate_rad_per_s - radar.turn_rate_rad_per_s,
        visible_share=visible_share,
    )
