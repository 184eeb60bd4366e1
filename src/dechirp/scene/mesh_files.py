"""Meshes from files: STL, OBJ and PLY, only their triangles, and only ones that can be meant.

Files may come from anywhere. Nothing beside the file itself is opened: not the materials of an
OBJ, not the textures of a PLY.
"""

import io
import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.scene.rays import Surface, tracing

FORMATS = ("stl", "obj", "ply")
UNITS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}

MOST_BYTES = 256 * 2**20
"""Of a file; a million triangles take 50 MB in binary STL."""
MOST_FACES = 2_000_000
LARGEST_M = 100.0
"""A lorry is 20 m long; in millimetres a hand is already larger."""

_WHERE = "Mesh.path"


class MeshFile(NamedTuple):
    """What a file holds."""

    surface: Surface
    n_degenerate: int
    """Triangles without area, left out of the surface."""
    is_closed: bool
    """Whether each edge belongs to two triangles, triangles without area among them."""


def read_mesh(path: str, unit: str = "m") -> MeshFile:
    """Read the triangles of an STL, OBJ or PLY file.

    Parameters
    ----------
    path : str
    unit : str
        Of the numbers in it: m, cm, mm or in.

    Raises
    ------
    InvalidSetting
        Named `Mesh.path` or `Mesh.unit`, with the file: if there is none, it is too large, is of
        another format, cannot be read, holds no triangles, numbers that are not finite, or
        something larger than 100 m; if trimesh and embreex are not installed.
    """
    kind = Path(path).suffix.lower().removeprefix(".")
    if kind not in FORMATS:
        raise InvalidSetting(
            _WHERE,
            got=f"{path}, whose name does not end in one of {', '.join('.' + f for f in FORMATS)}",
            need="a mesh in a format that can be read: STL, OBJ or PLY",
            fix="Convert it to one of these.",
        )
    vertices_m, faces = _arrays(path, _content(Path(path)), kind)
    vertices_m = vertices_m * UNITS_M[unit]
    _must_be_sound(path, vertices_m, faces)
    _must_be_small(path, float(np.ptp(vertices_m[faces].reshape(-1, 3), axis=0).max()), unit)
    # Files of triangles repeat the corners that neighbours share.
    trimesh, _ = tracing()
    mesh = trimesh.Trimesh(vertices_m, faces, process=False)
    mesh.merge_vertices()
    a, b, c = np.asarray(mesh.faces).T
    mesh.update_faces((a != b) & (b != c) & (c != a))
    is_closed = bool(mesh.is_watertight)
    corners_m = vertices_m[faces]
    across_m2 = np.cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0])
    area_m2 = np.linalg.norm(across_m2, axis=1)
    # Thinner than the roundings of single precision, in which most files are.
    has_area = area_m2 > 1e-14 * np.ptp(vertices_m, axis=0).max() ** 2
    if not has_area.any():
        raise InvalidSetting(
            _WHERE,
            got=f"{path}, whose {len(faces)} triangles all have no area",
            need="a surface",
            fix="Export the mesh again.",
        )
    surface = Surface(vertices_m, faces[has_area], name=path)
    return MeshFile(surface, int((~has_area).sum()), is_closed)


def _content(path: Path) -> bytes:
    try:
        if not path.exists():
            got = "which is not there"
        elif not path.is_file():
            got = "which is no file"
        elif path.stat().st_size > MOST_BYTES:
            got = f"a file of {path.stat().st_size / 2**20:.0f} MiB"
        else:
            return path.read_bytes()
    except OSError as error:
        got = f"which cannot be read: {error.strerror}"
    raise InvalidSetting(
        _WHERE,
        got=f"{path}, {got}",
        need=f"a mesh file of at most {MOST_BYTES / 2**20:.0f} MiB",
        fix="Give the path of one; in settings files it starts from the file's folder.",
    )


def _arrays(path: str, content: bytes, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3), as numbers in the file, and faces (m, 3)."""
    trimesh, _ = tracing()
    source: Any = io.BytesIO(content)
    if kind == "obj":  # its reader would guess at letters with a library of its own
        source = io.StringIO(content.decode("utf-8", errors="replace"))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            mesh = trimesh.load(
                source, file_type=kind, force="mesh", process=False, skip_materials=True
            )
            vertices = np.array(mesh.vertices, dtype=float).reshape(-1, 3)
            return vertices, np.array(mesh.faces, dtype=np.int64).reshape(-1, 3)
    except Exception as error:  # as many kinds as there are ways to break a file
        raise InvalidSetting(
            _WHERE,
            got=f"{path}, which is no {kind.upper()} that can be read",
            need=f"a file of the format that its name says, {kind.upper()}",
            fix="Export the mesh again, or correct the file's name.",
        ) from error


def _must_be_sound(path: str, vertices_m: np.ndarray, faces: np.ndarray) -> None:
    got = ""
    if not len(faces):
        got = "which is empty: it has no triangles"
    elif len(faces) > MOST_FACES:
        got = f"which has {len(faces)} triangles"
    elif faces.min() < 0 or faces.max() >= len(vertices_m):
        got = f"whose triangles name vertices beyond the {len(vertices_m)} that it has"
    else:
        right = (abs(vertices_m[faces]) < 1e12).all(axis=(1, 2))
        if not right.all():
            got = f"of whose triangles {(~right).sum()} have corners that are not finite"
    if got:
        raise InvalidSetting(
            _WHERE,
            got=f"{path}, {got}",
            need=f"a mesh of 1 to {MOST_FACES:.0e} triangles, at finite places",
            fix="Export the mesh again.",
        )


def _must_be_small(path: str, extent_m: float, unit: str) -> None:
    if extent_m > LARGEST_M:
        raise InvalidSetting(
            "Mesh.unit",
            got=f"{unit}, with which {path} is {extent_m:.4g} m in size",
            need=f"the unit that its numbers are in: bodies end at {LARGEST_M:g} m",
            fix=f"Give unit: mm: it would be {extent_m / UNITS_M[unit] / 1e3:.4g} m."
            if unit != "mm"
            else "Cut the mesh into parts.",
        )
