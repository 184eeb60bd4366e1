"""Integer samples: codes of a converter, or a cube rounded to steps."""

import numpy as np
import xarray as xr

from dechirp.core.errors import InvalidSetting
from dechirp.processing.fixed_point.word_lengths import WordLengths
from dechirp.radar.radar import Radar


def to_integer_samples_and_step(
    cube: xr.DataArray, radar: Radar, words: WordLengths
) -> tuple[np.ndarray, float]:
    """Return the samples of one frame, (chirp, rx, sample, 2) int32, and the amplitude of a step.

    Parameters
    ----------
    cube : DataArray (chirp, rx, sample), or (chirp, rx, sample, iq)
        Integers, with the last axis for complex samples, as from `codes`, are used unchanged.
        Others are rounded to steps: those of the attribute `scale` of a converter, else such that
        the largest part is the largest word.

    Raises
    ------
    InvalidSetting
        If the cube is not one frame of that radar, samples are not finite, or integers do not fit
        into `sample_bits`.
    """
    is_integer = cube.dtype.kind in "iu"
    _check_is_one_frame_of_radar(cube, radar, is_integer)
    axes = [name for name in ("chirp", "rx", "sample", "iq") if name in cube.dims]
    numbers = cube.transpose(*axes).values
    if np.iscomplexobj(numbers):
        numbers = np.stack([numbers.real, numbers.imag], axis=-1)
    lowest, highest = float(numbers.min()), float(numbers.max())
    if not np.isfinite([lowest, highest]).all():
        raise InvalidSetting(
            "cube",
            value="samples that are not finite (NaN or infinite)",
            expected="finite samples throughout",
            fix="find the source of these values, or replace them by zeros",
        )
    largest_word = 2 ** (words.sample_bits - 1) - 1
    step = float(cube.attrs.get("scale", 1.0))
    if not is_integer and "scale" not in cube.attrs:
        step = max(-lowest, highest) / largest_word or 1.0
        # In single precision (24 bits) the largest may be one step too large.
        numbers = np.clip(np.rint(numbers / step), -largest_word, largest_word)
    elif not is_integer:
        numbers = np.rint(numbers / step)
    if numbers.min() < -largest_word - 1 or numbers.max() > largest_word:
        raise InvalidSetting(
            "WordLengths.sample_bits",
            value=f"{words.sample_bits}, for samples from {numbers.min():.0f} to"
            f" {numbers.max():.0f}",
            expected="enough bits for the samples",
            fix="set sample_bits to the bits of the converter",
        )
    out = np.zeros((*numbers.shape[:3], 2), np.int32)
    if numbers.ndim == 4:
        out[:] = numbers
    else:
        out[..., 0] = numbers
    return out, step


def _check_is_one_frame_of_radar(cube: xr.DataArray, radar: Radar, is_integer: bool) -> None:
    frame, chirp = radar.frame, radar.frame.chirp
    is_complex = chirp.sampling == "complex"
    expected = {"chirp": frame.n_chirps_total, "rx": radar.array.n_rx, "sample": chirp.n_samples}
    if is_integer and is_complex:
        expected["iq"] = 2
    sizes = {str(name): size for name, size in cube.sizes.items()}
    if sizes != expected or (not is_integer and np.iscomplexobj(cube) != is_complex):
        raise InvalidSetting(
            "cube",
            value=f"an array of {sizes} and the type {cube.dtype}",
            expected=f"one frame of {expected}, {chirp.sampling} samples, as the radar has",
            fix="select one frame with isel(frame=0), and the radar of the recording",
        )
