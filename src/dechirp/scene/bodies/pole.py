"""Pole: an upright cylinder, such as a lamp post, a pillar or a delineator."""

import math
from functools import cached_property

import numpy as np

from dechirp.core.checks import check_positive_fields
from dechirp.core.values import frozen_dataclass
from dechirp.scene.bodies.base import AspectBody
from dechirp.scene.bodies.flash import FLASH_SPACING_M, flash_shares


@frozen_dataclass
class Pole(AspectBody):
    r"""Upright smooth cylinder that stands on its origin.

    Its axis is a line of points 0.5 m apart, of which the one at the height of the radar flashes.
    To a radar at the horizontal distance d, it has the cross section of a mirror that is straight
    along and curved across,

    .. math:: \sigma = R \pi \rho d

    and less beside the ends, see `flash_shares`. It is 0 above the upper end.

    Notes
    -----
    The formula requires a radius above some wavelengths, and a height above the first Fresnel zone,
    :math:`\sqrt{\lambda d / 2}`: 0.3 m at 50 m and 77 GHz. Points are on the axis, so that ranges
    are too long by the radius. Signs, lamps and foundations are not modelled.

    References
    ----------
    E. F. Knott, J. F. Shaeffer, M. T. Tuley, Radar Cross Section, 2nd ed. (2004), 5.
    """

    radius_m: float = 0.06
    """Radius of the cylinder."""
    height_m: float = 6.0
    """Height of the upper end."""
    reflectivity: float = 1.0
    """Share R of the power that is reflected at normal incidence: 1 metal, 0.154 concrete."""

    def __post_init__(self) -> None:
        check_positive_fields(self, "radius_m", at_least=1e-3, at_most=100.0)
        check_positive_fields(self, "height_m", at_least=0.1, at_most=1e3)
        check_positive_fields(self, "reflectivity", at_most=1.0)

    @property
    def is_rigid(self) -> bool:
        return True

    @property
    def blocking_box_m(self) -> np.ndarray:
        r = self.radius_m
        return np.array([[-r, -r, -np.inf], [r, r, self.height_m]])

    def n_scatterers(self) -> int:
        return len(self._heights_m)

    def scatterer_offsets_m(self, times_s: np.ndarray) -> np.ndarray:
        positions_m = np.zeros((len(times_s), self.n_scatterers(), 3))
        positions_m[..., 2] = self._heights_m
        return positions_m

    def cross_sections_towards_m2(self, radar_m: np.ndarray, wavelength_m: float) -> np.ndarray:
        x, y, z = radar_m.T
        distance_m = np.hypot(x, y)
        middle_m = self.height_m / 2
        shares = flash_shares(
            self._heights_m - middle_m,
            z - middle_m,
            distance_m,
            half_length_m=middle_m,
            wavelength_m=wavelength_m,
        )
        is_lit = (z >= 0) & (z <= self.height_m)
        flash_m2 = self.reflectivity * math.pi * self.radius_m * distance_m * is_lit
        return np.asarray(flash_m2[:, None] * shares)

    @cached_property
    def _heights_m(self) -> np.ndarray:
        n = math.ceil(self.height_m / FLASH_SPACING_M)
        return (np.arange(n) + 0.5) * self.height_m / n
