"""A measured pattern: gains at azimuths and elevations, interpolated between them."""

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from dechirp.core.values import value
from dechirp.radar.directions import interpolated, keep_table
from dechirp.radar.patterns.base import LEAST_GAIN, MOST_GAIN, Pattern, keep_beam, seen_from_beam


@value
class TablePattern(Pattern):
    """Gains as measured, bilinear in decibels between the angles.

    Round a whole circle of azimuths it wraps; outside the angles that were measured, the
    gain at the nearest edge holds: measure to where the antenna sees no more.
    """

    azimuth_rad: tuple[float, ...]
    """Ascending, from the axis of the antenna."""
    elevation_rad: tuple[float, ...] = (0.0,)
    """Ascending, from the axis of the antenna. One alone is a cut: the gain is constant in
    elevation then."""
    gain: tuple[tuple[float, ...], ...]
    """A row for each elevation, a gain for each azimuth in it: absolute, as ratios (dBi in
    files)."""
    beam_azimuth_rad: float = 0.0
    """Where the axis of the antenna points."""
    beam_elevation_rad: float = 0.0
    """Where the axis of the antenna points."""

    def __post_init__(self) -> None:
        keep_table(self, "gain", at_least=LEAST_GAIN, at_most=MOST_GAIN)
        keep_beam(self)

    @property
    def peak_gain(self) -> float:
        """The largest gain that was measured."""
        return float(self._arrays[2].max())

    def gain_towards(self, azimuth_rad: ArrayLike, elevation_rad: ArrayLike) -> np.ndarray:
        """Power gain towards directions, a ratio; see `interpolated`."""
        ahead, left, up = seen_from_beam(
            azimuth_rad,
            elevation_rad,
            beam_azimuth_rad=self.beam_azimuth_rad,
            beam_elevation_rad=self.beam_elevation_rad,
        )
        return interpolated(
            *self._arrays, np.arctan2(left, ahead), np.arctan2(up, np.hypot(ahead, left))
        )

    @cached_property
    def _arrays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return np.array(self.azimuth_rad), np.array(self.elevation_rad), np.array(self.gain)
