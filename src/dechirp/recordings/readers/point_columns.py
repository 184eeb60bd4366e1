"""Point clouds in text: a heading that names x, y and z or a velocity, and a point a line.

Comma, semicolon, tab or blanks separate the columns. Names may have units: `x_m`, `X [cm]`, `pos_x`
are all x, and `velocity [km/h]` becomes m/s. A column `frame`, else a column of times, divides the
points into frames. Columns of text are left out, and empty cells are unknown (NaN). The text may be
compressed with gzip.
"""

import gzip
import math
import re
import zlib
from contextlib import suppress
from operator import methodcaller
from pathlib import Path

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.memory import check_free_memory
from dechirp.core.values import frozen_dataclass
from dechirp.recordings.foreign_files import identify_foreign_file
from dechirp.recordings.messages.cloud_files import list_cloud_files, read_cloud_files
from dechirp.recordings.messages.message_arrays import VELOCITIES
from dechirp.recordings.readers.base import Contents, Format, MatchQuality, RecordingHints

_HEAD_BYTES = 2**14
_MAX_HEADINGS = 20
_BYTES_PER_NUMBER = 40  # of memory, while the lines are parsed
_GZIP = b"\x1f\x8b\x08"
_NOT_TEXT = bytes(byte for byte in range(32) if byte not in b"\t\n\r\f")
_SUFFIXES = (".csv", ".txt", ".tsv")
_PCD = re.compile(rb"(?:#[^\n]*\n|\s)*(?:VERSION|FIELDS)\s")
_COMMENT_MARKS = "#%/ \t"
_BRACKETS = re.compile(r"(.*?)\s*[\[(](.*)[\])]")
_POSITION = re.compile(r"(?:pos|position|point)?[_.]?([xyz])(?:[_.]?pos)?")
_FRAMES = ("frame", "frame_id", "frame_number", "frame_idx", "framenumber", "scan")
_TIMES = ("time", "timestamp", "t")
_VELOCITIES = (*VELOCITIES, "vx", "vy")
_KILOMETRES_PER_HOUR = 1 / 3.6
_SCALES_OF_POSITION = {"": 1.0, "m": 1.0, "km": 1e3, "cm": 1e-2, "mm": 1e-3}
_SCALES_OF_VELOCITY = {
    **dict.fromkeys(("", "m/s", "m_s", "ms", "mps", "m_per_s"), 1.0),
    **dict.fromkeys(("km/h", "km_h", "kmh", "kph", "km_per_h"), _KILOMETRES_PER_HOUR),
}
_SCALES_OF_TIME = {"": 0.0, "s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
# Times since 1970 without a unit, by their size: s until the year 5138, ms, us and ns above.
_SECONDS_OF_SIZE = ((1e17, 1e-9), (1e14, 1e-6), (1e11, 1e-3), (0.0, 1.0))


@frozen_dataclass
class PointColumns(Format):
    """Detections in text with named columns: x, y, z, velocity, frame or time, and others.

    A file with all frames, or a folder of files (`.csv`, `.txt`, `.tsv`), a frame each.
    """

    def recognise(self, path: Path) -> MatchQuality:
        files = _list_files(path)
        if not files or _find_columns(_read_head(files[0])) is None:
            return MatchQuality.NO
        return MatchQuality.SELF_DESCRIBING

    def read(self, path: Path, hints: RecordingHints) -> Contents:
        return read_cloud_files(path, _list_files(path), _read_points, hints)


@frozen_dataclass
class _Columns:
    """Columns of numbers that a heading names."""

    n_headings: int
    separator: str
    """Empty for blanks."""
    n_columns: int
    names: tuple[str, ...]
    """Of the columns of numbers."""
    indices: tuple[int, ...]
    scales: tuple[float, ...]
    """SI units of the unit of each column; 0 for times whose unit the heading does not name, NaN
    for unknown units."""


def _list_files(path: Path) -> list[Path]:
    return next((files for suffix in _SUFFIXES if (files := list_cloud_files(path, suffix))), [])


def _open_text(path: Path) -> gzip.GzipFile | None:
    """Return the decompressed text of a file that is compressed."""
    with path.open("rb") as file:
        return gzip.GzipFile(path) if file.read(len(_GZIP)) == _GZIP else None


def _read_head(path: Path) -> bytes:
    try:
        with _open_text(path) or path.open("rb") as file:
            return file.read(_HEAD_BYTES)
    except (OSError, EOFError, zlib.error):
        return b""


def _find_columns(head: bytes) -> _Columns | None:
    """Return the columns that the last heading names; None if it does not name those of points."""
    if head.translate(None, _NOT_TEXT) != head or identify_foreign_file(head) is not None:
        return None
    if _PCD.match(head):
        return None
    lines = [line.strip() for line in head.decode("utf-8-sig", "replace").splitlines()]
    heading = None
    for number, line in enumerate(lines[: _MAX_HEADINGS + 1]):
        if heading is not None and (columns := _match_heading(*heading, line)) is not None:
            return columns
        if line and not _is_number(re.split(r"[,;\s]", line)[0]):
            heading = number + 1, line.lstrip(_COMMENT_MARKS)
    return None


def _match_heading(n_headings: int, heading: str, first_row: str) -> _Columns | None:
    """Return the columns of points, if a heading names those of the first row."""
    separator = next((mark for mark in ";\t," if mark in heading), "")
    headings, cells = _split(heading, separator), _split(first_row, separator)
    named = [_name_and_scale(text) for text in headings]
    names = [name for name, _ in named]
    is_number = [_is_number(cell) or not cell for cell in cells]
    if len(names) != len(cells) or not any(cells):
        return None
    numeric = [name for name, is_used in zip(names, is_number, strict=True) if is_used]
    if numeric.count("x") != 1 or numeric.count("y") != 1:
        return None
    if "z" not in numeric and set(_VELOCITIES).isdisjoint(numeric):
        return None
    indices = [
        index for index, name in enumerate(names) if is_number[index] and name not in names[:index]
    ]
    return _Columns(
        n_headings=n_headings,
        separator=separator,
        n_columns=len(names),
        names=tuple(names[index] for index in indices),
        indices=tuple(indices),
        scales=tuple(named[index][1] for index in indices),
    )


def _split(line: str, separator: str) -> list[str]:
    cells = line.split(separator or None)
    return [_with_decimal_point(cell.strip().strip("\"'"), separator) for cell in cells]


def _with_decimal_point(cell: str, separator: str) -> str:
    return cell if separator == "," else cell.replace(",", ".")


def _name_and_scale(text: str) -> tuple[str, float]:
    """Return the name of a column in lower case, and the SI units of its unit, 1 for others."""
    bracketed = _BRACKETS.fullmatch(text.lower())
    name, unit = bracketed.groups() if bracketed else (text.lower(), None)
    name = name.strip().replace(" ", "_")
    for scales, find_name in (
        (_SCALES_OF_POSITION, _position_name),
        (_SCALES_OF_VELOCITY, lambda name: name if name in _VELOCITIES else None),
        (_SCALES_OF_TIME, lambda name: "time" if name in _TIMES else None),
    ):
        units = [unit] if unit is not None else sorted(scales, key=len, reverse=True)
        for candidate in units:
            suffix = "" if bracketed or not candidate else f"_{candidate}"
            found = find_name(name.removesuffix(suffix)) if name.endswith(suffix) else None
            if found is not None:
                return found, scales.get(candidate.strip(), math.nan)
    return ("frame" if name in _FRAMES else name or "_"), 1.0


def _position_name(name: str) -> str | None:
    position = _POSITION.fullmatch(name)
    return position[1] if position else None


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _read_points(path: Path) -> np.ndarray:
    """Return the points (n,) of a file, with its fields and `frame` where the text has it."""
    try:
        with _open_text(path) or path.open("rb") as file:
            content = file.read()
    except (OSError, EOFError, zlib.error) as error:
        raise RecordingError(
            path,
            value=f"not readable ({error})",
            expected="text compressed with gzip, complete",
            fix="copy the file again from its source",
        ) from None
    columns = _find_columns(content[:_HEAD_BYTES])
    if columns is None:
        raise RecordingError(
            path,
            value="no heading that names its columns",
            expected="a heading with x, y, and z or a velocity, as x,y,z,velocity",
            fix="name the columns in the first line",
        )
    if np.isnan(columns.scales).any():
        raise RecordingError(
            path,
            value="an unknown unit of "
            + " and ".join(
                name
                for name, scale in zip(columns.names, columns.scales, strict=True)
                if np.isnan(scale)
            ),
            expected="positions in m, km, cm or mm, velocities in m/s or km/h, times in s, ms, us"
            " or ns",
            fix="convert the column, or correct its heading; read samples with"
            " --format text-columns",
        )
    text = content.decode("utf-8-sig", "replace")
    check_free_memory(
        f"the points of {path.name}",
        needed_bytes=len(content) + _BYTES_PER_NUMBER * len(columns.names) * text.count("\n"),
        fix="divide the file, a frame each",
    )
    table = _parse_rows(path, text.splitlines(), columns)
    points = np.empty(len(table), [(name, "<f8") for name in columns.names])
    for name, values, scale in zip(columns.names, table.T, columns.scales, strict=True):
        points[name] = values * (scale or _seconds_of_size(values))
    has_only_times = "time" in columns.names and "frame" not in columns.names
    return _number_frames(points) if has_only_times else points


def _parse_rows(path: Path, lines: list[str], columns: _Columns) -> np.ndarray:
    """Parse the lines of points, (point, column)."""
    body = lines[columns.n_headings :]
    if columns.separator in (",", "\t"):
        # Four times as fast as the loop below, which reads empty cells, quotes and comments.
        with suppress(ValueError):
            table = np.loadtxt(
                body, delimiter=columns.separator, comments=None, usecols=columns.indices, ndmin=2
            )
            n_cells = len(table) + sum(map(methodcaller("count", columns.separator), body))
            if n_cells == len(table) * columns.n_columns:
                return table.reshape(-1, len(columns.names))
    rows = []
    for number, line in enumerate(body, columns.n_headings + 1):
        if not line.strip() or line.lstrip()[0] in "#%":
            continue
        cells = line.split(columns.separator or None)
        if len(cells) != columns.n_columns:
            problem = f"{len(cells)} columns"
        else:
            try:
                rows.append([_parse_cell(cells[i], columns.separator) for i in columns.indices])
                continue
            except ValueError as error:
                problem = str(error)[:60]
        raise RecordingError(
            path,
            value=f"line {number}: {problem}",
            expected=f"{columns.n_columns} columns, with numbers for {', '.join(columns.names)}",
            fix="correct the line, or copy the file again from its source",
        )
    return np.array(rows).reshape(-1, len(columns.names))


def _parse_cell(cell: str, separator: str) -> float:
    cell = _with_decimal_point(cell.strip().strip("\"'"), separator)
    return float(cell) if cell else np.nan


def _seconds_of_size(times: np.ndarray) -> float:
    """Return the seconds of the unit of times, s unless they are ms, us or ns since 1970."""
    largest = float(np.nanmax(np.abs(times), initial=0.0))
    return next(scale for size, scale in _SECONDS_OF_SIZE if largest >= size)


def _number_frames(points: np.ndarray) -> np.ndarray:
    """Return points with a field `frame`, one for each time."""
    numbered = np.empty(len(points), [*points.dtype.descr, ("frame", "<f8")])
    for name in points.dtype.names or ():
        numbered[name] = points[name]
    numbered["frame"] = np.unique(points["time"], return_inverse=True)[1]
    return numbered
