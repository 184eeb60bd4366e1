"""Contents of native files: samples with their description, lost chirps and tables."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from dechirp.core.conventions import CUBE_AXES
from dechirp.core.errors import RecordingError
from dechirp.recordings.arrays.lazy_array import LazyArray, convert_parser_errors, format_shape
from dechirp.recordings.arrays.named_axes import interpret_array_as_recording
from dechirp.recordings.description import (
    Description,
    is_native_description,
    parse_description,
    read_described_tables,
)
from dechirp.recordings.readers.base import Contents, RecordingHints
from dechirp.recordings.settings.base import Iq, RecordingSettings

MAX_DESCRIPTION_CHARACTERS = 2**24
"""Largest length of a description; one of 10,000 calibrated channels has 2^20."""
_START_TOLERANCE_S = 1e-9
MAX_SCALE = 1e30  # times the largest code it is still a single-precision number


def is_native_without_array_hints(description_text: str | None, hints: RecordingHints) -> bool:
    """Return True if a text is a native description and no hint describes the array."""
    has_array_hints = hints.inner_name or hints.axes or hints.encoding
    return (
        description_text is not None
        and is_native_description(description_text)
        and not has_array_hints
    )


def check_device_and_iq_hints(
    path: Path, hints: RecordingHints, *, device: str | None, iq: Iq | None
) -> None:
    """Raise `RecordingError` if a native file has another device or I/Q order than the user gave.

    A device given together with a radar belongs to the radar: it gives the antenna positions.
    """
    chip = None if hints.device is None or hints.settings is not None else hints.device.kind()
    for name, hint, actual in (("device", chip, device), ("iq", hints.iq, iq)):
        if hint not in (None, actual):
            raise RecordingError(
                path,
                value=f"written by dechirp, with --{name} {hint}",
                expected=f"no --{name} ({actual or 'none'} in the recording), since --{name} is for"
                " raw samples",
                fix=f"remove --{name} ({name}=... in Python)",
            )


def read_native_contents(
    path: Path,
    description_text: str,
    stored_samples: LazyArray,
    hints: RecordingHints,
    *,
    read_column: Callable[[str, str], np.ndarray],
    gaps: np.ndarray | None,
    file_bytes: int,
    axes: tuple[str, ...] = CUBE_AXES,
    frame_starts_s: np.ndarray | None = None,
) -> Contents:
    """Read the contents of a native file.

    Parameters
    ----------
    path : Path
        The file.
    description_text : str
        Its description.
    stored_samples : LazyArray
        Its samples, or their codes if the description has a scale.
    hints : RecordingHints
        A radar in it replaces that of the file.
    read_column : function (table, column)
        Returns the arrays of the tables.
    gaps : array (frame, chirp), optional
        Non-zero where samples were lost.
    file_bytes : int
        Size of the file of samples.
    axes : names
        Axes of the samples, in order; a further last one, of size 2, is `iq`.
    frame_starts_s : array (frame,), optional
        Start of each frame.

    Raises
    ------
    RecordingError
        If it is damaged, or does not match the radar.
    """
    radar = None if hints.settings is None else hints.settings.radar
    with convert_parser_errors(path, "a file with a complete description"):
        description = parse_description(path, description_text, radar)
        check_device_and_iq_hints(path, hints, device=description.device, iq=description.iq)
        _check_codes_have_scale(path, description, stored_samples.dtype)
        if len(stored_samples.shape) == len(axes) + 1:
            axes = (*axes, "iq")
        settings = hints.settings or RecordingSettings(radar=description.radar)
        array_hints = RecordingHints(settings=settings, axes=axes, encoding="full-scale")
        contents = interpret_array_as_recording(
            path, stored_samples, array_hints, file_bytes=file_bytes
        )
        tables = read_described_tables(path, description, read_column)
    decode, scale = contents.decode, description.scale
    assert decode is not None

    def scaled(index: int, out: np.ndarray) -> None:
        decode(index, out)
        if scale is not None:
            out *= np.float32(scale)

    return replace(
        contents,
        decode=scaled,
        decode_frames=None,
        units=description.units,
        gaps=lost_chirp_mask(path, gaps, contents),
        frame_starts_s=measured_frame_starts_s(frame_starts_s, contents),
        scale=scale,
        tables=tables,
        device=description.device,
        iq=description.iq,
    )


def _check_codes_have_scale(path: Path, description: Description, sample_dtype: np.dtype) -> None:
    """Raise `RecordingError` unless codes have a scale and floats have none."""
    numbers = sample_dtype if sample_dtype.names is None else sample_dtype[0]
    is_coded = numbers.kind == "i" and numbers.itemsize == 2
    scale = description.scale
    if (scale is None and numbers.kind in "fc") or (
        scale is not None and is_coded and 0 < scale < MAX_SCALE
    ):
        return
    raise RecordingError(
        path,
        value=f"a file with samples of type {sample_dtype} and a scale of {scale}",
        expected="codes of 16 bits with a positive scale, or floats without any",
        fix="copy the file again from its source",
    )


def lost_chirp_mask(path: Path, gaps: np.ndarray | None, contents: Contents) -> np.ndarray | None:
    """Return (frame, chirp), True where chirps are marked as lost or samples are absent."""
    if gaps is None:
        return contents.gaps
    assert contents.radar is not None
    expected_shape = (contents.n_frames, contents.radar.frame.n_chirps_total)
    if gaps.shape != expected_shape:
        raise RecordingError(
            path,
            value=f"a file with an array gap of {format_shape(gaps.shape)}",
            expected=f"the shape {format_shape(expected_shape)}, frames and chirps of its samples",
            fix="copy the file again from its source",
        )
    is_lost = gaps != 0
    return is_lost if contents.gaps is None else is_lost | contents.gaps


def measured_frame_starts_s(starts_s: np.ndarray | None, contents: Contents) -> np.ndarray | None:
    """Return stored starts of frames from that of the first; None where the radar defines them."""
    if starts_s is None or starts_s.shape != (contents.n_frames,) or starts_s.dtype.kind != "f":
        return None
    assert contents.radar is not None
    frame = contents.radar.frame
    nominal_s = np.array([frame.frame_start_s(number) for number in range(contents.n_frames)])
    relative_s = starts_s - starts_s[0]
    is_valid = np.isfinite(relative_s).all() and (np.diff(relative_s) > 0).all()
    return (
        relative_s
        if is_valid and (abs(relative_s - nominal_s) > _START_TOLERANCE_S).any()
        else None
    )
