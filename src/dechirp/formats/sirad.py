"""Silicon Radar SiRad: JSON with the settings, and one row of numbers a ramp.

`{"Bandwidth": 6000, "SamplingFrequency": 2.571, "Ramps": 1, "Samps": 32, "PRI": "0.01577",
"Gain": 8, "data": [[I0, Q0, I1, Q1, ...], ...]}`, in MHz, s and dB.

The bandwidth is swept in 37.5 sample periods more than are recorded: of 6 GHz and 32 samples
only 2.76 GHz. Checked on a recording, where ranges so found change as the phase does.
"""

import json
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO, ClassVar

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.values import value
from dechirp.formats.base import Contents, Fit, Format, Told
from dechirp.formats.samples.continuous import must_be_single, whole_frames
from dechirp.formats.samples.iq_order import guess, on_the_wrong_side
from dechirp.formats.settings.base import Iq, Settings, values_from
from dechirp.radar.chirp import Chirp
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar

_KEYS = ("Bandwidth", "SamplingFrequency", "Ramps", "Samps", "PRI")
_HEAD_BYTES = 1024
_BLOCK_BYTES = 2**20
_DATA = re.compile(rb'"data"\s*:\s*\[')
_END = re.compile(rb"(\[[^\[\]]*\])\s*\]\s*\}\s*")
_NUMBERS = b"0123456789-,[] \t\r\n"

_MORE_SAMPLES = 37.5
_START_HZ = 119e9
# At most so many chirps, and numbers of them, whose spectrum tells the order of I and Q.
_LOOKED_AT, _LOOKED_AT_NUMBERS = 4096, 2**20
# Rows, and about how many numbers: the file is found again at each of these.
_PER_MARK, _PER_MARK_NUMBERS = 16, 2**17


@value
class Sirad(Format):
    """Silicon Radar SiRad: JSON with its settings.

    One file; every row is a chirp, and all of them one frame unless the radar is given.
    """

    options: ClassVar[tuple[str, ...]] = ("iq",)

    def recognise(self, path: Path) -> Fit:
        """Tell by the names of the settings at the start."""
        if not path.is_file():
            return Fit.NO
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
        data = _DATA.search(head)
        before = head[: data.start()] if data else b""
        named = all(b'"%b"' % key.encode() in before for key in _KEYS)
        return Fit.OWN if named and before.lstrip()[:1] == b"{" else Fit.NO

    def read(self, path: Path, told: Told) -> Contents:
        """See `Format.read`."""
        head, start = _head(path)
        n_samples = _count(path, head, "Samps")
        if _count(path, head, "Ramps") != 1:
            raise RecordingError(
                path,
                got=f"a recording with Ramps {head['Ramps']!r}",
                need="one with Ramps 1",
                fix="Record one ramp a frame; how several lie in the file is not known.",
            )
        rows = _rows(path, start, 2 * n_samples)
        settings = told.settings or _settings(path, head, n_samples, rows.n_rows)
        must_be_single(path, settings.radar, "complex")
        if settings.radar.frame.chirp.n_samples != n_samples:
            raise RecordingError(
                path,
                got=f"a recording of {n_samples} samples a chirp",
                need=f"of {settings.radar.frame.chirp.n_samples}, as radar.frame.chirp.n_samples"
                " says",
                fix="Correct it, or leave out the radar: the file has its own settings.",
            )
        radar, n_frames, left = whole_frames(path, settings.radar, rows.n_rows)
        full_scale, scale = _full_scale(rows.lowest, rows.highest)
        findings = (*settings.findings, *left, scale)
        looked_at = rows.some[:, 0::2] + 1j * rows.some[:, 1::2]
        if told.iq is None:
            iq, guessed = guess(looked_at)
            findings += (guessed,)
        else:
            iq = told.iq
            swapped = 1j * looked_at.conj() if iq == "qi" else looked_at
            findings += on_the_wrong_side(swapped, iq)
        n_chirps = radar.frame.n_sent

        def decode(index: int, out: np.ndarray) -> None:
            for at, codes in _parts(path, rows, index * n_chirps, (index + 1) * n_chirps):
                _decode(codes, full_scale, iq, out[at : at + len(codes)])

        return Contents(
            radar=radar,
            n_frames=n_frames,
            decode=decode,
            findings=findings,
            iq=iq,
            scale=1 / full_scale,
        )


@value
class _Rows:
    """Where the rows of numbers are, and what was seen of them."""

    n_numbers: int
    """Numbers in a row."""
    n_rows: int
    per_mark: int
    marks: np.ndarray
    """First byte of every so many rows, and the byte behind the last row."""
    lowest: int
    highest: int
    some: np.ndarray
    """(row, number): rows from all over the file."""


def _decode(codes: np.ndarray, full_scale: int, iq: Iq, out: np.ndarray) -> None:
    """Fill (chirp, 1, sample) with rows of codes."""
    first, second = codes[:, None, 0::2], codes[:, None, 1::2]
    out.real, out.imag = (first, second) if iq == "iq" else (second, first)
    out *= np.float32(1 / full_scale)


def _full_scale(low: int, high: int) -> tuple[int, Finding]:
    """Full scale of the converter, which the file does not say."""
    bits = 12 if low >= -2048 and high <= 2047 else 16
    return 2 ** (bits - 1), Finding(
        level="note",
        setting="encoding",
        got=f"codes from {low} to {high}, taken as signed ones of {bits} bits",
        need="the full scale of the converter, for absolute powers only",
        fix="Nothing is to be done: ranges and velocities do not depend on it.",
    )


def _settings(path: Path, head: dict[str, Any], n_samples: int, n_chirps: int) -> Settings:
    """Settings from the file itself."""
    bandwidth_mhz = _number(path, head, "Bandwidth")
    sample_rate_mhz = _number(path, head, "SamplingFrequency")
    interval_s = _number(path, head, "PRI")
    with values_from(path):
        sample_rate_hz = sample_rate_mhz * 1e6
        ramp_s = (n_samples + _MORE_SAMPLES) / sample_rate_hz
        chirp = Chirp(
            start_frequency_hz=_START_HZ,
            slope_hz_per_s=bandwidth_mhz * 1e6 / ramp_s,
            # Where in the ramp the samples lie is not known: in its middle, so that their
            # middle frequency is that of the band.
            adc_start_s=_MORE_SAMPLES / 2 / sample_rate_hz,
            ramp_duration_s=ramp_s,
            sample_rate_hz=sample_rate_hz,
            n_samples=n_samples,
            sampling="complex",
        )
        radar = Radar(frame=Frame(chirp=chirp, n_chirps=n_chirps, interval_s=interval_s))
    assumed = Finding(
        level="note",
        setting="radar.frame.chirp.start_frequency",
        got="not in the file, taken as 119 GHz of the 122 GHz device",
        need="the true one: velocities scale with the wavelength, 1 % for 1.2 GHz",
        fix="Give the radar where the device is another one.",
    )
    one_frame = Finding(
        level="note",
        setting="radar.frame.n_chirps",
        got=f"{n_chirps} frames of one chirp, read as one frame of {n_chirps} chirps,"
        f" {interval_s * 1e3:g} ms apart",
        need="several chirps in a frame, to measure velocity",
        fix="Give the radar with another number of chirps to divide them otherwise.",
    )
    return Settings(radar=radar, merged=True, findings=(assumed, one_frame))


def _head(path: Path) -> tuple[dict[str, Any], int]:
    """Settings before the numbers, and the byte at which the rows begin."""
    with path.open("rb") as file:
        text = file.read(_HEAD_BYTES)
    data = _DATA.search(text)
    try:
        head = json.loads(text[: data.start()] + b'"data": 0}') if data else None
    except (ValueError, RecursionError):
        head = None
    if data is None or not isinstance(head, dict) or not set(_KEYS) <= set(head):
        raise RecordingError(
            path,
            got=f"a file whose first {len(text)} bytes are not the settings of a recording",
            need=f"a JSON object with {', '.join(_KEYS)} before its data",
            fix="Copy it again from its source.",
        )
    return head, data.end()


def _number(path: Path, head: dict[str, Any], key: str) -> float:
    """Setting above 0; some are written as text."""
    try:
        if isinstance(head[key], bool):
            raise ValueError
        number = float(head[key])
    except (ValueError, TypeError, OverflowError):
        number = math.nan
    if not 0 < number < math.inf:
        raise RecordingError(
            path,
            got=f"with {key} {str(head[key])[:40]!r}",
            need=f"with a number above 0 as {key}",
            fix="Copy the file again from its source, or correct it.",
        )
    return number


def _count(path: Path, head: dict[str, Any], key: str) -> int:
    number = _number(path, head, key)
    # Longer chirps would not even fit into a block of text.
    if number != int(number) or number > _BLOCK_BYTES / 8:
        raise RecordingError(
            path,
            got=f"with {key} {str(head[key])[:40]!r}",
            need=f"with a count as {key}",
            fix="Copy the file again from its source, or correct it.",
        )
    return int(number)


def _rows(path: Path, start: int, n_numbers: int) -> _Rows:
    """Look through all rows, of which only a few are kept.

    The whole text as Python numbers would take 12 times its size.
    """
    marks: list[np.ndarray] = []
    some: list[np.ndarray] = []
    most = max(2, min(_LOOKED_AT, _LOOKED_AT_NUMBERS // n_numbers))
    per_mark = max(1, min(_PER_MARK, _PER_MARK_NUMBERS // n_numbers))
    n_rows, n_some, step, lowest, highest, end = 0, 0, 1, 2**15, -(2**15), start
    with path.open("rb") as file:
        file.seek(start)
        for at, text in _texts_of_rows(path, file, start, n_numbers):
            rows = _parsed(path, at, text, n_numbers)
            begins = np.flatnonzero(np.frombuffer(text, np.uint8) == ord("["))
            marks.append(at + begins[-n_rows % per_mark :: per_mark])
            some.append(rows[-n_rows % step :: step].copy())
            n_some += len(some[-1])
            while n_some > most:
                some = [np.concatenate(some)[::2]]
                n_some, step = len(some[0]), 2 * step
            n_rows += len(rows)
            lowest, highest = min(lowest, int(rows.min())), max(highest, int(rows.max()))
            end = at + len(text)
    return _Rows(
        n_numbers=n_numbers,
        n_rows=n_rows,
        per_mark=per_mark,
        marks=np.append(np.concatenate(marks), end),
        lowest=lowest,
        highest=highest,
        some=np.concatenate(some),
    )


def _parts(path: Path, rows: _Rows, first: int, last: int) -> Iterator[tuple[int, np.ndarray]]:
    """Codes (row, number) of some rows, a block of text at a time, and which of them is first."""
    mark, stop = first // rows.per_mark, -(-last // rows.per_mark)
    with path.open("rb") as file:
        while mark < stop:
            at = int(rows.marks[mark])
            then = int(np.searchsorted(rows.marks, at + _BLOCK_BYTES, side="right")) - 1
            then = min(max(then, mark + 1), stop)
            file.seek(at)
            text = file.read(int(rows.marks[then]) - at).rstrip().removesuffix(b",")
            codes = _parsed(path, at, text, rows.n_numbers)
            begin, end = mark * rows.per_mark, min(then * rows.per_mark, rows.n_rows)
            if len(codes) != end - begin:
                raise _malformed(path, at, "other rows than when it was opened", rows.n_numbers)
            chosen = codes[max(first - begin, 0) : last - begin]
            yield max(begin - first, 0), chosen
            mark = then


def _texts_of_rows(
    path: Path, file: BinaryIO, start: int, n_numbers: int
) -> Iterator[tuple[int, bytes]]:
    """Text of several whole rows, and the byte at which it begins."""
    at, text = start, b""
    while block := file.read(_BLOCK_BYTES):
        text += block
        last = text.rfind(b"[")
        before = text[: max(last, 0)].rstrip()
        if before.endswith(b","):
            yield at, before[:-1]
            at, text = at + last, text[last:]
        if len(text) > _BLOCK_BYTES + 16 * n_numbers:
            raise _malformed(path, at, "a row that does not end", n_numbers)
    end = _END.fullmatch(text.lstrip())
    if end is None:
        raise _malformed(path, at, "rows that do not end in ]}", n_numbers)
    yield at + len(text) - len(text.lstrip()), end[1]


def _parsed(path: Path, at: int, text: bytes, n_numbers: int) -> np.ndarray:
    if other := text.translate(None, _NUMBERS):
        wrong = chr(other[0])
        raise _malformed(path, at + text.index(other[:1]), f"{wrong!r} among numbers", n_numbers)
    try:
        rows = json.loads(b"[" + text + b"]")
    except (ValueError, RecursionError) as error:
        place = at + max(getattr(error, "pos", 1) - 1, 0)
        raise _malformed(path, place, "what is no list of numbers", n_numbers) from None
    for row in rows:
        if not isinstance(row, list) or len(row) != n_numbers:
            got = f"a row of {len(row)} numbers" if isinstance(row, list) else "a number in no row"
            raise _malformed(path, at, got, n_numbers)
    try:
        codes = np.array(rows, dtype=np.int64)
        if codes.ndim == 2 and abs(codes).max() < 2**15:
            return codes.astype(np.int16)
    except (ValueError, TypeError, OverflowError):  # lists in lists, or beyond 64 bits
        pass
    raise _malformed(path, at, "what is no number of 16 bits", n_numbers)


def _malformed(path: Path, at: int, got: str, n_numbers: int) -> RecordingError:
    return RecordingError(
        path,
        got=f"a recording with {got}, at byte {at} or soon after",
        need=f"rows of {n_numbers} whole numbers of 16 bits, I and Q in turn, as Samps says",
        fix="Copy it again from its source.",
    )
