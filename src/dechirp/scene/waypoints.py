"""Waypoints, and the spline trajectory through them."""

import numpy as np

from dechirp.core.checks import Vector, check_and_convert_vector_field, check_positive_fields
from dechirp.core.errors import InvalidSetting
from dechirp.core.text import format_si
from dechirp.core.values import frozen_dataclass


@frozen_dataclass
class Waypoint:
    """Position of a target at a time after time zero."""

    time_s: float
    position_m: Vector

    def __post_init__(self) -> None:
        # Limits of thirty years, and beyond the Moon: other values indicate a wrong unit.
        check_positive_fields(self, "time_s", at_most=1e9)
        check_and_convert_vector_field(self, "position_m", max_magnitude=1e9)


class SplineTrajectory:
    """Natural cubic spline from a position at time zero through waypoints, straight after the last.

    Velocity and acceleration are continuous; the acceleration is zero at both ends.
    """

    def __init__(self, start_m: Vector, waypoints: tuple[Waypoint, ...]) -> None:
        from scipy.interpolate import CubicSpline  # takes 0.4 s, and few scenes have waypoints

        # Relative to the start, which preserves the digits of short paths far from the origin.
        displacements_m = np.array([start_m, *(point.position_m for point in waypoints)]) - start_m
        times_s = [0.0, *(point.time_s for point in waypoints)]
        self._end_s = times_s[-1]
        self._spline = CubicSpline(times_s, displacements_m, bc_type="natural")

    def displacements_m(self, times_s: np.ndarray) -> np.ndarray:
        """Return the displacements since time zero, (n_times, 3)."""
        within_s = np.clip(times_s, 0.0, self._end_s)
        beyond_s = (times_s - within_s)[:, None]
        return np.asarray(self._spline(within_s) + beyond_s * self._spline(within_s, 1))

    def velocities_m_per_s(self, times_s: np.ndarray) -> np.ndarray:
        """Return the velocity at each time, (n_times, 3)."""
        return np.asarray(self._spline(np.clip(times_s, 0.0, self._end_s), 1))

    @property
    def top_speed_m_per_s(self) -> float:
        """Return the largest speed, to a hundredth, from 17 samples of each segment."""
        knots_s = self._spline.x
        times_s = knots_s[:-1, None] + np.diff(knots_s)[:, None] * np.linspace(0, 1, 17)
        return float(np.linalg.norm(self.velocities_m_per_s(times_s.ravel()), axis=-1).max())


def check_waypoint_times_ascend(waypoints: tuple[Waypoint, ...], target_name: str) -> None:
    """Raise `InvalidSetting` for a waypoint of the named target if times do not ascend."""
    for index in range(1, len(waypoints)):
        previous_s, time_s = waypoints[index - 1].time_s, waypoints[index].time_s
        if time_s <= previous_s:
            raise InvalidSetting(
                f"Target.waypoints.{index}.time_s",
                value=f"{format_si(time_s, 's')} after {format_si(previous_s, 's')}: the path of"
                f" {target_name} goes"
                " back in time",
                expected="a time after that of the previous waypoint",
                fix="sort the waypoints by time, without duplicates",
            )
