"""uRAD: text, one line a measurement: I of all samples, then Q, as codes of a 12-bit converter.

In sawtooth mode a line holds `I Q`, N numbers each; in triangle mode `I-up I-down Q-up Q-down`.
The vendor's example adds the time of the computer, in s. Codes hold the converter's offset,
which stays: it is part of what was sampled. The file has no settings.

Samples of a down-ramp, taken in reverse, are those of an up-ramp from the lower frequency; only
their range-Doppler coupling has the opposite sign.
"""

import math
from array import array
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.values import value
from dechirp.formats.base import Contents, Fit, Format, Told
from dechirp.formats.samples.continuous import against_interval, must_be_single, whole_frames
from dechirp.formats.samples.iq_order import on_the_wrong_side
from dechirp.formats.settings.base import Iq
from dechirp.formats.settings_for import settings_for

_LARGEST_CODE = 4095
_HEAD_BYTES = 2**16
_LONGEST_LINE = 2**16
_COUNTS = range(100, 801)  # numbers of a line: 50 to 200 samples, in two or four parts
_CHARACTERS = b"0123456789. \t\r\n"
_LOOKED_AT = 64


@value
class Urad(Format):
    """uRAD text: a sweep a line.

    Every line is a chirp; of a triangle, its up-ramp or (`encoding` down) its down-ramp.
    """

    options: ClassVar[tuple[str, ...]] = ("encoding", "iq")
    encodings: ClassVar[tuple[str, ...]] = ("up", "down")

    def recognise(self, path: Path) -> Fit:
        """Tell by lines of equally many codes of 12 bits, an even number."""
        if not path.is_file():
            return Fit.NO
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
        lines = head.splitlines()
        if len(head) == _HEAD_BYTES:
            lines = lines[:-1]
        lines = [line for line in lines if line.strip()]
        # The last line of a recording that was stopped may be cut short.
        lines = lines[:-1] if len(lines) > 1 else lines
        counts = {_count(line) for line in lines}
        n_numbers = counts.pop() if len(counts) == 1 else None
        if n_numbers is None or not n_numbers or n_numbers % 2:
            return Fit.NO
        return Fit.LIKELY if n_numbers in _COUNTS else Fit.POSSIBLE

    def read(self, path: Path, told: Told) -> Contents:
        """See `Format.read`."""
        ramp = told.encoding or "up"
        lines = _lines(path)
        settings = settings_for(path, told)
        must_be_single(path, settings.radar, "complex")
        n_samples = settings.radar.frame.chirp.n_samples
        columns = _columns(path, lines.n_numbers, n_samples, ramp)
        radar, n_frames, left = whole_frames(path, settings.radar, len(lines.starts))
        iq = told.iq or "iq"
        n_chirps = radar.frame.n_sent

        def decode(index: int, out: np.ndarray) -> None:
            first = index * n_chirps
            _decode(path, lines, range(first, first + n_chirps), columns, iq, out)

        some = np.empty((min(n_chirps, _LOOKED_AT), 1, n_samples), np.complex64)
        _decode(path, lines, range(len(some)), columns, iq, some)
        findings = settings.findings + lines.findings + left + on_the_wrong_side(some, iq)
        if ramp == "down":
            findings += (_down(),)
        if lines.interval_s is not None:
            findings += against_interval(radar.frame, lines.interval_s, by="the times in the file")
        return Contents(radar=radar, n_frames=n_frames, decode=decode, findings=findings, iq=iq)


@value
class _Lines:
    """Where the lines of a file are."""

    starts: np.ndarray
    """(line,) int64: first byte of each."""
    n_numbers: int
    """Codes in each."""
    interval_s: float | None = None
    """Mean time from line to line; None where no times were written."""
    findings: tuple[Finding, ...] = ()


def _count(line: bytes) -> int | None:
    """How many codes a line holds; None if it holds anything else but a time at its end."""
    codes, _ = _split(line)
    fits = all(code.isdigit() and len(code) <= 4 and int(code) <= _LARGEST_CODE for code in codes)
    return len(codes) if fits and not line.translate(None, _CHARACTERS) else None


def _split(line: bytes) -> tuple[list[bytes], bytes | None]:
    """Words of the codes, and that of the time, which has a point."""
    words = line.split()
    if words and b"." in words[-1]:
        return words[:-1], words[-1]
    return words, None


def _lines(path: Path) -> _Lines:
    """Find the lines, which must hold equally many words; the last may be cut short."""
    starts = array("q")
    times_s: list[float] = []  # of the first line, and of the last one that is whole
    n_numbers = start = number = 0
    other = None
    with path.open("rb") as file:
        while line := file.readline(_LONGEST_LINE + 1):
            number += 1
            if len(line) > _LONGEST_LINE:
                raise _malformed(path, number, f"more than {_LONGEST_LINE} bytes")
            words, time = _split(line)
            if other and words:
                raise _malformed(path, other[0], f"{other[1]} numbers after lines of {n_numbers}")
            n_numbers = n_numbers or len(words)
            if len(words) != n_numbers or not words:
                other = number, len(words)
            else:
                starts.append(start)
                if time and line.endswith(b"\n"):
                    times_s = [*times_s[:1], _seconds(path, number, time)]
            start += len(line)
    if n_numbers < 4 or n_numbers % 2 or (other and other[1] > n_numbers):
        got = f"{other[1]} numbers after lines of {n_numbers}" if other else f"{n_numbers} numbers"
        raise _malformed(path, other[0] if other else 1, got)
    return _Lines(
        starts=np.frombuffer(starts, np.int64),
        n_numbers=n_numbers,
        interval_s=_mean_interval(times_s, len(starts)),
        findings=(_cut(*other, n_numbers),) if other and other[1] else (),
    )


def _mean_interval(times_s: list[float], n_lines: int) -> float | None:
    if len(times_s) < 2 or n_lines < 2:
        return None
    interval_s = (times_s[1] - times_s[0]) / (n_lines - 1)
    return interval_s if 0 < interval_s < math.inf else None


def _seconds(path: Path, number: int, time: bytes) -> float:
    try:
        return float(time)
    except ValueError:
        raise _malformed(path, number, f"{time[:20].decode('latin-1')!r}") from None


def _columns(path: Path, n_numbers: int, n_samples: int, ramp: str) -> tuple[slice, slice]:
    """Which numbers of a line are the first and the second part of the samples."""
    n = n_samples
    if n_numbers == 4 * n and ramp == "down":
        # In reverse: from the second half of each part down to its middle.
        return slice(2 * n - 1, n - 1, -1), slice(4 * n - 1, 3 * n - 1, -1)
    if n_numbers == 4 * n:
        return slice(0, n), slice(2 * n, 3 * n)
    if n_numbers == 2 * n and ramp == "up":
        return slice(0, n), slice(n, 2 * n)
    fits = [f"{4 * n} (I-up, I-down, Q-up, Q-down)"]
    fits += [f"{2 * n} (I, Q)"] * (ramp == "up")
    raise RecordingError(
        path,
        got=f"a recording of {n_numbers} numbers a line",
        need=f"of {' or '.join(fits)}, for chirps of {n} samples as radar.frame.chirp.n_samples"
        " says",
        fix="Correct radar.frame.chirp.n_samples, or leave out the encoding in sawtooth mode;"
        " the dual-rate mode is not read.",
    )


def _decode(
    path: Path, lines: _Lines, chosen: range, columns: tuple[slice, slice], iq: Iq, out: np.ndarray
) -> None:
    """Fill (chirp, 1, sample) with the chosen lines, within -1 to 1."""
    first, second = columns
    with path.open("rb") as file:
        for place, index in enumerate(chosen):
            file.seek(int(lines.starts[index]))
            words, _ = _split(file.readline(_LONGEST_LINE + 1))
            codes = _codes(path, index + 1, words, lines.n_numbers)
            scaled = codes.astype(np.float32) * np.float32(2 / _LARGEST_CODE) - np.float32(1)
            parts = scaled[first], scaled[second]
            chirp = out[place, 0]
            chirp.real, chirp.imag = parts if iq == "iq" else parts[::-1]


def _codes(path: Path, number: int, words: list[bytes], n_numbers: int) -> np.ndarray:
    """Codes of a line, every one checked."""
    if len(words) != n_numbers:
        raise _malformed(path, number, f"{len(words)} numbers after lines of {n_numbers}")
    try:
        if max(map(len, words)) <= 4:
            codes = np.array(words).astype(np.int64)
            if codes.min() >= 0 and codes.max() <= _LARGEST_CODE:
                return codes
    except ValueError:
        pass
    wrong = next(
        word for word in words if len(word) > 4 or not word.isdigit() or int(word) > _LARGEST_CODE
    )
    raise _malformed(path, number, f"{wrong[:20].decode('latin-1')!r}")


def _malformed(path: Path, number: int, got: str) -> RecordingError:
    return RecordingError(
        path,
        got=f"a recording with {got} in line {number}",
        need=f"lines of equally many codes from 0 to {_LARGEST_CODE}, half of them I and half Q",
        fix="Copy it again from its source.",
    )


def _cut(number: int, got: int, need: int) -> Finding:
    return Finding(
        level="note",
        setting="recording",
        got=f"{got} numbers in line {number}, the last, which is left out",
        need=f"{need} numbers, as in the lines before",
        fix="Nothing is to be done if the recording was stopped there.",
    )


def _down() -> Finding:
    return Finding(
        level="note",
        setting="encoding",
        got="down, the down-ramps, read in reverse as if they were up-ramps",
        need="care with moving targets: their range-Doppler coupling has the opposite sign, so"
        " that receding ones seem too near",
        fix="Range is free of coupling in the mean of both ramps.",
    )
