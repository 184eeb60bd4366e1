"""Cross sections as measured over aspect."""

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from dechirp.core.values import value
from dechirp.radar.directions import interpolated, keep_table


@value
class RcsTable:
    """Radar cross section over the direction in which the target sees the radar.

    In the axes of the target: x along its heading, y left, z up; at azimuth 0 the radar is
    ahead of it. Bilinear in decibels; round a whole circle of azimuths it wraps, outside the
    angles of a smaller table the nearest edge holds.
    """

    azimuth_rad: tuple[float, ...]
    """Ascending, left positive."""
    elevation_rad: tuple[float, ...] = (0.0,)
    """Ascending. One alone: the same from above and below."""
    rcs_m2: tuple[tuple[float, ...], ...]
    """A row for each elevation, a cross section for each azimuth in it (dBsm in files)."""

    def __post_init__(self) -> None:
        keep_table(self, "rcs_m2", at_least=1e-12, at_most=1e12)

    def seen_from_m2(self, azimuth_rad: ArrayLike, elevation_rad: ArrayLike) -> np.ndarray:
        """Cross sections towards directions, any shapes that broadcast."""
        return interpolated(*self._arrays, azimuth_rad, elevation_rad)

    @cached_property
    def _arrays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return np.array(self.azimuth_rad), np.array(self.elevation_rad), np.array(self.rcs_m2)
