"""A surface from a file: what its parts reflect follows from rays."""

import math
from functools import cached_property
from typing import Literal, get_args

import numpy as np

from dechirp.core.checks import positive
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding
from dechirp.core.values import value
from dechirp.scene.bodies.base import AspectBody
from dechirp.scene.cells import Cells, cells_of
from dechirp.scene.mesh_files import MeshFile, read_mesh
from dechirp.scene.rays import Rays, echoes

Unit = Literal["m", "cm", "mm", "in"]

_SMALLEST_M = 0.01  # of a mesh; smaller, its unit is wrong
_LARGE_M = 30.0  # a lorry is 20 m long; a hand in millimetres is larger
# Of directions, over the main lobe of a plate as large as a cell: at 0.7 of its null the nearest
# one is off by 0.8 dB.
_STEPS = 40
# Directions of which results are kept, and bytes: of 2,000 cells 16 MB.
_KEPT, _KEPT_BYTES = 1024, 2**28


@value
class Mesh(AspectBody):
    """A perfectly conducting surface from an STL, OBJ or PLY file; needs the extra `mesh`.

    The surface is cut into cells, and each is a scatterer at the middle of what it holds. Rays
    tell what comes back from each: coherent within a cell, where its parts keep their phases, and
    with the phase of its middle between cells. A return of many bounces belongs to the cell
    nearest to where its path ends in range, and in cross range to the middle of its bounces: of a
    corner, its apex. The radar is taken to be in the far field of each cell, and to look at all
    of them in the direction of the origin: beyond some five times the size of the body.
    """

    path: str
    """STL, OBJ or PLY, at most 256 MiB and 2,000,000 triangles; x forward along the heading,
    y left, z up."""
    unit: Unit = "m"
    """Of the numbers in the file, which seldom says: m, cm, mm or in."""
    cell_size_m: float = 0.3
    """Edge of the cells: several wavelengths, and no more than a range bin or two."""
    rays: Rays = Rays()
    """Half a wavelength apart, at 77 GHz a car takes 2,000,000 for each new direction: seconds.
    Directions within lambda / (40 cell size), 0.02 deg, count as one."""

    def __post_init__(self) -> None:
        positive(self, "cell_size_m", at_least=1e-4, at_most=100.0)
        if self.unit not in get_args(Unit):
            need = f"one of {', '.join(get_args(Unit))}"
            raise InvalidSetting("Mesh.unit", got=repr(self.unit), need=need, fix="Choose one.")
        if not isinstance(self.path, str):
            need = "the path of a mesh, as a text"
            raise InvalidSetting("Mesh.path", got=repr(self.path), need=need, fix="Give one.")
        if not isinstance(self.rays, Rays):
            raise InvalidSetting("Mesh.rays", got=self.rays, need="Rays", fix="Leave it out.")
        _ = self._cells  # reads the file: its mistakes are told here

    def findings(self, setting: str) -> list[Finding]:
        """List what surprises in the file, under the path of the body's setting."""
        surface, n_degenerate, is_closed = self._file
        found = []
        if not is_closed:
            found.append(
                Finding(
                    level="warning",
                    setting=f"{setting}.path",
                    got=f"{self.path} is open: it has edges that do not belong to two triangles",
                    need="a closed surface, so that no ray sees the inside of it",
                    fix="Close it, or go on where it is thin sheets: both sides reflect.",
                )
            )
        if n_degenerate:
            found.append(
                Finding(
                    level="warning",
                    setting=f"{setting}.path",
                    got=f"{n_degenerate} triangles of {self.path} have no area",
                    need="triangles with an area",
                    fix="Go on: they are left out.",
                )
            )
        if surface.extent_m < _SMALLEST_M:
            found.append(
                Finding(
                    level="warning",
                    setting=f"{setting}.unit",
                    got=f"{self.path} is {surface.extent_m * 1e3:.3g} mm in size",
                    need=f"a body of at least {_SMALLEST_M * 1e3:g} mm, several wavelengths",
                    fix="Give the unit of its numbers.",
                )
            )
        elif surface.extent_m > _LARGE_M:
            found.append(
                Finding(
                    level="warning",
                    setting=f"{setting}.unit",
                    got=f"{self.path} is {surface.extent_m:.4g} m in size",
                    need=f"a body of at most {_LARGE_M:g} m, or the unit that its numbers are in",
                    fix="Give unit: mm where they are millimetres, or go on.",
                )
            )
        return found

    @property
    def is_rigid(self) -> bool:
        """No part moves."""
        return True

    def n_scatterers(self) -> int:
        """How many cells hold a part of the surface."""
        return len(self._cells.center_m)

    def n_rays(self, wavelength_m: float) -> int:
        """Rays of one direction, at most: as if it were as large from all sides as across its box.

        Each frame is seen from one, at its middle, and of a direction that was seen before what
        came back is known.
        """
        apart_m = self.rays.spacing_m or wavelength_m / 2
        return (math.ceil(self._file.surface.extent_m / apart_m) + 1) ** 2

    def offsets_m(self, times_s: np.ndarray) -> np.ndarray:
        """Middle of what each cell holds, the same at each time, (n_times, n_scatterers, 3)."""
        at_m = self._cells.center_m
        return np.broadcast_to(at_m, (len(times_s), *at_m.shape))

    def seen_from_m2(self, radar_m: np.ndarray, wavelength_m: float) -> np.ndarray:
        """Cross section of each cell, (n_places, n_scatterers), 0 where nothing comes back."""
        x, y, z = np.asarray(radar_m, dtype=float).T
        step_rad = wavelength_m / (_STEPS * self.cell_size_m)
        azimuth = np.rint(np.arctan2(y, x) / step_rad)
        elevation = np.rint(np.arctan2(z, np.hypot(x, y)) / step_rad)
        return np.array(
            [
                self._towards_m2(*direction, wavelength_m)
                for direction in zip(azimuth * step_rad, elevation * step_rad, strict=True)
            ]
        )

    def _towards_m2(
        self, azimuth_rad: float, elevation_rad: float, wavelength_m: float
    ) -> np.ndarray:
        asked = azimuth_rad, elevation_rad, wavelength_m
        if asked not in self._known:
            if len(self._known) >= min(_KEPT, _KEPT_BYTES // (8 * self.n_scatterers())):
                del self._known[next(iter(self._known))]
            self._known[asked] = self._traced_m2(*asked)
        return self._known[asked]

    def _traced_m2(
        self, azimuth_rad: float, elevation_rad: float, wavelength_m: float
    ) -> np.ndarray:
        level = np.cos(elevation_rad)
        towards = np.array(
            [level * np.cos(azimuth_rad), level * np.sin(azimuth_rad), np.sin(elevation_rad)]
        )
        field_m = np.zeros(self.n_scatterers(), dtype=complex)
        for echo in echoes(self._file.surface, towards, wavelength_m, self.rays):
            np.add.at(field_m, self._cells.of(echo.place_m), echo.field_m)
        return abs(field_m) ** 2

    @cached_property
    def _known(self) -> dict[tuple[float, float, float], np.ndarray]:
        return {}

    @cached_property
    def _file(self) -> MeshFile:
        return read_mesh(self.path, self.unit)

    @cached_property
    def _cells(self) -> Cells:
        return cells_of(self._file.surface.corners_m, self.cell_size_m)
