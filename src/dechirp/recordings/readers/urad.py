"""uRAD text: one line a measurement, I of all samples, then Q, as codes of a 12-bit ADC.

In sawtooth mode a line holds `I Q`, N numbers each; in triangle mode `I-up I-down Q-up Q-down`.
Programs for the Raspberry Pi write I and Q to two files, whose names differ in that letter:
`I_yard.txt` and `Q_yard.txt`. The vendor's examples append the computer's time in s, some without
its decimal point. The ADC offset is part of the samples and stays.

The file contains no settings. Without settings, those of the vendor's examples are assumed, with a
warning: ramps of 240 MHz from 24.005 GHz, and 200 kS/s.

Reversed samples of a down-ramp equal those of an up-ramp from the lower frequency, except that
their range-Doppler coupling has the opposite sign.
"""

import math
import re
from array import array
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import BinaryIO, ClassVar

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.values import frozen_dataclass
from dechirp.radar.chirp import Chirp
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar
from dechirp.recordings.readers.base import Contents, Format, MatchQuality, RecordingHints
from dechirp.recordings.samples.continuous import (
    check_single_receiver_and_sampling,
    chirp_interval_findings,
    divide_chirps_into_frames,
    join_single_chirps,
)
from dechirp.recordings.samples.iq_files import iq_file_names, leading_iq_file, other_iq_file
from dechirp.recordings.samples.iq_order import negative_beat_frequency_findings
from dechirp.recordings.settings.base import Iq, RecordingSettings
from dechirp.recordings.settings.read import list_settings_files
from dechirp.recordings.settings_lookup import find_recording_settings

_MAX_CODE = 4095
_HEAD_BYTES = 2**16
_MAX_LINE_BYTES = 2**16
_MAX_HEADINGS = 100
_NUMBERS_PER_LINE = range(100, 801)  # 50 to 200 samples, in two or four parts
_MAX_SAMPLES = 200
_BLANKS = b" \t\r\n\v\f"
_SEPARATORS = bytes.maketrans(b",;\t", b"   ")
_MAX_SAMPLED_CHIRPS = 64
_NUMBERS_PER_BLOCK = 2**16  # arrays of 256 KiB fit into the L2 cache

# The vendor's examples set f0 = 5 MHz above 24 GHz and BW = 240 MHz, all that the band allows; the
# ADC takes 200 samples in the ramp of 1 ms.
_START_FREQUENCY_HZ = 24.005e9
_BANDWIDTH_HZ = 240e6
_SAMPLE_RATE_HZ = 200e3

# A code has at most four digits: a longer number, or one with a fraction, is a time.
_TIME = re.compile(rb"(?:^|[\s,;])((?:\d{5,}(?:[.,]\d*)?|\d*\.\d*)(?:[eE][+-]?\d+)?)[\s,;]*$")


@frozen_dataclass
class Urad(Format):
    """uRAD text: a sweep a line.

    Each line is a chirp; of a triangle, its up-ramp or (`encoding` down) its down-ramp. Single
    chirps are joined to frames, see `join_single_chirps`.
    """

    options: ClassVar[tuple[str, ...]] = ("encoding", "iq")
    encodings: ClassVar[tuple[str, ...]] = ("up", "down")

    def recognise(self, path: Path) -> MatchQuality:
        if not path.is_file():
            return MatchQuality.NO
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
        if b"\0" in head:  # no text; each of its lines would be tried, for 10 ms
            return MatchQuality.NO
        lines = head.splitlines()
        if len(head) == _HEAD_BYTES:
            lines = lines[:-1]
        lines = [*_without_headings([line for line in lines if line.strip()])]
        # A stopped recording may end within a line.
        lines = lines[:-1] if len(lines) > 1 else lines
        n_numbers = _count_codes_or_none(lines[0]) if lines else None
        if not n_numbers or (n_numbers % 2 and other_iq_file(path) is None):
            return MatchQuality.NO
        if any(_count_codes_or_none(line) != n_numbers for line in lines[1:]):
            return MatchQuality.NO
        if n_numbers not in _NUMBERS_PER_LINE and 2 * n_numbers not in _NUMBERS_PER_LINE:
            return MatchQuality.POSSIBLE
        return MatchQuality.CONTAINER if _has_times(lines) else MatchQuality.LIKELY

    def leading_file(self, path: Path, hints: RecordingHints) -> Path:
        return leading_iq_file(path)

    def read(self, path: Path, hints: RecordingHints) -> Contents:
        ramp = hints.encoding or "up"
        lines = _index_measurement_lines(path)
        files = _find_files_of_recording(path, lines)
        n_lines = min(len(file.starts) for file in files)
        settings = _given_or_assumed_settings(path, hints, files)
        check_single_receiver_and_sampling(path, settings.radar, "complex")
        n_samples = settings.radar.frame.chirp.n_samples
        columns = _columns_of_ramp(path, files, n_samples, ramp)
        joined_radar, joined_findings = join_single_chirps(
            settings.radar, n_lines, lines.interval_s
        )
        radar, n_frames, frame_findings = divide_chirps_into_frames(path, joined_radar, n_lines)
        iq = hints.iq or "iq"
        n_chirps = radar.frame.n_chirps_total

        def decode(index: int, out: np.ndarray) -> None:
            first = index * n_chirps
            _decode_lines_to_chirps(files, range(first, first + n_chirps), columns, iq, out)

        sampled_chirps = np.empty((min(n_chirps, _MAX_SAMPLED_CHIRPS), 1, n_samples), np.complex64)
        _decode_lines_to_chirps(files, range(len(sampled_chirps)), columns, iq, sampled_chirps)
        findings = (
            settings.findings
            + tuple(finding for file in files for finding in file.findings)
            + joined_findings
            + frame_findings
            + negative_beat_frequency_findings(sampled_chirps, iq)
        )
        if ramp == "down":
            findings += (_down_ramp_coupling_note(),)
        if lines.interval_s is not None:
            findings += chirp_interval_findings(
                radar.frame, lines.interval_s, source="the times in the file"
            )
        return Contents(radar=radar, n_frames=n_frames, decode=decode, findings=findings, iq=iq)


@frozen_dataclass
class _LineIndex:
    """Positions of the lines of a file."""

    path: Path
    starts: np.ndarray
    """(line,) int64: first byte of each line."""
    n_numbers: int
    """Codes in each line."""
    first_line: int
    """Number of the first line with codes, from 1."""
    start_s: float | None = None
    """Time of the first line; None without times."""
    interval_s: float | None = None
    """Mean interval between lines; None without times."""
    findings: tuple[Finding, ...] = ()


def _find_files_of_recording(path: Path, lines: _LineIndex) -> tuple[_LineIndex, ...]:
    """Return the lines of the file, or those of the I and of the Q file.

    Raises
    ------
    RecordingError
        If the file is one half of a pair without the other, or the halves do not belong together.
    """
    names = iq_file_names(path.name)
    others = [path.with_name(name) for name in names.values() if name != path.name]
    # An `I` may have another meaning: half a measurement has fewer numbers.
    is_half = others and (other_iq_file(path) or lines.n_numbers <= 2 * _MAX_SAMPLES)
    if not is_half:
        if lines.n_numbers % 2:
            raise _malformed_line_error(path, lines.first_line, f"{lines.n_numbers} numbers")
        return (lines,)
    (other,) = others
    if other_iq_file(path) is None:
        raise RecordingError(
            path,
            value=f"one half of an I/Q pair: {other.name} is missing, the other part of the"
            " samples",
            expected=f"{names['i']} and {names['q']} in one folder",
            fix=f"copy {other.name} next to it; if this file contains both I and Q, rename it,"
            f" such as to IQ{path.suffix}",
        )
    other_lines = _index_measurement_lines(other)
    files = (lines, other_lines) if path.name == names["i"] else (other_lines, lines)
    problem = _describe_pair_mismatch(*files)
    if problem:
        raise RecordingError(
            path,
            value=f"{problem} in {names['i']} and {names['q']}",
            expected="the I and the Q file of one recording, with equal lines",
            fix="copy both files of the recording to one folder",
        )
    return files


def _describe_pair_mismatch(i_lines: _LineIndex, q_lines: _LineIndex) -> str:
    """Describe why two files are not the halves of one recording; empty if they are."""
    if i_lines.n_numbers != q_lines.n_numbers:
        return f"{i_lines.n_numbers} and {q_lines.n_numbers} numbers a line"
    # A recording that is stopped may end between the two writes.
    if abs(len(i_lines.starts) - len(q_lines.starts)) > 1:
        return f"{len(i_lines.starts)} and {len(q_lines.starts)} lines"
    times_s = i_lines.start_s, q_lines.start_s
    if None not in times_s and abs((times_s[0] or 0.0) - (times_s[1] or 0.0)) > 1.0:
        return f"times {times_s[0]:.3f} and {times_s[1]:.3f} s of the first lines"
    return ""


def _given_or_assumed_settings(
    path: Path, hints: RecordingHints, files: Sequence[_LineIndex]
) -> RecordingSettings:
    """Return the settings, or those of the vendor's examples for lines with a time.

    Numbers without times may come from another radar.
    """
    if hints.settings or list_settings_files(path) or files[0].start_s is None:
        return find_recording_settings(path, hints)
    n_ramp_numbers = files[0].n_numbers * len(files) // 2
    n_ramps = 1 if n_ramp_numbers <= _MAX_SAMPLES else 2
    n_samples = n_ramp_numbers // n_ramps
    if not 8 <= n_samples <= _MAX_SAMPLES:
        return find_recording_settings(path, hints)
    ramp_s = n_samples / _SAMPLE_RATE_HZ
    measured_s = files[0].interval_s
    interval_s = max(measured_s or 0.0, n_ramps * ramp_s)
    chirp = Chirp(
        start_frequency_hz=_START_FREQUENCY_HZ,
        slope_hz_per_s=_BANDWIDTH_HZ / ramp_s,
        ramp_duration_s=ramp_s,
        sample_rate_hz=_SAMPLE_RATE_HZ,
        n_samples=n_samples,
        sampling="complex",
    )
    radar = Radar(frame=Frame(chirp=chirp, n_chirps=1, interval_s=interval_s))
    return RecordingSettings(radar=radar, findings=(_assumed_radar_warning(radar, n_ramps),))


def _assumed_radar_warning(radar: Radar, n_ramps: int) -> Finding:
    """Warn that the settings are those of the vendor's examples."""
    chirp = radar.frame.chirp
    shape = "sawtooth" if n_ramps == 1 else "triangle"
    return Finding(
        level="warning",
        setting="radar",
        value=f"missing, assumed: {shape} ramps of {_BANDWIDTH_HZ / 1e6:g} MHz from"
        f" {_START_FREQUENCY_HZ / 1e9:g} GHz in {chirp.ramp_duration_s * 1e3:g} ms,"
        f" {chirp.n_samples} samples each, every {radar.frame.single_interval_s * 1e3:.4g} ms",
        expected="the f0, BW, Ns and mode of the program that recorded: ranges are proportional to"
        " 1 / BW",
        fix="give the radar as a YAML file (--radar FILE) if they were others",
    )


def _without_headings(lines: Sequence[bytes]) -> Sequence[bytes]:
    """Return the lines from the first one that does not begin with text or a comment sign."""
    first = next((n for n, line in enumerate(lines) if not _is_heading(line)), len(lines))
    return lines[first:] if first <= _MAX_HEADINGS else ()


def _is_heading(line: bytes) -> bool:
    """Return whether a line begins with text or a comment sign."""
    first = line.removeprefix(b"\xef\xbb\xbf").lstrip()[:1]
    return first.isalpha() or first in b"#%;/\"'"


def _has_times(lines: Sequence[bytes]) -> bool:
    """Return whether every line ends with a time."""
    return all(_split_codes_and_time(line)[1] is not None for line in lines)


def _count_codes_or_none(line: bytes) -> int | None:
    """Count the codes of a line; None if it holds anything else, except a time at its end."""
    text, _ = _split_text_and_time(line)
    n_words = _count_words(text)
    if n_words and _parse_plain_lines(text + b"\n", np.zeros(1, int), n_words) is not None:
        return n_words
    codes = text.split()
    return len(codes) if all(map(_is_code, codes)) else None


def _split_codes_and_time(line: bytes) -> tuple[list[bytes], bytes | None]:
    """Split a line into its codes and its time."""
    text, time = _split_text_and_time(line)
    return text.split(), time


def _split_text_and_time(line: bytes) -> tuple[bytes, bytes | None]:
    """Split a line into its codes, separated by blanks, and its time."""
    # A time has no blank, so it is in the last word: a search of 64 bytes takes ten times as long.
    last_word = line.rstrip(_BLANKS + b",;").rfind(b" ", -64)
    time = _TIME.search(line, max(last_word, len(line) - 64, 0))
    codes = line if time is None else line[: time.start(1)]
    text = codes.removeprefix(b"\xef\xbb\xbf").translate(_SEPARATORS)
    return text, None if time is None else time[1]


def _index_measurement_lines(path: Path) -> _LineIndex:
    """Find the lines and check that their lengths agree; the last may be incomplete."""
    starts = array("q")
    times_s = array("d")  # of each line, NaN without a time
    n_numbers = start = line_number = first_line = 0
    odd_line = None
    with path.open("rb") as file:
        while line := file.readline(_MAX_LINE_BYTES + 1):
            line_number += 1
            if len(line) > _MAX_LINE_BYTES:
                raise _malformed_line_error(path, line_number, f"more than {_MAX_LINE_BYTES} bytes")
            if n_numbers or not _is_heading(line) or line_number > _MAX_HEADINGS:
                text, time = _split_text_and_time(line)
                n_words = _count_words(text)
                if odd_line and n_words:
                    raise _malformed_line_error(
                        path, odd_line[0], f"{odd_line[1]} numbers after lines of {n_numbers}"
                    )
                if n_words and not n_numbers:
                    first_line, n_numbers = line_number, n_words
                    _check_codes(path, line_number, text.split())
                if n_words and n_words != n_numbers:
                    odd_line = line_number, n_words
                elif n_words:
                    starts.append(start)
                    is_complete = line.endswith(b"\n")
                    times_s.append(
                        _parse_time_s(path, line_number, time) if time and is_complete else math.nan
                    )
            start += len(line)
    if n_numbers < 4 or (odd_line and odd_line[1] > n_numbers):
        count_text = (
            f"{odd_line[1]} numbers after lines of {n_numbers}"
            if odd_line
            else f"{n_numbers} numbers"
        )
        raise _malformed_line_error(path, odd_line[0] if odd_line else first_line or 1, count_text)
    return _LineIndex(
        path=path,
        starts=np.frombuffer(starts, np.int64),
        n_numbers=n_numbers,
        first_line=first_line,
        start_s=next((time_s for time_s in times_s if math.isfinite(time_s)), None),
        interval_s=_mean_line_interval_s(np.frombuffer(times_s, np.float64)),
        findings=(_incomplete_last_line_note(*odd_line, n_numbers),)
        if odd_line and odd_line[1]
        else (),
    )


def _count_words(text: bytes) -> int:
    """Count the words of a line; single blanks are counted without a split."""
    text = text.strip(_BLANKS)
    if b"  " in text or b"\r" in text or b"\v" in text or b"\f" in text:
        return len(text.split())
    return text.count(b" ") + bool(text)


def _mean_line_interval_s(times_s: np.ndarray) -> float | None:
    """Return the mean interval between lines from their times, NaN where missing, or None.

    Times in whole seconds repeat. Those that differ from the one before are late by less than an
    interval, the first and the last one by up to a second.
    """
    timed_lines = np.flatnonzero(np.isfinite(times_s))
    if len(timed_lines) < 2:
        return None
    changes = 1 + np.flatnonzero(np.diff(times_s[timed_lines]))
    if 1 < len(changes) < len(timed_lines) - 1:
        timed_lines = timed_lines[changes]
    first, last = timed_lines[0], timed_lines[-1]
    interval_s = float(times_s[last] - times_s[first]) / int(last - first)
    return interval_s if 0 < interval_s < math.inf else None


def _parse_time_s(path: Path, line_number: int, time: bytes) -> float:
    """Parse the time of a line in s; whole numbers may count ms, us or ns since 1970."""
    try:
        time_s = float(time.replace(b",", b"."))
    except ValueError:
        raise _malformed_line_error(path, line_number, f"{time[:20].decode('latin-1')!r}") from None
    # 1e11 s since 1970 are the year 5138.
    return next((time_s / unit for unit in (1e9, 1e6, 1e3) if time_s / unit > 1e8), time_s)


def _columns_of_ramp(path: Path, files: Sequence[_LineIndex], n_samples: int, ramp: str) -> slice:
    """Return the columns of the ramp, among those of I or of Q."""
    n, n_numbers = n_samples, files[0].n_numbers
    n_part_numbers = n_numbers * len(files) / 2
    if n_part_numbers == 2 * n and ramp == "down":
        return slice(2 * n - 1, n - 1, -1)  # reversed
    if n_part_numbers == 2 * n or (n_part_numbers == n and ramp == "up"):
        return slice(0, n)
    is_pair = len(files) == 2
    triangle, sawtooth = (
        ("I-up, I-down, or Q", "I or Q") if is_pair else ("I-up, I-down, Q-up, Q-down", "I, Q")
    )
    n_sawtooth = n if is_pair else 2 * n
    fits = [f"{2 * n_sawtooth} ({triangle})"]
    fits += [f"{n_sawtooth} ({sawtooth})"] * (ramp == "up")
    raise RecordingError(
        path,
        value=f"{n_numbers} numbers a line",
        expected=f"{' or '.join(fits)}, for chirps of {n} samples (radar.frame.chirp.n_samples)",
        fix="correct radar.frame.chirp.n_samples, or leave out the encoding in sawtooth mode;"
        " the dual-rate mode is not supported",
    )


def _decode_lines_to_chirps(
    files: Sequence[_LineIndex],
    line_indices: range,
    columns: slice,
    iq: Iq,
    out: np.ndarray,
) -> None:
    """Fill (chirp, 1, sample) with lines, scaled to -1 ... 1."""
    chirps = out[:, 0]
    parts = (chirps.real, chirps.imag) if iq == "iq" else (chirps.imag, chirps.real)
    for number, lines in enumerate(files):
        filled_parts = parts if len(files) == 1 else parts[number : number + 1]
        n_block_lines = max(_NUMBERS_PER_BLOCK // lines.n_numbers, 1)
        with lines.path.open("rb") as file:
            for first in range(0, len(line_indices), n_block_lines):
                indices = line_indices[first : first + n_block_lines]
                codes = _read_codes(lines, indices, file)
                by_part = codes.reshape(len(indices), len(filled_parts), -1)[:, :, columns]
                for part_index, part in enumerate(filled_parts):
                    block = part[first : first + len(indices)]
                    np.multiply(by_part[:, part_index], np.float32(2 / _MAX_CODE), out=block)
                    block -= np.float32(1)


def _read_codes(lines: _LineIndex, indices: range, file: BinaryIO) -> np.ndarray:
    """Return (line, code) of consecutive lines."""
    starts = lines.starts[indices.start : indices.stop]
    file.seek(int(starts[0]))
    text = file.read(int(starts[-1] - starts[0])) + file.readline(_MAX_LINE_BYTES + 1)
    starts = starts - starts[0]
    codes = _parse_plain_lines(text + b"\n", starts, lines.n_numbers)
    if codes is not None:
        return codes
    ends = np.append(starts[1:], len(text))
    words = [
        _split_codes_and_time(text[start:end].partition(b"\n")[0])[0]
        for start, end in zip(starts, ends, strict=True)
    ]
    rows = [b" ".join(line_words) + b"\n" for line_words in words]
    starts = np.cumsum([0, *map(len, rows[:-1])])
    codes = _parse_plain_lines(b"".join(rows), starts, lines.n_numbers)
    if codes is not None:
        return codes
    return np.array(list(map(partial(_parse_codes, lines), indices, words)))


def _parse_plain_lines(text: bytes, starts: np.ndarray, n_numbers: int) -> np.ndarray | None:
    """Parse the first numbers of all lines at once, (line, number) uint32.

    The four bytes before a separator are one little-endian word: digits are checked and combined
    in all words at once, which takes a third of the time of a plain conversion of integers.

    Returns
    -------
    array, or None
        None if single blanks do not separate the numbers, or any is no code.
    """
    text_bytes = np.frombuffer(b"000" + text, np.uint8)  # four bytes end at the first separator
    starts = starts + 3
    separators = np.flatnonzero(text_bytes < ord("0"))
    first = np.searchsorted(separators, starts)
    if first[-1] + n_numbers > len(separators):
        return None
    ends = separators[first[:, None] + np.arange(n_numbers)]
    n_digits = np.diff(ends, axis=1, prepend=starts[:, None] - 1) - 1
    are_blanks_single = n_digits.min() >= 1 and np.all(text_bytes[ends[:, :-1]] == ord(" "))
    if not (are_blanks_single and n_digits.max() <= 4):
        return None
    if set(text_bytes[ends[:, -1]].tolist()) - set(_BLANKS):
        return None
    # Bytes of other words are shifted out; digit n from the left has place n - 1 from the right.
    words = np.ndarray((len(text_bytes) - 3,), "<u4", text_bytes, strides=(1,))[ends - 4]
    n_foreign_bits = (8 * (4 - n_digits)).astype(np.uint32)
    digits = (words ^ np.uint32(0x30303030)) >> n_foreign_bits << n_foreign_bits
    if np.bitwise_or.reduce((digits | (digits + np.uint32(0x76767676))) & 0x80808080, axis=None):
        return None
    pairs = (10 * digits + (digits >> 8)) & np.uint32(0x00FF00FF)
    codes = (100 * pairs + (pairs >> 16)) & np.uint32(0xFFFF)
    return codes if codes.max() <= _MAX_CODE else None


def _parse_codes(lines: _LineIndex, index: int, words: list[bytes]) -> np.ndarray:
    """Parse and check the codes of a line."""
    if len(words) != lines.n_numbers:
        raise _malformed_line_error(
            lines.path,
            lines.first_line + index,
            f"{len(words)} numbers after lines of {lines.n_numbers}",
        )
    _check_codes(lines.path, lines.first_line + index, words)
    return np.array(words).astype(np.int64)


def _check_codes(path: Path, line_number: int, words: list[bytes]) -> None:
    """Raise `RecordingError` if a word is not a code."""
    for word in words:
        if not _is_code(word):
            text = word[:20].decode("latin-1")
            raise _malformed_line_error(path, line_number, f"{text!r}")


def _is_code(word: bytes) -> bool:
    return len(word) <= 4 and word.isdigit() and int(word) <= _MAX_CODE


def _malformed_line_error(path: Path, line_number: int, value: str) -> RecordingError:
    """Return the error of a line that is not a row of codes."""
    return RecordingError(
        path,
        value=f"{value} in line {line_number}",
        expected=f"lines with the same number of codes from 0 to {_MAX_CODE}, half I, half Q",
        fix="copy it again from its source",
    )


def _incomplete_last_line_note(line_number: int, n_numbers: int, n_expected: int) -> Finding:
    """Return a note that an incomplete last line was left out."""
    return Finding(
        level="note",
        setting="recording",
        value=f"{n_numbers} numbers in line {line_number}, the last, which is left out",
        expected=f"{n_expected} numbers, as in the lines before",
        fix="no action needed if the recording was stopped there",
    )


def _down_ramp_coupling_note() -> Finding:
    """Return a note on the coupling of down-ramps."""
    return Finding(
        level="note",
        setting="encoding",
        value="down: the down-ramps, reversed and read as up-ramps",
        expected="range-Doppler coupling of the opposite sign: receding targets appear too near",
        fix="average the ranges of both ramps, which cancels the coupling",
    )
