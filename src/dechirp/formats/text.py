"""Text of numbers in columns, such as an oscilloscope's: the user names what they are.

Numbers are taken in reading order, with as many in a line as the last axes hold: for `frame,
chirp,sample` a chirp a line, for `sample,rx` a column for each receiver. Commas, semicolons,
tabs or blanks stand between them; where it is none of the commas, decimals may have one.
"""

import math
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.values import value
from dechirp.formats.arrays.axes import contents, shape_in
from dechirp.formats.arrays.encodings import LIMITS
from dechirp.formats.arrays.stored import Part, Stored, written
from dechirp.formats.base import Contents, Fit, Format, Told
from dechirp.formats.settings_for import settings_for

_HEAD_BYTES = 2**16
_MOST_HEADINGS = 100
_LONGEST_LINE = 2**22  # its words take 14 times as much
_PER_MARK = 64  # lines: the file is found again at each of these
_PARSED_BYTES = 2**20
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
_NOT_TEXT = bytes(byte for byte in range(32) if byte not in b"\t\n\r\f")


@value
class Text(Format):
    """Text: columns of numbers, a chirp a line, whose axes the user names.

    Lines of equally many numbers; lines before the first of them are left out.
    """

    options: ClassVar[tuple[str, ...]] = ("axes", "encoding", "iq")
    encodings: ClassVar[tuple[str, ...]] = tuple(LIMITS)

    def recognise(self, path: Path) -> Fit:
        """Tell by lines of equally many numbers."""
        if not path.is_file():
            return Fit.NO
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
        if head.translate(None, _NOT_TEXT) != head or head.lstrip()[:1] in (b"{", b"["):
            return Fit.NO
        lines = [line for line in head.splitlines() if line.strip()]
        if len(head) == _HEAD_BYTES and len(lines) > 1:
            lines = lines[:-1]  # it may be cut
        separators = [_separator(line) for line in lines]
        first = next((at for at, found in enumerate(separators) if found is not None), None)
        if first is None or first > _MOST_HEADINGS:
            return Fit.NO
        counts = {
            None if found is None else _count(line, found)
            for line, found in zip(lines[first:], separators[first:], strict=True)
        }
        return Fit.LIKELY if len(counts) == 1 else Fit.POSSIBLE

    def read(self, path: Path, told: Told) -> Contents:
        """See `Format.read`."""
        table = _table(path)
        settings = settings_for(path, told)
        n_numbers = table.n_lines * table.n_columns
        what = f"text of {table.n_lines} lines of {table.n_columns} numbers"
        shape, findings = shape_in(path, told.axes, settings, n_numbers, what=what)
        if table.n_lines > 1:
            _must_end_with_axes(path, shape, told.axes or (), table)
        stored = _stored(path, table, shape)
        return contents(
            path,
            stored,
            replace(told, settings=settings),
            file_bytes=path.stat().st_size,
            findings=(*table.findings, *findings),
        )


@value
class _Table:
    """Where the lines of numbers are, and what is between the numbers."""

    separator: bytes
    """Empty for blanks."""
    n_columns: int
    n_lines: int
    marks: tuple[tuple[int, int], ...]
    """Of every so many lines, the first byte, and the number counted from 1."""
    findings: tuple[Finding, ...]


def _separator(line: bytes) -> bytes | None:
    """What is between the numbers of a line, empty for blanks; None if it holds others."""
    for separator in (b";", b"\t", b","):
        if separator in line and all(map(_is_number, _words(line, separator))):
            return separator
    words = _words(line, b"")
    return b"" if words and all(map(_is_number, words)) else None


def _words(line: bytes, separator: bytes) -> list[bytes]:
    return _plain(line, separator).split(separator or None)


def _plain(line: bytes, separator: bytes) -> bytes:
    """A line without blanks and separators at its end, and with points in its numbers."""
    line = line.removeprefix(_BYTE_ORDER_MARK).strip().removesuffix(separator).rstrip()
    return line if separator == b"," else line.replace(b",", b".")


def _is_number(word: bytes) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return b"_" not in word


def _table(path: Path) -> _Table:
    """Find the lines of numbers, which must hold equally many; none is parsed yet."""
    headings: list[bytes] = []
    marks: list[tuple[int, int]] = []
    separator, n_columns, n_lines = None, 0, 0
    start = number = 0
    with path.open("rb") as file:
        while line := file.readline(_LONGEST_LINE + 1):
            number += 1
            if len(line) > _LONGEST_LINE:
                raise _malformed(path, number, f"longer than {_LONGEST_LINE} bytes")
            if not line.strip():
                pass
            elif separator is None and (separator := _separator(line)) is None:
                headings.append(line.strip())
                if len(headings) > _MOST_HEADINGS:
                    raise _malformed(path, number, "still no line of numbers")
            else:
                count = _count(line, separator)
                n_columns = n_columns or count
                if count != n_columns:
                    raise _malformed(path, number, f"one of {count}, not {n_columns} numbers")
                if n_lines % _PER_MARK == 0:
                    marks.append((start, number))
                n_lines += 1
            start += len(line)
    if separator is None:
        raise _malformed(path, number, "the last, and none held numbers alone")
    return _Table(
        separator=separator,
        n_columns=n_columns,
        n_lines=n_lines,
        marks=tuple(marks),
        findings=(_left_out(headings),) if headings else (),
    )


def _count(line: bytes, separator: bytes) -> int:
    line = _plain(line, separator)
    return line.count(separator) + 1 if separator else len(line.split())


def _left_out(headings: list[bytes]) -> Finding:
    said = " / ".join(heading.decode("latin-1")[:60] for heading in headings[:3])
    return Finding(
        level="note",
        setting="recording",
        got=f"{len(headings)} lines before the first one of numbers, left out: {said}",
        need="numbers",
        fix="Nothing is to be done if those are names and units.",
    )


def _malformed(path: Path, number: int, what: str) -> RecordingError:
    return RecordingError(
        path,
        got=f"text whose line {number} is {what}",
        need=f"lines of equally many numbers, after at most {_MOST_HEADINGS} others",
        fix="Correct the line, or copy the file again from its source.",
    )


def _must_end_with_axes(
    path: Path, shape: tuple[int, ...], axes: tuple[str, ...], table: _Table
) -> None:
    """Raise `RecordingError` unless a line holds all that the last axes count."""
    ends = [math.prod(shape[at:]) for at in range(len(shape) + 1)]
    if table.n_columns not in ends:
        raise RecordingError(
            path,
            got=f"text of {table.n_columns} numbers in a line",
            need=f"of {' or '.join(map(str, ends[1:-1]))}, as axes {','.join(axes)} of"
            f" {written(shape)} can end with",
            fix="Correct the axes, or the radar's settings; columns of time have to go.",
        )


def _stored(path: Path, table: _Table, shape: tuple[int, ...]) -> Stored:
    per_row = math.prod(shape[1:])

    def read(part: Part) -> np.ndarray:
        first, last = part[0].start * per_row, part[0].stop * per_row
        lines = slice(first // table.n_columns, -(-last // table.n_columns))
        skipped = first - lines.start * table.n_columns
        numbers = _parsed(path, table, lines)[skipped : skipped + last - first]
        return numbers.reshape(-1, *shape[1:])[(slice(None), *part[1:])]

    return Stored(shape=shape, dtype=np.dtype(np.float64), read=read, outer=0)


def _parsed(path: Path, table: _Table, lines: slice) -> np.ndarray:
    """Numbers of some lines, one after the other."""
    start, number = table.marks[lines.start // _PER_MARK]
    to_skip = lines.start % _PER_MARK
    made = np.empty((lines.stop - lines.start, table.n_columns))
    with path.open("rb") as file:
        file.seek(start)
        done, block, n_bytes = 0, list[bytes](), 0
        while done < len(made):
            line = file.readline(_LONGEST_LINE)
            if not line:
                raise _malformed(path, number, "missing: the file was longer when it was opened")
            number += 1
            line = _plain(line, table.separator)
            if line and to_skip:
                to_skip -= 1
            elif line:
                block.append(line)
                n_bytes += len(line)
            if done + len(block) == len(made) or n_bytes > _PARSED_BYTES:
                made[done : done + len(block)] = _numbers(path, block, table, number)
                done, block, n_bytes = done + len(block), [], 0
    return made.reshape(-1)


def _numbers(path: Path, block: list[bytes], table: _Table, number: int) -> np.ndarray:
    """Numbers (line, column) of some lines, all before the one of this number."""
    separator = table.separator.decode() or None
    try:
        return np.loadtxt(block, delimiter=separator, comments=None, ndmin=2)
    except ValueError as error:
        said = str(error).split(";")[0]
        raise RecordingError(
            path,
            got=f"text with something else than numbers in one of the {len(block)} lines before"
            f" line {number} ({said})",
            need=f"lines of {table.n_columns} numbers",
            fix="Correct the line, or copy the file again from its source.",
        ) from None
