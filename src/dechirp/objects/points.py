"""Object lists as point clouds, PCD and PLY: a point for each object, the columns as fields.

Numbers are single precision, as readers of point clouds want x, y and z; time is double.
`status` is 0 detection, 1 tentative, 2 confirmed. Frames without objects have no point.

References
----------
Point Cloud Library, "The PCD file format", version 0.7; G. Turk, "The PLY polygon file format",
1994, version 1.0.
"""

import re
from pathlib import Path
from typing import Literal, TypeAlias, get_args

import numpy as np
import xarray as xr

from dechirp.core.errors import InvalidSetting, RecordingError
from dechirp.objects.rows import MEASURED, STATUSES, must_be_objects, of_rows, status_codes
from dechirp.objects.saturation import say_beyond
from dechirp.objects.whole import named, whole_file

Encoding: TypeAlias = Literal["binary", "ascii"]

_POINT = np.dtype(
    [
        *((name, "<f4") for name in MEASURED),
        ("time", "<f8"),
        ("frame", "<u4"),
        ("number", "<u4"),
        ("status", "u1"),
    ]
)
_NAMES = _POINT.names or ()
_LONGEST_HEADER = 4096
_PLY_TYPES = {"<f4": "float", "<f8": "double", "<u4": "uint", "|u1": "uchar"}
_PLY_ENCODINGS = {"binary": "binary_little_endian", "ascii": "ascii"}


def write_points(objects: xr.Dataset, path: str | Path, *, encoding: Encoding = "binary") -> None:
    """Write an object list as `.pcd` or `.ply`, whole or not at all.

    Raises
    ------
    InvalidSetting
        If it is no object list, or the path cannot be written.

    Warns
    -----
    PhysicsWarning
        If values are beyond what a field can tell.
    """
    if encoding not in get_args(Encoding):
        need = " or ".join(get_args(Encoding))
        raise InvalidSetting("encoding", got=encoding, need=need, fix="Choose one of them.")
    path = named(path, SUFFIXES)
    points = _points(must_be_objects(objects))
    header, _ = _HEADERS[path.suffix.lower()]
    with whole_file(path) as made:
        made.write_bytes(header(len(points), encoding).encode() + _encoded(points, encoding))


def read_points(path: str | Path) -> xr.Dataset:
    """Read an object list from `.pcd` or `.ply`, as `write_points` writes it.

    Raises
    ------
    RecordingError
        If it cannot be read, is cut off, or has other fields.
    InvalidSetting
        If the values in it are no object list.
    """
    path = named(path, SUFFIXES)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise _unreadable(path, error.strerror or str(error)) from None
    header, count = _HEADERS[path.suffix.lower()]
    found = re.search(count, content[:_LONGEST_HEADER])
    n_points = int(found[1]) if found else 0
    for encoding in get_args(Encoding):
        start = header(n_points, encoding).encode()
        if content.startswith(start):
            return _of_points(_decoded(path, content[len(start) :], n_points, encoding))
    raise _unreadable(path, "a file with another header")


def _pcd_header(n_points: int, encoding: Encoding) -> str:
    types = [_POINT[name] for name in _NAMES]
    lines = (
        "# .PCD v0.7 - Point Cloud Data file format",
        "VERSION 0.7",
        f"FIELDS {' '.join(_NAMES)}",
        f"SIZE {' '.join(str(one.itemsize) for one in types)}",
        f"TYPE {' '.join(one.kind.upper() for one in types)}",
        f"COUNT {' '.join('1' for _ in types)}",
        f"WIDTH {n_points}",
        "HEIGHT 1",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {n_points}",
        f"DATA {encoding}",
    )
    return "\n".join(lines) + "\n"


def _ply_header(n_points: int, encoding: Encoding) -> str:
    lines = (
        "ply",
        f"format {_PLY_ENCODINGS[encoding]} 1.0",
        "comment an object list of dechirp",
        f"element vertex {n_points}",
        *(f"property {_PLY_TYPES[_POINT[name].str]} {name}" for name in _NAMES),
        "end_header",
    )
    return "\n".join(lines) + "\n"


_HEADERS = {
    ".pcd": (_pcd_header, rb"\nPOINTS (\d{1,15})\n"),
    ".ply": (_ply_header, rb"\nelement vertex (\d{1,15})\n"),
}
"""Header of each suffix, and where it says how many points there are."""

SUFFIXES = tuple(_HEADERS)


def _encoded(points: np.ndarray, encoding: Encoding) -> bytes:
    if encoding == "binary":
        return points.tobytes()
    rows = zip(*(map(str, points[name]) for name in _NAMES), strict=True)
    return "".join(" ".join(row) + "\n" for row in rows).encode()


def _points(objects: xr.Dataset) -> np.ndarray:
    points = np.zeros(objects.sizes["object"], _POINT)
    beyond = {}
    for name in (*MEASURED, "frame", "number"):
        values = objects[name].values
        info = np.iinfo(np.uint32) if name in ("frame", "number") else np.finfo(np.float32)
        largest = float(info.max)
        beyond[f"{name} (to {largest:.6g})"] = int((np.abs(values) > largest).sum())
        points[name] = np.clip(values, -largest, largest)
    say_beyond("a field", beyond)
    points["time"], points["status"] = objects["time"].values, status_codes(objects)
    return points


def _of_points(points: np.ndarray) -> xr.Dataset:
    columns = {name: points[name].astype(float) for name in (*MEASURED, "time")}
    columns |= {name: points[name].astype(np.int64) for name in ("frame", "number")}
    believed = np.minimum(points["status"], len(STATUSES) - 1)
    return of_rows({**columns, "status": np.array(STATUSES)[believed]})


def _decoded(path: Path, body: bytes, n_points: int, encoding: Encoding) -> np.ndarray:
    if encoding == "binary":
        if len(body) != n_points * _POINT.itemsize:
            raise _unreadable(path, f"{len(body)} bytes for {n_points} points")
        return np.frombuffer(body, _POINT)
    rows = body.split(b"\n")[:-1]
    try:
        table = np.array([row.split() for row in rows], float).reshape(-1, len(_NAMES))
    except ValueError:
        raise _unreadable(path, "text that is not as many numbers in each line") from None
    if len(table) != n_points:
        raise _unreadable(path, f"{len(table)} lines for {n_points} points")
    points = np.zeros(n_points, _POINT)
    for name, column in zip(_NAMES, table.T, strict=True):
        points[name] = column
    return points


def _unreadable(path: Path, got: str) -> RecordingError:
    return RecordingError(
        path,
        got=got,
        need="an object list as write_points writes it, whole",
        fix="Write it again, or give the file that is one.",
    )
