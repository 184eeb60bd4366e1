"""Object lists as point clouds, PCD and PLY: one point for each object, columns as fields.

Numbers have single precision, as point-cloud readers expect of x, y and z; time has double.
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

from dechirp.core.atomic_files import atomic_output_file, check_file_suffix
from dechirp.core.errors import InvalidSetting, RecordingError
from dechirp.results.object_lists.list_columns import (
    MEASURED,
    STATUSES,
    check_object_list,
    object_list_from_rows,
    status_codes,
    warn_clipped_values,
)

Encoding: TypeAlias = Literal["binary", "ascii"]

_POINT_DTYPE = np.dtype(
    [
        *((name, "<f4") for name in MEASURED),
        ("time", "<f8"),
        ("frame", "<u4"),
        ("number", "<u4"),
        ("status", "u1"),
    ]
)
_FIELD_NAMES = _POINT_DTYPE.names or ()
_MAX_HEADER_BYTES = 4096
_PLY_TYPES = {"<f4": "float", "<f8": "double", "<u4": "uint", "|u1": "uchar"}
_PLY_ENCODINGS = {"binary": "binary_little_endian", "ascii": "ascii"}


def write_points(objects: xr.Dataset, path: str | Path, *, encoding: Encoding = "binary") -> None:
    """Write an object list as `.pcd` or `.ply`, atomically.

    Raises
    ------
    InvalidSetting
        If it is not an object list, or the path cannot be written.

    Warns
    -----
    PhysicsWarning
        If values exceed the range of their fields.
    """
    if encoding not in get_args(Encoding):
        expected = " or ".join(get_args(Encoding))
        raise InvalidSetting(
            "encoding", value=encoding, expected=expected, fix="choose one of them"
        )
    path = check_file_suffix(path, SUFFIXES)
    points = _points_from_objects(check_object_list(objects))
    header, _ = _HEADERS[path.suffix.lower()]
    with atomic_output_file(path) as temporary:
        temporary.write_bytes(
            header(len(points), encoding).encode() + _encode_points(points, encoding)
        )


def read_points(path: str | Path) -> xr.Dataset:
    """Read an object list from `.pcd` or `.ply`, as `write_points` writes it.

    Raises
    ------
    RecordingError
        If it cannot be read, is truncated, or has other fields.
    InvalidSetting
        If its values are not an object list.
    """
    path = check_file_suffix(path, SUFFIXES)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise _unreadable_point_cloud_error(path, error.strerror or str(error)) from None
    header, count = _HEADERS[path.suffix.lower()]
    match = re.search(count, content[:_MAX_HEADER_BYTES])
    n_points = int(match[1]) if match else 0
    for encoding in get_args(Encoding):
        start = header(n_points, encoding).encode()
        if content.startswith(start):
            return _objects_from_points(
                _decode_points(path, content[len(start) :], n_points, encoding)
            )
    raise _unreadable_point_cloud_error(path, "a file with another header")


def _pcd_header(n_points: int, encoding: Encoding) -> str:
    types = [_POINT_DTYPE[name] for name in _FIELD_NAMES]
    lines = (
        "# .PCD v0.7 - Point Cloud Data file format",
        "VERSION 0.7",
        f"FIELDS {' '.join(_FIELD_NAMES)}",
        f"SIZE {' '.join(str(dtype.itemsize) for dtype in types)}",
        f"TYPE {' '.join(dtype.kind.upper() for dtype in types)}",
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
        *(f"property {_PLY_TYPES[_POINT_DTYPE[name].str]} {name}" for name in _FIELD_NAMES),
        "end_header",
    )
    return "\n".join(lines) + "\n"


_HEADERS = {
    ".pcd": (_pcd_header, rb"\nPOINTS (\d{1,15})\n"),
    ".ply": (_ply_header, rb"\nelement vertex (\d{1,15})\n"),
}
"""Header of each suffix, and the pattern of its number of points."""

SUFFIXES = tuple(_HEADERS)


def _encode_points(points: np.ndarray, encoding: Encoding) -> bytes:
    if encoding == "binary":
        return points.tobytes()
    rows = zip(*(map(str, points[name]) for name in _FIELD_NAMES), strict=True)
    return "".join(" ".join(row) + "\n" for row in rows).encode()


def _points_from_objects(objects: xr.Dataset) -> np.ndarray:
    points = np.zeros(objects.sizes["object"], _POINT_DTYPE)
    n_clipped = {}
    for name in (*MEASURED, "frame", "number"):
        values = objects[name].values
        info = np.iinfo(np.uint32) if name in ("frame", "number") else np.finfo(np.float32)
        largest = float(info.max)
        n_clipped[f"{name} (to {largest:.6g})"] = int((np.abs(values) > largest).sum())
        points[name] = np.clip(values, -largest, largest)
    warn_clipped_values("a field", n_clipped)
    points["time"], points["status"] = objects["time"].values, status_codes(objects)
    return points


def _objects_from_points(points: np.ndarray) -> xr.Dataset:
    columns = {name: points[name].astype(float) for name in (*MEASURED, "time")}
    columns |= {name: points[name].astype(np.int64) for name in ("frame", "number")}
    status_code = np.minimum(points["status"], len(STATUSES) - 1)
    return object_list_from_rows({**columns, "status": np.array(STATUSES)[status_code]})


def _decode_points(path: Path, body: bytes, n_points: int, encoding: Encoding) -> np.ndarray:
    if encoding == "binary":
        if len(body) != n_points * _POINT_DTYPE.itemsize:
            raise _unreadable_point_cloud_error(path, f"{len(body)} bytes for {n_points} points")
        return np.frombuffer(body, _POINT_DTYPE)
    rows = body.split(b"\n")[:-1]
    try:
        table = np.array([row.split() for row in rows], float).reshape(-1, len(_FIELD_NAMES))
    except ValueError:
        raise _unreadable_point_cloud_error(
            path, "lines that are not numbers of all fields"
        ) from None
    if len(table) != n_points:
        raise _unreadable_point_cloud_error(path, f"{len(table)} lines for {n_points} points")
    points = np.zeros(n_points, _POINT_DTYPE)
    for name, column in zip(_FIELD_NAMES, table.T, strict=True):
        points[name] = column
    return points


def _unreadable_point_cloud_error(path: Path, value: str) -> RecordingError:
    return RecordingError(
        path,
        value=value,
        expected="a complete object list of write_points",
        fix="write it again; read a point cloud of another program with dechirp.open",
    )
