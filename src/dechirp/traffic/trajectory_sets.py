"""Columns of well-known trajectory files, and their conversion to the CSV of this package."""

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple


class TrajectorySet(NamedTuple):
    """Layout of other trajectory files."""

    name: str
    columns: frozenset[str]
    """Columns, in lower case, that together only this layout has."""
    conversion: str


_SUMO_COLUMNS = frozenset({"vehicle_id", "vehicle_x", "vehicle_y", "vehicle_angle"})
_SETS = (
    TrajectorySet(
        "highD",
        frozenset({"frame", "id", "x", "y", "width", "height", "xvelocity", "yvelocity"}),
        "time = frame / 25; length = width, width = height; x = x + length / 2 and"
        " y = -(y + width / 2), as x and y are the upper left corner and y is downwards; vx ="
        " xVelocity, vy = -yVelocity; class from tracksMeta; heading and height empty",
    ),
    TrajectorySet(
        "inD, rounD, exiD or uniD",
        frozenset({"trackid", "frame", "xcenter", "ycenter", "heading"}),
        "time = frame / frameRate of recordingMeta; id = trackId; x = xCenter, y = yCenter;"
        " heading in radians; vx = xVelocity, vy = yVelocity; class from tracksMeta; height empty",
    ),
    TrajectorySet(
        "NGSIM",
        frozenset({"vehicle_id", "frame_id", "local_x", "local_y"}),
        "time = Global_Time / 1000; id = Vehicle_ID; class 1 is motorcycle, 2 car, 3 truck; feet"
        " to metres, 0.3048; x = Local_Y - v_length / 2, as Local_Y is the front, y = -Local_X;"
        " length = v_length, width = v_width; heading and height empty",
    ),
    TrajectorySet(
        "SUMO floating car data",
        _SUMO_COLUMNS,
        "time = timestep_time; id as a number; class, length and width from the vehicle type;"
        " heading = radians(90 - vehicle_angle); x and y are the middle of the front bumper:"
        " half of the length back; height empty",
    ),
    TrajectorySet(
        "INTERACTION",
        frozenset({"track_id", "timestamp_ms", "agent_type"}),
        "time = timestamp_ms / 1000; id = track_id; class = agent_type; heading = psi_rad; height"
        " empty",
    ),
)


def find_trajectory_set(columns: Iterable[str]) -> TrajectorySet | None:
    """Return the layout of a file with these columns in lower case, None if it is not known."""
    names = set(columns)
    return next((layout for layout in _SETS if layout.columns <= names), None)


def recognise_foreign_xml(path: Path) -> TrajectorySet | None:
    """Return the layout of floating car data that SUMO writes as XML, its default; else None."""
    with path.open("rb") as file:
        is_floating_car_data = b"<fcd-export" in file.read(4096)
    return find_trajectory_set(_SUMO_COLUMNS) if is_floating_car_data else None
