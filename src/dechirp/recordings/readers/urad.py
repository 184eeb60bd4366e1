"""uRAD text: one line a measurement, I of all samples, then Q, as codes of a 12-bit ADC.

In sawtooth mode a line holds `I Q`, N numbers each; in triangle mode `I-up I-down Q-up Q-down`.
The vendor's example appends the computer's time in s. The ADC offset is part of the samples and
stays. The file contains no settings.

Reversed samples of a down-ramp equal those of an up-ramp from the lower frequency, except that
their range-Doppler coupling has the opposite sign.
"""

import math
from array import array
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.values import frozen_dataclass
from dechirp.recordings.readers.base import Contents, Format, MatchQuality, RecordingHints
from dechirp.recordings.samples.continuous import (
    check_single_receiver_and_sampling,
    chirp_interval_findings,
    divide_chirps_into_frames,
)
from dechirp.recordings.samples.iq_order import negative_beat_frequency_findings
from dechirp.recordings.settings.base import Iq
from dechirp.recordings.settings_lookup import find_recording_settings

_MAX_CODE = 4095
_HEAD_BYTES = 2**16
_MAX_LINE_BYTES = 2**16
_NUMBERS_PER_LINE = range(100, 801)  # 50 to 200 samples, in two or four parts
_CHARACTERS = b"0123456789. \t\r\n"
_MAX_SAMPLED_CHIRPS = 64


@frozen_dataclass
class Urad(Format):
    """uRAD text: a sweep a line.

    Each line is a chirp; of a triangle, its up-ramp or (`encoding` down) its down-ramp.
    """

    options: ClassVar[tuple[str, ...]] = ("encoding", "iq")
    encodings: ClassVar[tuple[str, ...]] = ("up", "down")

    def recognise(self, path: Path) -> MatchQuality:
        if not path.is_file():
            return MatchQuality.NO
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
        lines = head.splitlines()
        if len(head) == _HEAD_BYTES:
            lines = lines[:-1]
        lines = [line for line in lines if line.strip()]
        # A stopped recording may end within a line.
        lines = lines[:-1] if len(lines) > 1 else lines
        counts = {_count_codes_or_none(line) for line in lines}
        n_numbers = counts.pop() if len(counts) == 1 else None
        if n_numbers is None or not n_numbers or n_numbers % 2:
            return MatchQuality.NO
        return MatchQuality.LIKELY if n_numbers in _NUMBERS_PER_LINE else MatchQuality.POSSIBLE

    def read(self, path: Path, hints: RecordingHints) -> Contents:
        ramp = hints.encoding or "up"
        lines = _index_measurement_lines(path)
        settings = find_recording_settings(path, hints)
        check_single_receiver_and_sampling(path, settings.radar, "complex")
        n_samples = settings.radar.frame.chirp.n_samples
        columns = _iq_columns(path, lines.n_numbers, n_samples, ramp)
        radar, n_frames, frame_findings = divide_chirps_into_frames(
            path, settings.radar, len(lines.starts)
        )
        iq = hints.iq or "iq"
        n_chirps = radar.frame.n_chirps_total

        def decode(index: int, out: np.ndarray) -> None:
            first = index * n_chirps
            _decode_lines_to_chirps(path, lines, range(first, first + n_chirps), columns, iq, out)

        sampled_chirps = np.empty((min(n_chirps, _MAX_SAMPLED_CHIRPS), 1, n_samples), np.complex64)
        _decode_lines_to_chirps(
            path, lines, range(len(sampled_chirps)), columns, iq, sampled_chirps
        )
        findings = (
            settings.findings
            + lines.findings
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

    starts: np.ndarray
    """(line,) int64: first byte of each line."""
    n_numbers: int
    """Codes in each line."""
    interval_s: float | None = None
    """Mean interval between lines; None without times."""
    findings: tuple[Finding, ...] = ()


def _count_codes_or_none(line: bytes) -> int | None:
    """Count the codes of a line; None if it holds anything else, except a time at its end."""
    codes, _ = _split_codes_and_time(line)
    fits = all(code.isdigit() and len(code) <= 4 and int(code) <= _MAX_CODE for code in codes)
    return len(codes) if fits and not line.translate(None, _CHARACTERS) else None


def _split_codes_and_time(line: bytes) -> tuple[list[bytes], bytes | None]:
    """Split a line into its codes and its time, which contains a decimal point."""
    words = line.split()
    if words and b"." in words[-1]:
        return words[:-1], words[-1]
    return words, None


def _index_measurement_lines(path: Path) -> _LineIndex:
    """Find the lines and check that their lengths agree; the last may be incomplete."""
    starts = array("q")
    times_s: list[float] = []  # of the first and of the last complete line
    n_numbers = start = line_number = 0
    odd_line = None
    with path.open("rb") as file:
        while line := file.readline(_MAX_LINE_BYTES + 1):
            line_number += 1
            if len(line) > _MAX_LINE_BYTES:
                raise _malformed_line_error(path, line_number, f"more than {_MAX_LINE_BYTES} bytes")
            words, time = _split_codes_and_time(line)
            if odd_line and words:
                raise _malformed_line_error(
                    path, odd_line[0], f"{odd_line[1]} numbers after lines of {n_numbers}"
                )
            n_numbers = n_numbers or len(words)
            if len(words) != n_numbers or not words:
                odd_line = line_number, len(words)
            else:
                starts.append(start)
                if time and line.endswith(b"\n"):
                    times_s = [*times_s[:1], _parse_time_s(path, line_number, time)]
            start += len(line)
    if n_numbers < 4 or n_numbers % 2 or (odd_line and odd_line[1] > n_numbers):
        count_text = (
            f"{odd_line[1]} numbers after lines of {n_numbers}"
            if odd_line
            else f"{n_numbers} numbers"
        )
        raise _malformed_line_error(path, odd_line[0] if odd_line else 1, count_text)
    return _LineIndex(
        starts=np.frombuffer(starts, np.int64),
        n_numbers=n_numbers,
        interval_s=_mean_line_interval_s(times_s, len(starts)),
        findings=(_incomplete_last_line_note(*odd_line, n_numbers),)
        if odd_line and odd_line[1]
        else (),
    )


def _mean_line_interval_s(first_and_last_time_s: list[float], n_lines: int) -> float | None:
    """Return the mean interval between lines; None without two times."""
    if len(first_and_last_time_s) < 2 or n_lines < 2:
        return None
    interval_s = (first_and_last_time_s[1] - first_and_last_time_s[0]) / (n_lines - 1)
    return interval_s if 0 < interval_s < math.inf else None


def _parse_time_s(path: Path, line_number: int, time: bytes) -> float:
    """Parse the time of a line."""
    try:
        return float(time)
    except ValueError:
        raise _malformed_line_error(path, line_number, f"{time[:20].decode('latin-1')!r}") from None


def _iq_columns(path: Path, n_numbers: int, n_samples: int, ramp: str) -> tuple[slice, slice]:
    """Return the columns of the first and of the second part of the samples."""
    n = n_samples
    if n_numbers == 4 * n and ramp == "down":
        # Reversed: from the end of each part down to its middle.
        return slice(2 * n - 1, n - 1, -1), slice(4 * n - 1, 3 * n - 1, -1)
    if n_numbers == 4 * n:
        return slice(0, n), slice(2 * n, 3 * n)
    if n_numbers == 2 * n and ramp == "up":
        return slice(0, n), slice(n, 2 * n)
    fits = [f"{4 * n} (I-up, I-down, Q-up, Q-down)"]
    fits += [f"{2 * n} (I, Q)"] * (ramp == "up")
    raise RecordingError(
        path,
        value=f"{n_numbers} numbers a line",
        expected=f"{' or '.join(fits)}, for chirps of {n} samples (radar.frame.chirp.n_samples)",
        fix="correct radar.frame.chirp.n_samples, or leave out the encoding in sawtooth mode;"
        " the dual-rate mode is not supported",
    )


def _decode_lines_to_chirps(
    path: Path,
    lines: _LineIndex,
    line_indices: range,
    columns: tuple[slice, slice],
    iq: Iq,
    out: np.ndarray,
) -> None:
    """Fill (chirp, 1, sample) with lines, scaled to -1 ... 1."""
    first, second = columns
    with path.open("rb") as file:
        for chirp_index, index in enumerate(line_indices):
            file.seek(int(lines.starts[index]))
            words, _ = _split_codes_and_time(file.readline(_MAX_LINE_BYTES + 1))
            codes = _parse_codes(path, index + 1, words, lines.n_numbers)
            scaled = codes.astype(np.float32) * np.float32(2 / _MAX_CODE) - np.float32(1)
            parts = scaled[first], scaled[second]
            chirp = out[chirp_index, 0]
            chirp.real, chirp.imag = parts if iq == "iq" else parts[::-1]


def _parse_codes(path: Path, line_number: int, words: list[bytes], n_numbers: int) -> np.ndarray:
    """Parse and check the codes of a line."""
    if len(words) != n_numbers:
        raise _malformed_line_error(
            path, line_number, f"{len(words)} numbers after lines of {n_numbers}"
        )
    try:
        if max(map(len, words)) <= 4:
            codes = np.array(words).astype(np.int64)
            if codes.min() >= 0 and codes.max() <= _MAX_CODE:
                return codes
    except ValueError:
        pass
    bad_word = next(
        word for word in words if len(word) > 4 or not word.isdigit() or int(word) > _MAX_CODE
    )
    raise _malformed_line_error(path, line_number, f"{bad_word[:20].decode('latin-1')!r}")


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
