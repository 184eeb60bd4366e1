"""Ground clutter: echoes of the road and its surroundings."""

from functools import cached_property

import numpy as np

from dechirp.core.checks import check_integer_fields, check_number, check_positive_fields
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.scene.bodies.base import AspectBody


@frozen_dataclass
class GroundClutter(AspectBody):
    r"""Patches of flat ground at random positions in a rectangle, fixed in the scene.

    The rectangle extends from `near_m` to `far_m` along the x axis and equally to both sides; the
    origin is on the ground. Each of n patches of a rectangle of the area A reflects, to a radar
    above it at the grazing angle :math:`\psi`, by the constant-gamma model

    .. math:: \sigma = \gamma \sin\psi \, A / n

    Relative to a moving radar, ground at the azimuth :math:`\varphi` from its heading has the
    velocity :math:`-v \cos\varphi`, times the cosine of its elevation: a ridge over azimuth.

    Notes
    -----
    Gamma at 10 GHz: flat land -20 dB, farmland and woods -15 dB, wooded hills -10 dB, cities 0 dB
    (Nathanson; Long); by the usual rule 5 log10(f / 10 GHz) dB more at f. The default is flat land
    at 77
    GHz, -15.6 dB. Roads of many kinds were measured at 94 GHz under grazing angles of 2 to 20 deg
    (Li
    and Sarabandi): choose a matching value.

    Patches do not fluctuate individually: if a cell of the radar contains some ten or more, their
    sum is Rayleigh distributed over cells by their random positions, as ground at 95 GHz is (Ulaby
    et al.). It is constant for a radar at rest, and changes as the radar moves on. Use the
    fluctuation swerling-1 if cells contain fewer. Shadowing by other bodies is neglected, and the
    steep rise within some degrees of the nadir.

    References
    ----------
    F. E. Nathanson, Radar Design Principles, 2nd ed. (1991), 7.
    M. W. Long, Radar Reflectivity of Land and Sea, 3rd ed. (2001).
    F. T. Ulaby et al., 95-GHz scattering by terrain at near-grazing incidence, IEEE Trans.
    Antennas Propag. 46 (1998) 3.
    E. S. Li, K. Sarabandi, Low grazing incidence millimeter-wave scattering models and
    measurements for various road surfaces, IEEE Trans. Antennas Propag. 47 (1999) 851.
    """

    near_m: float = 2.0
    """Start of the rectangle along x; it may be behind the origin."""
    far_m: float = 60.0
    """End of the rectangle along x."""
    width_m: float = 40.0
    """Width along y, half of it on each side."""
    n_patches: int = 2000
    """Number of scatterers."""
    gamma: float = 0.0277
    """Cross section per area at normal incidence, a ratio (dB in files)."""
    seed: int = 0
    """Seed of the positions, which are the same in every run."""

    def __post_init__(self) -> None:
        far_m = check_number("GroundClutter.far_m", self.far_m, at_least=-1e6, at_most=1e6)
        check_number("GroundClutter.near_m", self.near_m, at_least=-1e6)
        if self.near_m >= far_m:
            raise InvalidSetting(
                "GroundClutter.near_m",
                value=f"{self.near_m:.4g} m",
                expected=f"below far_m, {far_m:.4g} m",
                fix="exchange them, or move one of them",
            )
        check_positive_fields(self, "width_m", at_most=1e6)
        check_integer_fields(self, "n_patches", at_most=10_000_000)
        check_positive_fields(self, "gamma", at_least=1e-9, at_most=100.0)
        check_integer_fields(self, "seed", at_least=0)

    @property
    def is_rigid(self) -> bool:
        return True

    def n_scatterers(self) -> int:
        return self.n_patches

    def scatterer_offsets_m(self, times_s: np.ndarray) -> np.ndarray:
        """Return the centres of the patches at each time, (n_times, n_patches, 3)."""
        return np.repeat(self._patch_positions_m[None], len(times_s), axis=0)

    def cross_sections_towards_m2(self, radar_m: np.ndarray, wavelength_m: float) -> np.ndarray:
        """Return the mean cross section of each patch, (n_positions, n_patches).

        Raises
        ------
        InvalidSetting
            If the radar is not above the ground.
        """
        lowest_m = radar_m[:, 2].min()
        if lowest_m <= 0:
            raise InvalidSetting(
                "Target.position_m",
                value=f"a ground {0.0 - lowest_m:.4g} m above the radar",
                expected="a ground below the radar",
                fix="put the ground at z = -0.5 m for a radar in a bumper, or raise the radar"
                " (ego position)",
            )
        area_m2 = (self.far_m - self.near_m) * self.width_m / self.n_patches
        distances_m = np.linalg.norm(radar_m[:, None] - self._patch_positions_m, axis=-1)
        return np.asarray(self.gamma * area_m2 * radar_m[:, 2:] / distances_m)

    @cached_property
    def _patch_positions_m(self) -> np.ndarray:
        x, y = np.random.default_rng(self.seed).random((2, self.n_patches))
        x_m = self.near_m + x * (self.far_m - self.near_m)
        return np.stack([x_m, (y - 0.5) * self.width_m, np.zeros(self.n_patches)], axis=-1)
