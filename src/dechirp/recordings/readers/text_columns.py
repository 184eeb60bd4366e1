"""Text with columns of numbers, such as an oscilloscope writes; the user names the axes.

Numbers are taken in reading order, and a line holds the last axes: for `frame,chirp,sample` a chirp
a line, for `sample,rx` a column for each receiver. The separator is a comma, semicolon, tab or
blank; if it is not the comma, numbers may have decimal commas.
"""

import math
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.values import frozen_dataclass
from dechirp.recordings.arrays.encodings import LIMITS
from dechirp.recordings.arrays.lazy_array import ArrayPart, LazyArray, format_shape
from dechirp.recordings.arrays.named_axes import (
    infer_shape_and_findings,
    interpret_array_as_recording,
)
from dechirp.recordings.readers.base import Contents, Format, MatchQuality, RecordingHints
from dechirp.recordings.settings_lookup import find_recording_settings

_HEAD_BYTES = 2**16
_MAX_HEADINGS = 100
_MAX_LINE_BYTES = 2**22  # its words take 14 times as much memory
_LINES_PER_OFFSET = 64  # lines between two stored offsets
_PARSED_BYTES = 2**20
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
_NOT_TEXT = bytes(byte for byte in range(32) if byte not in b"\t\n\r\f")


@frozen_dataclass
class TextColumns(Format):
    """Text: columns of numbers, a chirp a line, whose axes the user names.

    All lines have the same number of values; lines before the first of them are skipped.
    """

    options: ClassVar[tuple[str, ...]] = ("axes", "encoding", "iq")
    encodings: ClassVar[tuple[str, ...]] = tuple(LIMITS)

    def recognise(self, path: Path) -> MatchQuality:
        if not path.is_file():
            return MatchQuality.NO
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
        if head.translate(None, _NOT_TEXT) != head or head.lstrip()[:1] in (b"{", b"["):
            return MatchQuality.NO
        lines = [line for line in head.splitlines() if line.strip()]
        if len(head) == _HEAD_BYTES and len(lines) > 1:
            lines = lines[:-1]  # may be incomplete
        separators = [_detect_separator(line) for line in lines]
        first = next(
            (index for index, separator in enumerate(separators) if separator is not None), None
        )
        if first is None or first > _MAX_HEADINGS:
            return MatchQuality.NO
        counts = {
            None if separator is None else _count_numbers(line, separator)
            for line, separator in zip(lines[first:], separators[first:], strict=True)
        }
        return MatchQuality.LIKELY if len(counts) == 1 else MatchQuality.POSSIBLE

    def read(self, path: Path, hints: RecordingHints) -> Contents:
        table = _index_number_lines(path)
        settings = find_recording_settings(path, hints)
        n_numbers = table.n_lines * table.n_columns
        description = f"text of {table.n_lines} lines of {table.n_columns} numbers"
        shape, findings = infer_shape_and_findings(
            path, hints.axes, settings, n_numbers, description=description
        )
        if table.n_lines > 1:
            _check_line_holds_whole_axes(path, shape, hints.axes or (), table)
        numbers = _open_lazy_table(path, table, shape)
        return interpret_array_as_recording(
            path,
            numbers,
            replace(hints, settings=settings),
            file_bytes=path.stat().st_size,
            findings=(*table.findings, *findings),
        )


@frozen_dataclass
class _LineIndex:
    """Positions of the lines of numbers, and their separator."""

    separator: bytes
    """Empty for blanks."""
    n_columns: int
    n_lines: int
    offsets: tuple[tuple[int, int], ...]
    """First byte and line number (from 1) of every `_LINES_PER_OFFSET`-th line of numbers."""
    findings: tuple[Finding, ...]


def _detect_separator(line: bytes) -> bytes | None:
    """Return the separator of a line of numbers, empty for blanks; None for other text."""
    for separator in (b";", b"\t", b","):
        if separator in line and all(map(_is_number, _split_number_line(line, separator))):
            return separator
    words = _split_number_line(line, b"")
    return b"" if words and all(map(_is_number, words)) else None


def _split_number_line(line: bytes, separator: bytes) -> list[bytes]:
    """Split a line at its separator."""
    return _strip_and_convert_decimal_commas(line, separator).split(separator or None)


def _strip_and_convert_decimal_commas(line: bytes, separator: bytes) -> bytes:
    """Strip blanks and a trailing separator, and replace decimal commas by points."""
    line = line.removeprefix(_BYTE_ORDER_MARK).strip().removesuffix(separator).rstrip()
    return line if separator == b"," else line.replace(b",", b".")


def _is_number(word: bytes) -> bool:
    """Return whether a word is a number."""
    try:
        float(word)
    except ValueError:
        return False
    return b"_" not in word


def _index_number_lines(path: Path) -> _LineIndex:
    """Find the lines of numbers, check that their lengths agree, and parse none of them."""
    headings: list[bytes] = []
    offsets: list[tuple[int, int]] = []
    separator, n_columns, n_lines = None, 0, 0
    start = number = 0
    with path.open("rb") as file:
        while line := file.readline(_MAX_LINE_BYTES + 1):
            number += 1
            if len(line) > _MAX_LINE_BYTES:
                raise _malformed_line_error(path, number, f"longer than {_MAX_LINE_BYTES} bytes")
            if not line.strip():
                pass
            elif separator is None and (separator := _detect_separator(line)) is None:
                headings.append(line.strip())
                if len(headings) > _MAX_HEADINGS:
                    raise _malformed_line_error(path, number, "not yet a line of numbers")
            else:
                count = _count_numbers(line, separator)
                n_columns = n_columns or count
                if count != n_columns:
                    raise _malformed_line_error(
                        path, number, f"a row of {count} numbers instead of {n_columns}"
                    )
                if n_lines % _LINES_PER_OFFSET == 0:
                    offsets.append((start, number))
                n_lines += 1
            start += len(line)
    if separator is None:
        raise _malformed_line_error(path, number, "the last, and no line consists of numbers only")
    return _LineIndex(
        separator=separator,
        n_columns=n_columns,
        n_lines=n_lines,
        offsets=tuple(offsets),
        findings=(_skipped_headings_note(headings),) if headings else (),
    )


def _count_numbers(line: bytes, separator: bytes) -> int:
    """Count the numbers in a line."""
    line = _strip_and_convert_decimal_commas(line, separator)
    return line.count(separator) + 1 if separator else len(line.split())


def _skipped_headings_note(headings: list[bytes]) -> Finding:
    """Return a note that headings were skipped."""
    excerpt = " / ".join(heading.decode("latin-1")[:60] for heading in headings[:3])
    return Finding(
        level="note",
        setting="recording",
        value=f"{len(headings)} lines before the first line of numbers, skipped: {excerpt}",
        expected="lines of numbers",
        fix="no action needed if those are names and units",
    )


def _malformed_line_error(path: Path, line_number: int, problem: str) -> RecordingError:
    """Return the error of a line that is not a row of numbers."""
    return RecordingError(
        path,
        value=f"line {line_number} is {problem}",
        expected=f"lines with the same number of values, after at most {_MAX_HEADINGS} headings",
        fix="correct the line, or copy the file again from its source",
    )


def _check_line_holds_whole_axes(
    path: Path, shape: tuple[int, ...], axes: tuple[str, ...], table: _LineIndex
) -> None:
    """Raise `RecordingError` unless a line holds a whole number of the last axes."""
    allowed_lengths = [math.prod(shape[axis:]) for axis in range(len(shape) + 1)]
    if table.n_columns not in allowed_lengths:
        raise RecordingError(
            path,
            value=f"{table.n_columns} numbers in a line",
            expected=f"{' or '.join(map(str, allowed_lengths[1:-1]))}, a whole number of the last"
            f" axes of {','.join(axes)} ({format_shape(shape)})",
            fix="correct the axes or the radar's settings, and remove columns of time",
        )


def _open_lazy_table(path: Path, table: _LineIndex, shape: tuple[int, ...]) -> LazyArray:
    """Open the lines as an array of a shape, parsed when it is read."""
    numbers_per_row = math.prod(shape[1:])

    def read(part: ArrayPart) -> np.ndarray:
        first, last = part[0].start * numbers_per_row, part[0].stop * numbers_per_row
        lines = slice(first // table.n_columns, -(-last // table.n_columns))
        n_skipped = first - lines.start * table.n_columns
        numbers = _read_numbers_of_lines(path, table, lines)[n_skipped : n_skipped + last - first]
        return numbers.reshape(-1, *shape[1:])[(slice(None), *part[1:])]

    return LazyArray(shape=shape, dtype=np.dtype(np.float64), read=read, outer_axis=0)


def _read_numbers_of_lines(path: Path, table: _LineIndex, lines: slice) -> np.ndarray:
    """Read the numbers of some lines, flattened."""
    start, line_number = table.offsets[lines.start // _LINES_PER_OFFSET]
    n_to_skip = lines.start % _LINES_PER_OFFSET
    numbers = np.empty((lines.stop - lines.start, table.n_columns))
    with path.open("rb") as file:
        file.seek(start)
        n_done, block, n_bytes = 0, list[bytes](), 0
        while n_done < len(numbers):
            line = file.readline(_MAX_LINE_BYTES)
            if not line:
                raise _malformed_line_error(
                    path, line_number, "missing: the file has become shorter since it was opened"
                )
            line_number += 1
            line = _strip_and_convert_decimal_commas(line, table.separator)
            if line and n_to_skip:
                n_to_skip -= 1
            elif line:
                block.append(line)
                n_bytes += len(line)
            if n_done + len(block) == len(numbers) or n_bytes > _PARSED_BYTES:
                numbers[n_done : n_done + len(block)] = _parse_number_lines(
                    path, block, table, line_number
                )
                n_done, block, n_bytes = n_done + len(block), [], 0
    return numbers.reshape(-1)


def _parse_number_lines(
    path: Path, block: list[bytes], table: _LineIndex, next_line_number: int
) -> np.ndarray:
    """Parse lines of numbers, (line, column), all before line `next_line_number`."""
    separator = table.separator.decode() or None
    try:
        return np.loadtxt(block, delimiter=separator, comments=None, ndmin=2)
    except ValueError as error:
        reason = str(error).split(";")[0]
        raise RecordingError(
            path,
            value=f"text with something else than numbers in one of the {len(block)} lines before"
            f" line {next_line_number} ({reason})",
            expected=f"lines of {table.n_columns} numbers",
            fix="correct the line, or copy the file again from its source",
        ) from None
