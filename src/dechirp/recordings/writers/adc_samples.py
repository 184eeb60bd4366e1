"""Samples to be written: converter codes if all samples are codes, else floats."""

from collections.abc import Callable, Iterator
from typing import TypeVar

import numpy as np
import xarray as xr

from dechirp.core.errors import DechirpError, InvalidSetting, Mistake
from dechirp.recordings.recording import Recording
from dechirp.simulation.adc_codes import extract_adc_codes

T = TypeVar("T")


class _NotACodeError(Exception):
    """Sample that is not an integer number of steps."""


def write_as_codes_else_floats(recording: Recording, write: Callable[[float | None], T]) -> T:
    """Write a recording as codes, and again as floats if a sample is not a code.

    `write` is called with the scale, or None for floats, and passes it to
    `iter_code_or_float_arrays`. The first non-code may come late: a lost frame, all zeros, consists
    of codes.
    """
    scale = recording.contents.scale
    if scale is not None:
        try:
            return write(scale)
        except _NotACodeError:
            pass
    return write(None)


def iter_frames_as_codes_or_floats(
    recording: Recording, scale: float | None
) -> Iterator[xr.DataArray]:
    """Yield cubes of one frame each: floats, or int16 codes as `simulation.adc_codes` returns them.

    Codes of complex samples have a further axis, `iq`. Times `scale` in single precision they are
    exactly the samples.

    Raises
    ------
    DechirpError
        If a sample is not finite, since no reader accepts it.
    """
    for number, cube in zip(recording.frame_numbers, recording.frames(), strict=True):
        if scale is None:
            _check_finite_samples(recording, number, cube.values)
            cube.attrs.pop("scale", None)
            yield cube
            continue
        try:
            yield extract_adc_codes(cube)
        except InvalidSetting:
            raise _NotACodeError from None


def iter_code_or_float_arrays(recording: Recording, scale: float | None) -> Iterator[np.ndarray]:
    """Yield the samples of each frame, (chirp, rx, sample[, iq]), as codes or floats."""
    return (cube.values[0] for cube in iter_frames_as_codes_or_floats(recording, scale))


def _check_finite_samples(recording: Recording, number: int, samples: np.ndarray) -> None:
    if np.isfinite(samples).all():
        return
    raise DechirpError(
        Mistake(
            setting="recording",
            value=f"{recording.path.name}, with non-finite samples in frame {number}",
            expected="finite samples",
            fix="replace them, or leave the frame out",
        )
    )
