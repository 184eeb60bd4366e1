"""Guard rail: a steel beam on posts beside the road."""

import math
from functools import cached_property

import numpy as np

from dechirp.core.checks import check_positive_fields
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.scene.bodies.base import MAX_RCS_M2, MIN_RCS_M2, AspectBody
from dechirp.scene.bodies.flash import FLASH_SPACING_M, flash_shares

_BEAM_HEIGHT_M = 0.31  # of a W-beam (EN 1317 type A, AASHTO M 180)
_N_WAVES = 2  # of the profile of the beam, each a separate mirror


@frozen_dataclass
class GuardRail(AspectBody):
    r"""Straight beam on posts along the x axis, with its middle above the origin on the ground.

    Posts are isotropic points. The beam is a line of points 0.5 m apart, of which the one abreast
    of the radar flashes, at the foot of the perpendicular: the flash moves along with the radar. It
    is the reflection of two long mirrors, straight along and curved across, to a radar at the
    distance d from the line:

    .. math:: \sigma = 2 \pi \rho d

    and less beside the ends and beyond them, see `flash_shares`.

    Notes
    -----
    The radius of the waves and the cross section of a post are assumptions: no published
    levels were found. Mirror images of cars in the beam are modelled by `BodyMultipath`, or by
    `WallMultipath` for a line beside the radar, not by this body.

    References
    ----------
    E. F. Knott, J. F. Shaeffer, M. T. Tuley, Radar Cross Section, 2nd ed. (2004), 5.
    """

    length_m: float
    """Length of the beam."""
    height_m: float = 0.6
    """Height of the middle of the beam above the ground."""
    post_spacing_m: float = 2.0
    """Distance from post to post."""
    post_rcs_m2: float = 1.0
    """Cross section of each post (dBsm in files)."""
    wave_radius_m: float = 0.05
    """Radius of the waves in the profile of the beam."""

    def __post_init__(self) -> None:
        check_positive_fields(self, "length_m", at_least=1e-3, at_most=1e4)
        check_positive_fields(self, "height_m", at_most=10.0)
        check_positive_fields(self, "post_spacing_m", at_least=0.1)
        check_positive_fields(self, "post_rcs_m2", at_least=MIN_RCS_M2, at_most=MAX_RCS_M2)
        check_positive_fields(self, "wave_radius_m")
        if self.wave_radius_m > self.height_m:
            raise InvalidSetting(
                "GuardRail.wave_radius_m",
                value=f"{self.wave_radius_m:.4g} m",
                expected=f"at most the height, {self.height_m:.4g} m",
                fix="check the unit",
            )

    @property
    def is_rigid(self) -> bool:
        return True

    @property
    def blocking_box_m(self) -> np.ndarray:
        """Return the beam alone: posts are narrower than a Fresnel zone."""
        x, z = self.length_m / 2, _BEAM_HEIGHT_M / 2
        return np.array([[-x, -self.wave_radius_m, self.height_m - z],
                         [x, self.wave_radius_m, self.height_m + z]])  # fmt: skip

    @property
    def side_reflectivity(self) -> None:
        return None

    def n_scatterers(self) -> int:
        return len(self._beam_point_x_m) + len(self._post_x_m)

    def scatterer_offsets_m(self, times_s: np.ndarray) -> np.ndarray:
        """Return the points of the beam, then the post centres, (n_times, n_scatterers, 3)."""
        x_m = np.concatenate([self._beam_point_x_m, self._post_x_m])
        z_m = np.where(
            np.arange(len(x_m)) < len(self._beam_point_x_m), self.height_m, self.height_m / 2
        )
        positions_m = np.stack([x_m, np.zeros(len(x_m)), z_m], axis=-1)
        return np.repeat(positions_m[None], len(times_s), axis=0)

    def cross_sections_towards_m2(self, radar_m: np.ndarray, wavelength_m: float) -> np.ndarray:
        x, y, z = radar_m.T
        distance_m = np.hypot(y, z - self.height_m)
        flash_m2 = _N_WAVES * math.pi * self.wave_radius_m * distance_m
        shares = flash_shares(
            self._beam_point_x_m,
            x,
            distance_m,
            half_length_m=self.length_m / 2,
            wavelength_m=wavelength_m,
        )
        posts_m2 = np.full((len(radar_m), len(self._post_x_m)), self.post_rcs_m2)
        return np.concatenate([flash_m2[:, None] * shares, posts_m2], axis=1)

    @cached_property
    def _beam_point_x_m(self) -> np.ndarray:
        return _evenly_spaced_about_zero_m(self.length_m, FLASH_SPACING_M)

    @cached_property
    def _post_x_m(self) -> np.ndarray:
        return _evenly_spaced_about_zero_m(self.length_m, self.post_spacing_m)


def _evenly_spaced_about_zero_m(length_m: float, spacing_m: float) -> np.ndarray:
    """Return evenly spaced positions along a length about 0, as many as fit."""
    n = math.floor(length_m / spacing_m) + 1
    return (np.arange(n) - (n - 1) / 2) * spacing_m
