"""Silicon Radar SiRad: JSON with the settings and one row of numbers a ramp.

`{"Bandwidth": 6000, "SamplingFrequency": 2.571, "Ramps": 1, "Samps": 32, "PRI": "0.01577",
"Gain": 8, "data": [[Q0, I0, Q1, I1, ...], ...]}`, in MHz, s and dB.

The ramp sweeps the bandwidth in 37.5 more sample periods than are recorded: 32 samples cover only
2.76 of 6 GHz. Verified on a recording in which ranges computed so change as the phase does.
"""

import codecs
import json
import math
import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO, ClassVar

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
    divide_chirps_into_frames,
    join_single_chirps,
)
from dechirp.recordings.samples.iq_order import negative_beat_frequency_findings
from dechirp.recordings.settings.base import Iq, RecordingSettings, convert_setting_errors

_KEYS = ("Bandwidth", "SamplingFrequency", "Ramps", "Samps", "PRI")
_HEAD_BYTES = 1024
_BLOCK_BYTES = 2**20
_DATA = re.compile(rb'"data"\s*:\s*\[')
_END = re.compile(rb"(\[[^\[\]]*\])\s*\]\s*\}\s*")
_NUMBER_CHARACTERS = b"0123456789- \t\r\n"
_NUMBERS = _NUMBER_CHARACTERS + b",[]"
_JOINT = re.compile(rb"\]\s*,\s*\[")

_UNRECORDED_SAMPLES = 37.5
_START_HZ = 119e9
_IQ: Iq = "qi"
"""Order of the two numbers of a sample: I first, as the file has them, puts the echoes of the
upward ramp at negative beat frequencies."""
# Limits of the chirps, and of their numbers, whose spectrum confirms the order of I and Q.
_MAX_SAMPLED_ROWS, _MAX_SAMPLED_NUMBERS = 4096, 2**20
# Rows, and numbers, between two stored offsets of the file.
_ROWS_PER_OFFSET, _NUMBERS_PER_OFFSET = 16, 2**17


@frozen_dataclass
class Sirad(Format):
    """Silicon Radar SiRad: JSON with its settings.

    One file; each row is a chirp, joined to frames (see `join_single_chirps`) unless the radar is
    given.
    """

    options: ClassVar[tuple[str, ...]] = ("iq",)

    def recognise(self, path: Path) -> MatchQuality:
        if not path.is_file():
            return MatchQuality.NO
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
        data = _DATA.search(head)
        header = head[: data.start()] if data else b""
        has_all_keys = all(b'"%b"' % key.encode() in header for key in _KEYS)
        return (
            MatchQuality.SELF_DESCRIBING
            if has_all_keys and header.removeprefix(codecs.BOM_UTF8).lstrip()[:1] == b"{"
            else MatchQuality.NO
        )

    def read(self, path: Path, hints: RecordingHints) -> Contents:
        header, start = _read_json_header_and_data_start(path)
        n_samples = _positive_header_integer(path, header, "Samps")
        if _positive_header_integer(path, header, "Ramps") != 1:
            raise RecordingError(
                path,
                value=f"Ramps {header['Ramps']!r}",
                expected="Ramps 1: the layout of several ramps is not known",
                fix="record one ramp a frame",
            )
        rows = _index_rows_with_statistics(path, start, 2 * n_samples)
        settings = hints.settings or _settings_from_header(path, header, n_samples)
        check_single_receiver_and_sampling(path, settings.radar, "complex")
        if settings.radar.frame.chirp.n_samples != n_samples:
            raise RecordingError(
                path,
                value=f"{n_samples} samples a chirp",
                expected=f"{settings.radar.frame.chirp.n_samples}, the radar.frame.chirp.n_samples",
                fix="correct it, or leave out the radar: the file has its own settings",
            )
        joined_radar, joined_findings = join_single_chirps(settings.radar, rows.n_rows)
        radar, n_frames, frame_findings = divide_chirps_into_frames(path, joined_radar, rows.n_rows)
        full_scale, scale_note = _guess_adc_full_scale_with_note(rows.lowest, rows.highest)
        findings = (*settings.findings, *joined_findings, *frame_findings, scale_note)
        sampled_chirps = rows.sampled_rows[:, 0::2] + 1j * rows.sampled_rows[:, 1::2]
        iq = hints.iq or _IQ
        ordered_chirps = 1j * sampled_chirps.conj() if iq == "qi" else sampled_chirps
        findings += negative_beat_frequency_findings(ordered_chirps[:, None], iq)
        n_chirps = radar.frame.n_chirps_total

        def decode(index: int, out: np.ndarray) -> None:
            for chirp, codes in _iter_code_row_blocks(
                path, rows, index * n_chirps, (index + 1) * n_chirps
            ):
                _decode_iq_chirps(codes, full_scale, iq, out[chirp : chirp + len(codes)])

        return Contents(
            radar=radar,
            n_frames=n_frames,
            decode=decode,
            findings=findings,
            iq=iq,
            scale=1 / full_scale,
        )


@frozen_dataclass
class _RowIndex:
    """Positions of the rows of numbers, and the statistics of a first pass over them."""

    n_numbers: int
    """Numbers in a row."""
    n_rows: int
    rows_per_offset: int
    offsets: np.ndarray
    """First byte of every `rows_per_offset`-th row, and the end of the last row."""
    lowest: int
    highest: int
    sampled_rows: np.ndarray
    """(row, number): rows from all over the file."""


def _decode_iq_chirps(codes: np.ndarray, full_scale: int, iq: Iq, out: np.ndarray) -> None:
    """Fill (chirp, 1, sample) with rows of codes."""
    first, second = codes[:, None, 0::2], codes[:, None, 1::2]
    out.real, out.imag = (first, second) if iq == "iq" else (second, first)
    out *= np.float32(1 / full_scale)


def _guess_adc_full_scale_with_note(lowest_code: int, highest_code: int) -> tuple[int, Finding]:
    """Guess the full scale of the ADC, which the file does not contain."""
    bits = 12 if lowest_code >= -2048 and highest_code <= 2047 else 16
    return 2 ** (bits - 1), Finding(
        level="note",
        setting="encoding",
        value=f"codes from {lowest_code} to {highest_code}, taken as signed ones of {bits} bits",
        expected="the full scale of the ADC, which only absolute powers need",
        fix="no action needed for ranges and velocities",
    )


def _settings_from_header(path: Path, header: dict[str, Any], n_samples: int) -> RecordingSettings:
    """Build the settings from the header of the file."""
    bandwidth_mhz = _positive_header_number(path, header, "Bandwidth")
    sample_rate_mhz = _positive_header_number(path, header, "SamplingFrequency")
    interval_s = _positive_header_number(path, header, "PRI")
    with convert_setting_errors(path):
        sample_rate_hz = sample_rate_mhz * 1e6
        ramp_s = (n_samples + _UNRECORDED_SAMPLES) / sample_rate_hz
        chirp = Chirp(
            start_frequency_hz=_START_HZ,
            slope_hz_per_s=bandwidth_mhz * 1e6 / ramp_s,
            # The position of the samples in the ramp is unknown; in its middle, their centre
            # frequency is that of the band.
            adc_start_s=_UNRECORDED_SAMPLES / 2 / sample_rate_hz,
            ramp_duration_s=ramp_s,
            sample_rate_hz=sample_rate_hz,
            n_samples=n_samples,
            sampling="complex",
        )
        radar = Radar(frame=Frame(chirp=chirp, n_chirps=1, interval_s=interval_s))
    start_frequency_note = Finding(
        level="note",
        setting="radar.frame.chirp.start_frequency",
        value="missing in the file, assumed to be 119 GHz, as of the 122 GHz device",
        expected="the start frequency of the device; 1.2 GHz change velocities by 1 %",
        fix="give the radar if the device is another one",
    )
    return RecordingSettings(radar=radar, findings=(start_frequency_note,))


def _read_json_header_and_data_start(path: Path) -> tuple[dict[str, Any], int]:
    """Return the settings before the numbers, and the byte at which the rows begin."""
    with path.open("rb") as file:
        text = file.read(_HEAD_BYTES)
    data = _DATA.search(text)
    try:
        header = json.loads(text[: data.start()] + b'"data": 0}') if data else None
    except (ValueError, RecursionError):
        header = None
    if data is None or not isinstance(header, dict) or not set(_KEYS) <= set(header):
        raise RecordingError(
            path,
            value=f"no settings of a recording in the first {len(text)} bytes",
            expected=f"a JSON object with {', '.join(_KEYS)} before its data",
            fix="copy it again from its source",
        )
    return header, data.end()


def _positive_header_number(path: Path, header: dict[str, Any], key: str) -> float:
    """Return a positive setting; some are written as text."""
    try:
        if isinstance(header[key], bool):
            raise ValueError
        number = float(header[key])
    except (ValueError, TypeError, OverflowError):
        number = math.nan
    if not 0 < number < math.inf:
        raise RecordingError(
            path,
            value=f"{key} {str(header[key])[:40]!r}",
            expected=f"a positive number as {key}",
            fix="copy the file again from its source, or correct it",
        )
    return number


def _positive_header_integer(path: Path, header: dict[str, Any], key: str) -> int:
    """Return a positive integer setting."""
    number = _positive_header_number(path, header, key)
    # Longer chirps would not fit into a block of text.
    if number != int(number) or number > _BLOCK_BYTES / 8:
        raise RecordingError(
            path,
            value=f"{key} {str(header[key])[:40]!r}",
            expected=f"a positive integer as {key}",
            fix="copy the file again from its source, or correct it",
        )
    return int(number)


def _index_rows_with_statistics(path: Path, start: int, n_numbers: int) -> _RowIndex:
    """Find all rows, keeping only a few of them.

    As Python numbers, the whole text would take 12 times its size.
    """
    offsets: list[np.ndarray] = []
    sampled_rows: list[np.ndarray] = []
    max_sampled = max(2, min(_MAX_SAMPLED_ROWS, _MAX_SAMPLED_NUMBERS // n_numbers))
    rows_per_offset = max(1, min(_ROWS_PER_OFFSET, _NUMBERS_PER_OFFSET // n_numbers))
    n_rows, n_sampled, step, lowest, highest, end = 0, 0, 1, 2**15, -(2**15), start
    with path.open("rb") as file:
        file.seek(start)
        for text_offset, text in _iter_row_blocks(path, file, start, n_numbers):
            rows = _parse_rows_to_codes(path, text_offset, text, n_numbers)
            row_starts = np.flatnonzero(np.frombuffer(text, np.uint8) == ord("["))
            offsets.append(text_offset + row_starts[-n_rows % rows_per_offset :: rows_per_offset])
            sampled_rows.append(rows[-n_rows % step :: step].copy())
            n_sampled += len(sampled_rows[-1])
            while n_sampled > max_sampled:
                sampled_rows = [np.concatenate(sampled_rows)[::2]]
                n_sampled, step = len(sampled_rows[0]), 2 * step
            n_rows += len(rows)
            lowest, highest = min(lowest, int(rows.min())), max(highest, int(rows.max()))
            end = text_offset + len(text)
    return _RowIndex(
        n_numbers=n_numbers,
        n_rows=n_rows,
        rows_per_offset=rows_per_offset,
        offsets=np.append(np.concatenate(offsets), end),
        lowest=lowest,
        highest=highest,
        sampled_rows=np.concatenate(sampled_rows),
    )


def _iter_code_row_blocks(
    path: Path, row_index: _RowIndex, first_row: int, stop_row: int
) -> Iterator[tuple[int, np.ndarray]]:
    """Yield the codes (row, number) of some rows block by block, with the index of the first."""
    block, last_block = (
        first_row // row_index.rows_per_offset,
        -(-stop_row // row_index.rows_per_offset),
    )
    with path.open("rb") as file:
        while block < last_block:
            start = int(row_index.offsets[block])
            next_block = (
                int(np.searchsorted(row_index.offsets, start + _BLOCK_BYTES, side="right")) - 1
            )
            next_block = min(max(next_block, block + 1), last_block)
            file.seek(start)
            text = file.read(int(row_index.offsets[next_block]) - start).rstrip().removesuffix(b",")
            codes = _parse_rows_to_codes(path, start, text, row_index.n_numbers)
            begin, end = (
                block * row_index.rows_per_offset,
                min(next_block * row_index.rows_per_offset, row_index.n_rows),
            )
            if len(codes) != end - begin:
                raise _malformed_rows_error(
                    path, start, "other rows than when it was opened", row_index.n_numbers
                )
            selected_codes = codes[max(first_row - begin, 0) : stop_row - begin]
            yield max(begin - first_row, 0), selected_codes
            block = next_block


def _iter_row_blocks(
    path: Path, file: BinaryIO, start: int, n_numbers: int
) -> Iterator[tuple[int, bytes]]:
    """Yield the text of several complete rows, with the byte at which it begins."""
    offset, text = start, b""
    while block := file.read(_BLOCK_BYTES):
        text += block
        last_row = text.rfind(b"[")
        complete_rows = text[: max(last_row, 0)].rstrip()
        if complete_rows.endswith(b","):
            yield offset, complete_rows[:-1]
            offset, text = offset + last_row, text[last_row:]
        if len(text) > _BLOCK_BYTES + 16 * n_numbers:
            raise _malformed_rows_error(path, offset, "a row that does not end", n_numbers)
    final_row = _END.fullmatch(text.lstrip())
    if final_row is None:
        raise _malformed_rows_error(path, offset, "rows that do not end in ]}", n_numbers)
    yield offset + len(text) - len(text.lstrip()), final_row[1]


def _parse_rows_to_codes(path: Path, offset: int, text: bytes, n_numbers: int) -> np.ndarray:
    """Parse the text of complete rows to codes (row, number)."""
    if unexpected := text.translate(None, _NUMBERS):
        character = chr(unexpected[0])
        raise _malformed_rows_error(
            path, offset + text.index(unexpected[:1]), f"{character!r} among numbers", n_numbers
        )
    codes = _parse_canonical_rows(text, n_numbers)
    if codes is not None:
        return codes
    try:
        rows = json.loads(b"[" + text + b"]")
    except (ValueError, RecursionError) as error:
        error_offset = offset + max(getattr(error, "pos", 1) - 1, 0)
        raise _malformed_rows_error(
            path, error_offset, "text other than a list of numbers", n_numbers
        ) from None
    for row in rows:
        if not isinstance(row, list) or len(row) != n_numbers:
            found_row = (
                f"a row of {len(row)} numbers"
                if isinstance(row, list)
                else "a number outside of a row"
            )
            raise _malformed_rows_error(path, offset, found_row, n_numbers)
    try:
        codes = np.array(rows, dtype=np.int64)
        if codes.ndim == 2 and _fit_into_16_bits(codes):
            return codes.astype(np.int16)
    except (ValueError, TypeError, OverflowError):  # nested lists, or numbers beyond 64 bits
        pass
    raise _malformed_rows_error(path, offset, "a value other than a 16-bit integer", n_numbers)


def _parse_canonical_rows(text: bytes, n_numbers: int) -> np.ndarray | None:
    """Parse valid rows in a quarter of the time of `json`; return None where it has to judge."""
    separators = text.translate(None, _NUMBER_CHARACTERS)
    n_rows = separators.count(b"[")
    numbers, n_joints = _JOINT.subn(b",", text)
    if (
        separators + b"," != (b"[" + b"," * (n_numbers - 1) + b"],") * n_rows
        or n_joints != n_rows - 1
        or not (text.startswith(b"[") and text.endswith(b"]"))
    ):
        return None
    # NumPy reads a lone sign and an empty place as 0, and leading zeros: none of them is JSON.
    characters = np.frombuffer(numbers, np.uint8)
    is_digit = characters - np.uint8(ord("0")) < 10
    is_first_digit = is_digit[1:] & ~is_digit[:-1]
    is_lone_sign = (characters[:-1] == ord("-")) & ~is_digit[1:]
    is_leading_zero = is_first_digit[:-1] & (characters[1:-1] == ord("0")) & is_digit[2:]
    if is_lone_sign.any() or is_leading_zero.any():
        return None
    if np.count_nonzero(is_first_digit) != n_rows * n_numbers:
        return None
    try:
        with warnings.catch_warnings():
            # Numbers that no comma divides; some versions of NumPy only warn of them.
            warnings.simplefilter("error", DeprecationWarning)
            codes = np.fromstring(numbers[1:-1], np.int64, sep=",")
    except (ValueError, DeprecationWarning):
        return None
    if codes.size != n_rows * n_numbers or not _fit_into_16_bits(codes):
        return None
    return codes.astype(np.int16).reshape(n_rows, n_numbers)


def _fit_into_16_bits(codes: np.ndarray) -> bool:
    return bool(codes.min() >= -(2**15) and codes.max() < 2**15)


def _malformed_rows_error(path: Path, offset: int, value: str, n_numbers: int) -> RecordingError:
    """Return the error of rows that are not numbers of 16 bits."""
    return RecordingError(
        path,
        value=f"{value}, at byte {offset} or soon after",
        expected=f"rows of {n_numbers} 16-bit integers, Q and I alternating, from Samps",
        fix="copy it again from its source",
    )
