"""Shooting and bouncing rays: how much a perfectly conducting surface sends back.

A plane wave is a grid of tubes, each a ray and the square about it. They bounce by geometrical
optics, and wherever one meets the surface its current radiates by physical optics.

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
from numpy.typing import ArrayLike

from dechirp.core.checks import count, numbers, positive
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value

MOST_RAYS = 100_000_000
"""For one direction; takes some two minutes."""

_AT_ONCE = 2**16  # rays; 1 kB each on the way
# Of the grid about the line of sight: rows at the slope of the golden section run along no edge,
# where a row too few would be 1.2 dB of a plate 13 rows wide.
_TURN_RAD = math.atan((math.sqrt(5) - 1) / 2)
# Below it, 1 deg from grazing, the footprint of a tube is longer than the facets it falls on.
_GRAZING = 0.02


@value
class Rays:
    """How a surface is sampled by rays."""

    spacing_m: float | None = None
    """Between neighbours. None: half a wavelength. Over the main lobes of a plate, a dihedral and
    a trihedral with edges of 26 wavelengths and of a sphere as wide in radius, errors are at most
    0.2 dB, of the sphere 0.4 dB; a wavelength apart 0.3 and 0.7 dB; two apart 0.5 and 2 dB."""
    n_bounces: int = 3
    """Most of one ray: 1 for a convex surface, 3 for trihedrals."""
    polarisation: Literal["vertical", "horizontal"] = "vertical"
    """Of the antennas, sent and received: with the z axis, or across it."""

    def __post_init__(self) -> None:
        if self.spacing_m is not None:
            positive(self, "spacing_m", at_most=1e3)
        count(self, "n_bounces", at_most=20)
        if self.polarisation not in ("vertical", "horizontal"):
            raise InvalidSetting(
                "Rays.polarisation",
                got=repr(self.polarisation),
                need="vertical or horizontal",
                fix="Choose one.",
            )


@dataclass(frozen=True, eq=False)
class Surface:
    """Flat triangles that conduct perfectly, on both sides; `scene.mesh_files` reads them."""

    vertices_m: np.ndarray
    """(n_vertices, 3)."""
    faces: np.ndarray
    """Places of three vertices each, (n_faces, 3); their area is above 0."""
    name: str = "the surface"
    """How errors call it."""

    @cached_property
    def corners_m(self) -> np.ndarray:
        """Of each face, (n_faces, 3, 3)."""
        return np.asarray(self.vertices_m, dtype=float)[np.asarray(self.faces)]

    @cached_property
    def normals(self) -> np.ndarray:
        """Unit vectors, (n_faces, 3)."""
        a, b, c = np.moveaxis(self.corners_m, 1, 0)
        across = np.cross(b - a, c - a)
        return across / np.linalg.norm(across, axis=1, keepdims=True)

    @cached_property
    def extent_m(self) -> float:
        """Diagonal of its box, m."""
        return float(np.linalg.norm(np.ptp(self.corners_m.reshape(-1, 3), axis=0)))

    def first_hit(self, origins_m: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """Place of the face that each ray meets first, -1 where there is none, (n_rays,)."""
        if not len(origins_m):
            return np.empty(0, dtype=np.int64)
        return np.asarray(self._embree.intersects_first(origins_m, directions))

    def __reduce__(self) -> tuple[object, ...]:
        # What the engine built cannot go to another process, and is built again there.
        return Surface, (self.vertices_m, self.faces, self.name)

    @cached_property
    def _embree(self) -> Any:
        trimesh, embree = tracing()
        mesh = trimesh.Trimesh(self.vertices_m, self.faces, process=False)
        return embree.RayMeshIntersector(mesh)


class Echoes(NamedTuple):
    """What tubes send back at one of their bounces."""

    field_m: np.ndarray
    """Complex, (n,): squared, the sum of all is the cross section; phase at the origin 0."""
    place_m: np.ndarray
    """Where each comes from, (n, 3): at half the length of its path, across the line of sight
    in the middle between its first and its last bounce."""


class _Tubes(NamedTuple):
    """Rays under way, and the parallelograms across them."""

    at_m: np.ndarray
    """(n, 3)."""
    direction: np.ndarray
    """(n, 3)."""
    path_m: np.ndarray
    """Come so far, from the wave front through the origin, (n,)."""
    field: np.ndarray
    """Direction of the electric field, (n, 3)."""
    sides_m: tuple[np.ndarray, np.ndarray]
    """Each (n, 3)."""
    first_m: np.ndarray
    """Of the first bounce, (n, 3); as `at_m` before it."""
    face: np.ndarray
    """Which it comes from, (n,); -1 for none."""

    def some(self, chosen: np.ndarray) -> "_Tubes":
        a_m, b_m = self.sides_m
        return _Tubes(
            self.at_m[chosen],
            self.direction[chosen],
            self.path_m[chosen],
            self.field[chosen],
            (a_m[chosen], b_m[chosen]),
            self.first_m[chosen],
            self.face[chosen],
        )


def tracing() -> tuple[Any, Any]:
    """`trimesh`, and its rays by embree; raise `InvalidSetting` where they are not installed."""
    try:
        import trimesh
        from trimesh.ray import ray_pyembree
    except ImportError as error:
        raise InvalidSetting(
            "Mesh.path",
            got=f"a mesh, while {error.name or 'embreex'} is not installed",
            need="traced by trimesh and embreex",
            fix="Run pip install 'dechirp[mesh]'.",
        ) from None
    return trimesh, ray_pyembree


def rcs_m2(
    surface: Surface, towards: ArrayLike, wavelength_m: float, rays: Rays | None = None
) -> np.ndarray:
    """Monostatic radar cross section of a perfectly conducting surface.

    Parameters
    ----------
    surface : Surface
    towards : array (..., 3)
        Directions from it to the radar, of any length. The radar is in the far field.
    wavelength_m : float
    rays : Rays, optional

    Returns
    -------
    array (...), m^2
        Co-polar, from the coherent sum over all tubes. Edges do not diffract, and what creeps
        round is missing: it holds near speculars and returns of corners, not in nulls.

    Raises
    ------
    InvalidSetting
        If a direction is no direction, or more than 1e8 rays would be needed.
    """
    directions = numbers("towards", towards)
    flat = directions.reshape(-1, 3)
    sums = [
        sum(complex(part.field_m.sum()) for part in echoes(surface, one, wavelength_m, rays))
        for one in flat
    ]
    return abs(np.array(sums)).reshape(directions.shape[:-1]) ** 2


def echoes(
    surface: Surface, towards: np.ndarray, wavelength_m: float, rays: Rays | None = None
) -> Iterator[Echoes]:
    """Trace the tubes from one direction: what they send back, in parts, as for `rcs_m2`."""
    rays = rays or Rays()
    length = float(np.linalg.norm(towards))
    if not length > 0:
        raise InvalidSetting(
            "towards",
            got=np.asarray(towards).tolist(),
            need="a direction",
            fix="Place the radar outside of what it looks at.",
        )
    towards = np.asarray(towards, dtype=float) / length
    spacing_m = wavelength_m / 2 if rays.spacing_m is None else rays.spacing_m
    field = _polarisation(towards, rays.polarisation)
    for tubes in _launched(surface, towards, field, spacing_m):
        for bounce in range(rays.n_bounces):
            echo, tubes = _bounced(surface, tubes, towards, field, wavelength_m, bounce)  # noqa: PLW2901
            yield echo._replace(field_m=echo.field_m * spacing_m**2)
            if not len(tubes.face):
                break


def _polarisation(towards: np.ndarray, polarisation: str) -> np.ndarray:
    level = np.cross((0.0, 0.0, 1.0), towards)
    if np.linalg.norm(level) < 1e-9:  # from above, vertical is along x
        level = np.array((0.0, 1.0, 0.0))
    level /= np.linalg.norm(level)
    return level if polarisation == "horizontal" else np.cross(towards, level)


def _launched(
    surface: Surface, towards: np.ndarray, field: np.ndarray, spacing_m: float
) -> Iterator[_Tubes]:
    """Tubes of a plane wave that covers the surface, some at a time."""
    across = np.cross(towards, field)
    u = math.cos(_TURN_RAD) * field + math.sin(_TURN_RAD) * across
    axes = np.array([u, np.cross(towards, u), towards])
    seen_m = axes @ surface.corners_m.reshape(-1, 3).T
    low_m, high_m = seen_m.min(axis=1), seen_m.max(axis=1)
    n_u, n_v = (math.ceil(size_m / spacing_m) + 1 for size_m in (high_m - low_m)[:2].tolist())
    _must_be_few(surface, n_u, n_v, spacing_m)
    front_m = high_m[2] + surface.extent_m / 10
    middle_u_m, middle_v_m = ((low_m + high_m) / 2)[:2]
    for start in range(0, n_u * n_v, _AT_ONCE):
        row, column = np.divmod(np.arange(start, min(start + _AT_ONCE, n_u * n_v)), n_u)
        u_m = middle_u_m + spacing_m * (column - (n_u - 1) / 2)
        v_m = middle_v_m + spacing_m * (row - (n_v - 1) / 2)
        at_m = np.stack([u_m, v_m, np.full(len(row), front_m)], axis=1) @ axes

        def same(vector: np.ndarray, n: int = len(row)) -> np.ndarray:
            return np.broadcast_to(vector, (n, 3))

        yield _Tubes(
            at_m,
            same(-towards),
            np.full(len(row), -front_m),
            same(field),
            (same(spacing_m * axes[0]), same(spacing_m * axes[1])),
            at_m,
            np.full(len(row), -1),
        )


def _must_be_few(surface: Surface, n_u: int, n_v: int, spacing_m: float) -> None:
    if n_u * n_v > MOST_RAYS:
        raise InvalidSetting(
            "Rays.spacing_m",
            got=f"a spacing of {spacing_m * 1e3:.3g} mm between rays, which takes"
            f" {n_u * n_v:.2g} rays to cover {surface.name}, {surface.extent_m:.4g} m in size",
            need=f"wide enough for {MOST_RAYS:.0e} rays from one direction",
            fix="Space the rays wider, cut the mesh into parts, or check its unit.",
        )


def _bounced(
    surface: Surface,
    tubes: _Tubes,
    towards: np.ndarray,
    field: np.ndarray,
    wavelength_m: float,
    bounce: int,
) -> tuple[Echoes, _Tubes]:
    """What tubes send back from where they meet the surface next, and tubes as they go on."""
    hit = surface.first_hit(tubes.at_m, tubes.direction)
    met = (hit >= 0) & (hit != tubes.face)  # a flat face is not met twice
    tubes, face = tubes.some(met), hit[met]
    normal = surface.normals[face]
    steep = _dot(normal, tubes.direction)
    normal, steep = np.where(steep[:, None] > 0, -normal, normal), -abs(steep)
    steep = np.minimum(steep, -1e-12)
    # The engine's floats have 24 bits: it tells the face, the place follows in double precision.
    way_m = _dot(surface.corners_m[face, 0] - tubes.at_m, normal) / steep
    at_m = tubes.at_m + way_m[:, None] * tubes.direction
    path_m = tubes.path_m + way_m
    first_m = at_m if bounce == 0 else tubes.first_m

    seen = normal @ towards > 0
    off_m = at_m + 1e-6 * surface.extent_m * normal
    if bounce:
        asked = np.flatnonzero(seen)
        back = np.broadcast_to(towards, (len(asked), 3))
        seen[asked] = surface.first_hit(off_m[asked], back) < 0
    # 2 n x H, H of the tube's own wave, over its footprint: the cosine of incidence cancels.
    current = tubes.field @ field - _dot(normal, tubes.field) * (
        tubes.direction @ field
    ) / np.minimum(steep, -_GRAZING)
    turn = 2 * np.pi / wavelength_m
    gradient = turn * (tubes.direction - towards)
    for side_m in tubes.sides_m:
        foot_m = side_m - (_dot(normal, side_m) / steep)[:, None] * tubes.direction
        current *= np.sinc(_dot(gradient, foot_m) / (2 * np.pi))
    round_m = path_m - at_m @ towards
    size = math.sqrt(4 * math.pi) / wavelength_m
    middle_m = (first_m + at_m) / 2
    depth_m = round_m / 2 + middle_m @ towards
    echo = Echoes(
        (size * current * np.exp(-1j * turn * round_m))[seen],
        (middle_m - depth_m[:, None] * towards)[seen],
    )

    def mirrored(vectors: np.ndarray) -> np.ndarray:
        return vectors - 2 * _dot(normal, vectors)[:, None] * normal

    a_m, b_m = tubes.sides_m
    return echo, _Tubes(
        off_m,
        mirrored(tubes.direction),
        path_m,
        -mirrored(tubes.field),
        (mirrored(a_m), mirrored(b_m)),
        first_m,
        face,
    )


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("ij,ij->i", a, b)
