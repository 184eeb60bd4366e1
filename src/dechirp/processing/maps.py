"""Range-Doppler maps and spectra of plain arrays, without a `Radar`."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dechirp.core.argument_types import as_python_number, check_argument_types
from dechirp.core.checks import (
    as_tuple_or_none,
    check_axes,
    check_finite_samples,
    check_integer,
    largest_part,
)
from dechirp.core.compiled_kernels import plain_twins_in_first_calls
from dechirp.core.errors import InvalidSetting
from dechirp.core.memory import check_free_memory
from dechirp.processing.spectrum import Transform, mean_range_doppler_power
from dechirp.processing.spectrum import range_doppler_spectrum as transform_frame
from dechirp.processing.spectrum import range_spectrum as transform_samples
from dechirp.radar.chirp import Sampling
from dechirp.theory.windows import WindowSpec, hashable_window, is_pair_of_windows

__all__ = ["range_doppler_map", "range_doppler_spectrum", "range_spectrum"]

_MAX_BINS = 2**20
# Measured peaks: samples in single precision and their mask of finite values; four partial sums in
# single precision, spectra of as many channels, and the map in double precision.
_BYTES_PER_SAMPLE, _BYTES_PER_CELL = 9, 4 * (4 + 8) + 8


@check_argument_types
def range_doppler_map(
    samples: ArrayLike,
    window: WindowSpec | tuple[WindowSpec, WindowSpec] = "hann",
    *,
    axes: tuple[int, int] = (-2, -1),
    n_bins: tuple[int, int] | None = None,
) -> np.ndarray:
    """Compute the range-Doppler map of beat samples, as `dechirp.power_map` does for a `Radar`.

    Parameters
    ----------
    samples : array (..., chirp, sample)
        One frame, real or complex.
    window : str, tuple or array, or a pair of them
        Window over chirps and over samples: a name of `dechirp.windows.window_names`, a window of
        SciPy such as `("chebwin", 80)`, or weights; see `dechirp.windows.window_weights`. Weights
        are scaled, so that only their shape matters.
    axes : (int, int)
        Axes of the chirps and of the samples. All others are channels, such as receivers.
    n_bins : (int, int), optional
        Bins over velocity and range, for zero padding; as many as chirps and samples by default.

    Returns
    -------
    array (velocity, range)
        Mean power over the channels, in the unit of the squared samples; a tone on a bin keeps its
        power. Zero velocity is in row n_velocity // 2, receding is above it if a receding target
        has a positive Doppler frequency. Real samples give n_range // 2 + 1 ranges. Computed in
        single precision, like the map of the chain.

    Raises
    ------
    InvalidSetting
        If the samples are no finite array of two or more axes, all of them filled, a window is
        unknown, or there are fewer bins than points.
    NotEnoughMemory
        If samples in single precision and spectra do not fit into the free memory.
    """
    frame = _scale_frame(samples, window, axes, n_bins, bytes_per_value=0)
    with plain_twins_in_first_calls(frame.samples.size):
        power = mean_range_doppler_power(frame.samples, *frame.transform)
    return np.ldexp(power.astype(float), 2 * frame.exponent)


@check_argument_types
def range_doppler_spectrum(
    samples: ArrayLike,
    window: WindowSpec | tuple[WindowSpec, WindowSpec] = "hann",
    *,
    axes: tuple[int, int] = (-2, -1),
    n_bins: tuple[int, int] | None = None,
) -> np.ndarray:
    """Compute the complex range-Doppler spectrum of each channel, (..., velocity, range).

    Arguments, cells and errors as of `range_doppler_map`, which is the mean of the squared
    magnitudes. Amplitudes of a cell in all receivers are a snapshot of `dechirp.angle`.

    Parameters
    ----------
    samples : array (..., chirp, sample)
        One frame, real or complex.
    window : str, tuple or array, or a pair of them
        Window over chirps and over samples.
    axes : (int, int)
        Axes of the chirps and of the samples.
    n_bins : (int, int), optional
        Bins over velocity and range; as many as chirps and samples by default.
    """
    frame = _scale_frame(samples, window, axes, n_bins, bytes_per_value=8 + 16)
    with plain_twins_in_first_calls(frame.samples.size):
        spectrum = transform_frame(frame.samples, *frame.transform)
    spectrum = np.moveaxis(spectrum, 1, 0).reshape(*frame.channels, *spectrum.shape[::2])
    return spectrum.astype(complex) * np.ldexp(1.0, frame.exponent)


@check_argument_types
def range_spectrum(
    samples: ArrayLike, window: WindowSpec = "hann", *, axis: int = -1, n_bins: int | None = None
) -> np.ndarray:
    """Compute the complex range spectrum of each chirp.

    Parameters
    ----------
    samples : array
        Samples of one or more chirps, real or complex.
    window : str, tuple or array
        Window over the samples, as of `range_doppler_map`.
    axis : int
        Axis of the samples.
    n_bins : int, optional
        Bins, for zero padding; as many as samples by default.

    Returns
    -------
    array
        The spectrum, with ranges in place of the samples; real samples give n_bins // 2 + 1. The
        squared magnitude of a tone on a bin is its mean power.

    Raises
    ------
    InvalidSetting
        If the samples are not finite or empty, the window is unknown, or there are fewer bins than
        samples.
    """
    array = check_finite_samples(
        "samples", samples, axes="(..., sample)", fits=lambda array: array.ndim >= 1
    )
    (sample_axis,) = check_axes("axis", axis, array, n_axes=(1,))
    chirps = np.moveaxis(array, sample_axis, -1)
    n_samples = chirps.shape[-1]
    n_range = n_samples if n_bins is None else n_bins
    check_integer("n_bins", n_range, at_least=n_samples, at_most=_MAX_BINS)
    check_free_memory(
        f"spectra of {array.size} samples",
        needed_bytes=16.0 * (array.size + array.size // n_samples * n_range),
        fix="give fewer chirps at once, or lower n_bins",
    )
    transform = Transform(window=hashable_window(window), n_points=n_samples, n_bins=n_range)
    sampling: Sampling = "complex" if np.iscomplexobj(array) else "real"
    chirps = chirps.astype(complex if sampling == "complex" else float)
    with plain_twins_in_first_calls(chirps.size):
        spectrum = transform_samples(chirps, sampling, transform)
    return np.moveaxis(spectrum, -1, sample_axis)


class _ScaledFrame(NamedTuple):
    samples: np.ndarray
    """Samples (chirp, channel, sample) in single precision, divided by 2^exponent."""
    exponent: int
    transform: tuple[Sampling, Transform, Transform]
    """Sampling, and the transforms over range and velocity."""
    channels: tuple[int, ...]
    """Lengths of the other axes."""


def _scale_frame(
    samples: ArrayLike,
    window: WindowSpec | tuple[WindowSpec, WindowSpec],
    axes: tuple[int, int],
    n_bins: tuple[int, int] | None,
    *,
    bytes_per_value: int,
) -> _ScaledFrame:
    """Check the arguments of a map, and scale the samples to the range of single precision.

    `bytes_per_value` are needed for each cell of each channel, besides those of the map.
    """
    frame = check_finite_samples(
        "samples", samples, axes="(..., chirp, sample)", fits=lambda array: array.ndim >= 2
    )
    frame = np.moveaxis(frame, check_axes("axes", axes, frame, n_axes=(2,)), (0, -1))
    n_chirps, *channels, n_samples = frame.shape
    slow_window, fast_window = pair_of_windows(window)
    n_velocity, n_range = (n_chirps, n_samples) if n_bins is None else pair_of("n_bins", n_bins)
    for n_of_axis, n_points in ((n_velocity, n_chirps), (n_range, n_samples)):
        # A single point has the same power in every bin.
        at_most = _MAX_BINS if n_points > 1 else 1
        check_integer("n_bins", n_of_axis, at_least=n_points, at_most=at_most)
    n_channels = math.prod(channels)
    check_free_memory(
        f"the map of {frame.size} samples",
        needed_bytes=frame.size * _BYTES_PER_SAMPLE
        + n_velocity * n_range * (_BYTES_PER_CELL + n_channels * bytes_per_value),
        fix="give fewer channels at once, or lower n_bins",
    )
    is_complex = np.iscomplexobj(frame)
    exponent = unity_exponent(frame)
    scaled = np.empty(frame.shape, np.complex64 if is_complex else np.float32)
    np.multiply(frame, np.ldexp(1.0, -exponent), out=scaled, casting="same_kind")
    return _ScaledFrame(
        scaled.reshape(n_chirps, n_channels, n_samples),
        exponent,
        (
            "complex" if is_complex else "real",
            Transform(window=fast_window, n_points=n_samples, n_bins=n_range),
            Transform(window=slow_window, n_points=n_chirps, n_bins=n_velocity),
        ),
        tuple(channels),
    )


def unity_exponent(array: np.ndarray) -> int:
    """Return the power of two by which an array is divided so that its largest part is 0.5 to 1.

    Single precision ends at 1e-38: the power of an echo in square watts would not fit.
    """
    # Beyond -1000, the inverse of the power of two would overflow.
    return max(int(np.frexp(largest_part(array))[1]), -1000)


def pair_of_windows(window: Any) -> tuple[Any, Any]:
    """Return the windows of a pair, and a single window twice, as keys of a cache."""
    slow, fast = window if is_pair_of_windows(window) else (window, window)
    return hashable_window(slow), hashable_window(fast)


def pair_of(setting: str, value: Any) -> tuple[Any, Any]:
    """Return the members of a pair, and a single value twice."""
    members = as_tuple_or_none(value)
    if members is not None:
        if len(members) != 2:
            raise InvalidSetting(
                setting,
                value=value,
                expected="one value, or a pair for velocity and range",
                fix="give one value for both axes, or two",
            )
        first, second = map(as_python_number, members)  # narrow integers overflow
        return first, second
    return value, value
