"""A guard rail: a beam of steel on posts beside the road."""

import math
from functools import cached_property

import numpy as np

from dechirp.core.checks import positive
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.scene.bodies.base import LEAST_RCS_M2, MOST_RCS_M2, AspectBody

_SPACING_M = 0.5  # of the points of the beam
_WAVES = 2  # of the profile of the beam, each one a mirror of its own


@value
class GuardRail(AspectBody):
    r"""A straight beam on posts along the x axis, its middle above the origin on the ground.

    Posts are points that are seen from all sides. The beam is a line of points 0.5 m apart, of
    which those beside the radar flash, at the foot of the perpendicular: as the radar drives
    on, so does the flash. It is what two long mirrors reflect that are straight along and
    round across, to a radar at the distance d from the line (geometrical optics):

    .. math:: \sigma = 2 \pi \rho d, \quad \sigma_i = \sigma \sqrt{2 / \pi}
        \exp\left(-2 (x_i - x)^2 / (0.5\,\mathrm{m})^2\right)

    with the radar abreast of x: in the sum within 2 % of it anywhere along the rail, 0 beyond
    its ends.

    Notes
    -----
    The radius of the waves and the cross section of a post are assumptions: no published
    levels were found. What a car on the road sees of itself in the beam is a matter of the
    paths, not of this body.

    References
    ----------
    E. F. Knott, J. F. Shaeffer, M. T. Tuley, Radar Cross Section, 2nd ed. (2004), 5.
    """

    length_m: float
    height_m: float = 0.6
    """Of the middle of the beam above the ground."""
    post_spacing_m: float = 2.0
    post_rcs_m2: float = 1.0
    """Of each post (dBsm in files)."""
    wave_radius_m: float = 0.05
    """Of the round of the waves in the profile of the beam."""

    def __post_init__(self) -> None:
        positive(self, "length_m", at_least=1e-3, at_most=1e4)
        positive(self, "height_m", at_most=10.0)
        positive(self, "post_spacing_m", at_least=0.1)
        positive(self, "post_rcs_m2", at_least=LEAST_RCS_M2, at_most=MOST_RCS_M2)
        positive(self, "wave_radius_m")
        if self.wave_radius_m > self.height_m:
            raise InvalidSetting(
                "GuardRail.wave_radius_m",
                got=f"{self.wave_radius_m:.4g} m",
                need=f"at most the height, {self.height_m:.4g} m",
                fix="Check the unit.",
            )

    @property
    def is_rigid(self) -> bool:
        """It is."""
        return True

    def n_scatterers(self) -> int:
        """Points of the beam and posts."""
        return len(self._beam_m) + len(self._posts_m)

    def offsets_m(self, times_s: np.ndarray) -> np.ndarray:
        """Points of the beam, then posts by their middles, (n_times, n_scatterers, 3)."""
        x_m = np.concatenate([self._beam_m, self._posts_m])
        z_m = np.where(np.arange(len(x_m)) < len(self._beam_m), self.height_m, self.height_m / 2)
        at_m = np.stack([x_m, np.zeros(len(x_m)), z_m], axis=-1)
        return np.repeat(at_m[None], len(times_s), axis=0)

    def seen_from_m2(self, radar_m: np.ndarray, wavelength_m: float) -> np.ndarray:
        """Cross section of each scatterer, (n_places, n_scatterers)."""
        x, y, z = radar_m.T[..., None]
        flash_m2 = _WAVES * math.pi * self.wave_radius_m * np.hypot(y, z - self.height_m)
        share = np.exp(-2 * ((self._beam_m - x) / _SPACING_M) ** 2) * math.sqrt(2 / math.pi)
        posts_m2 = np.full((len(radar_m), len(self._posts_m)), self.post_rcs_m2)
        return np.concatenate([flash_m2 * share, posts_m2], axis=1)

    @cached_property
    def _beam_m(self) -> np.ndarray:
        return _spread_m(self.length_m, _SPACING_M)

    @cached_property
    def _posts_m(self) -> np.ndarray:
        return _spread_m(self.length_m, self.post_spacing_m)


def _spread_m(length_m: float, spacing_m: float) -> np.ndarray:
    """Places along a length about 0, as many as fit."""
    n = math.floor(length_m / spacing_m) + 1
    return (np.arange(n) - (n - 1) / 2) * spacing_m
