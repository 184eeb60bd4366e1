r"""Speed of a radar that looks ahead, from few standing objects over many lists.

In dense traffic a list has too few standing objects for `ego_motion`. They come and go, though,
while the cars beside the radar stay: over a minute, more objects agree with the speed of the radar
than with that of the traffic. Each object i, seen under the azimuth phi, implies the speed

.. math:: u_i = -v_i / \cos\phi_i

The speed over time is the path through all u that has the votes of most objects, one vote for each
however long it is seen, less the cost of accelerations (Viterbi's algorithm). Around it, linear
splines are fitted by weighted least squares with Cauchy weights and a penalty on jerk. An object's
errors are alike from list to list: its sightings of half a second count as one.

References
----------
A. J. Viterbi, Error bounds for convolutional codes and an asymptotically optimum decoding
algorithm, IEEE Trans. IT 13(2), 1967. P. H. C. Eilers and B. D. Marx, Flexible smoothing with
B-splines and penalties, Statistical Science 11(2), 1996. P. W. Holland and R. E. Welsch, Robust
regression using iteratively reweighted least-squares, Communications in Statistics 6(9), 1977.
"""

import math

import numpy as np
import scipy
import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import (
    check_integer_fields,
    check_non_negative_fields,
    check_positive_fields,
)
from dechirp.core.detection_columns import check_detection_rows, detection_columns_as_floats
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass

_REQUIRED = ("time", "range", "velocity", "azimuth", "velocity_std", "azimuth_std", "number")
_STEP_S = 0.25  # of the path; the cost of acceleration is continuous in time
_SPEED_STEP_M_PER_S = 0.25
_KNOT_S = 0.5
_LOG_RATIO_OF_VOTE = 4.0  # speeds agree to 0.3 of some 20 m/s by chance in one case of e^4
_GATE = 3.0  # standard errors
_CAUCHY_SCALE = 2.0
_COHERENCE_S = 0.5  # of the errors of one object
_LARGEST_GAP_S = 0.2
_LARGEST_JUMP_M = 3.0
_MIN_SIGHTINGS = 3
_MAX_ITERATIONS = 100
_MAX_DURATION_S = 7200.0  # the path of two hours takes 60 MiB


@frozen_dataclass
class ForwardSpeed:
    """Settings of the speed from standing objects over many lists."""

    lag_s: float = 0.0
    """Time by which velocities lag behind positions and time stamps: filters of the radar."""
    tolerance_m_per_s: float = 0.05
    """Standard deviation of the velocities of standing objects beyond their own errors."""
    acceleration_std_m_per_s2: float = 1.5
    """Of the radar, over one second; decides which objects stand."""
    jerk_std_m_per_s3: float = 0.5
    """Of the radar, over one second; smooths the speed."""
    max_speed_m_per_s: float = 60.0
    min_objects: int = 2
    """Least number of standing objects within a second around a time; else NaN."""

    def __post_init__(self) -> None:
        check_non_negative_fields(self, "lag_s", "tolerance_m_per_s", at_most=10.0)
        check_positive_fields(
            self, "acceleration_std_m_per_s2", "jerk_std_m_per_s3", "max_speed_m_per_s", at_most=100
        )
        check_integer_fields(self, "min_objects", at_most=100)


_DEFAULT = ForwardSpeed()


@check_argument_types
def forward_speed(detections: xr.Dataset, settings: ForwardSpeed = _DEFAULT) -> xr.Dataset:
    """Estimate the speed of a radar that moves along its boresight, over a whole recording.

    Valid for a radar that moves forward along its boresight, without velocity across it, as on a
    straight road. Velocities are resolved, as those of a vendor's objects. Cars of one speed that
    appear in larger numbers than standing objects over the recording are taken for the road.

    Parameters
    ----------
    detections : Dataset over `detection`
        From `objects_to_detections`: with `time`, `range`, `velocity`, `azimuth`, their standard
        errors and the `number` of the object, which later objects may use again.
    settings : ForwardSpeed, optional

    Returns
    -------
    Dataset over `time` (s)
        Every half second, `lag_s` before the lists: `speed` and `speed_std` (m/s), NaN where fewer
        than `min_objects` stand nearby, and `n_objects`.

    Raises
    ------
    InvalidSetting
        If a column is missing or invalid, if no row has all values, or if the times span more than
        two hours.
    """
    columns = detection_columns_as_floats(detections, _REQUIRED, ())
    positive = "above 0, or NaN"
    check_detection_rows(
        columns,
        {
            "velocity_std": (~(columns["velocity_std"] <= 0), positive),
            "azimuth_std": (~(columns["azimuth_std"] <= 0), positive),
            "range": (~(columns["range"] <= 0), positive),
        },
    )
    is_known = np.isfinite(list(columns.values())).all(axis=0)
    order = np.argsort(columns["time"][is_known], kind="stable")
    columns = {name: column[is_known][order] for name, column in columns.items()}
    times_s = columns["time"]
    if not times_s.size or np.ptp(times_s) > _MAX_DURATION_S:
        raise InvalidSetting(
            "detections",
            value=f"{times_s.size} complete rows over {np.ptp(times_s) if times_s.size else 0:g} s",
            expected=f"one row or more, over {_MAX_DURATION_S:g} s at most",
            fix="give the objects of one drive with their numbers, in parts if it is longer",
        )
    objects = _separate_objects(columns)
    speeds, stds = _speeds_of_objects(columns, settings)
    path = _find_consensus(times_s, speeds, stds, objects, settings.max_speed_m_per_s, settings)
    knots_s, curve, variances, is_standing = _fit_curve(times_s, speeds, stds, path, settings)
    n_objects = _count_objects(times_s[is_standing], objects[is_standing], knots_s)
    is_measured = n_objects >= settings.min_objects
    return xr.Dataset(
        {
            "speed": ("time", np.where(is_measured, curve, np.nan), {"units": "m/s"}),
            "speed_std": (
                "time",
                np.where(is_measured, np.sqrt(variances), np.nan),
                {"units": "m/s"},
            ),
            "n_objects": ("time", n_objects, {"units": "1"}),
        },
        coords={"time": ("time", knots_s - settings.lag_s, {"units": "s"})},
    )


def _separate_objects(columns: dict[str, np.ndarray]) -> np.ndarray:
    """Return the index of the object of each row: numbers are used again after gaps and jumps."""
    order = np.lexsort((columns["time"], columns["number"]))
    time_s, range_m, velocity, number = (
        columns[name][order] for name in ("time", "range", "velocity", "number")
    )
    step_s = np.diff(time_s)
    jump_m = np.abs(np.diff(range_m) - velocity[:-1] * step_s)
    is_next = (number[1:] != number[:-1]) | (step_s > _LARGEST_GAP_S) | (jump_m > _LARGEST_JUMP_M)
    objects = np.empty(order.size, int)
    objects[order] = np.concatenate([[0], np.cumsum(is_next)])
    return objects


def _speeds_of_objects(
    columns: dict[str, np.ndarray], settings: ForwardSpeed
) -> tuple[np.ndarray, np.ndarray]:
    """Return the forward speed that each row implies if it stands, and its standard error."""
    velocity = columns["velocity"]
    x = columns["range"] * np.cos(columns["azimuth"]) - velocity * settings.lag_s
    azimuth = np.arctan2(columns["range"] * np.sin(columns["azimuth"]), x)
    cosine = np.maximum(np.cos(azimuth), 0.1)  # those across the boresight have no weight
    along = np.hypot(columns["velocity_std"], settings.tolerance_m_per_s) / cosine
    across = np.abs(velocity) * np.abs(np.sin(azimuth)) / cosine**2 * columns["azimuth_std"]
    return -velocity / cosine, np.hypot(along, across)


def _find_consensus(
    times_s: np.ndarray,
    speeds: np.ndarray,
    stds: np.ndarray,
    objects: np.ndarray,
    max_speed: float,
    settings: ForwardSpeed,
) -> np.ndarray:
    """Return the speed of the best path at each row."""
    grid = np.arange(0.0, max_speed + _SPEED_STEP_M_PER_S, _SPEED_STEP_M_PER_S)
    step = ((times_s - times_s[0]) / _STEP_S).astype(int)
    n_sightings = np.maximum(np.bincount(objects)[objects], _MIN_SIGHTINGS)
    votes = np.zeros((step[-1] + 1, grid.size))
    widths = _GATE * np.hypot(stds, _SPEED_STEP_M_PER_S)
    for begin in range(0, times_s.size, 4096):
        rows = slice(begin, begin + 4096)
        distance = (speeds[rows, None] - grid) / widths[rows, None]
        vote = np.maximum(1 - distance**2, 0) / n_sightings[rows, None]
        np.add.at(votes, step[rows], _LOG_RATIO_OF_VOTE * vote)
    most = math.ceil(4 * settings.acceleration_std_m_per_s2 * _STEP_S / _SPEED_STEP_M_PER_S)
    shifts = np.arange(-most, most + 1)
    accelerations = shifts * _SPEED_STEP_M_PER_S / _STEP_S
    cost = 0.5 * (accelerations / settings.acceleration_std_m_per_s2) ** 2 * _STEP_S
    previous = np.arange(grid.size) - shifts[:, None]
    is_inside = (previous >= 0) & (previous < grid.size)
    previous = np.clip(previous, 0, grid.size - 1)
    score, came_from = votes[0], np.zeros(votes.shape, np.int32)
    for index in range(1, len(votes)):
        candidates = np.where(is_inside, score[previous] - cost[:, None], -np.inf)
        best = candidates.argmax(axis=0)
        came_from[index] = previous[best, np.arange(grid.size)]
        score = candidates.max(axis=0) + votes[index]
    path = np.empty(len(votes), int)
    path[-1] = score.argmax()
    for index in range(len(votes) - 1, 0, -1):
        path[index - 1] = came_from[index, path[index]]
    middle_s = times_s[0] + (np.arange(len(votes)) + 0.5) * _STEP_S
    return np.interp(times_s, middle_s, grid[path])


def _fit_curve(
    times_s: np.ndarray,
    speeds: np.ndarray,
    stds: np.ndarray,
    path: np.ndarray,
    settings: ForwardSpeed,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return knots, speeds there and their variances, and which rows agree with them."""
    n_knots = max(math.ceil(np.ptp(times_s) / _KNOT_S), 2) + 1
    knots_s = times_s[0] + _KNOT_S * np.arange(n_knots)
    first = np.minimum(((times_s - times_s[0]) / _KNOT_S).astype(int), n_knots - 2)
    late = (times_s - knots_s[first]) / _KNOT_S
    bend = np.diff(np.eye(3), 2, axis=0)[0] / _KNOT_S**2
    penalty = np.zeros((3, n_knots))  # upper bands, the main one last
    for row in range(3):
        for column in range(row, 3):
            penalty[2 - (column - row), column : n_knots - 2 + column] += (
                bend[row] * bend[column] * _KNOT_S / settings.jerk_std_m_per_s3**2
            )
    # Rows of one object within the coherence of its errors share the weight of one.
    period_s = np.median(np.diff(np.unique(times_s))) if np.ptp(times_s) else _COHERENCE_S
    share = min(period_s / _COHERENCE_S, 1.0)
    is_near = np.abs(speeds - path) < 1.5 + _GATE * stds
    residuals = speeds - path
    curve = path[np.minimum(np.searchsorted(times_s, knots_s), path.size - 1)]
    bands = penalty
    for _ in range(_MAX_ITERATIONS):
        weights = np.where(
            is_near, share / (stds * (1 + (residuals / stds / _CAUCHY_SCALE) ** 2)) ** 2, 0.0
        )
        bands = penalty.copy()
        bands[2] += np.bincount(first, weights * (1 - late) ** 2, n_knots)
        bands[2] += np.bincount(first + 1, weights * late**2, n_knots)
        bands[1, 1:] += np.bincount(first, weights * late * (1 - late), n_knots)[:-1]
        bands[2] += 1e-9 * bands[2].max()  # beyond the last standing object
        sums = np.bincount(first, weights * (1 - late) * speeds, n_knots)
        sums += np.bincount(first + 1, weights * late * speeds, n_knots)
        fitted = scipy.linalg.solveh_banded(bands, sums)
        residuals = speeds - np.interp(times_s, knots_s, fitted)
        change = np.abs(fitted - curve).max()
        curve = fitted
        if change < 1e-4:
            break
    return knots_s, curve, _inverse_diagonal(bands), np.abs(residuals) < _GATE * stds


def _inverse_diagonal(bands: np.ndarray) -> np.ndarray:
    """Return the diagonal of the inverse of a banded matrix, by blocks of columns."""
    n = bands.shape[1]
    diagonal = np.empty(n)
    for begin in range(0, n, 256):
        columns = np.arange(begin, min(begin + 256, n))
        unit = np.zeros((n, columns.size))
        unit[columns, np.arange(columns.size)] = 1
        diagonal[columns] = scipy.linalg.solveh_banded(bands, unit)[
            columns, np.arange(columns.size)
        ]
    return diagonal


def _count_objects(times_s: np.ndarray, objects: np.ndarray, knots_s: np.ndarray) -> np.ndarray:
    """Return the number of objects with three sightings or more within a second of each knot."""
    begins, ends = (np.searchsorted(times_s, knots_s + side) for side in (-1.0, 1.0))
    return np.array(
        [
            int((np.unique(objects[begin:end], return_counts=True)[1] >= _MIN_SIGHTINGS).sum())
            for begin, end in zip(begins, ends, strict=True)
        ]
    )
