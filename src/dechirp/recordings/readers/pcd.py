"""PCD point clouds of a radar: one file a frame, text, binary or compressed.

References
----------
Point Cloud Library, "The PCD (Point Cloud Data) file format", versions 0.6 and 0.7; LibLZF (the
compression).
"""

import re
from pathlib import Path

import numpy as np

from dechirp.core.compiled_kernels import AS_WRITTEN, kernel
from dechirp.core.units import to_decibels
from dechirp.core.values import frozen_dataclass
from dechirp.recordings.arrays.lazy_array import convert_parser_errors
from dechirp.recordings.messages.cloud_files import list_cloud_files, read_cloud_files
from dechirp.recordings.readers.base import Contents, Format, MatchQuality, RecordingHints

_START_BYTES, _HEAD_BYTES = 2**12, 2**16
_MAX_FIELDS = 256
_MAX_POINTS = 2**31
_MAX_EXPANSION = 300  # LZF: three bytes stand for at most 264
_START = re.compile(rb"(?:#[^\n]*\n|\s)*(?:VERSION\s+\.?\d|FIELDS\s)")
_DATA_LINE = re.compile(rb"^DATA[ \t]+(\w+)[ \t]*\r?\n", re.MULTILINE)
_EXPECTED = "a complete PCD point cloud"
_OBJECT_LIST_FIELDS = {"x_std", "vx_std", "snr", "frame", "time", "number", "status"}


@frozen_dataclass
class Pcd(Format):
    """Detections in PCD files: a file, or a folder of such files, a frame each.

    Fields x, y, z; velocities as in messages of ROS, or vx and vy along the line of sight. A file
    with a field `frame`, such as an object list, contains several frames.
    """

    def recognise(self, path: Path) -> MatchQuality:
        files = list_cloud_files(path, ".pcd")
        if not files:
            return MatchQuality.NO
        with files[0].open("rb") as file:
            is_pcd = _START.match(file.read(_START_BYTES)) is not None
        return MatchQuality.SELF_DESCRIBING if is_pcd else MatchQuality.NO

    def read(self, path: Path, hints: RecordingHints) -> Contents:
        return read_cloud_files(path, list_cloud_files(path, ".pcd"), _read_points, hints)


def _read_points(path: Path) -> np.ndarray:
    """Return the points of a file, those of a native object list with the ratio `snr` in dB."""
    points = read_pcd_points(path)
    if set(points.dtype.names or ()) >= _OBJECT_LIST_FIELDS:
        points = points.copy()
        with np.errstate(divide="ignore", invalid="ignore"):
            points["snr"] = to_decibels(points["snr"])
    return points


def read_pcd_points(path: Path) -> np.ndarray:
    """Return the points (n,) of a file, with its fields.

    Raises
    ------
    RecordingError
        If the file is damaged or cut short.
    """
    with convert_parser_errors(path, _EXPECTED):
        content = path.read_bytes()
        line = _DATA_LINE.search(content, 0, _HEAD_BYTES)
        if line is None:
            raise ValueError("no line DATA")
        header = _parse_header(content[: line.start()])
        dtype, n_points = _point_dtype(header), _count_points(header)
        body = memoryview(content)[line.end() :]
        encoding = line[1].decode()
        if encoding == "ascii":
            points = _parse_text(bytes(body), dtype, n_points)
        elif encoding == "binary":
            points = _points_from_bytes(body, dtype, n_points)
        elif encoding == "binary_compressed":
            points = _decompress_points(body, dtype, n_points)
        else:
            raise ValueError(f"DATA {encoding[:20]}")
    return points


def _parse_header(text: bytes) -> dict[str, list[str]]:
    """Parse the lines of a header: a name, then its values."""
    lines = [line.split() for line in text.decode("latin-1").splitlines()]
    return {line[0]: line[1:] for line in lines if line and not line[0].startswith("#")}


def _point_dtype(header: dict[str, list[str]]) -> np.dtype:
    """Return the type of a point; fields named `_` are padding."""
    names, sizes, kinds = header["FIELDS"], header["SIZE"], header["TYPE"]
    counts = [int(count) for count in header.get("COUNT", ["1"] * len(names))]
    if not 0 < len(names) <= _MAX_FIELDS or not len(names) == len(sizes) == len(kinds):
        raise ValueError(f"{len(names)} FIELDS, {len(sizes)} SIZE and {len(kinds)} TYPE")
    if len(counts) != len(names) or min(counts) < 1 or max(counts) > 10_000:
        raise ValueError(f"COUNT {counts[:10]}")
    types = []
    seen: set[str] = set()
    for number, (name, size, kind, count) in enumerate(
        zip(names, sizes, kinds, counts, strict=True)
    ):
        if kind not in "IUF" or size not in ("1", "2", "4", "8") or (kind == "F" and size in "12"):
            raise ValueError(f"a field of TYPE {kind[:5]} and SIZE {size[:5]}")
        is_named = name != "_" and name not in seen
        seen.add(name)
        shape = (count,) if count > 1 else ()
        types.append((name if is_named else f"_{number}", f"<{kind.lower()}{size}", shape))
    return np.dtype(types)


def _count_points(header: dict[str, list[str]]) -> int:
    """Return the number of points, WIDTH times HEIGHT where POINTS is missing."""
    if "POINTS" in header:
        n_points = int(header["POINTS"][0])
    else:
        n_points = int(header["WIDTH"][0]) * int(header.get("HEIGHT", ["1"])[0])
    if not 0 <= n_points <= _MAX_POINTS:
        raise ValueError(f"{n_points} points")
    return n_points


def _points_from_bytes(body: memoryview, dtype: np.dtype, n_points: int) -> np.ndarray:
    if len(body) < n_points * dtype.itemsize:
        raise ValueError(f"{len(body)} bytes for {n_points} points of {dtype.itemsize} bytes")
    return np.frombuffer(body, dtype, n_points)


def _parse_text(body: bytes, dtype: np.dtype, n_points: int) -> np.ndarray:
    """Parse lines of numbers, one line for each point."""
    lines = body.splitlines()[:n_points]
    if len(lines) < n_points:
        raise ValueError(f"{len(lines)} lines for {n_points} points")
    points = np.zeros(n_points, dtype)
    if not n_points:
        return points
    table = np.loadtxt(lines, comments=None, ndmin=2)
    column = 0
    with np.errstate(invalid="ignore"):  # NaN in a field of integers
        for name in dtype.names or ():
            shape = dtype[name].shape
            width = shape[0] if shape else 1
            values = table[:, column : column + width]
            points[name] = values if shape else values[:, 0]
            column += width
    if column != table.shape[1] or len(table) != n_points:
        raise ValueError(f"{table.shape[1]} numbers a line for {column} fields")
    return points


def _decompress_points(body: memoryview, dtype: np.dtype, n_points: int) -> np.ndarray:
    """Decompress points that are stored field after field."""
    sizes = np.frombuffer(body[:8], "<u4")
    n_compressed, n_bytes = (int(size) for size in sizes)
    if n_bytes != n_points * dtype.itemsize:
        raise ValueError(f"{n_bytes} bytes for {n_points} points of {dtype.itemsize} bytes")
    if n_compressed > len(body) - 8 or n_bytes > _MAX_EXPANSION * n_compressed:
        raise ValueError(f"{len(body) - 8} compressed bytes, for {n_compressed} to {n_bytes}")
    unpacked = np.empty(n_bytes, np.uint8)
    packed = np.frombuffer(body, np.uint8, n_compressed, 8)
    if _decompress_lzf(packed, unpacked) != n_bytes:
        raise ValueError("damaged compressed points")
    points = np.empty(n_points, dtype)
    position = 0
    for name in dtype.names or ():
        field = dtype[name]
        part = unpacked[position : position + n_points * field.itemsize]
        points[name] = part.view(field.base).reshape(n_points, *field.shape)
        position += n_points * field.itemsize
    return points


@kernel(plain=AS_WRITTEN, error_model="python")
def _decompress_lzf(packed: np.ndarray, out: np.ndarray) -> int:
    """Fill `out` with the decompressed bytes; return their number, -1 for damaged bytes.

    A byte below 32 precedes that many bytes and one more, which are copied. Others hold the length
    (3 bits) and distance (13 bits) of bytes to repeat; of length 7, another byte is added to it.
    """
    source, target = 0, 0
    while source < len(packed):
        control = int(packed[source])
        source += 1
        if control < 32:
            length = control + 1
            if source + length > len(packed) or target + length > len(out):
                return -1
            for k in range(length):
                out[target + k] = packed[source + k]
            source += length
            target += length
            continue
        length = control >> 5
        if length == 7:
            if source >= len(packed):
                return -1
            length += int(packed[source])
            source += 1
        if source >= len(packed):
            return -1
        start = target - ((control & 31) << 8) - int(packed[source]) - 1
        source += 1
        length += 2
        if start < 0 or target + length > len(out):
            return -1
        for k in range(length):
            out[target + k] = out[start + k]
        target += length
    return target
