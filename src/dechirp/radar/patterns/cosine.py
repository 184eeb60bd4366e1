"""Cosine-power antenna pattern: a smooth main lobe given by two beamwidths."""

import math
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import ArrayLike

from dechirp.core.checks import check_positive_fields
from dechirp.core.values import frozen_dataclass
from dechirp.radar.patterns.base import (
    MAX_GAIN,
    MIN_GAIN,
    Pattern,
    check_beam_direction,
    direction_in_beam_axes,
)


@frozen_dataclass
class Cosine(Pattern):
    r"""Cosine-power beam: half of its peak at half of each beamwidth, zero behind.

    .. math:: G = G_0 \cos^m(\alpha) \cos^n(\epsilon),
              \quad m = \frac{\ln 1/2}{\ln \cos(\alpha_{3dB}/2)}

    with azimuth and elevation from the axis of the beam; equal beamwidths give
    cos^n of the angle from the axis. No sidelobes: it holds for the main lobe.
    """

    azimuth_beamwidth_rad: float
    """Angle between the half-power directions to the left and right of the beam."""
    elevation_beamwidth_rad: float
    """Angle between the half-power directions above and below the beam."""
    beam_azimuth_rad: float = 0.0
    """Azimuth to which the antenna is turned."""
    beam_elevation_rad: float = 0.0
    """Elevation to which the antenna is turned."""
    gain: float | None = None
    """Gain along the beam as a ratio (dBi in files); none: the directivity, for a lossless
    antenna."""

    def __post_init__(self) -> None:
        # Half power at 90 deg would take a cosine to the power of 0.
        widths = ("azimuth_beamwidth_rad", "elevation_beamwidth_rad")
        check_positive_fields(self, *widths, at_least=1e-3, at_most=3.1)
        check_beam_direction(self)
        if self.gain is not None:
            check_positive_fields(self, "gain", at_least=MIN_GAIN, at_most=MAX_GAIN)

    @property
    def peak_gain(self) -> float:
        """Gain along the beam: the given gain, or the directivity."""
        return self.directivity if self.gain is None else self.gain

    @cached_property
    def directivity(self) -> float:
        r"""Ratio of the largest to the mean of the pattern.

        4 pi over the integral of both cosines and of the width cos(elevation) of a ring:
        :math:`\int_{-\pi/2}^{\pi/2} \cos^k = B((k + 1)/2, 1/2)`, exact.
        """
        m, n = self._cosine_exponents
        return float(
            4
            * math.pi
            / (scipy.special.beta((m + 1) / 2, 0.5) * scipy.special.beta(n / 2 + 1, 0.5))
        )

    def gain_towards(self, azimuth_rad: ArrayLike, elevation_rad: ArrayLike) -> np.ndarray:
        """Return the power gain towards directions, a ratio; zero beyond 90 deg from the beam."""
        forward, leftward, _ = direction_in_beam_axes(
            azimuth_rad,
            elevation_rad,
            beam_azimuth_rad=self.beam_azimuth_rad,
            beam_elevation_rad=self.beam_elevation_rad,
        )
        m, n = self._cosine_exponents
        cos_elevation = np.hypot(forward, leftward)
        is_front = forward > 0
        cos_azimuth = np.divide(
            forward, cos_elevation, out=np.zeros_like(cos_elevation), where=is_front
        )
        return np.asarray(self.peak_gain * cos_azimuth**m * cos_elevation**n)

    @property
    def _cosine_exponents(self) -> tuple[float, float]:
        return _cosine_exponent_for_beamwidth(
            self.azimuth_beamwidth_rad
        ), _cosine_exponent_for_beamwidth(self.elevation_beamwidth_rad)


def _cosine_exponent_for_beamwidth(beamwidth_rad: float) -> float:
    # ln cos x computed from the sine, which stays accurate for pencil beams.
    return math.log(0.5) / (0.5 * math.log1p(-(math.sin(beamwidth_rad / 2) ** 2)))
