"""Points of extended objects as positions and range rates in the plane."""

from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.errors import InvalidSetting
from dechirp.tracking.group_tracker import GroupTracker

_MAX_VALUE = 1e9  # m and m/s; squares of larger damaged numbers could overflow


class GroupPoints(NamedTuple):
    """Points in the plane; the first axis of all arrays counts points."""

    position_m: np.ndarray
    """(n, 2): x, y."""
    position_covariance: np.ndarray
    """(n, 2, 2): error of the radar, without the extent of an object."""
    line_of_sight: np.ndarray
    """(n, 2): unit vector from the radar."""
    rate_m_per_s: np.ndarray
    """(n,): range rate in the plane; NaN if unknown."""
    rate_variance: np.ndarray
    azimuth_variance: np.ndarray
    span_m_per_s: np.ndarray
    """(n,): rates are known up to a multiple of it; infinite if unambiguous."""

    def select_points(self, rows: np.ndarray) -> "GroupPoints":
        """Return the points of a mask or of indices."""
        return GroupPoints(*(column[rows] for column in self))


def empty_group_points() -> GroupPoints:
    """Return points of an empty frame."""
    shapes = [(0, 2), (0, 2, 2), (0, 2), (0,), (0,), (0,), (0,)]
    return GroupPoints(*(np.empty(shape) for shape in shapes))


def check_point_table(points: xr.Dataset, *extra_columns: str) -> None:
    """Raise `InvalidSetting` unless a table has range, azimuth and velocity of each point.

    Negative ranges and standard errors and azimuths beyond pi are refused, too.
    """
    columns = set(points.variables) if isinstance(points, xr.Dataset) else set()
    wanted = ("range", "azimuth", "velocity", *extra_columns)
    missing = [name for name in wanted if name not in columns]
    invalid = (
        [] if missing else [name for name in wanted if not _is_numeric_row_column(points, name)]
    )
    if missing or invalid:
        raise InvalidSetting(
            "points",
            value=f"a table without {', '.join(missing)}"
            if missing
            else f"a table whose {', '.join(invalid)} are not a number for each row",
            expected=f"a dataset with {', '.join(wanted)} of each point",
            fix="pass `dechirp.open(...).points`, or what `detect` returned",
        )
    # NaN stands for unknown; a float32 of pi is 9e-8 above it.
    azimuth = np.abs(points.variables["azimuth"].values)
    _refuse_rows("azimuth", azimuth > np.pi + 1e-6, "from -pi to pi, in rad")
    for name in ("range", "range_std", "azimuth_std", "velocity_std"):
        if name in columns:
            _refuse_rows(name, points.variables[name].values < 0, "0 or more")


def _refuse_rows(name: str, is_wrong: np.ndarray, expected: str) -> None:
    if is_wrong.any():
        raise InvalidSetting(
            f"points.{name}",
            value=f"impossible in {np.count_nonzero(is_wrong)} of {is_wrong.size} rows",
            expected=f"{expected}; NaN if unknown",
            fix="leave these rows out, or convert the units",
        )


def _is_numeric_row_column(points: xr.Dataset, name: str) -> bool:
    column, axes = points.variables[name], points.variables["range"].dims
    return len(axes) == 1 and column.dims == axes and column.dtype.kind in "iuf"


def usable_point_mask(points: xr.Dataset) -> np.ndarray:
    """Return the mask of rows with a range above zero and an azimuth, (n,)."""
    range_m, azimuth = (points.variables[name].values for name in ("range", "azimuth"))
    is_usable: np.ndarray = (range_m > 0) & (range_m < _MAX_VALUE) & np.isfinite(azimuth)
    return is_usable


def usable_rows_to_group_points(
    points: xr.Dataset, tracker: GroupTracker, velocity_span_m_per_s: float | None
) -> GroupPoints:
    """Convert the usable rows of a table to points in the plane.

    The settings of the tracker replace standard errors that the table does not state. An elevation
    is treated as in `usable_rows_to_measurements`: the range is projected onto the plane, and the
    rate divided by the cosine of the elevation. Rates whose `ambiguity_number` is NaN are known up
    to the unambiguous velocity span, if given.
    """
    rows = usable_point_mask(points)
    columns = {
        name: points.variables[name].values[rows].astype(float)
        for name in (
            *("range", "azimuth", "velocity", "elevation", "ambiguity_number"),
            *("range_std", "azimuth_std", "velocity_std"),
        )
        if name in points.variables
    }
    n = int(rows.sum())

    def known_or(name: str, default: float) -> np.ndarray:
        column = columns.get(name, np.full(n, np.nan))
        return np.where((column > 0) & (column < _MAX_VALUE), column, default)

    cos_elevation = np.cos(np.nan_to_num(columns.get("elevation", np.zeros(n))))
    range_m, azimuth = columns["range"] * cos_elevation, columns["azimuth"]
    rate = columns["velocity"] / cos_elevation
    line_of_sight = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)
    across = np.stack([-np.sin(azimuth), np.cos(azimuth)], axis=-1)
    range_variance = (known_or("range_std", tracker.range_std_m) * cos_elevation) ** 2
    azimuth_variance = known_or("azimuth_std", tracker.azimuth_std_rad) ** 2
    span = np.full(n, np.inf)
    if velocity_span_m_per_s is not None and "ambiguity_number" in columns:
        span[np.isnan(columns["ambiguity_number"])] = velocity_span_m_per_s
    return GroupPoints(
        position_m=range_m[:, None] * line_of_sight,
        position_covariance=range_variance[:, None, None]
        * line_of_sight[:, :, None]
        * line_of_sight[:, None]
        + (range_m**2 * azimuth_variance)[:, None, None] * across[:, :, None] * across[:, None],
        line_of_sight=line_of_sight,
        rate_m_per_s=np.where(np.abs(rate) < _MAX_VALUE, rate, np.nan),
        rate_variance=(known_or("velocity_std", tracker.velocity_std_m_per_s) / cos_elevation) ** 2,
        azimuth_variance=azimuth_variance,
        span_m_per_s=span / cos_elevation,
    )
