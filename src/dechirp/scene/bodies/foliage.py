"""Foliage: leaves and branches of trees and hedges."""

import math
from functools import cached_property

import numpy as np

from dechirp.core.checks import check_non_negative_fields, check_positive_fields
from dechirp.core.errors import InvalidSetting
from dechirp.core.units import from_decibels
from dechirp.core.values import frozen_dataclass
from dechirp.scene.bodies.base import Body

_POINTS_PER_M3, _MAX_POINTS = 2.0, 400
_SEED = 0


@frozen_dataclass
class Foliage(Body):
    r"""Ellipsoid of leaves above its origin on the ground, without a trunk.

    Its points are at random places, fixed in the body, and share the cross section of the
    constant-gamma model, as of woods seen from the side, with the mean silhouette A:

    .. math:: \sigma = \gamma A, \quad A = \frac{\pi}{4} \sqrt{l w} \, (h - b)

    of an ellipsoid of the length l and the width w from the height b to h. The leaves shadow like a
    box of this size: at 77 GHz, some metres of them take more than 20 dB, one way.

    Notes
    -----
    Gamma of woods is -15 dB at 10 GHz (Nathanson; Long), by the usual rule 5 log10(f / 10 GHz) dB
    more at f: the default is that of 77 GHz, -10.6 dB. Leaves do not move in the wind; use the
    fluctuation swerling-1 for independent frames.

    References
    ----------
    F. E. Nathanson, Radar Design Principles, 2nd ed. (1991), 7.
    M. W. Long, Radar Reflectivity of Land and Sea, 3rd ed. (2001).
    Recommendation ITU-R P.833-10 (2021), attenuation in vegetation.
    """

    length_m: float = 4.0
    """Extent along x."""
    width_m: float = 4.0
    """Extent along y."""
    height_m: float = 8.0
    """Upper end above the ground."""
    base_height_m: float = 0.0
    """Lower end above the ground: 0 for a hedge, the height of the trunk for a tree."""
    gamma: float = float(from_decibels(-10.6))
    """Cross section per area of the silhouette (dB in files)."""

    def __post_init__(self) -> None:
        check_positive_fields(self, "length_m", "width_m", at_least=0.01, at_most=1e4)
        check_positive_fields(self, "height_m", at_least=0.01, at_most=1e3)
        check_non_negative_fields(self, "base_height_m")
        check_positive_fields(self, "gamma", at_most=1e3)
        if self.base_height_m >= self.height_m:
            raise InvalidSetting(
                "Foliage.base_height_m",
                value=f"{self.base_height_m:.4g} m",
                expected=f"below the height, {self.height_m:.4g} m",
                fix="give the height of the trunk",
            )

    @property
    def is_rigid(self) -> bool:
        return True

    @property
    def blocking_box_m(self) -> np.ndarray:
        x, y = self.length_m / 2, self.width_m / 2
        return np.array([[-x, -y, self.base_height_m or -np.inf], [x, y, self.height_m]])

    def n_scatterers(self) -> int:
        return len(self._positions_m)

    def scatterer_offsets_m(self, times_s: np.ndarray) -> np.ndarray:
        return np.broadcast_to(self._positions_m, (len(times_s), *self._positions_m.shape))

    def cross_sections_m2(self) -> np.ndarray:
        thickness_m = self.height_m - self.base_height_m
        silhouette_m2 = math.pi / 4 * math.sqrt(self.length_m * self.width_m) * thickness_m
        n = self.n_scatterers()
        return np.full(n, self.gamma * silhouette_m2 / n)

    @cached_property
    def _positions_m(self) -> np.ndarray:
        half_m = np.array(
            [self.length_m / 2, self.width_m / 2, (self.height_m - self.base_height_m) / 2]
        )
        n = math.ceil(_POINTS_PER_M3 * 4 / 3 * math.pi * float(half_m.prod()))
        rng = np.random.default_rng(_SEED)
        directions = rng.normal(size=(min(max(n, 10), _MAX_POINTS), 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        radii = rng.uniform(size=(len(directions), 1)) ** (1 / 3)
        positions_m = radii * directions * half_m + [0, 0, self.base_height_m + half_m[2]]
        positions_m.flags.writeable = False
        return positions_m
