"""Samples as whole numbers: those a converter gave, or a cube in steps of its own."""

import numpy as np
import xarray as xr

from dechirp.core.errors import InvalidSetting
from dechirp.process.fixed_point.words import WordLengths
from dechirp.radar.radar import Radar


def whole_samples(cube: xr.DataArray, radar: Radar, words: WordLengths) -> tuple[np.ndarray, float]:
    """Samples of one frame, (chirp, rx, sample, 2) int32, and the amplitude of one step.

    Parameters
    ----------
    cube : DataArray (chirp, rx, sample), or (chirp, rx, sample, iq)
        Whole numbers, with the last axis where samples are complex, as `codes` gives: they are
        taken as they are. Others are rounded to steps: those of the attribute `scale`, where a
        converter made them; else such that the largest part is the largest word.

    Raises
    ------
    InvalidSetting
        If the cube is not one frame of that radar, samples are not finite, or whole numbers do
        not fit into `sample_bits`.
    """
    is_whole = cube.dtype.kind in "iu"
    _must_be_one_frame(cube, radar, is_whole)
    axes = [name for name in ("chirp", "rx", "sample", "iq") if name in cube.dims]
    numbers = cube.transpose(*axes).values
    if np.iscomplexobj(numbers):
        numbers = np.stack([numbers.real, numbers.imag], axis=-1)
    lowest, highest = float(numbers.min()), float(numbers.max())
    if not np.isfinite([lowest, highest]).all():
        raise InvalidSetting(
            "cube",
            got="samples that are not finite (NaN or infinite)",
            need="finite samples throughout",
            fix="Find what wrote them, or replace them by zeros.",
        )
    most = 2 ** (words.sample_bits - 1) - 1
    step = float(cube.attrs.get("scale", 1.0))
    if not is_whole and "scale" not in cube.attrs:
        step = max(-lowest, highest) / most or 1.0
        # Single precision has 24 bits: the largest may come out one step too large.
        numbers = np.clip(np.rint(numbers / step), -most, most)
    elif not is_whole:
        numbers = np.rint(numbers / step)
    if numbers.min() < -most - 1 or numbers.max() > most:
        raise InvalidSetting(
            "WordLengths.sample_bits",
            got=f"{words.sample_bits}, for samples from {numbers.min():.0f} to {numbers.max():.0f}",
            need="enough bits for the samples",
            fix="Give the bits of the converter.",
        )
    out = np.zeros((*numbers.shape[:3], 2), np.int32)
    if numbers.ndim == 4:
        out[:] = numbers
    else:
        out[..., 0] = numbers
    return out, step


def _must_be_one_frame(cube: xr.DataArray, radar: Radar, is_whole: bool) -> None:
    frame, chirp = radar.frame, radar.frame.chirp
    is_complex = chirp.sampling == "complex"
    need = {"chirp": frame.n_sent, "rx": radar.array.n_rx, "sample": chirp.n_samples}
    if is_whole and is_complex:
        need["iq"] = 2
    got = {str(name): size for name, size in cube.sizes.items()}
    if got != need or (not is_whole and np.iscomplexobj(cube) != is_complex):
        raise InvalidSetting(
            "cube",
            got=f"of {got} and the type {cube.dtype}",
            need=f"one frame of {need}, {chirp.sampling} samples, as the radar has",
            fix="Choose one frame with isel(frame=0), and the radar that it was taken with.",
        )
