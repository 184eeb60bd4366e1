"""Tables of measured cross sections over aspect."""

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from dechirp.core.values import frozen_dataclass
from dechirp.radar.angle_table import check_angle_table, interpolate_angle_table


@frozen_dataclass
class RcsTable:
    """Radar cross section over the direction from the target to the radar.

    In the axes of the target: x along its heading, y left, z up; at azimuth 0 the radar is ahead of
    it. Interpolation is bilinear in decibels. A full circle of azimuths is periodic; outside the
    angles of a smaller table, the nearest edge applies.
    """

    azimuth_rad: tuple[float, ...]
    """Azimuths, ascending, left positive."""
    elevation_rad: tuple[float, ...] = (0.0,)
    """Elevations, ascending. A single one applies to all elevations."""
    rcs_m2: tuple[tuple[float, ...], ...]
    """One row for each elevation, with a cross section for each azimuth (dBsm in files)."""

    def __post_init__(self) -> None:
        check_angle_table(self, "rcs_m2", at_least=1e-12, at_most=1e12)

    def cross_sections_towards_m2(
        self, azimuth_rad: ArrayLike, elevation_rad: ArrayLike
    ) -> np.ndarray:
        """Return cross sections towards directions, any shapes that broadcast."""
        return interpolate_angle_table(
            *self._azimuth_elevation_rcs_arrays, azimuth_rad, elevation_rad
        )

    @cached_property
    def _azimuth_elevation_rcs_arrays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return np.array(self.azimuth_rad), np.array(self.elevation_rad), np.array(self.rcs_m2)
