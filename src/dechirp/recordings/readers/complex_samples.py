"""Bare complex samples of software-defined radios: I and Q of each sample side by side, no header.

The type of the numbers follows from the suffix, as GNU Radio, SDR programs and SigMF name it, or
is recognised: words of a converter, read as float32, are hardly ever numbers of ordinary size.
Chirps follow one another, without or with the pauses between them: the length of the file or the
sharper spectrum decides.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from dechirp.core.compiled_kernels import kernel
from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.values import frozen_dataclass
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar
from dechirp.recordings.arrays.encodings import scale_lazily_to_full_scale
from dechirp.recordings.arrays.lazy_files import open_memory_mapped_array
from dechirp.recordings.arrays.named_axes import (
    infer_shape_and_findings,
    interpret_array_as_recording,
)
from dechirp.recordings.readers.base import (
    Contents,
    Format,
    MatchQuality,
    RecordingHints,
    identify_non_raw_content,
)
from dechirp.recordings.readers.float_points import likely_row_length
from dechirp.recordings.samples.continuous import (
    chirp_start_offsets,
    chirp_start_samples,
    count_frames_with_pauses,
)
from dechirp.recordings.samples.iq_order import negative_beat_frequency_findings
from dechirp.recordings.samples.sample_order import choose_sample_order, spectral_concentration
from dechirp.recordings.settings.base import Iq
from dechirp.recordings.settings_lookup import find_recording_settings

_TYPES = {
    "cf32": "<f4",
    "cf64": "<f8",
    "cs8": "i1",
    "cu8": "u1",
    "cs16": "<i2",
    "cu16": "<u2",
    "cs32": "<i4",
}
_OTHER_SUFFIXES = {
    **dict.fromkeys(("fc32", "cfile", "c64", "complex64", "gr_complex"), "cf32"),
    **dict.fromkeys(("fc64", "complex128"), "cf64"),
    **dict.fromkeys(("sc8", "ci8"), "cs8"),
    **dict.fromkeys(("sc16", "ci16"), "cs16"),
    **dict.fromkeys(("sc32", "ci32"), "cs32"),
}
_UNDECIDED_SUFFIXES = ("iq", "c")
_HEAD_BYTES = 2**14
_MAX_SAMPLED_CHIRPS = 64
_MAX_SAMPLE = 1e15  # its square still fits into single precision


@frozen_dataclass
class ComplexSamples(Format):
    """Bare complex samples (`.cf32`, `.cfile`, `.cs16`, `.cu8`, `.iq`): I and Q side by side.

    The suffix names the type of the numbers, else `encoding`. Integers of b bits have their full
    scale at 2^(b - 1); unsigned ones have their zero there. Floats stay unchanged.
    """

    options: ClassVar[tuple[str, ...]] = ("axes", "encoding", "iq")
    encodings: ClassVar[tuple[str, ...]] = tuple(_TYPES)

    def recognise(self, path: Path) -> MatchQuality:
        if not path.is_file() or identify_non_raw_content(path) is not None:
            return MatchQuality.NO
        suffix = path.suffix.lower().removeprefix(".")
        if suffix in (*_TYPES, *_OTHER_SUFFIXES, *_UNDECIDED_SUFFIXES):
            return MatchQuality.CONTAINER
        return MatchQuality.LIKELY if holds_float32_numbers(path) else MatchQuality.NO

    def read(self, path: Path, hints: RecordingHints) -> Contents:
        try:
            settings = find_recording_settings(path, hints)
        except RecordingError:
            _refuse_points(path)
            raise
        encoding, type_findings = _number_type_and_findings(path, hints)
        frame = settings.radar.frame
        if frame.chirp.sampling != "complex":
            raise RecordingError(
                path,
                value=f"complex samples ({encoding}), and real samples in the settings",
                expected="radar.frame.chirp.sampling: complex",
                fix="correct the settings, or give --format bare-cube for real numbers",
            )
        n_bytes = path.stat().st_size
        dtype = np.dtype(_TYPES[encoding])
        n_samples, rest = divmod(n_bytes, 2 * dtype.itemsize)
        description = f"{n_samples} complex samples ({encoding})"
        axes = hints.axes or _default_axes(path, settings.radar, description)
        shape, findings = infer_shape_and_findings(
            path, axes, settings, n_samples, description=description
        )
        findings = (*type_findings, *findings, *_incomplete_sample_findings(rest))
        if hints.axes is None:
            packed = Contents(
                radar=settings.radar,
                n_frames=shape[0],
                decode=_make_decoder(path, dtype, hints.iq or "iq", _packed_starts(frame)),
                findings=(*settings.findings, *findings),
            )
            continuous = Contents(
                radar=settings.radar,
                n_frames=0,
                decode=_make_decoder(
                    path, dtype, hints.iq or "iq", partial(chirp_start_samples, frame)
                ),
                findings=(*settings.findings, *type_findings),
            )
            contents = _choose_without_or_with_pauses(path, packed, continuous, n_samples)
        else:
            numbers = open_memory_mapped_array(path, dtype, (*shape, 2))
            contents = interpret_array_as_recording(
                path,
                numbers if dtype.kind == "f" else scale_lazily_to_full_scale(numbers),
                replace(hints, settings=settings, axes=(*axes, "iq"), encoding="full-scale"),
                file_bytes=n_bytes,
                findings=findings,
            )
        return _with_iq_findings(contents, hints)


def _refuse_points(path: Path) -> None:
    """Raise `RecordingError` for a file without a suffix of samples that looks like points."""
    suffix = path.suffix.lower().removeprefix(".")
    if suffix in (*_TYPES, *_OTHER_SUFFIXES, *_UNDECIDED_SUFFIXES):
        return
    n_columns = likely_row_length(path) if holds_float32_numbers(path) else None
    if n_columns is not None:
        raise RecordingError(
            path,
            value=f"float32 numbers that look like points in rows of {n_columns}, without names",
            expected="the name of each number of a row, or a radar if they are samples",
            fix="name them, such as --axes x,y,z,velocity,snr; for samples, give --radar FILE",
        )


def _packed_starts(frame: Frame) -> Callable[[int], np.ndarray]:
    """Return the function that gives the first samples of the chirps of a frame without pauses."""
    starts = frame.chirp.n_samples * np.arange(frame.n_chirps_total)
    return lambda index: starts + index * frame.n_chirps_total * frame.chirp.n_samples


def _choose_without_or_with_pauses(
    path: Path, packed: Contents, continuous: Contents, n_samples: int
) -> Contents:
    """Return the chirps without or with pauses between them, whichever has the sharper spectrum.

    A chirp at a wrong place contains the end of one and the start of the next. Without a complete
    frame with pauses, or without pauses in the settings, there is no choice.
    """
    assert packed.radar is not None
    frame = packed.radar.frame
    if np.array_equal(chirp_start_samples(frame, 0), _packed_starts(frame)(0)):
        return packed
    try:
        n_frames = count_frames_with_pauses(path, frame, n_samples)
    except RecordingError:
        return packed
    offsets = chirp_start_offsets(frame, n_frames)
    orders = [packed, replace(continuous, n_frames=n_frames, start_offsets=offsets)]
    best_index, findings = choose_sample_order(
        [
            "chirps one after the other, without pauses",
            "chirps with the pauses between them, the first at the start of the file",
        ],
        [spectral_concentration(_decode_first_chirps(order)) for order in orders],
        n_samples=frame.chirp.n_samples,
        setting="recording",
        fix="correct radar.frame.interval or radar.frame.chirp, or cut the file",
    )
    best = orders[best_index]
    return replace(best, findings=(*best.findings, *findings))


def _make_decoder(
    path: Path, dtype: np.dtype, iq: Iq, chirp_starts: Callable[[int], np.ndarray]
) -> Callable[[int, np.ndarray], None]:
    """Return the function that fills (chirp, 1, sample).

    `chirp_starts` gives the first sample of each chirp of a frame.
    """
    full_scale = 1.0 if dtype.kind == "f" else 2.0 ** (8 * dtype.itemsize - 1)
    zero: Any = np.float32(full_scale if dtype.kind == "u" else 0)
    step: Any = np.float32(1 / full_scale)

    def decode(index: int, out: np.ndarray) -> None:
        starts = chirp_starts(index)[: len(out)]
        first, n_samples = int(starts[0]), int(starts[-1] - starts[0]) + out.shape[-1]
        n_numbers = 2 * n_samples
        numbers = np.fromfile(path, dtype, n_numbers, offset=2 * first * dtype.itemsize)
        if numbers.size < n_numbers:
            raise RecordingError(
                path,
                value="the file has become shorter since it was opened",
                expected="a file that does not change while it is read",
                fix="open it again after the writing program has finished",
            )
        is_packed = out.size == n_samples and out.flags.c_contiguous
        samples = out.reshape(-1) if is_packed else np.empty(n_samples, np.complex64)
        parts = samples.view(np.float32)
        _scale_numbers(numbers, zero, step, parts)
        # NaN fails both comparisons.
        if dtype.kind == "f" and not (parts.min() > -_MAX_SAMPLE and parts.max() < _MAX_SAMPLE):
            raise RecordingError(
                path,
                value=f"samples that are not finite, or beyond {_MAX_SAMPLE:.0e}, in frame {index}",
                expected="the numbers of a converter (no NaN, no infinity)",
                fix="name another number type with --encoding, or record it again",
            )
        if not is_packed:
            out[:, 0] = samples[(starts - first)[:, None] + np.arange(out.shape[-1])]
        if iq == "qi":
            out.real, out.imag = out.imag.copy(), out.real.copy()

    return decode


def _scale_numbers_in_numpy(numbers: np.ndarray, zero: float, step: float, out: np.ndarray) -> None:
    np.subtract(numbers.astype(np.float32), np.float32(zero), out=out)
    out *= np.float32(step)


@kernel(plain=_scale_numbers_in_numpy)
def _scale_numbers(numbers: np.ndarray, zero: float, step: float, out: np.ndarray) -> None:
    """Fill float32 with numbers minus `zero` times `step`, in single precision; all flat."""
    for k in range(len(numbers)):
        out[k] = (np.float32(numbers[k]) - zero) * step


def holds_float32_numbers(path: Path) -> bool:
    """Return whether a file begins with float32 numbers of ordinary size, or zeros.

    int16 words of a converter have the exponent of such a number if every second word lies between
    13,000 and 18,000, or between -20,000 and -14,000, which samples around zero do not.
    """
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    numbers = np.frombuffer(head[: len(head) // 4 * 4], "<f4")
    with np.errstate(invalid="ignore"):  # signalling NaN
        sizes = np.abs(numbers)
        is_ordinary = (sizes > 1e-7) & (sizes < 1e6)
    n_ordinary, n_zeros = int(np.count_nonzero(is_ordinary)), int(np.count_nonzero(sizes == 0))
    return n_ordinary >= 16 and n_ordinary + n_zeros > 0.99 * numbers.size


def _number_type_and_findings(path: Path, hints: RecordingHints) -> tuple[str, tuple[Finding, ...]]:
    """Return the type of the numbers, with a finding if neither user nor suffix names it."""
    suffix = path.suffix.lower().removeprefix(".")
    named = hints.encoding or _OTHER_SUFFIXES.get(suffix, suffix)
    if named in _TYPES:
        return named, ()
    guessed = "cf32" if holds_float32_numbers(path) else "cs16"
    return guessed, (
        Finding(
            level="note" if guessed == "cf32" else "warning",
            setting="encoding",
            value=f"missing, assumed to be {guessed} by the size of the first numbers",
            expected=f"the type of the numbers, one of {', '.join(_TYPES)}",
            fix="give --encoding if echoes do not appear at the right ranges",
        ),
    )


def _default_axes(path: Path, radar: Radar, description: str) -> tuple[str, ...]:
    """Return the axes of consecutive chirps of one receiver."""
    if radar.array.n_rx > 1:
        raise RecordingError(
            path,
            value=f"{description} of {radar.array.n_rx} receivers, without axis names",
            expected="the order of the receivers",
            fix="give --axes frame,chirp,rx,sample where each chirp has one receiver after the"
            " other, or frame,chirp,sample,rx where they alternate",
        )
    return ("frame", "chirp", "sample")


def _incomplete_sample_findings(n_bytes_left: int) -> tuple[Finding, ...]:
    """Report an incomplete last sample."""
    if not n_bytes_left:
        return ()
    return (
        Finding(
            level="warning",
            setting="recording",
            value=f"{n_bytes_left} bytes after the last complete sample, left out",
            expected="complete samples",
            fix="copy the whole file again, or name another number type with --encoding",
        ),
    )


def _with_iq_findings(contents: Contents, hints: RecordingHints) -> Contents:
    """Add the order of I and Q, and a warning if echoes are on the side of the other order."""
    iq = hints.iq or "iq"
    findings = negative_beat_frequency_findings(_decode_first_chirps(contents), iq)
    return replace(contents, iq=iq, findings=(*contents.findings, *findings))


def _decode_first_chirps(contents: Contents) -> np.ndarray:
    """Return the first chirps (chirp, rx, sample), enough for their spectrum, of at most 1."""
    assert contents.radar is not None and contents.decode is not None
    frame, n_rx = contents.radar.frame, contents.radar.array.n_rx
    first = np.empty((frame.n_chirps_total, n_rx, frame.chirp.n_samples), np.complex64)
    contents.decode(0, first)
    first = first[:_MAX_SAMPLED_CHIRPS]
    largest = np.abs(first).max()
    return first / largest if largest > 0 else first
