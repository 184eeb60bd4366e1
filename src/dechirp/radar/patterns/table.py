"""Tabulated antenna pattern: measured gains, interpolated between azimuths and elevations."""

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from dechirp.core.values import frozen_dataclass
from dechirp.radar.angle_table import check_angle_table, interpolate_angle_table
from dechirp.radar.patterns.base import (
    MAX_GAIN,
    MIN_GAIN,
    Pattern,
    check_beam_direction,
    direction_in_beam_axes,
)


@frozen_dataclass
class Table(Pattern):
    """Measured gains, bilinear in decibels between the angles.

    The table wraps round a full circle of azimuths; outside the measured angles the gain at the
    nearest edge holds, so measure out to negligible gain.
    """

    azimuth_rad: tuple[float, ...]
    """Ascending azimuths from the axis of the antenna."""
    elevation_rad: tuple[float, ...] = (0.0,)
    """Ascending elevations from the axis of the antenna. A single one is a cut: the gain is then
    constant in elevation."""
    gain: tuple[tuple[float, ...], ...]
    """A row for each elevation with a gain for each azimuth: absolute, as ratios (dBi in files)."""
    beam_azimuth_rad: float = 0.0
    """Azimuth to which the antenna is turned."""
    beam_elevation_rad: float = 0.0
    """Elevation to which the antenna is turned."""

    def __post_init__(self) -> None:
        check_angle_table(self, "gain", at_least=MIN_GAIN, at_most=MAX_GAIN)
        check_beam_direction(self)

    @property
    def peak_gain(self) -> float:
        """Largest measured gain."""
        return float(self._angle_and_gain_arrays[2].max())

    def gain_towards(self, azimuth_rad: ArrayLike, elevation_rad: ArrayLike) -> np.ndarray:
        """Return the power gain towards directions, a ratio; see `interpolate_angle_table`."""
        forward, leftward, upward = direction_in_beam_axes(
            azimuth_rad,
            elevation_rad,
            beam_azimuth_rad=self.beam_azimuth_rad,
            beam_elevation_rad=self.beam_elevation_rad,
        )
        return interpolate_angle_table(
            *self._angle_and_gain_arrays,
            np.arctan2(leftward, forward),
            np.arctan2(upward, np.hypot(forward, leftward)),
        )

    @cached_property
    def _angle_and_gain_arrays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return np.array(self.azimuth_rad), np.array(self.elevation_rad), np.array(self.gain)
