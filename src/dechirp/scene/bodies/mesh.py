"""Mesh body: a surface from a file, with cross sections from ray tracing."""

import math
from functools import cached_property
from typing import Literal, get_args

import numpy as np

from dechirp.core.checks import check_positive_fields
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding
from dechirp.core.values import frozen_dataclass
from dechirp.scene.bodies.base import AspectBody
from dechirp.scene.mesh_files import MeshFile, read_mesh
from dechirp.scene.rays import Rays, trace_bounce_echoes
from dechirp.scene.voxels import SurfaceCells, cut_triangles_into_cells

Unit = Literal["m", "cm", "mm", "in"]

_MIN_EXTENT_M = 0.01  # of a mesh; a smaller extent indicates a wrong unit
_MAX_USUAL_EXTENT_M = 30.0  # a lorry is 20 m long; a hand in millimetres is larger
# Directions over the main lobe of a plate as large as a cell: at 0.7 of its null, the nearest one
# errs by 0.8 dB.
_STEPS_PER_LOBE = 40
# Cached directions, and bytes: 16 MB for 2,000 cells.
_MAX_CACHED_DIRECTIONS, _MAX_CACHED_BYTES = 1024, 2**28


@frozen_dataclass
class Mesh(AspectBody):
    """Perfectly conducting surface from an STL, OBJ or PLY file; needs the extra `mesh`.

    The surface is cut into cells, each a scatterer at the centre of its area. Ray tracing yields
    the echo of each cell: coherent within a cell, where the parts keep their phases, and with the
    phase of its centre between cells. A return of several bounces belongs to the cell nearest to
    the end of its path in range, and in cross range to the middle of its bounces: of a corner, its
    apex. The radar is assumed to be in the far field of each cell, and in the same direction from
    all of them: beyond some five times the size of the body.
    """

    path: str
    """STL, OBJ or PLY file, at most 256 MiB and 2,000,000 triangles; x forward along the
    heading, y left, z up."""
    unit: Unit = "m"
    """Unit of the numbers in the file, which files seldom specify: m, cm, mm or in."""
    cell_size_m: float = 0.3
    """Edge of the cells: several wavelengths, and at most a range bin or two."""
    rays: Rays = Rays()
    """Ray sampling. With half a wavelength at 77 GHz, a car needs 2,000,000 rays for each new
    direction: seconds. Directions within lambda / (40 cell size), 0.02 deg, share a result."""

    def __post_init__(self) -> None:
        check_positive_fields(self, "cell_size_m", at_least=1e-4, at_most=100.0)
        if self.unit not in get_args(Unit):
            expected = f"one of {', '.join(get_args(Unit))}"
            raise InvalidSetting(
                "Mesh.unit", value=repr(self.unit), expected=expected, fix="choose one"
            )
        if not isinstance(self.path, str):
            expected = "the path of a mesh, as a string"
            raise InvalidSetting(
                "Mesh.path", value=repr(self.path), expected=expected, fix="give one"
            )
        if not isinstance(self.rays, Rays):
            raise InvalidSetting("Mesh.rays", value=self.rays, expected="Rays", fix="leave it out")
        _ = self._surface_cells  # reads the file, to raise its errors here

    def unusual_property_findings(self, setting: str) -> list[Finding]:
        surface, n_degenerate, is_closed = self._mesh_file
        findings = []
        if not is_closed:
            findings.append(
                Finding(
                    level="warning",
                    setting=f"{setting}.path",
                    value=f"{self.path} is open: it has edges that do not belong to two triangles",
                    expected="a closed surface, so that no ray enters it",
                    fix="close it, or accept it for thin sheets: both sides reflect",
                )
            )
        if n_degenerate:
            findings.append(
                Finding(
                    level="warning",
                    setting=f"{setting}.path",
                    value=f"{n_degenerate} triangles of {self.path} have no area",
                    expected="triangles with an area",
                    fix="no action needed: they are omitted",
                )
            )
        if surface.extent_m < _MIN_EXTENT_M:
            findings.append(
                Finding(
                    level="warning",
                    setting=f"{setting}.unit",
                    value=f"{self.path} is {surface.extent_m * 1e3:.3g} mm in size",
                    expected=f"a body of at least {_MIN_EXTENT_M * 1e3:g} mm, several wavelengths",
                    fix="give the unit of its numbers",
                )
            )
        elif surface.extent_m > _MAX_USUAL_EXTENT_M:
            findings.append(
                Finding(
                    level="warning",
                    setting=f"{setting}.unit",
                    value=f"{self.path} is {surface.extent_m:.4g} m in size",
                    expected=f"a body of at most {_MAX_USUAL_EXTENT_M:g} m",
                    fix="set unit to mm if its numbers are millimetres, or accept the size",
                )
            )
        return findings

    @property
    def is_rigid(self) -> bool:
        return True

    @property
    def blocking_box_m(self) -> np.ndarray:
        corners_m = self._mesh_file.surface.corners_m
        return np.stack([corners_m.min(axis=(0, 1)), corners_m.max(axis=(0, 1))])

    def n_scatterers(self) -> int:
        return len(self._surface_cells.centres_m)

    def max_rays_per_direction(self, wavelength_m: float) -> int:
        """Return a bound on the rays of one direction, from the diagonal of the bounding box.

        Each frame has one direction, at its middle; results of earlier directions are cached.
        """
        spacing_m = self.rays.spacing_m or wavelength_m / 2
        return (math.ceil(self._mesh_file.surface.extent_m / spacing_m) + 1) ** 2

    def scatterer_offsets_m(self, times_s: np.ndarray) -> np.ndarray:
        centres_m = self._surface_cells.centres_m
        return np.broadcast_to(centres_m, (len(times_s), *centres_m.shape))

    def cross_sections_towards_m2(self, radar_m: np.ndarray, wavelength_m: float) -> np.ndarray:
        x, y, z = np.asarray(radar_m, dtype=float).T
        step_rad = wavelength_m / (_STEPS_PER_LOBE * self.cell_size_m)
        azimuth = np.rint(np.arctan2(y, x) / step_rad)
        elevation = np.rint(np.arctan2(z, np.hypot(x, y)) / step_rad)
        return np.array(
            [
                self._cached_cross_sections_m2(*direction, wavelength_m)
                for direction in zip(azimuth * step_rad, elevation * step_rad, strict=True)
            ]
        )

    def _cached_cross_sections_m2(
        self, azimuth_rad: float, elevation_rad: float, wavelength_m: float
    ) -> np.ndarray:
        key = azimuth_rad, elevation_rad, wavelength_m
        if key not in self._cross_section_cache:
            if len(self._cross_section_cache) >= min(
                _MAX_CACHED_DIRECTIONS, _MAX_CACHED_BYTES // (8 * self.n_scatterers())
            ):
                del self._cross_section_cache[next(iter(self._cross_section_cache))]
            self._cross_section_cache[key] = self._trace_cross_sections_m2(*key)
        return self._cross_section_cache[key]

    def _trace_cross_sections_m2(
        self, azimuth_rad: float, elevation_rad: float, wavelength_m: float
    ) -> np.ndarray:
        cos_elevation = np.cos(elevation_rad)
        towards = np.array(
            [
                cos_elevation * np.cos(azimuth_rad),
                cos_elevation * np.sin(azimuth_rad),
                np.sin(elevation_rad),
            ]
        )
        field_m = np.zeros(self.n_scatterers(), dtype=complex)
        for echo in trace_bounce_echoes(self._mesh_file.surface, towards, wavelength_m, self.rays):
            np.add.at(field_m, self._surface_cells.find_cells(echo.position_m), echo.field_m)
        return abs(field_m) ** 2

    @cached_property
    def _cross_section_cache(self) -> dict[tuple[float, float, float], np.ndarray]:
        return {}

    @cached_property
    def _mesh_file(self) -> MeshFile:
        return read_mesh(self.path, self.unit)

    @cached_property
    def _surface_cells(self) -> SurfaceCells:
        return cut_triangles_into_cells(self._mesh_file.surface.corners_m, self.cell_size_m)
