"""A sphere of metal, which reflects alike to all sides."""

import math

import numpy as np

from dechirp.core.checks import positive
from dechirp.core.values import value
from dechirp.scene.bodies.optical import OpticalBody


@value
class Sphere(OpticalBody):
    r"""A sphere of metal: one scatterer at the origin, its point that is nearest to the radar.

    .. math:: \sigma = \pi r^2

    in the optical region. Creeping waves add to it by less than 0.5 dB from two wavelengths
    of radius on, below which it is refused.

    References
    ----------
    E. F. Knott, J. F. Shaeffer, M. T. Tuley, Radar Cross Section, 2nd ed. (2004), 5.
    """

    radius_m: float

    def __post_init__(self) -> None:
        positive(self, "radius_m", at_most=1e3)

    def seen_from_m2(self, radar_m: np.ndarray, wavelength_m: float) -> np.ndarray:
        """Cross section, (n_places, 1); refuses with `InvalidSetting` what is not optical."""
        self.must_be_large("radius_m", wavelength_m, wavelengths=2)
        return np.full((len(radar_m), 1), math.pi * self.radius_m**2)
