"""What a tracker takes of detections: azimuth, range and its rate in the plane."""

from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.errors import InvalidSetting

NEEDED = ("range", "velocity", "azimuth", "range_std", "velocity_std", "azimuth_std")


class Measured(NamedTuple):
    """Detections of a frame, seen from above; (n, 3) in rad, m, m/s. NaN: a rate is not told."""

    seen: np.ndarray
    """Azimuth, range, rate of the range."""
    variance: np.ndarray
    span_m_per_s: np.ndarray
    """(n,): rates are known up to a multiple of it; infinite where their fold is told."""

    def some(self, chosen: np.ndarray) -> "Measured":
        """Those of a mask, or of indices."""
        return Measured(*(column[chosen] for column in self))


def rows_of(found: xr.Dataset, *also: str) -> str:
    """Name of the axis of detections, or of clusters.

    Raises
    ------
    InvalidSetting
        If the table is neither, or lacks a column, also of the other names, or one holds no
        numbers.
    """
    columns = set(found) if isinstance(found, xr.Dataset) else set()
    wanted = (*NEEDED, *also)
    missing = [name for name in wanted if name not in columns]
    wrong = [] if missing else [name for name in wanted if not _is_column(found, name)]
    if missing or wrong:
        raise InvalidSetting(
            "found",
            got=f"a table without {', '.join(missing)}"
            if missing
            else f"a table whose {', '.join(wrong)} are not a number for each row",
            need="a table of detections or of clusters, with their standard errors",
            fix="Give what `detect` or `cluster` returned.",
        )
    return str(found["range"].dims[0])


def _is_column(found: xr.Dataset, name: str) -> bool:
    column, axes = found[name], found["range"].dims
    return len(axes) == 1 and column.dims == axes and column.dtype.kind in "iuf"


def usable(found: xr.Dataset) -> np.ndarray:
    """Whether a row tells range and azimuth, with their errors, (n,)."""
    told = [found[name].values for name in ("range", "azimuth", "range_std", "azimuth_std")]
    good: np.ndarray = np.all(np.isfinite(told), axis=0)
    return good & (told[0] > 0) & (told[2] > 0) & (told[3] > 0)


def measured(
    found: xr.Dataset, *, target_size_m: float, velocity_span_m_per_s: float | None
) -> Measured:
    """Columns of usable detections, brought into the plane.

    With an elevation e the range is R cos e, and of a target that stays at its height the rate
    divided by cos e; without one, a target is taken to be level with the radar. Rates whose `fold`
    is NaN are known up to the span of unambiguous velocity, if one is given.
    """
    range_m, azimuth, rate = (found[name].values for name in ("range", "azimuth", "velocity"))
    elevation, elevation_std = (
        np.nan_to_num(found[name].values) if name in found else np.zeros_like(range_m)
        for name in ("elevation", "elevation_std")
    )
    level, up = np.cos(elevation), np.sin(elevation)
    plane_m = range_m * level
    range_variance = (level * found["range_std"].values) ** 2 + (range_m * up * elevation_std) ** 2
    rate_std = found["velocity_std"].values / level
    is_told = np.isfinite(rate) & np.isfinite(rate_std) & (rate_std > 0)
    span = np.full(range_m.shape, np.inf)
    if velocity_span_m_per_s is not None and "fold" in found:
        span[np.isnan(found["fold"].values)] = velocity_span_m_per_s
    return Measured(
        seen=np.stack([azimuth, plane_m, np.where(is_told, rate / level, np.nan)], axis=-1),
        variance=np.stack(
            [
                found["azimuth_std"].values ** 2 + (target_size_m / plane_m) ** 2,
                range_variance + target_size_m**2,
                np.where(is_told, rate_std**2, np.nan),
            ],
            axis=-1,
        ),
        span_m_per_s=span / level,
    )
