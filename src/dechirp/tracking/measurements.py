"""Measurements of a tracker: azimuth, range and range rate in the plane."""

from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.errors import InvalidSetting

REQUIRED = ("range", "velocity", "azimuth", "range_std", "velocity_std", "azimuth_std")
_OPTIONAL = ("elevation", "elevation_std", "ambiguity_number", "range_extent", "azimuth_extent")


class Measurements(NamedTuple):
    """Measurements in the plane, (n, 3) in rad, m, m/s; NaN for unknown rates."""

    z: np.ndarray
    """Azimuth, range, range rate."""
    variance: np.ndarray
    span_m_per_s: np.ndarray
    """(n,): rates are known up to a multiple of it; infinite if unambiguous."""
    size_m2: np.ndarray
    """(n, 2): variance of the echo about the centre of its body, along and across the line of
    sight; 0 for points."""

    def select_measurements(self, rows: np.ndarray) -> "Measurements":
        """Return the measurements of a mask or of indices."""
        return Measurements(*(column[rows] for column in self))


def checked_row_axis_name(detections: xr.Dataset, *extra_columns: str) -> str:
    """Return the name of the axis of a table of detections or clusters.

    Raises
    ------
    InvalidSetting
        If the table is neither, lacks a required or an extra column, or one is not numeric.
    """
    columns = set(detections) if isinstance(detections, xr.Dataset) else set()
    wanted = (*REQUIRED, *extra_columns)
    missing = [name for name in wanted if name not in columns]
    invalid = (
        []
        if missing
        else [name for name in wanted if not _is_numeric_column_over_rows(detections, name)]
    )
    if missing or invalid:
        raise InvalidSetting(
            "detections",
            value=f"a table without {', '.join(missing)}"
            if missing
            else f"a table whose {', '.join(invalid)} are not a number for each row",
            expected="a table of detections or of clusters, with their standard errors",
            fix="pass what `detect` or `cluster` returned",
        )
    return str(detections["range"].dims[0])


def _is_numeric_column_over_rows(detections: xr.Dataset, name: str) -> bool:
    column, axes = detections.variables[name], detections.variables["range"].dims
    return len(axes) == 1 and column.dims == axes and column.dtype.kind in "iuf"


def usable_row_mask(detections: xr.Dataset) -> np.ndarray:
    """Return the mask of rows with range and azimuth and their errors, (n,)."""
    wanted = ("range", "azimuth", "range_std", "azimuth_std")
    values = [detections.variables[name].values for name in wanted]
    is_finite: np.ndarray = np.all(np.isfinite(values), axis=0)
    return is_finite & (values[0] > 0) & (values[2] > 0) & (values[3] > 0)


def usable_rows_to_measurements(
    detections: xr.Dataset, *, target_size_m: float, velocity_span_m_per_s: float | None
) -> Measurements:
    """Convert usable detections to measurements in the plane.

    With an elevation e the range is R cos e, and the rate of a target at constant height is divided
    by cos e; without one, the target is assumed level with the radar. Rates whose
    `ambiguity_number` is NaN are known up to the unambiguous velocity span, if given.

    The size of a body is `target_size_m`, and the extents of its cluster: a centre that is anywhere
    within an extent has the variance of a twelfth of its square.
    """
    rows = usable_row_mask(detections)
    # Rows of arrays: selecting rows of a dataset with 16 columns takes 0.4 ms.
    columns = {
        name: detections.variables[name].values[rows]
        for name in (*REQUIRED, *_OPTIONAL)
        if name in detections
    }
    range_m, rate = columns["range"], columns["velocity"]
    elevation, elevation_std = (
        np.nan_to_num(columns[name]) if name in columns else np.zeros_like(range_m)
        for name in ("elevation", "elevation_std")
    )
    cos_elevation, sin_elevation = np.cos(elevation), np.sin(elevation)
    plane_m = range_m * cos_elevation
    range_variance = (cos_elevation * columns["range_std"]) ** 2 + (
        range_m * sin_elevation * elevation_std
    ) ** 2
    rate_std = columns["velocity_std"] / cos_elevation
    has_rate = np.isfinite(rate) & np.isfinite(rate_std) & (rate_std > 0)
    span = np.full(range_m.shape, np.inf)
    if velocity_span_m_per_s is not None and "ambiguity_number" in columns:
        span[np.isnan(columns["ambiguity_number"])] = velocity_span_m_per_s
    size_m2 = _size_variances_m2(columns, plane_m, target_size_m)
    return Measurements(
        z=np.stack(
            [columns["azimuth"], plane_m, np.where(has_rate, rate / cos_elevation, np.nan)], axis=-1
        ),
        variance=np.stack(
            [
                columns["azimuth_std"] ** 2,
                range_variance,
                np.where(has_rate, rate_std**2, np.nan),
            ],
            axis=-1,
        ),
        span_m_per_s=span / cos_elevation,
        size_m2=size_m2,
    )


def _size_variances_m2(
    columns: dict[str, np.ndarray], range_m: np.ndarray, target_size_m: float
) -> np.ndarray:
    """Return the variances of echoes about the centres of their bodies, (n, 2)."""
    if not target_size_m:
        return np.zeros((len(range_m), 2))
    along_m, across_rad = (
        np.nan_to_num(columns.get(f"{name}_extent", np.zeros_like(range_m)))
        for name in ("range", "azimuth")
    )
    extents_m = np.stack([along_m, range_m * across_rad], axis=-1)
    return target_size_m**2 + extents_m**2 / 12
