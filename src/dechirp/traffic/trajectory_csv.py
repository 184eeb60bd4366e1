"""Trajectories as CSV, a row for each object and time."""

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import TextIO, get_args

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.text import join_names
from dechirp.traffic.base import (
    STRUCTURE_KINDS,
    CutTrafficError,
    ObjectKind,
    ObjectState,
    TrafficFormat,
)
from dechirp.traffic.trajectory_sets import find_trajectory_set

_MAX_ROW_BYTES = 10_000
_REQUIRED = ("time", "id", "class", "x", "y", "heading", "length", "width", "height")
_OPTIONAL = ("z", "vx", "vy")
_MIN_NAMES = 6  # of the required ones: with fewer, the file may be something else
_FIELDS = {
    "time": "time_s",
    "x": "x_m",
    "y": "y_m",
    "z": "z_m",
    "heading": "heading_rad",
    "vx": "vx_m_per_s",
    "vy": "vy_m_per_s",
    "length": "length_m",
    "width": "width_m",
    "height": "height_m",
}


class TrajectoryCsv(TrafficFormat):
    """Columns time, id, class, x, y, heading, length, width, height, in SI units; z, vx, vy too."""

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """Return True if the first line names most columns, or those of another trajectory file.

        `read_states` then states the difference.
        """
        if path.suffix.lower() != ".csv":
            return False
        names = _read_column_names(path)
        n_found = len(set(_REQUIRED) & set(names))
        return n_found >= _MIN_NAMES or find_trajectory_set(names) is not None

    def read_states(self, path: Path) -> Iterator[ObjectState]:
        """Yield a state for each row; empty cells are unknown."""
        _check_columns(path)
        with _open_text(path) as file:
            lines = _Lines(file)
            reader = csv.DictReader(lines, skipinitialspace=True)
            row: dict[str, str | None] = {}
            try:
                reader.fieldnames = [name.strip().lower() for name in reader.fieldnames or ()]
                for row in reader:
                    if lines.lack_end and None in row.values():
                        raise ValueError("cells are missing")
                    yield _state_of_row(row)
            except (TypeError, ValueError, csv.Error) as error:
                place = f"line {reader.line_num}{_describe_object(row)}"
                if isinstance(error, csv.Error):  # the library does not count this line
                    place = f"line {reader.line_num + 1}"
                if lines.lack_end:
                    raise CutTrafficError(
                        path,
                        value=f"{place}, which has no line end: {error}",
                        expected="complete rows",
                        fix="complete the last row, or record the file again",
                    ) from None
                raise RecordingError(
                    path,
                    value=f"{place}: {error}",
                    expected=f"{', '.join(_REQUIRED)} as numbers, class as one of"
                    f" {', '.join(get_args(ObjectKind))}",
                    fix="correct the line",
                ) from None

    def read_findings(self, path: Path) -> tuple[Finding, ...]:
        """Return a note if the last row is complete without a line end: its last cell may be cut.

        `12.3` of `12.345` is a number too. Rows that are incomplete are no states.
        """
        with path.open("rb") as file:
            header = file.readline(_MAX_ROW_BYTES)
            file.seek(max(path.stat().st_size - _MAX_ROW_BYTES, 0))
            last_bytes = file.read()
        last_row = last_bytes.splitlines()[-1]
        if last_bytes.endswith((b"\n", b"\r")) or last_row.count(b",") < header.count(b","):
            return ()
        return (
            Finding(
                level="note",
                setting="traffic.path",
                value=f"the last row has no line end: {last_row[:80].decode(errors='replace')}",
                expected="a line end, as it shows that the last cell is complete",
                fix="nothing to do if it is; else complete it, or record the file again",
            ),
        )


def _read_column_names(path: Path) -> list[str]:
    """Return the names in the first line, in lower case, separated by commas or semicolons."""
    with _open_text(path) as file:
        header = file.readline(_MAX_ROW_BYTES).lower()
    separator = "," if header.count(",") >= header.count(";") else ";"
    return [name.strip() for name in header.split(separator)]


def missing_columns(path: Path) -> list[str]:
    """Return the required columns that the first line does not name."""
    names = _read_column_names(path)
    return [name for name in _REQUIRED if name not in names]


def _check_columns(path: Path) -> None:
    """Raise `RecordingError` if columns are missing, or the separator is no comma."""
    names = _read_column_names(path)
    layout = find_trajectory_set(names)
    missing = missing_columns(path)
    with _open_text(path) as file:
        has_commas = "," in file.readline(_MAX_ROW_BYTES)
    if not missing and has_commas:
        return
    if not missing:
        value, fix = "columns separated by semicolons", "write it with commas and decimal points"
    elif layout is not None:
        value, fix = f"trajectories of {layout.name}", f"convert the columns: {layout.conversion}"
    else:
        value = f"no column {join_names(missing)}"
        fix = "rename or add it; cells of heading, length, width and height may be empty"
    raise RecordingError(
        path,
        value=value,
        expected=f"columns {', '.join(_REQUIRED)}, and optionally {', '.join(_OPTIONAL)},"
        " separated by commas, in SI units and radians",
        fix=fix,
    )


def _open_text(path: Path) -> TextIO:
    """Open a file whose first bytes may be the byte order mark that spreadsheets write."""
    return path.open(encoding="utf-8-sig", errors="replace", newline="")


class _Lines(Iterator[str]):
    """Lines of a file. The last one may lack its end, complete or cut."""

    def __init__(self, file: TextIO) -> None:
        self._file = file
        self.lack_end = False
        """True if the line read last has no end."""

    def __next__(self) -> str:
        line = next(self._file)
        self.lack_end = not line.endswith(("\n", "\r"))
        return line


def _describe_object(row: dict[str, str | None]) -> str:
    """Return the id and the time of a row as the file states them, if it does."""
    cells = [f"{name} {(row.get(name) or '').strip()[:40]}" for name in ("id", "time")]
    return f" ({', '.join(cells)})" if row.get("id") and row.get("time") else ""


def _state_of_row(row: dict[str, str | None]) -> ObjectState:
    name_of_class = (row["class"] or "").strip()
    kind = next((kind for kind in get_args(ObjectKind) if kind == name_of_class.lower()), None)
    if kind is None:
        raise ValueError(f"class {name_of_class[:40]!r}")
    for name in ("time", "x", "y"):
        if not (row[name] or "").strip():
            raise ValueError(f"no {name}")
    number = _read_id((row["id"] or "").strip())
    numbers = {
        field: float(text)
        for name, field in _FIELDS.items()
        if name in row and (text := (row[name] or "").strip())
    }
    return ObjectState(id=number, kind=kind, is_stationary=kind in STRUCTURE_KINDS, **numbers)


def _read_id(text: str) -> int:
    """Return a whole number; tables with gaps write 12.0 for 12."""
    whole, _, decimals = text.partition(".")
    try:
        return int(whole if not decimals.strip("0") else text)
    except ValueError:
        raise ValueError(f"id {text[:40]!r}, which is not a whole number") from None
