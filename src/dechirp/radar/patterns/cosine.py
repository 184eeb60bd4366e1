"""Powers of cosines: the smooth main lobe that two beamwidths describe."""

import math
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import beta

from dechirp.core.checks import positive
from dechirp.core.values import value
from dechirp.radar.patterns.base import LEAST_GAIN, MOST_GAIN, Pattern, keep_beam, seen_from_beam


@value
class CosinePattern(Pattern):
    r"""A beam of cosine powers, half of its peak at half of each beamwidth, zero behind.

    .. math:: G = G_0 \cos^m(\alpha) \cos^n(\epsilon),
              \quad m = \frac{\ln 1/2}{\ln \cos(\alpha_{3dB}/2)}

    with azimuth and elevation from the axis of the beam; equal beamwidths give
    cos^n of the angle from the axis. No sidelobes: it holds for the main lobe.
    """

    azimuth_beamwidth_rad: float
    """Between the half-power directions to the left and the right of the beam."""
    elevation_beamwidth_rad: float
    """Between the half-power directions above and below the beam."""
    beam_azimuth_rad: float = 0.0
    beam_elevation_rad: float = 0.0
    gain: float | None = None
    """Along the beam, as a ratio (dBi in files); none: the directivity, an antenna
    without loss."""

    def __post_init__(self) -> None:
        # Half power at 90 deg would take a cosine to the power of 0.
        widths = ("azimuth_beamwidth_rad", "elevation_beamwidth_rad")
        positive(self, *widths, at_least=1e-3, at_most=3.1)
        keep_beam(self)
        if self.gain is not None:
            positive(self, "gain", at_least=LEAST_GAIN, at_most=MOST_GAIN)

    @property
    def peak_gain(self) -> float:
        """Gain along the beam: as given, or the directivity."""
        return self.directivity if self.gain is None else self.gain

    @cached_property
    def directivity(self) -> float:
        r"""Largest over mean of the pattern, a ratio.

        4 pi over the integral of both cosines and of the width cos(elevation) of a ring:
        :math:`\int_{-\pi/2}^{\pi/2} \cos^k = B((k + 1)/2, 1/2)`, exact.
        """
        m, n = self._exponents
        return float(4 * math.pi / (beta((m + 1) / 2, 0.5) * beta(n / 2 + 1, 0.5)))

    def gain_towards(self, azimuth_rad: ArrayLike, elevation_rad: ArrayLike) -> np.ndarray:
        """Power gain towards directions, a ratio; zero beyond 90 deg from the beam."""
        ahead, left, _ = seen_from_beam(
            azimuth_rad,
            elevation_rad,
            beam_azimuth_rad=self.beam_azimuth_rad,
            beam_elevation_rad=self.beam_elevation_rad,
        )
        m, n = self._exponents
        cos_elevation = np.hypot(ahead, left)
        is_front = ahead > 0
        cos_azimuth = np.divide(
            ahead, cos_elevation, out=np.zeros_like(cos_elevation), where=is_front
        )
        return np.asarray(self.peak_gain * cos_azimuth**m * cos_elevation**n)

    @property
    def _exponents(self) -> tuple[float, float]:
        return _exponent(self.azimuth_beamwidth_rad), _exponent(self.elevation_beamwidth_rad)


def _exponent(beamwidth_rad: float) -> float:
    # ln cos x from its sine, which keeps its digits for pencil beams.
    return math.log(0.5) / (0.5 * math.log1p(-(math.sin(beamwidth_rad / 2) ** 2)))
