"""Smooth paths through the steps of a traffic file, with bounded acceleration."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.traffic.object_steps import find_gaps
from dechirp.traffic.traffic import FASTEST_M_PER_S, step_speeds_m_per_s

MAX_ACCELERATION_M_PER_S2 = 12.0
"""Largest acceleration of a path: full braking on a dry road takes 10 m/s^2."""
_MAX_TURN_ACCELERATION_RAD_PER_S2 = {"pedestrian": 30.0}
_MAX_TURN_ACCELERATION_OF_VEHICLES_RAD_PER_S2 = 3.0
_MOVES_M_PER_S = 0.5  # slower objects keep their heading: the course of jitter is random
_MIN_SMOOTHED_STEPS = 5  # fewer are joined by a straight line

# Decades of the smoothing parameter, in cubes of a step: from none to a straight line; halvings of
# this interval in the search, to a tenth of a decade.
_SMOOTHING_DECADES, _N_HALVINGS = (-6.0, 8.0), 7


class Motion(NamedTuple):
    """Motion of an object at one time, in the axes of the file."""

    position_m: np.ndarray
    """(3,): centre of the object seen from above, on the ground."""
    velocity_m_per_s: np.ndarray
    """(2,)."""
    acceleration_m_per_s2: np.ndarray
    """(2,)."""
    heading_rad: float
    turn_rate_rad_per_s: float
    turn_acceleration_rad_per_s2: float


class _Steps(NamedTuple):
    """Steps of one object, arrays over time; all present. Columns as of `Traffic.objects`."""

    kind: str
    height_m: float
    time: np.ndarray
    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    heading: np.ndarray
    vx: np.ndarray
    vy: np.ndarray

    def select(self, indices: np.ndarray) -> "_Steps":
        """Return some of the steps."""
        return _Steps(self.kind, self.height_m, *(column[indices] for column in self[2:]))


class ObjectPath:
    r"""Path of one object between two gaps: polynomials of degree 3 between the steps.

    The path follows positions and velocities of the file (cubic Hermite). If their acceleration
    exceeds the limit, it follows positions alone (cubic spline); if that does too, it is the least
    smoothed spline within the limit, which minimises

    .. math:: \sum_k |x(t_k) - x_k|^2 + \lambda \int |\ddot x|^2 dt

    Headings are smoothed likewise. Before the first and after the last step, the object exists for
    half a step, on a straight line.

    References
    ----------
    C. H. Reinsch, Smoothing by spline functions, Numerische Mathematik 10, 1967.
    """

    def __init__(self, steps: _Steps, margin_s: float) -> None:
        """Fit the path to the steps of one object."""
        self.times_s = steps.time
        self.start_s, self.end_s = self.times_s[0] - margin_s, self.times_s[-1] + margin_s
        positions_m = np.stack([steps.x, steps.y], axis=-1)
        velocities = np.stack([steps.vx, steps.vy], axis=-1)
        velocities = np.where(np.isfinite(velocities), velocities, 0.0)
        self._position, self.follows_velocities = _fit_bounded_path(
            self.times_s, positions_m, velocities
        )
        self.shift_m = float(
            np.linalg.norm(self._position(self.times_s) - positions_m, axis=-1).max()
        )
        """Largest distance between the path and the positions of the file."""
        self._heading = _fit_bounded_spline(
            self.times_s,
            self._unwrapped_headings_rad(steps.heading)[:, None],
            _MAX_TURN_ACCELERATION_RAD_PER_S2.get(
                steps.kind, _MAX_TURN_ACCELERATION_OF_VEHICLES_RAD_PER_S2
            ),
        )
        half_height_m = steps.height_m / 2 if np.isfinite(steps.height_m) else 0.0
        self._ground_m = np.where(np.isfinite(steps.z), steps.z - half_height_m, 0.0)

    def motion_at(self, time_s: float) -> Motion:
        """Return the motion at a time from `start_s` to `end_s`."""
        within_s = min(max(time_s, self.times_s[0]), self.times_s[-1])
        beyond_s = time_s - within_s
        velocity, turn_rate = self._position(within_s, 1), float(self._heading(within_s, 1)[0])
        acceleration, turn_acceleration = np.zeros(2), 0.0
        if beyond_s:
            turn_rate = 0.0
        else:
            acceleration = self._position(within_s, 2)
            turn_acceleration = float(self._heading(within_s, 2)[0])
        x_m, y_m = self._position(within_s) + beyond_s * velocity
        return Motion(
            np.array([x_m, y_m, np.interp(within_s, self.times_s, self._ground_m)]),
            velocity,
            acceleration,
            float(self._heading(within_s)[0]),
            turn_rate,
            turn_acceleration,
        )

    def integrate_over_speed(self, rate_of_speed: Callable[[float], float], time_s: float) -> float:
        """Return the integral of a rate that depends on the speed, from the first step to a time.

        The rate is taken at the steps and linear between them.
        """
        speeds = np.linalg.norm(self._position(self.times_s, 1), axis=-1)
        rates = np.array([rate_of_speed(speed) for speed in speeds.tolist()])
        steps = np.diff(self.times_s) * (rates[1:] + rates[:-1]) / 2
        within_s = min(max(time_s, self.times_s[0]), self.times_s[-1])
        last = int(np.searchsorted(self.times_s, within_s, side="right")) - 1
        rate = np.interp(within_s, self.times_s, rates)
        since_s = within_s - self.times_s[last]
        return float(
            steps[:last].sum() + since_s * (rates[last] + rate) / 2 + (time_s - within_s) * rate
        )

    def _unwrapped_headings_rad(self, stated_rad: np.ndarray) -> np.ndarray:
        """Return the headings of all steps; unknown ones are the course, or the nearest known."""
        vx, vy = self._position(self.times_s, 1).T
        course_rad = np.where(np.hypot(vx, vy) > _MOVES_M_PER_S, np.arctan2(vy, vx), np.nan)
        headings_rad = np.where(np.isfinite(stated_rad), stated_rad, course_rad)
        known_steps = np.flatnonzero(np.isfinite(headings_rad))
        if not known_steps.size:
            return np.zeros(len(headings_rad))
        nearest = known_steps[
            np.abs(self.times_s[:, None] - self.times_s[known_steps]).argmin(axis=1)
        ]
        return np.unwrap(headings_rad[nearest])


def fit_paths(steps: xr.Dataset, step_s: float) -> list[ObjectPath]:
    """Fit a path to each run of steps of one object, from `open_traffic`, over `time`.

    A run ends where the object is absent, or jumps; `step_s` is its typical step.
    """
    columns = _Steps(
        str(steps["kind"].item()),
        float(steps["height"]),
        *(steps[name].values for name in _Steps._fields[2:]),
    )
    if steps["is_stationary"].item() and not np.any(_ranges_over_time(columns)):
        margin_s = step_s / 2 + float(columns.time[-1] - columns.time[0])
        return [ObjectPath(columns.select(np.array([0])), margin_s)]
    present = np.flatnonzero(np.isfinite(columns.x))
    there = columns.select(present)
    speeds = step_speeds_m_per_s(there.time, there.x, there.y)
    is_break = find_gaps(columns.time, present, step_s) | (speeds > FASTEST_M_PER_S)
    runs = np.split(present, np.flatnonzero(is_break) + 1)
    return [ObjectPath(columns.select(run), step_s / 2) for run in runs if run.size]


def _ranges_over_time(steps: _Steps) -> np.ndarray:
    """Return the spans of position and heading over all steps, (4,); 0 of unknown ones."""
    return np.ptp(np.nan_to_num([steps.x, steps.y, steps.z, steps.heading]), axis=1)


def _fit_bounded_path(
    times_s: np.ndarray, positions_m: np.ndarray, velocities: np.ndarray
) -> tuple[Callable[..., np.ndarray], bool]:
    """Return a path within the acceleration limit, and whether it follows the velocities."""
    from scipy.interpolate import CubicHermiteSpline

    if len(times_s) == 1:
        return _Line(times_s[0], positions_m[0], velocities[0]), True
    hermite = CubicHermiteSpline(times_s, positions_m, velocities)
    if _peak_second_derivative(hermite, times_s) <= MAX_ACCELERATION_M_PER_S2:
        return hermite, True
    return _fit_bounded_spline(times_s, positions_m, MAX_ACCELERATION_M_PER_S2), False


def _fit_bounded_spline(
    times_s: np.ndarray, values: np.ndarray, limit: float
) -> Callable[..., np.ndarray]:
    """Return the least smoothed spline whose second derivative stays within a limit.

    `values` are (n_times, n).
    """
    from scipy.interpolate import CubicSpline, make_smoothing_spline

    if len(times_s) == 1:
        return _Line(times_s[0], values[0], np.zeros_like(values[0]))
    spline = CubicSpline(times_s, values, bc_type="natural")
    if _peak_second_derivative(spline, times_s) <= limit:
        return spline
    slope, start = np.polyfit(times_s - times_s[0], values, 1)
    smoothest: Callable[..., np.ndarray] = _Line(times_s[0], start, slope)
    if len(times_s) < _MIN_SMOOTHED_STEPS:
        return smoothest
    step_s = (times_s[-1] - times_s[0]) / (len(times_s) - 1)
    low, high = _SMOOTHING_DECADES
    for _ in range(_N_HALVINGS):
        middle = (low + high) / 2
        smooth = make_smoothing_spline(times_s, values, lam=10**middle * step_s**3)
        if _peak_second_derivative(smooth, times_s) <= limit:
            smoothest, high = smooth, middle
        else:
            low = middle
    return smoothest


def _peak_second_derivative(spline: Callable[..., np.ndarray], knots_s: np.ndarray) -> float:
    """Return the largest norm of the second derivative, which is linear between the knots."""
    inside_s = 1e-9 * (knots_s[-1] - knots_s[0])
    sides_s = np.concatenate([knots_s[:-1] + inside_s, knots_s[1:] - inside_s])
    return float(np.linalg.norm(spline(sides_s, 2), axis=-1).max())


class _Line:
    """Straight line with the derivatives of a spline."""

    def __init__(self, start_s: float, start: np.ndarray, slope: np.ndarray) -> None:
        self._start_s, self._start, self._slope = start_s, start, slope

    def __call__(self, times_s: float | np.ndarray, derivative: int = 0) -> np.ndarray:
        times_s = np.asarray(times_s)[..., None]
        if derivative == 0:
            return np.asarray(self._start + (times_s - self._start_s) * self._slope)
        slope = self._slope if derivative == 1 else np.zeros_like(self._slope)
        return np.asarray(slope + 0.0 * times_s)
