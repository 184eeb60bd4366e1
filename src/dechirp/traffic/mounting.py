"""Poses of radars on vehicles."""

import math
from typing import Literal

from dechirp.core.checks import Vector, check_and_convert_vector_field, check_number
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass

MountName = Literal[
    "front", "front-left", "left", "rear-left", "rear", "rear-right", "right", "front-right"
]

# Forward and left, in halves of length and width; azimuth to the left, in degrees. Corner radars of
# production cars look 45 degrees outwards.
_PLACES: dict[str, tuple[float, float, float]] = {
    "front": (1, 0, 0),
    "front-left": (1, 1, 45),
    "left": (0, 1, 90),
    "rear-left": (-1, 1, 135),
    "rear": (-1, 0, 180),
    "rear-right": (-1, -1, -135),
    "right": (0, -1, -90),
    "front-right": (1, -1, -45),
}
_HEIGHT_M = 0.5  # of bumpers


@frozen_dataclass
class Mounting:
    """Pose of a radar on a vehicle; axes x forward, y left, z up."""

    position_m: Vector
    """Position from the centre of the vehicle, z from the ground."""
    yaw_rad: float = 0.0
    """Azimuth of the boresight from straight ahead, to the left positive."""
    pitch_rad: float = 0.0
    """Pitch, upwards positive."""
    roll_rad: float = 0.0
    """Roll about the boresight, the left side upwards positive."""

    def __post_init__(self) -> None:
        # Beyond the longest road train: other values indicate a wrong unit.
        check_and_convert_vector_field(self, "position_m", max_magnitude=100.0)
        for name in ("yaw_rad", "pitch_rad", "roll_rad"):
            angle = check_number(
                f"Mounting.{name}",
                getattr(self, name),
                at_least=-2 * math.pi,
                at_most=2 * math.pi,
            )
            object.__setattr__(self, name, angle)


def mounting_on_vehicle(name: str, length_m: float, width_m: float) -> Mounting:
    """Return the mounting of a name, on the outline of a vehicle at the height of a bumper.

    Raises
    ------
    InvalidSetting
        If there is no mounting of that name.
    """
    if name not in _PLACES:
        raise InvalidSetting(
            "traffic.mount",
            value=name,
            expected=f"one of {', '.join(_PLACES)}",
            fix="choose one, or give a pose",
        )
    x_share, y_share, azimuth_deg = _PLACES[name]
    return Mounting(
        position_m=(x_share * length_m / 2, y_share * width_m / 2, _HEIGHT_M),
        yaw_rad=math.radians(azimuth_deg),
    )
