"""Wall: an upright box with rough faces, such as a building, a barrier or a bridge deck."""

import math
from functools import cached_property
from typing import NamedTuple

import numpy as np

from dechirp.core.checks import check_non_negative_fields, check_positive_fields
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.scene.bodies.base import AspectBody
from dechirp.scene.bodies.flash import FLASH_SPACING_M, flash_shares

CONCRETE_REFLECTIVITY = 0.154
"""Power that concrete of the permittivity 5.24 (ITU-R P.2040) reflects at normal incidence."""
_SPACING_M, _LEVEL_SPACING_M = 1.0, 4.0  # of the points of a face, along it and in height
_SPECULAR_HEIGHT_M = 0.5  # of them above the base, that of a radar in a bumper
# Normals of the faces: front, left, rear, right.
_NORMALS = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])


class _Points(NamedTuple):
    """Points on the faces."""

    position_m: np.ndarray
    """(n, 3)."""
    face: np.ndarray
    """(n,): index of the face."""
    area_m2: np.ndarray
    """(n,): area that scatters diffusely; 0 for points that reflect like a mirror."""


@frozen_dataclass
class Wall(AspectBody):
    r"""Upright box with rough vertical faces; its origin is below the middle of the box.

    A face reflects the share R of the power, a part of it diffusely (effective roughness, Lambert's
    law). Seen at the angle :math:`\theta` from the normal, each area A of a face has the cross
    section

    .. math:: \sigma = 4 R S^2 A \cos^2 \theta

    The remaining share, 1 - S^2, is the mirror image of the radar: at the foot of the perpendicular
    at the distance d, one of the points 0.5 m apart along the face, at a height of 0.5 m, flashes:

    .. math:: \sigma = \pi d^2 R (1 - S^2)

    It is less beside the ends of the face, see `flash_shares`, and 0 above the upper edge. Faces
    that face away do not reflect, nor do top and bottom.

    Notes
    -----
    The default of R is concrete; brick has 0.108, glass 0.185, metal 1. S was measured as 0.2 to
    0.4 for buildings below 6 GHz; at 77 GHz it is an assumption. Windows, balconies and corners,
    which reflect back towards the radar, are not modelled.

    References
    ----------
    V. Degli-Esposti, F. Fuschini, E. M. Vitucci, G. Falciasecca, Measurement and modelling of
    scattering from buildings, IEEE Trans. Antennas Propag. 55 (2007) 143.
    Recommendation ITU-R P.2040-3 (2023), table 3.
    E. F. Knott, J. F. Shaeffer, M. T. Tuley, Radar Cross Section, 2nd ed. (2004), 5.
    """

    length_m: float
    """Length along x."""
    width_m: float
    """Width along y."""
    height_m: float
    """Height of the upper edge above the base."""
    reflectivity: float = CONCRETE_REFLECTIVITY
    """Share R of the power that is reflected at normal incidence."""
    scattering: float = 0.4
    """Amplitude share S that is scattered diffusely."""
    is_overhead: bool = False
    """True: waves also pass below the box, such as a bridge deck."""

    def __post_init__(self) -> None:
        check_positive_fields(self, "length_m", "width_m", at_least=1e-3, at_most=1e4)
        check_positive_fields(self, "height_m", at_least=1e-3, at_most=1e3)
        check_positive_fields(self, "reflectivity", at_most=1.0)
        check_non_negative_fields(self, "scattering", at_most=1.0)
        if not isinstance(self.is_overhead, bool):
            raise InvalidSetting(
                "Wall.is_overhead",
                value=self.is_overhead,
                expected="true or false",
                fix="set it to true for a box above the road",
            )

    @property
    def is_rigid(self) -> bool:
        return True

    @property
    def blocking_box_m(self) -> np.ndarray:
        x, y = self.length_m / 2, self.width_m / 2
        return np.array([[-x, -y, 0.0 if self.is_overhead else -np.inf], [x, y, self.height_m]])

    @property
    def side_reflectivity(self) -> float:
        """Return the share that is not scattered diffusely, R (1 - S^2)."""
        return self.reflectivity * (1 - self.scattering**2)

    def n_scatterers(self) -> int:
        return len(self._points.face)

    def scatterer_offsets_m(self, times_s: np.ndarray) -> np.ndarray:
        return np.repeat(self._points.position_m[None], len(times_s), axis=0)

    def cross_sections_towards_m2(self, radar_m: np.ndarray, wavelength_m: float) -> np.ndarray:
        points = self._points
        normals = _NORMALS[points.face]
        to_radar_m = radar_m[:, None] - points.position_m
        ahead_m = np.maximum((to_radar_m[..., :2] * normals).sum(axis=-1), 0.0)
        cosine = ahead_m / np.linalg.norm(to_radar_m, axis=-1)
        diffuse_m2 = 4 * self.scattering**2 * points.area_m2 * cosine**2
        mirror_m2 = math.pi * ahead_m**2 * (1 - self.scattering**2)
        mirror_m2 *= self._flash_shares(radar_m, ahead_m, wavelength_m)
        return np.asarray(self.reflectivity * (diffuse_m2 + mirror_m2))

    def _flash_shares(
        self, radar_m: np.ndarray, ahead_m: np.ndarray, wavelength_m: float
    ) -> np.ndarray:
        """Return the shares of all points in the mirror image of the radar, (n_positions, n)."""
        points = self._points
        shares = np.zeros_like(ahead_m)
        has_foot = (radar_m[:, 2] >= 0) & (radar_m[:, 2] <= self.height_m)
        for face, (x, y) in enumerate(_NORMALS.tolist()):
            rows = np.flatnonzero((points.face == face) & (points.area_m2 == 0))
            along = np.array([-y, x, 0.0])
            shares[:, rows] = has_foot[:, None] * flash_shares(
                points.position_m[rows] @ along,
                radar_m @ along,
                ahead_m[:, rows[0]],
                half_length_m=(self.width_m if x else self.length_m) / 2,
                wavelength_m=wavelength_m,
            )
        return shares

    @cached_property
    def _points(self) -> _Points:
        faces = []
        for face, (x, y) in enumerate(_NORMALS.tolist()):
            across_m, along_m = (
                (self.length_m, self.width_m) if x else (self.width_m, self.length_m)
            )
            columns_m, levels_m = (
                _cell_middles_m(size_m, spacing_m)
                for size_m, spacing_m in ((along_m, _SPACING_M), (self.height_m, _LEVEL_SPACING_M))
            )
            flash_m = _cell_middles_m(along_m, FLASH_SPACING_M) - along_m / 2
            place_m, level_m = np.meshgrid(columns_m - along_m / 2, levels_m, indexing="ij")
            place_m = np.concatenate([place_m.ravel(), flash_m])
            level_m = np.concatenate(
                [level_m.ravel(), np.full(len(flash_m), min(_SPECULAR_HEIGHT_M, self.height_m / 2))]
            )
            area_m2 = np.zeros(len(place_m))
            n_cells = len(place_m) - len(flash_m)
            area_m2[:n_cells] = along_m * self.height_m / n_cells
            position_m = np.stack(
                [x * across_m / 2 - y * place_m, y * across_m / 2 + x * place_m, level_m], axis=-1
            )
            faces.append(_Points(position_m, np.full(len(place_m), face), area_m2))
        return _Points(*(np.concatenate(arrays) for arrays in zip(*faces, strict=True)))


def _cell_middles_m(size_m: float, spacing_m: float) -> np.ndarray:
    """Return the middles of equal cells of about a spacing along a length from 0."""
    n = max(round(size_m / spacing_m), 1)
    return (np.arange(n) + 0.5) * size_m / n
