"""Mesh files: triangles from STL, OBJ and PLY, with checks of size and plausibility.

Files may be untrusted. Only the file itself is opened, not the materials of an OBJ or the textures
of a PLY.
"""

import io
import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.scene.rays import Surface, import_ray_tracer

FORMATS = ("stl", "obj", "ply")
UNITS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}

MAX_FILE_BYTES = 256 * 2**20
"""Largest file; a million triangles take 50 MB in binary STL."""
MAX_FACES = 2_000_000
MAX_EXTENT_M = 100.0
"""Largest mesh. A lorry is 20 m long; a hand in millimetres is larger than this limit."""

_PATH_SETTING = "Mesh.path"


class MeshFile(NamedTuple):
    """Content of a mesh file."""

    surface: Surface
    n_degenerate: int
    """Number of triangles without area, omitted from the surface."""
    is_closed: bool
    """True if each edge belongs to two triangles, including triangles without area."""


def read_mesh(path: str, unit: str = "m") -> MeshFile:
    """Read the triangles of an STL, OBJ or PLY file.

    Parameters
    ----------
    path : str
    unit : str
        Unit of its numbers: m, cm, mm or in.

    Raises
    ------
    InvalidSetting
        Named `Mesh.path` or `Mesh.unit`, with the file: if it is missing, too large, of another
        format, unreadable, contains no triangles, non-finite numbers, or a mesh larger than 100 m;
        if trimesh and embreex are not installed.
    """
    file_format = Path(path).suffix.lower().removeprefix(".")
    if file_format not in FORMATS:
        raise InvalidSetting(
            _PATH_SETTING,
            value=f"{path}, with an ending other than {', '.join('.' + f for f in FORMATS)}",
            expected="a mesh in STL, OBJ or PLY format",
            fix="convert it to one of these formats",
        )
    vertices_m, faces = _parse_vertices_and_faces(path, _read_mesh_bytes(Path(path)), file_format)
    vertices_m = vertices_m * UNITS_M[unit]
    _check_triangle_count_and_corners(path, vertices_m, faces)
    _check_mesh_extent(path, float(np.ptp(vertices_m[faces].reshape(-1, 3), axis=0).max()), unit)
    # Files of triangles repeat the vertices that neighbours share.
    trimesh, _ = import_ray_tracer()
    mesh = trimesh.Trimesh(vertices_m, faces, process=False)
    mesh.merge_vertices()
    a, b, c = np.asarray(mesh.faces).T
    mesh.update_faces((a != b) & (b != c) & (c != a))
    is_closed = bool(mesh.is_watertight)
    corners_m = vertices_m[faces]
    normals_m2 = np.cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0])
    area_m2 = np.linalg.norm(normals_m2, axis=1)
    # Relative to the rounding of single precision, in which most files are.
    has_area = area_m2 > 1e-14 * np.ptp(vertices_m, axis=0).max() ** 2
    if not has_area.any():
        raise InvalidSetting(
            _PATH_SETTING,
            value=f"{path}, with {len(faces)} triangles that all have no area",
            expected="triangles with an area",
            fix="export the mesh again",
        )
    surface = Surface(vertices_m, faces[has_area], name=path)
    return MeshFile(surface, int((~has_area).sum()), is_closed)


def _read_mesh_bytes(path: Path) -> bytes:
    try:
        if not path.exists():
            problem = "which does not exist"
        elif not path.is_file():
            problem = "which is not a file"
        elif path.stat().st_size > MAX_FILE_BYTES:
            problem = f"a file of {path.stat().st_size / 2**20:.0f} MiB"
        else:
            return path.read_bytes()
    except OSError as error:
        problem = f"which cannot be read: {error.strerror}"
    raise InvalidSetting(
        _PATH_SETTING,
        value=f"{path}, {problem}",
        expected=f"a mesh file of at most {MAX_FILE_BYTES / 2**20:.0f} MiB",
        fix="give the path of a mesh; in settings files it is relative to the file's folder",
    )


def _parse_vertices_and_faces(
    path: str, content: bytes, file_format: str
) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices (n, 3), in units of the file, and faces (m, 3)."""
    trimesh, _ = import_ray_tracer()
    source: Any = io.BytesIO(content)
    if file_format == "obj":  # its reader would guess the encoding with another library
        source = io.StringIO(content.decode("utf-8", errors="replace"))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            mesh = trimesh.load(
                source, file_type=file_format, force="mesh", process=False, skip_materials=True
            )
            vertices = np.array(mesh.vertices, dtype=float).reshape(-1, 3)
            return vertices, np.array(mesh.faces, dtype=np.int64).reshape(-1, 3)
    except Exception as error:  # readers raise many kinds of errors on broken files
        raise InvalidSetting(
            _PATH_SETTING,
            value=f"{path}, which cannot be read as {file_format.upper()}",
            expected=f"a file of the format of its ending, {file_format.upper()}",
            fix="export the mesh again, or correct the ending",
        ) from error


def _check_triangle_count_and_corners(path: str, vertices_m: np.ndarray, faces: np.ndarray) -> None:
    problem = ""
    if not len(faces):
        problem = "which is empty: it has no triangles"
    elif len(faces) > MAX_FACES:
        problem = f"which has {len(faces)} triangles"
    elif faces.min() < 0 or faces.max() >= len(vertices_m):
        problem = f"with triangles that refer to vertices beyond its {len(vertices_m)}"
    else:
        is_finite = (abs(vertices_m[faces]) < 1e12).all(axis=(1, 2))
        if not is_finite.all():
            problem = f"with {(~is_finite).sum()} triangles that have non-finite corners"
    if problem:
        raise InvalidSetting(
            _PATH_SETTING,
            value=f"{path}, {problem}",
            expected=f"a mesh of 1 to {MAX_FACES:.0e} triangles with finite coordinates",
            fix="export the mesh again",
        )


def _check_mesh_extent(path: str, extent_m: float, unit: str) -> None:
    if extent_m > MAX_EXTENT_M:
        raise InvalidSetting(
            "Mesh.unit",
            value=f"{unit}, with which {path} is {extent_m:.4g} m in size",
            expected=f"the unit of its numbers: bodies are at most {MAX_EXTENT_M:g} m large",
            fix=f"give unit: mm: it would be {extent_m / UNITS_M[unit] / 1e3:.4g} m"
            if unit != "mm"
            else "cut the mesh into parts",
        )
