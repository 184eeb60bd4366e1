"""Shooting and bouncing rays: cross section of a perfectly conducting surface.

A plane wave is a grid of tubes, each a ray and the square around it. They bounce by geometrical
optics, and at each point of incidence the surface current radiates by physical optics.

H. Ling, R.-C. Chou and S.-W. Lee, "Shooting and bouncing rays", IEEE Trans. Antennas Propag.
37 (1989), 194. Currents at all bounces rather than at the last: F. Weinmann, "Ray tracing with
PO/PTD for RCS modeling of large complex objects", IEEE Trans. Antennas Propag. 54 (2006), 1797.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np

from dechirp.core.checks import check_integer_fields, check_positive_fields
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass

MAX_RAYS = 100_000_000
"""Largest number of rays for one direction, which takes about two minutes."""

_BLOCK_RAYS = 2**16  # rays; 1 kB each while traced
# Rotation of the ray grid about the line of sight: rows at the slope of the golden section are
# parallel to no edge, where a missing row would cost 1.2 dB of a plate 13 rows wide.
_GRID_ROTATION_RAD = math.atan((math.sqrt(5) - 1) / 2)
# Below it, 1 deg from grazing, the footprint of a tube is longer than the facets it falls on.
_MIN_INCIDENCE_COSINE = 0.02


@frozen_dataclass
class Rays:
    """Ray sampling of a surface."""

    spacing_m: float | None = None
    """Spacing of neighbouring rays. Unset: half a wavelength. Over the main lobes of a plate, a
    dihedral and a trihedral with edges of 26 wavelengths and of a sphere with such a radius,
    errors are at most 0.2 dB, of the sphere 0.4 dB; at one wavelength 0.3 and 0.7 dB; at two 0.5
    and 2 dB."""
    n_bounces: int = 3
    """Largest number of bounces of a ray: 1 for a convex surface, 3 for trihedrals."""
    polarisation: Literal["vertical", "horizontal"] = "vertical"
    """Polarisation of the transmit and receive antennas: along the z axis, or across it."""

    def __post_init__(self) -> None:
        if self.spacing_m is not None:
            check_positive_fields(self, "spacing_m", at_most=1e3)
        check_integer_fields(self, "n_bounces", at_most=20)
        if self.polarisation not in ("vertical", "horizontal"):
            raise InvalidSetting(
                "Rays.polarisation",
                value=repr(self.polarisation),
                expected="vertical or horizontal",
                fix="choose one",
            )


@dataclass(frozen=True, eq=False)
class Surface:
    """Flat triangles that conduct perfectly, on both sides; `scene.mesh_files` reads them."""

    vertices_m: np.ndarray
    """(n_vertices, 3)."""
    faces: np.ndarray
    """Indices of three vertices each, (n_faces, 3); their area is above 0."""
    name: str = "the surface"
    """Name in error messages."""

    @cached_property
    def corners_m(self) -> np.ndarray:
        """Return the corners of each face, (n_faces, 3, 3)."""
        return np.asarray(self.vertices_m, dtype=float)[np.asarray(self.faces)]

    @cached_property
    def normals(self) -> np.ndarray:
        """Return the unit normals, (n_faces, 3)."""
        a, b, c = np.moveaxis(self.corners_m, 1, 0)
        across = np.cross(b - a, c - a)
        return across / np.linalg.norm(across, axis=1, keepdims=True)

    @cached_property
    def extent_m(self) -> float:
        """Return the diagonal of the bounding box, m."""
        return float(np.linalg.norm(np.ptp(self.corners_m.reshape(-1, 3), axis=0)))

    def find_first_hit_face_indices(
        self, origins_m: np.ndarray, directions: np.ndarray
    ) -> np.ndarray:
        """Return the index of the face that each ray hits first, -1 for none, (n_rays,)."""
        if not len(origins_m):
            return np.empty(0, dtype=np.int64)
        return np.asarray(self._intersector.intersects_first(origins_m, directions))

    def __reduce__(self) -> tuple[object, ...]:
        # The intersector of the ray engine cannot be pickled, and is rebuilt in another process.
        return Surface, (self.vertices_m, self.faces, self.name)

    @cached_property
    def _intersector(self) -> Any:
        trimesh, embree = import_ray_tracer()
        mesh = trimesh.Trimesh(self.vertices_m, self.faces, process=False)
        return embree.RayMeshIntersector(mesh)


class BounceEchoes(NamedTuple):
    """Echoes of tubes at one of their bounces."""

    field_m: np.ndarray
    """Complex, (n,): the cross section is the squared magnitude of the sum; phase 0 at the
    origin."""
    position_m: np.ndarray
    """Apparent origin of each echo, (n, 3): at half the length of its path, and in cross range
    in the middle between its first and its last bounce."""


class _RayTubes(NamedTuple):
    """Propagating rays, and the parallelograms across them."""

    position_m: np.ndarray
    """(n, 3)."""
    direction: np.ndarray
    """(n, 3)."""
    path_m: np.ndarray
    """Path length from the wave front through the origin, (n,)."""
    field: np.ndarray
    """Direction of the electric field, (n, 3)."""
    sides_m: tuple[np.ndarray, np.ndarray]
    """Each (n, 3)."""
    first_m: np.ndarray
    """Position of the first bounce, (n, 3); before it, that of the ray."""
    last_face: np.ndarray
    """Face of the last bounce, (n,); -1 for none."""

    def select_tubes(self, selected: np.ndarray) -> "_RayTubes":
        a_m, b_m = self.sides_m
        return _RayTubes(
            self.position_m[selected],
            self.direction[selected],
            self.path_m[selected],
            self.field[selected],
            (a_m[selected], b_m[selected]),
            self.first_m[selected],
            self.last_face[selected],
        )


def import_ray_tracer() -> tuple[Any, Any]:
    """Return `trimesh` and its embree rays; raise `InvalidSetting` if not installed."""
    try:
        import trimesh
        from trimesh.ray import ray_pyembree
    except ImportError as error:
        raise InvalidSetting(
            "Mesh.path",
            value=f"a mesh, but {error.name or 'embreex'} is not installed",
            expected="the packages trimesh and embreex",
            fix="run pip install 'dechirp[mesh]'",
        ) from None
    return trimesh, ray_pyembree


def trace_bounce_echoes(
    surface: Surface, towards: np.ndarray, wavelength_m: float, rays: Rays | None = None
) -> Iterator[BounceEchoes]:
    """Trace the tubes from one direction, and yield their echoes at each bounce."""
    rays = rays or Rays()
    length = float(np.linalg.norm(towards))
    if not length > 0:
        raise InvalidSetting(
            "towards",
            value=np.asarray(towards).tolist(),
            expected="a vector of positive length",
            fix="move the radar out of the body",
        )
    towards = np.asarray(towards, dtype=float) / length
    spacing_m = wavelength_m / 2 if rays.spacing_m is None else rays.spacing_m
    field = _polarisation_vector(towards, rays.polarisation)
    for tubes in _launch_ray_tubes(surface, towards, field, spacing_m):
        for bounce in range(rays.n_bounces):
            echo, tubes = _bounce_ray_tubes_with_echoes(  # noqa: PLW2901
                surface, tubes, towards, field, wavelength_m, bounce
            )
            yield echo._replace(field_m=echo.field_m * spacing_m**2)
            if not len(tubes.last_face):
                break


def _polarisation_vector(towards: np.ndarray, polarisation: str) -> np.ndarray:
    level = np.cross((0.0, 0.0, 1.0), towards)
    if np.linalg.norm(level) < 1e-9:  # seen from above, vertical polarisation is along x
        level = np.array((0.0, 1.0, 0.0))
    level /= np.linalg.norm(level)
    return level if polarisation == "horizontal" else np.cross(towards, level)


def _launch_ray_tubes(
    surface: Surface, towards: np.ndarray, field: np.ndarray, spacing_m: float
) -> Iterator[_RayTubes]:
    """Yield the tubes of a plane wave that covers the surface, in blocks."""
    perpendicular = np.cross(towards, field)
    u = math.cos(_GRID_ROTATION_RAD) * field + math.sin(_GRID_ROTATION_RAD) * perpendicular
    axes = np.array([u, np.cross(towards, u), towards])
    projected_m = axes @ surface.corners_m.reshape(-1, 3).T
    low_m, high_m = projected_m.min(axis=1), projected_m.max(axis=1)
    n_u, n_v = (math.ceil(size_m / spacing_m) + 1 for size_m in (high_m - low_m)[:2].tolist())
    _check_ray_count(surface, n_u, n_v, spacing_m)
    front_m = high_m[2] + surface.extent_m / 10
    middle_u_m, middle_v_m = ((low_m + high_m) / 2)[:2]
    for start in range(0, n_u * n_v, _BLOCK_RAYS):
        row, column = np.divmod(np.arange(start, min(start + _BLOCK_RAYS, n_u * n_v)), n_u)
        u_m = middle_u_m + spacing_m * (column - (n_u - 1) / 2)
        v_m = middle_v_m + spacing_m * (row - (n_v - 1) / 2)
        at_m = np.stack([u_m, v_m, np.full(len(row), front_m)], axis=1) @ axes

        def repeat_vector(vector: np.ndarray, n: int = len(row)) -> np.ndarray:
            return np.broadcast_to(vector, (n, 3))

        yield _RayTubes(
            at_m,
            repeat_vector(-towards),
            np.full(len(row), -front_m),
            repeat_vector(field),
            (repeat_vector(spacing_m * axes[0]), repeat_vector(spacing_m * axes[1])),
            at_m,
            np.full(len(row), -1),
        )


def _check_ray_count(surface: Surface, n_u: int, n_v: int, spacing_m: float) -> None:
    if n_u * n_v > MAX_RAYS:
        raise InvalidSetting(
            "Rays.spacing_m",
            value=f"a spacing of {spacing_m * 1e3:.3g} mm, which requires"
            f" {n_u * n_v:.2g} rays to cover {surface.name}, {surface.extent_m:.4g} m in size",
            expected=f"at most {MAX_RAYS:.0e} rays from one direction",
            fix="increase the spacing, cut the mesh into parts, or check its unit",
        )


def _bounce_ray_tubes_with_echoes(
    surface: Surface,
    tubes: _RayTubes,
    towards: np.ndarray,
    field: np.ndarray,
    wavelength_m: float,
    bounce: int,
) -> tuple[BounceEchoes, _RayTubes]:
    """Return the echoes of tubes at their next hit of the surface, and the reflected tubes."""
    hit = surface.find_first_hit_face_indices(tubes.position_m, tubes.direction)
    is_hit = (hit >= 0) & (hit != tubes.last_face)  # a flat face is not hit twice in succession
    tubes, face = tubes.select_tubes(is_hit), hit[is_hit]
    normal = surface.normals[face]
    cosines = _dot_by_row(normal, tubes.direction)
    normal, cosines = np.where(cosines[:, None] > 0, -normal, normal), -abs(cosines)
    cosines = np.minimum(cosines, -1e-12)
    # The engine's floats have 24 bits: it yields the face, the position follows in double
    # precision.
    distance_m = _dot_by_row(surface.corners_m[face, 0] - tubes.position_m, normal) / cosines
    at_m = tubes.position_m + distance_m[:, None] * tubes.direction
    path_m = tubes.path_m + distance_m
    first_m = at_m if bounce == 0 else tubes.first_m

    is_visible = normal @ towards > 0
    start_m = at_m + 1e-6 * surface.extent_m * normal
    if bounce:
        candidates = np.flatnonzero(is_visible)
        return_directions = np.broadcast_to(towards, (len(candidates), 3))
        is_visible[candidates] = (
            surface.find_first_hit_face_indices(start_m[candidates], return_directions) < 0
        )
    # 2 n x H, with H of the tube's wave, over its footprint: the cosine of incidence cancels.
    current = tubes.field @ field - _dot_by_row(normal, tubes.field) * (
        tubes.direction @ field
    ) / np.minimum(cosines, -_MIN_INCIDENCE_COSINE)
    wavenumber = 2 * np.pi / wavelength_m
    gradient = wavenumber * (tubes.direction - towards)
    for side_m in tubes.sides_m:
        footprint_m = side_m - (_dot_by_row(normal, side_m) / cosines)[:, None] * tubes.direction
        current *= np.sinc(_dot_by_row(gradient, footprint_m) / (2 * np.pi))
    round_trip_m = path_m - at_m @ towards
    size = math.sqrt(4 * math.pi) / wavelength_m
    middle_m = (first_m + at_m) / 2
    depth_m = round_trip_m / 2 + middle_m @ towards
    echo = BounceEchoes(
        (size * current * np.exp(-1j * wavenumber * round_trip_m))[is_visible],
        (middle_m - depth_m[:, None] * towards)[is_visible],
    )

    def mirror(vectors: np.ndarray) -> np.ndarray:
        return vectors - 2 * _dot_by_row(normal, vectors)[:, None] * normal

    a_m, b_m = tubes.sides_m
    return echo, _RayTubes(
        start_m,
        mirror(tubes.direction),
        path_m,
        -mirror(tubes.field),
        (mirror(a_m), mirror(b_m)),
        first_m,
        face,
    )


def _dot_by_row(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("ij,ij->i", a, b)
