"""Samples as they are written: the codes of a converter where all of them are, else floats."""

from collections.abc import Callable, Iterator
from typing import TypeVar

import numpy as np
import xarray as xr

from dechirp.core.errors import DechirpError, InvalidSetting, Mistake
from dechirp.echoes.codes import codes
from dechirp.formats.recording import Recording

T = TypeVar("T")


class _NoCode(Exception):
    """A sample that is no whole number of steps."""


def if_codes(recording: Recording, write: Callable[[float | None], T]) -> T:
    """Write a recording with its scale, and once more without if a sample is no code after all.

    `write` is called with the scale, or None for floats, and takes `numbers` with it. What no
    code may come late: a frame that was lost, all zeros, is one of codes.
    """
    scale = recording.contents.scale
    if scale is not None:
        try:
            return write(scale)
        except _NoCode:
            pass
    return write(None)


def frames(recording: Recording, scale: float | None) -> Iterator[xr.DataArray]:
    """Cubes of one frame each: floats, or int16 codes as `echoes.codes` gives them.

    Codes of complex samples have one more axis, `iq`. Times `scale` in single precision they are
    the samples, bit by bit.

    Raises
    ------
    DechirpError
        If a sample is not finite: no reader would take it.
    """
    for number, cube in zip(recording.frame_numbers, recording.frames(), strict=True):
        if scale is None:
            _must_be_finite(recording, number, cube.values)
            cube.attrs.pop("scale", None)
            yield cube
            continue
        try:
            yield codes(cube)
        except InvalidSetting:
            raise _NoCode from None


def numbers(recording: Recording, scale: float | None) -> Iterator[np.ndarray]:
    """Samples of each frame alone, (chirp, rx, sample), with `iq` for codes; see `frames`."""
    return (cube.values[0] for cube in frames(recording, scale))


def _must_be_finite(recording: Recording, number: int, samples: np.ndarray) -> None:
    if np.isfinite(samples).all():
        return
    raise DechirpError(
        Mistake(
            setting="recording",
            got=f"{recording.path.name}, with samples in frame {number} that are not finite",
            need="finite samples",
            fix="Replace them, or leave the frame out.",
        )
    )
