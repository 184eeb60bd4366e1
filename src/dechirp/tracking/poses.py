"""Poses of radars in the plane of their common tracks."""

import math

from dechirp.core.checks import check_number, check_numbers
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass

_MAX_POSITION_M = 1e9  # beyond the Moon, and beyond all projected coordinates of the Earth


@frozen_dataclass
class RadarPose:
    """Pose and velocity of a radar in the frame of reference of tracks, at mid-frame."""

    position_m: tuple[float, float] = (0.0, 0.0)
    """Position x, y."""
    yaw_rad: float = 0.0
    """Azimuth of the boresight from the x axis, to the left positive."""
    velocity_m_per_s: tuple[float, float] = (0.0, 0.0)
    """Velocity x, y: zero in axes that are fixed to the vehicle of the radar."""

    def __post_init__(self) -> None:
        for name in ("position_m", "velocity_m_per_s"):
            where = f"RadarPose.{name}"
            vector = check_numbers(
                where, getattr(self, name), at_least=-_MAX_POSITION_M, at_most=_MAX_POSITION_M
            )
            if len(vector) != 2:
                raise InvalidSetting(
                    where,
                    value=getattr(self, name),
                    expected="two numbers, x and y",
                    fix="leave out z: tracks are in the plane",
                )
            object.__setattr__(self, name, vector)
        check_number("RadarPose.yaw_rad", self.yaw_rad, at_least=-1e6, at_most=1e6)


AT_ORIGIN = RadarPose()
"""Pose of a single radar, in whose coordinates its tracks are."""


@frozen_dataclass
class RadarView:
    """Pose of a radar in one frame, and the sector in which it detects targets."""

    pose: RadarPose = AT_ORIGIN
    half_angle_rad: float = math.pi
    """Angle to each side of boresight."""
    max_range_m: float = math.inf

    def contains(self, x_m: float, y_m: float) -> bool:
        """Return whether a position is within the sector."""
        x_m, y_m = x_m - self.pose.position_m[0], y_m - self.pose.position_m[1]
        azimuth_rad = math.remainder(math.atan2(y_m, x_m) - self.pose.yaw_rad, 2 * math.pi)
        is_near = math.hypot(x_m, y_m) <= self.max_range_m
        return is_near and abs(azimuth_rad) <= self.half_angle_rad
