"""Metal sphere, with equal reflection in all directions."""

import math

import numpy as np

from dechirp.core.checks import check_positive_fields
from dechirp.core.values import frozen_dataclass
from dechirp.scene.bodies.optical_region import OpticalBody


@frozen_dataclass
class Sphere(OpticalBody):
    r"""Metal sphere, as one scatterer at the origin, its point nearest to the radar.

    .. math:: \sigma = \pi r^2

    in the optical region. Creeping waves add less than 0.5 dB from two wavelengths of radius on;
    smaller spheres raise an error.

    References
    ----------
    E. F. Knott, J. F. Shaeffer, M. T. Tuley, Radar Cross Section, 2nd ed. (2004), 5.
    """

    radius_m: float
    """Radius of the sphere."""

    def __post_init__(self) -> None:
        check_positive_fields(self, "radius_m", at_most=1e3)

    @property
    def blocking_box_m(self) -> np.ndarray:
        return np.array([[-self.radius_m] * 3, [self.radius_m] * 3])

    def cross_sections_towards_m2(self, radar_m: np.ndarray, wavelength_m: float) -> np.ndarray:
        """Return the cross section, (n_positions, 1); raise if not in the optical region."""
        self.check_optical_size("radius_m", wavelength_m, min_wavelengths=2)
        return np.full((len(radar_m), 1), math.pi * self.radius_m**2)
