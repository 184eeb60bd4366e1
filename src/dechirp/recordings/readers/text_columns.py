"""Text with columns of numbers, such as an oscilloscope writes; the user names the axes.

Numbers are taken in reading order, and a line holds the last axes: for `frame,chirp,sample` a chirp
a line, for `sample,rx` a column for each receiver. The separator is a comma, semicolon, tab or
blank; if it is not the comma, numbers may have decimal commas. Lines that begin with `#` or `%` are
comments. A first column that rises in equal steps, where no other does, holds times or indices: it
is left out.

Complex numbers are read as `numpy.savetxt`, MATLAB and C++ write them: `(1.5+2j)`, `(1.5+-2j)`,
`1.5 + 2i`, `(1.5,2)`. The text may be compressed with gzip.
"""

import gzip
import math
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO, ClassVar, TypeAlias, cast

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.text import format_si
from dechirp.core.values import frozen_dataclass
from dechirp.recordings.arrays.encodings import LIMITS
from dechirp.recordings.arrays.lazy_array import (
    ArrayPart,
    LazyArray,
    convert_parser_errors,
    format_shape,
)
from dechirp.recordings.arrays.named_axes import (
    infer_shape_and_findings,
    interpret_array_as_recording,
)
from dechirp.recordings.foreign_files import identify_foreign_file
from dechirp.recordings.readers.base import Contents, Format, MatchQuality, RecordingHints
from dechirp.recordings.settings.base import RecordingSettings
from dechirp.recordings.settings.radar_example import RadarExample
from dechirp.recordings.settings_lookup import find_recording_settings

_HEAD_BYTES = 2**16
_EXAMPLE_CHIRPS = 128
_MAX_HEADINGS = 100
_MAX_LINE_BYTES = 2**22  # its words take 14 times as much memory
_LINES_PER_OFFSET = 64  # lines between two stored offsets
# A column of times is recognised in so many lines, beside at most 16 channels of an oscilloscope.
_MIN_TIMES, _MAX_TIMES, _MAX_CHANNELS = 16, 4096, 16
_MAX_STEP_S = 0.1  # of times; indices rise by 1
_MAX_RATE_ERROR = 1e-3  # relative
_PARSED_BYTES = 2**20
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
_NOT_TEXT = bytes(byte for byte in range(32) if byte not in b"\t\n\r\f")
_GZIP = b"\x1f\x8b\x08"
# Other forms of complex numbers, and that of Python. The first line decides which are needed: all
# of them in every line take 19 s instead of 3.4 s for 100 MB.
_Substitutions: TypeAlias = tuple[tuple[re.Pattern[bytes], bytes], ...]
_SUBSTITUTIONS: _Substitutions = (
    (re.compile(rb"\(\s*([^(),\s]+)\s*,\s*([^(),\s]+)\s*\)"), rb"(\1+\2j)"),
    (re.compile(rb"[iIJ](?<=[\d.][iIJ])(?![a-zA-Z\d])"), b"j"),
    (re.compile(rb" (?<=[\d.] ) *([+-]) +(?=[\d.]+(?:e[+-]?\d+)?j)"), rb"\1"),
)


@frozen_dataclass
class TextColumns(Format):
    """Text: columns of real or complex numbers, a chirp a line, whose axes the user names.

    All lines have the same number of values; lines before the first of them are skipped. The text
    may be compressed with gzip.
    """

    options: ClassVar[tuple[str, ...]] = ("axes", "encoding", "iq")
    encodings: ClassVar[tuple[str, ...]] = tuple(LIMITS)

    def recognise(self, path: Path) -> MatchQuality:
        if not path.is_file():
            return MatchQuality.NO
        try:
            with _TextFile(path).open_at(0) as file:
                head = file.read(_HEAD_BYTES)
        except RecordingError:  # no text of gzip
            return MatchQuality.NO
        if head.translate(None, _NOT_TEXT) != head or head.lstrip()[:1] in (b"{", b"["):
            return MatchQuality.NO
        if identify_foreign_file(head) is not None:
            return MatchQuality.NO
        lines = [line for line in head.splitlines() if not _is_blank_or_comment(line)]
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
        text = _TextFile(path)
        table = _leave_times_out(text, _index_number_lines(text))
        settings = find_recording_settings(path, hints, _radar_example(table, hints.axes))
        n_numbers = table.n_lines * table.n_columns
        description = f"text of {table.n_lines} lines of {table.n_columns} numbers"
        shape, findings = infer_shape_and_findings(
            path,
            hints.axes,
            settings,
            n_numbers,
            description=description,
            has_iq_columns=table.n_columns == 2
            and not table.is_complex
            and settings.radar.frame.chirp.sampling == "complex",
        )
        if table.n_lines > 1:
            _check_line_holds_whole_axes(path, shape, hints.axes or (), table)
        numbers = _open_lazy_table(text, table, shape)
        return interpret_array_as_recording(
            path,
            numbers,
            replace(hints, settings=settings),
            file_bytes=table.n_bytes,
            findings=(*table.findings, *_time_findings(table, settings), *findings),
        )


def _radar_example(table: "_LineIndex", axes: tuple[str, ...] | None) -> RadarExample:
    """Return the example of a radar whose chirps are the lines of a text."""
    n_chirps = min(table.n_lines, _EXAMPLE_CHIRPS)
    names = axes or (("frame",) if table.n_lines > n_chirps else ()) + ("chirp", "sample")
    example = replace(
        RadarExample(),
        n_samples=table.n_columns,
        n_chirps=n_chirps,
        sampling="complex" if table.is_complex else "real",
        options=f" --axes {','.join(names)}",
        known=("n_samples",),
    )
    if table.step is None:
        return example
    default = RadarExample()  # lines are samples, and the length of a chirp is unknown
    names = axes or (("chirp", "sample") if table.n_columns == 1 else ("sample", "rx"))
    known = ("sample_rate",) if table.step < _MAX_STEP_S else ()
    return replace(
        example,
        sample_rate_hz=float(f"{1 / table.step:.6g}") if known else default.sample_rate_hz,
        n_samples=default.n_samples,
        n_chirps=default.n_chirps,
        options=f" --axes {','.join(names)}",
        known=known,
    )


class _TextFile:
    """Text of a file, decompressed while it is read if it is compressed with gzip."""

    def __init__(self, path: Path) -> None:
        self.path = path
        with path.open("rb") as file:
            self._is_compressed = file.read(len(_GZIP)) == _GZIP
        # Frames are read in order: going on where the last one ended decompresses nothing twice.
        self._decompressed: gzip.GzipFile | None = None
        self._lock = threading.Lock()

    @contextmanager
    def open_at(self, offset: int) -> Iterator[BinaryIO]:
        """Open the text from a byte of it on."""
        if not self._is_compressed:
            with self.path.open("rb") as file:
                file.seek(offset)
                yield file
            return
        with self._lock, convert_parser_errors(self.path, "text compressed with gzip, complete"):
            if self._decompressed is None:
                self._decompressed = gzip.GzipFile(self.path, "rb")
            self._decompressed.seek(offset)
            yield cast(BinaryIO, self._decompressed)


@frozen_dataclass
class _LineIndex:
    """Positions of the lines of numbers, and their separator."""

    separator: bytes
    """Empty for blanks."""
    is_complex: bool
    substitutions: _Substitutions
    """Those that the first line of numbers needs."""
    n_columns: int
    """Columns of samples."""
    n_lines: int
    n_bytes: int
    """Bytes of the text."""
    offsets: tuple[tuple[int, int], ...]
    """First byte and line number (from 1) of every `_LINES_PER_OFFSET`-th line of numbers."""
    findings: tuple[Finding, ...]
    step: float | None = None
    """Step from line to line of a first column that is left out; None without one."""


def _detect_separator(line: bytes) -> bytes | None:
    """Return the separator of a line of numbers, empty for blanks; None for other text."""
    for separator in (b";", b"\t", b","):
        if separator in line and all(map(_is_number, _split_number_line(line, separator))):
            return separator
    words = _split_number_line(line, b"")
    return b"" if words and all(map(_is_number, words)) else None


def _split_number_line(line: bytes, separator: bytes) -> list[bytes]:
    """Split a line at its separator."""
    return _strip_and_normalise_numbers(line, separator).split(separator or None)


def _strip_and_normalise_numbers(
    line: bytes, separator: bytes, substitutions: _Substitutions = _SUBSTITUTIONS
) -> bytes:
    """Strip blanks and a trailing separator; write numbers in the form of Python.

    Decimal commas become points, and complex numbers take the form `(1.5+2j)`.
    """
    line = line.removeprefix(_BYTE_ORDER_MARK).strip().removesuffix(separator).rstrip()
    for pattern, replacement in substitutions:
        line = pattern.sub(replacement, line)
    return line if separator == b"," else line.replace(b",", b".")


def _is_blank_or_comment(line: bytes) -> bool:
    """Return whether a line holds no numbers: it is blank, or begins with # or %."""
    return line.lstrip()[:1] in (b"", b"#", b"%")


def _is_number(word: bytes) -> bool:
    """Return whether a word is a real or complex number."""
    if word.isdigit():
        return True
    if b"_" in word:
        return False
    try:
        float(word)
    except ValueError:
        return _is_complex_number(word)
    return True


def _is_complex_number(word: bytes) -> bool:
    """Return whether a word is a number with an imaginary part, such as (1.5+-2j)."""
    try:
        complex(word.decode("latin-1").replace("+-", "-"))
    except ValueError:
        return False
    return b"j" in word and any(byte in b"0123456789" for byte in word)


def _index_number_lines(text: _TextFile) -> _LineIndex:
    """Find the lines of numbers, check that their lengths agree, and parse none of them."""
    headings: list[bytes] = []
    offsets: list[tuple[int, int]] = []
    separator, is_complex, n_columns, n_lines = None, False, 0, 0
    substitutions = _SUBSTITUTIONS
    start = number = 0
    path = text.path
    with text.open_at(0) as file:
        while line := file.readline(_MAX_LINE_BYTES + 1):
            number += 1
            if len(line) > _MAX_LINE_BYTES:
                raise _malformed_line_error(path, number, f"longer than {_MAX_LINE_BYTES} bytes")
            is_blank = not line.strip()
            if is_blank or (separator is not None and _is_blank_or_comment(line)):
                pass
            elif separator is None and (separator := _detect_separator(line)) is None:
                headings.append(line.strip())
                if len(headings) > _MAX_HEADINGS:
                    raise _malformed_line_error(path, number, "not yet a line of numbers")
            else:
                count = _count_numbers(line, separator, substitutions)
                if not n_columns:
                    n_columns = count
                    substitutions = _needed_substitutions(line)
                    is_complex = any(map(_is_complex_number, _split_number_line(line, separator)))
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
        is_complex=is_complex,
        substitutions=substitutions,
        n_columns=n_columns,
        n_lines=n_lines,
        n_bytes=start,
        offsets=tuple(offsets),
        findings=(_skipped_headings_note(headings),) if headings else (),
    )


def _leave_times_out(text: _TextFile, table: _LineIndex) -> _LineIndex:
    """Leave out a first column of times or indices, see the module."""
    n = min(table.n_lines, _MAX_TIMES)
    if table.is_complex or not 2 <= table.n_columns <= 1 + _MAX_CHANNELS or n < _MIN_TIMES:
        return table
    numbers = _read_numbers_of_lines(text, table, slice(0, n)).reshape(n, table.n_columns)
    steps = (numbers[-1] - numbers[0]) / (n - 1)
    # Printed digits may be few: times are then rounded to steps.
    from_line = numbers - numbers[0] - steps * np.arange(n)[:, None]
    is_straight = np.abs(from_line).max(axis=0) <= np.abs(steps)
    if not (is_straight[0] and steps[0] > 0) or (is_straight & (steps != 0))[1:].any():
        return table
    return replace(table, n_columns=table.n_columns - 1, step=float(steps[0]))


def _time_findings(table: _LineIndex, settings: RecordingSettings) -> tuple[Finding, ...]:
    """Return what was left out, as a warning if the times contradict the sample rate."""
    if table.step is None:
        return ()
    rate_hz = settings.radar.frame.chirp.sample_rate_hz
    differs = table.step < _MAX_STEP_S and abs(table.step * rate_hz - 1) > _MAX_RATE_ERROR
    return (
        Finding(
            level="warning" if differs else "note",
            setting="recording",
            value=f"a first column that rises by {table.step:.6g} a line, left out as times"
            + (f", which are those of {format_si(1 / table.step, 'hz')}" if differs else ""),
            expected=f"the sample rate of the radar, {format_si(rate_hz, 'hz')}"
            if differs
            else "columns of samples",
            fix="correct frame.chirp.sample_rate" if differs else "no action needed",
        ),
    )


def _needed_substitutions(line: bytes) -> _Substitutions:
    """Return the substitutions that change a line."""
    needed = []
    for pattern, replacement in _SUBSTITUTIONS:
        line, count = pattern.subn(replacement, line)
        if count:
            needed.append((pattern, replacement))
    return tuple(needed)


def _count_numbers(
    line: bytes, separator: bytes, substitutions: _Substitutions = _SUBSTITUTIONS
) -> int:
    """Count the numbers in a line."""
    line = _strip_and_normalise_numbers(line, separator, substitutions)
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
            fix="correct the axes or the radar's settings",
        )


def _open_lazy_table(text: _TextFile, table: _LineIndex, shape: tuple[int, ...]) -> LazyArray:
    """Open the lines as an array of a shape, parsed when it is read."""
    numbers_per_row = math.prod(shape[1:])

    def read(part: ArrayPart) -> np.ndarray:
        first, last = part[0].start * numbers_per_row, part[0].stop * numbers_per_row
        lines = slice(first // table.n_columns, -(-last // table.n_columns))
        n_skipped = first - lines.start * table.n_columns
        numbers = _read_numbers_of_lines(text, table, lines)[n_skipped : n_skipped + last - first]
        return numbers.reshape(-1, *shape[1:])[(slice(None), *part[1:])]

    return LazyArray(shape=shape, dtype=_number_dtype(table), read=read, outer_axis=0)


def _number_dtype(table: _LineIndex) -> np.dtype:
    return np.dtype(np.complex128 if table.is_complex else np.float64)


def _read_numbers_of_lines(text: _TextFile, table: _LineIndex, lines: slice) -> np.ndarray:
    """Read the numbers of some lines, flattened."""
    start, line_number = table.offsets[lines.start // _LINES_PER_OFFSET]
    n_to_skip = lines.start % _LINES_PER_OFFSET
    numbers = np.empty((lines.stop - lines.start, table.n_columns), _number_dtype(table))
    path = text.path
    with text.open_at(start) as file:
        n_done, block, n_bytes = 0, list[bytes](), 0
        while n_done < len(numbers):
            line = file.readline(_MAX_LINE_BYTES)
            if not line:
                raise _malformed_line_error(
                    path, line_number, "missing: the file has become shorter since it was opened"
                )
            line_number += 1
            line = (
                b""
                if _is_blank_or_comment(line)
                else _strip_and_normalise_numbers(line, table.separator, table.substitutions)
            )
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
    options: dict[str, Any] = {"delimiter": table.separator.decode() or None, "comments": None}
    if table.step is not None:
        options["usecols"] = range(1, 1 + table.n_columns)
    try:
        return np.loadtxt(block, _number_dtype(table), ndmin=2, **options)
    except ValueError as error:
        reason = str(error).split(";")[0]
        is_hexadecimal = re.search(r"'(0[xX])?[0-9a-fA-F]+'", reason) is not None
        content = "hexadecimal codes" if is_hexadecimal else "something else than numbers"
        raise RecordingError(
            path,
            value=f"text with {content} in one of the {len(block)} lines before"
            f" line {next_line_number} ({reason})",
            expected=f"lines of {table.n_columns + (table.step is not None)} decimal numbers",
            fix="write the codes as decimal numbers with their sign"
            if is_hexadecimal
            else "correct the line, or copy the file again from its source",
        ) from None
