"""Paths through given places at given times."""

import numpy as np

from dechirp.core.checks import Vector, positive, vector
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value


@value
class Waypoint:
    """Where a target is at one time after time zero."""

    time_s: float
    position_m: Vector

    def __post_init__(self) -> None:
        # Thirty years, and beyond the Moon: outside, a unit is wrong.
        positive(self, "time_s", at_most=1e9)
        vector(self, "position_m", at_most=1e9)


class Course:
    """A natural cubic spline: from a place at time zero through waypoints, straight after them.

    The velocity has no jumps, nor has the acceleration, which is zero at both ends.
    """

    def __init__(self, start_m: Vector, waypoints: tuple[Waypoint, ...]) -> None:
        from scipy.interpolate import CubicSpline  # takes 0.4 s, and few scenes have waypoints

        # From the start: far from the origin of the scene, the digits of short ways stay.
        ways_m = np.array([start_m, *(point.position_m for point in waypoints)]) - start_m
        times_s = [0.0, *(point.time_s for point in waypoints)]
        self._end_s = times_s[-1]
        self._spline = CubicSpline(times_s, ways_m, bc_type="natural")

    def ways_m(self, times_s: np.ndarray) -> np.ndarray:
        """How far it has come since time zero, (n_times, 3)."""
        within_s = np.clip(times_s, 0.0, self._end_s)
        beyond_s = (times_s - within_s)[:, None]
        return np.asarray(self._spline(within_s) + beyond_s * self._spline(within_s, 1))

    def velocities_m_per_s(self, times_s: np.ndarray) -> np.ndarray:
        """Velocity at each time, (n_times, 3)."""
        return np.asarray(self._spline(np.clip(times_s, 0.0, self._end_s), 1))

    @property
    def top_speed_m_per_s(self) -> float:
        """The largest speed, to a hundredth: parabolas are looked at in 17 places each."""
        knots_s = self._spline.x
        times_s = knots_s[:-1, None] + np.diff(knots_s)[:, None] * np.linspace(0, 1, 17)
        return float(np.linalg.norm(self.velocities_m_per_s(times_s.ravel()), axis=-1).max())


def must_go_on(waypoints: tuple[Waypoint, ...], of: str) -> None:
    """Raise `InvalidSetting`, about a waypoint of the target called so, if time runs backwards."""
    for place in range(1, len(waypoints)):
        before_s, time_s = waypoints[place - 1].time_s, waypoints[place].time_s
        if time_s <= before_s:
            raise InvalidSetting(
                f"Target.waypoints.{place}.time_s",
                got=f"{time_s:.6g} s after {before_s:.6g} s: the path of {of} runs backwards in"
                " time",
                need="above that of the waypoint before",
                fix="Sort the waypoints by their times, each once.",
            )
