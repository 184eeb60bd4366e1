"""What a tracker takes of detections: azimuth, range and its rate in the plane."""

from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.errors import InvalidSetting

NEEDED = ("range", "velocity", "azimuth", "range_std", "velocity_std", "azimuth_std")
_OTHERS = ("elevation", "elevation_std", "fold")


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
    column, axes = found.variables[name], found.variables["range"].dims
    return len(axes) == 1 and column.dims == axes and column.dtype.kind in "iuf"


def usable(found: xr.Dataset) -> np.ndarray:
    """Whether a row tells range and azimuth, with their errors, (n,)."""
    wanted = ("range", "azimuth", "range_std", "azimuth_std")
    told = [found.variables[name].values for name in wanted]
    good: np.ndarray = np.all(np.isfinite(told), axis=0)
    return good & (told[0] > 0) & (told[2] > 0) & (told[3] > 0)


def measured(
    found: xr.Dataset, *, target_size_m: float, velocity_span_m_per_s: float | None
) -> Measured:
    """Usable detections, brought into the plane.

    With an elevation e the range is R cos e, and of a target that stays at its height the rate
    divided by cos e; without one, a target is taken to be level with the radar. Rates whose `fold`
    is NaN are known up to the span of unambiguous velocity, if one is given.
    """
    good = usable(found)
    # Rows of arrays: those of a table of 16 columns take 0.4 ms.
    told = {
        name: found.variables[name].values[good] for name in (*NEEDED, *_OTHERS) if name in found
    }
    range_m, rate = told["range"], told["velocity"]
    elevation, elevation_std = (
        np.nan_to_num(told[name]) if name in told else np.zeros_like(range_m)
        for name in ("elevation", "elevation_std")
    )
    level, up = np.cos(elevation), np.sin(elevation)
    plane_m = range_m * level
    range_variance = (level * told["range_std"]) ** 2 + (range_m * up * elevation_std) ** 2
    rate_std = told["velocity_std"] / level
    is_told = np.isfinite(rate) & np.isfinite(rate_std) & (rate_std > 0)
    span = np.full(range_m.shape, np.inf)
    if velocity_span_m_per_s is not None and "fold" in told:
        span[np.isnan(told["fold"])] = velocity_span_m_per_s
    return Measured(
        seen=np.stack([told["azimuth"], plane_m, np.where(is_told, rate / level, np.nan)], axis=-1),
        variance=np.stack(
            [
                told["azimuth_std"] ** 2 + (target_size_m / plane_m) ** 2,
                range_variance + target_size_m**2,
                np.where(is_told, rate_std**2, np.nan),
            ],
            axis=-1,
        ),
        span_m_per_s=span / level,
    )
