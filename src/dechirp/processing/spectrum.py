"""Windowed Fourier transforms over range and velocity, and the statistics of their noise."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from functools import cached_property, lru_cache, partial
from typing import TYPE_CHECKING

import numpy as np
import scipy
import xarray as xr

from dechirp.core.compiled_kernels import is_small_work, kernel, uses_compiled_kernels
from dechirp.core.conventions import axis_coordinate
from dechirp.core.errors import InvalidSetting
from dechirp.core.threads import run_in_threads, split_range, thread_count
from dechirp.core.values import frozen_dataclass
from dechirp.radar.chirp import Chirp, Sampling
from dechirp.theory.windows import (
    HashableWindow,
    bin_correlation,
    half_main_lobe_bins,
    is_explicit_window,
    noise_bandwidth_bins,
    window_names,
    window_weights,
)

if TYPE_CHECKING:
    from dechirp.processing.simd_range_doppler import AxisTransform

# Partial maps that threads sum in parallel: at most half the size of the samples.
_N_PARTS = 4


@frozen_dataclass
class Transform:
    """Windowed discrete Fourier transform, zero-padded if bins outnumber points."""

    window: HashableWindow
    n_points: int
    n_bins: int

    def __post_init__(self) -> None:
        # Of named windows the name is checked: a billion weights would fill the memory.
        window_weights(self.window, self.n_points if is_explicit_window(self.window) else 1)
        if self.n_bins < self.n_points:
            raise InvalidSetting(
                "Transform.n_bins",
                value=self.n_bins,
                expected=f"at least {self.n_points}, the number of points",
                fix="leave the number of bins out, or pad to a larger one",
            )
        if self.n_points == 1 < self.n_bins:
            raise InvalidSetting(
                "Transform.n_bins",
                value=self.n_bins,
                expected="1: one point has the same power in every bin",
                fix="leave the number of bins out",
            )

    @property
    def _effective_window(self) -> HashableWindow:
        """Window that is applied: two points have equal weights, unless they are given.

        A periodic window of two drops one of them, and with it the frequency; a main lobe of two
        bins or more leaves no sidelobes to suppress.
        """
        is_named = not is_explicit_window(self.window)
        return "rectangular" if self.n_points == 2 and is_named else self.window

    @cached_property
    def weights(self) -> np.ndarray:
        """Window, (n_points,)."""
        return window_weights(self._effective_window, self.n_points)

    @cached_property
    def noise_bandwidth_bins(self) -> float:
        """SNR loss of the window, as a ratio: 1.5 for Hann."""
        return float(noise_bandwidth_bins(self.weights))

    @property
    def keeps_noise_white(self) -> bool:
        """Return whether noise in different bins is independent."""
        if self._effective_window in window_names():
            is_flat = self._effective_window == "rectangular"
        else:
            is_flat = float(np.ptp(self.weights)) == 0
        return is_flat and self.n_bins == self.n_points

    @property
    def main_lobe_half_width_bins(self) -> float:
        """Half the width of the main lobe of a tone, in bins of the transform."""
        return half_main_lobe_bins(self._effective_window) * self.n_bins / self.n_points

    def straddling_loss(self, cycles_per_point: float) -> float:
        """Return the straddling loss of a tone: power in the nearest bin over that on a bin."""
        off = cycles_per_point * self.n_bins
        off -= round(off)
        turns = np.exp(2j * np.pi * off / self.n_bins * np.arange(self.n_points))
        return float(abs(self.weights @ turns) ** 2 / self.weights.sum() ** 2)

    def noise_correlation_of_bins(self, n_neighbours: int) -> np.ndarray:
        """Return the correlation of white noise among n neighbouring bins, (n, n), Hermitian."""
        if self.keeps_noise_white and n_neighbours <= self.n_bins:
            return np.eye(n_neighbours)
        bins = np.arange(n_neighbours)
        by_lag = bin_correlation(
            self.weights, self.n_bins, np.arange(1 - n_neighbours, n_neighbours)
        )
        return by_lag[bins[:, None] - bins + n_neighbours - 1]


def rows_with_circular_noise(chirp: Chirp, transform: Transform) -> slice:
    """Return the range rows with circular noise, on which the false-alarm laws hold.

    Complex samples: all. Real samples: noise in the rows about DC and about half the sample
    rate correlates with its own conjugate (fully in the rows 0 and N / 2, 1 / 6 in row 1
    under a Hann window); rows above 0.1 are excluded from detection.
    """
    return circular_noise_rows(chirp.sampling, transform)


def circular_noise_rows(sampling: Sampling, transform: Transform) -> slice:
    """Return `rows_with_circular_noise` of samples without a `Chirp`."""
    if sampling == "complex":
        return slice(0, transform.n_bins)
    rows = np.arange(transform.n_bins // 2 + 1)
    own_conjugate = abs(bin_correlation(transform.weights, transform.n_bins, 2 * rows))
    circular = np.flatnonzero(own_conjugate <= 0.1)
    if circular.size == 0:
        return slice(0, 0)
    middle = circular[np.argmin(abs(circular - transform.n_bins // 4))]
    tied = np.flatnonzero(own_conjugate > 0.1)
    first = tied[tied < middle].max(initial=-1) + 1
    last = tied[tied > middle].min(initial=rows.size) - 1
    return slice(int(first), int(last) + 1)


def nearest_circular_noise_rows(row: np.ndarray, circular_rows: slice) -> np.ndarray:
    """Return the nearest row with circular noise, counted from the first, whose threshold holds."""
    return np.clip(row, circular_rows.start, circular_rows.stop - 1) - circular_rows.start


@lru_cache(maxsize=32)
def velocities_with_circular_noise(transform: Transform) -> np.ndarray:
    """Return which velocities have circular noise in all range rows of real samples, (n_bins,).

    Noise of row r and velocity v correlates with its own conjugate by the product of two factors,
    that of `rows_with_circular_noise` and its equal over chirps: 1 for zero velocity and for the
    largest, 1 / 6 one bin beside them under a Hann window; those up to 0.1 are circular.
    """
    velocity_bins = np.arange(transform.n_bins) - transform.n_bins // 2
    own_conjugate = abs(bin_correlation(transform.weights, transform.n_bins, 2 * velocity_bins))
    mask = np.asarray(own_conjugate <= 0.1)
    mask.setflags(write=False)
    return mask


@lru_cache(maxsize=8)
def searched_cell_mask(chirp: Chirp, range_transform: Transform, doppler: Transform) -> np.ndarray:
    """Return the cells of a map that are searched for targets, (velocity, range), bool.

    Complex samples: all. Real samples: those with circular noise, except within half a cell of zero
    range, where the noise of receivers rises.
    """
    if chirp.sampling == "complex":
        return np.broadcast_to(np.True_, (doppler.n_bins, range_transform.n_bins))
    rows = np.arange(range_transform.n_bins // 2 + 1)
    is_beyond_half_a_cell = 2 * rows * range_transform.n_points >= range_transform.n_bins
    mask = velocities_with_circular_noise(doppler)[:, None] & is_beyond_half_a_cell
    circular_rows = rows_with_circular_noise(chirp, range_transform)
    if circular_rows.start == circular_rows.stop:
        mask[:] = False
    mask[:, circular_rows] = True
    mask.setflags(write=False)
    return mask


def range_profiles(cube: xr.DataArray, chirp: Chirp, transform: Transform) -> xr.DataArray:
    """Transform (..., sample) to (..., range), complex; a tone keeps its power.

    |.|^2 of a tone on a bin is its mean power, for complex and for real samples.
    """
    array = cube.transpose(..., "sample")
    profiles = range_spectrum(array.values, chirp.sampling, transform)
    coords = {name: c for name, c in array.coords.items() if "sample" not in c.dims}
    coords["range"] = axis_coordinate("range", chirp.range_bins_m(transform.n_bins))
    return xr.DataArray(
        profiles, dims=(*array.dims[:-1], "range"), coords=coords, attrs=dict(cube.attrs)
    )


def range_spectrum(samples: np.ndarray, sampling: Sampling, transform: Transform) -> np.ndarray:
    """Transform an array without labels like `range_profiles`, (..., sample) to (..., range)."""
    tapered = samples * amplitude_range_weights(transform, sampling)
    if sampling == "complex":
        return _fft(tapered, transform.n_bins, axis=-1)
    return _rfft(tapered, transform.n_bins)


def range_doppler_spectrum(
    samples: np.ndarray,
    sampling: Sampling,
    range_transform: Transform,
    doppler_transform: Transform,
) -> np.ndarray:
    """Transform one frame, (chirp, channel, sample), to (velocity, channel, range).

    A tone on a bin keeps its power. Velocities ascend, receding positive. Needs one more cube
    of memory.
    """
    slow = _centring_doppler_weights(doppler_transform)
    fast = amplitude_range_weights(range_transform, sampling)
    if sampling == "real":
        spectrum = _rfft(samples * fast, range_transform.n_bins)
        spectrum *= slow[:, None, None]
        return _fft(spectrum, doppler_transform.n_bins, axis=0)
    if doppler_transform.n_bins % 2 == 0:
        # Numbers in a row, two to a sample, times real weights: a fifth of the time.
        numbers = np.ascontiguousarray(samples, np.complex64).view(np.float32)
        spectrum = _apply_windows(numbers, slow.real, fast).view(np.complex64)
    else:
        spectrum = samples * slow[:, None, None] * fast
    # Zeros that pad the range are not transformed over chirps; without padding, range comes first,
    # which takes a quarter less for 256 x 128 samples.
    transforms = [(0, doppler_transform.n_bins), (2, range_transform.n_bins)]
    if range_transform.n_bins == range_transform.n_points:
        transforms.reverse()
    for axis, n_bins in transforms:
        spectrum = _fft(spectrum, n_bins, axis=axis)
    return spectrum


def _fft(values: np.ndarray, n_bins: int, *, axis: int) -> np.ndarray:
    """Transform along an axis; `values`, which may be overwritten, must be complex."""
    # Importing SciPy's transforms takes 0.13 s of CPU time, more than they save in small work.
    if is_small_work():
        return np.fft.fft(values, n_bins, axis)
    return np.asarray(scipy.fft.fft(values, n_bins, axis, overwrite_x=True))


def _rfft(values: np.ndarray, n_bins: int) -> np.ndarray:
    """Transform real values along the last axis."""
    if is_small_work():
        return np.fft.rfft(values, n_bins)
    return np.asarray(scipy.fft.rfft(values, n_bins))


def _transform_threads(n_threads: int) -> AbstractContextManager[object]:
    """Return a context in which `_fft` uses several threads."""
    return nullcontext() if is_small_work() else scipy.fft.set_workers(n_threads)


FrameTransform = Callable[[np.ndarray, Sampling, Transform, Transform], np.ndarray]
"""Transform of a frame, with the signature of `range_doppler_spectrum`."""


def mean_range_doppler_power(
    samples: np.ndarray,
    sampling: Sampling,
    range_transform: Transform,
    doppler_transform: Transform,
    transform: FrameTransform = range_doppler_spectrum,
) -> np.ndarray:
    """Compute the power of each cell of one frame, to (velocity, range) float32.

    `samples` is (chirp, channel, sample). Mean over the channels; a tone on a bin keeps its power.
    Channels are transformed one by one: one spectrum fits into the cache, whereas that of all
    takes a third longer (512 x 256 x 16). Several threads share the channels, in four parts at
    most, or the rows of one: the partition, and so the rounding, is the same for any number of
    threads. Twin in vector registers: `simd_range_doppler.add_channel_power`.
    """
    n_channels = samples.shape[1]
    n_rows = range_transform.n_bins if sampling == "complex" else range_transform.n_bins // 2 + 1
    n_threads = thread_count()
    parts = split_range(n_channels, _N_PARTS)
    threads_per_part = max(n_threads // len(parts), 1)
    shape = len(parts), doppler_transform.n_bins, n_rows
    share = 1 / n_channels
    axes = _simd_axis_transforms(samples, sampling, range_transform, doppler_transform, transform)
    if axes is not None:
        from dechirp.processing import simd_range_doppler

        slow, fast = axes
        contiguous = np.ascontiguousarray(samples, np.complex64)
        sums = np.empty(shape, np.float32)

        def add(part: int) -> None:
            first, *others = range(n_channels)[parts[part]]
            add_power = partial(
                simd_range_doppler.add_channel_power,
                sums[part],
                contiguous,
                n_threads=threads_per_part,
            )
            add_power(first, slow, fast, share, is_first=True)
            for k in others:
                add_power(k, slow, fast, share, is_first=False)
    else:
        sums = np.zeros(shape, np.float32)

        def add(part: int) -> None:
            for k in range(n_channels)[parts[part]]:
                spectrum = transform(
                    samples[:, k : k + 1], sampling, range_transform, doppler_transform
                )
                _add_scaled_power(sums[part], spectrum[:, 0], np.float32(share))

    with _transform_threads(threads_per_part):
        run_in_threads(n_threads, add, range(len(parts)))
    for other in sums[1:]:
        sums[0] += other
    return np.asarray(sums[0])


def range_doppler_real_and_imaginary(
    samples: np.ndarray,
    sampling: Sampling,
    range_transform: Transform,
    doppler_transform: Transform,
    transform: FrameTransform = range_doppler_spectrum,
) -> np.ndarray:
    """Transform a frame to (velocity, channel, 2, range) float32, real and imaginary parts.

    Like `range_doppler_spectrum`; separate parts let compiled loops over ranges use vectors.
    """
    n_threads = thread_count()
    axes = _simd_axis_transforms(samples, sampling, range_transform, doppler_transform, transform)
    if axes is None:
        with _transform_threads(n_threads):
            spectrum = transform(samples, sampling, range_transform, doppler_transform)
        return np.stack([spectrum.real, spectrum.imag], axis=2, dtype=np.float32)
    from dechirp.processing import simd_range_doppler

    slow, fast = axes
    contiguous = np.ascontiguousarray(samples, np.complex64)
    n_channels = samples.shape[1]
    out = np.empty((slow.n_bins, n_channels, 2, fast.n_bins), np.float32)

    def write_channel(channel: int) -> None:
        simd_range_doppler.write_channel_spectrum(out, contiguous, channel, slow, fast)

    run_in_threads(n_threads, write_channel, range(n_channels))
    return out


def _simd_axis_transforms(
    samples: np.ndarray,
    sampling: Sampling,
    range_transform: Transform,
    doppler_transform: Transform,
    transform: FrameTransform,
) -> "tuple[AxisTransform, AxisTransform] | None":
    """Return the axes for `simd_range_doppler`; None for small work, or if it cannot do them."""
    is_plain = transform is range_doppler_spectrum and sampling == "complex"
    n_bins = doppler_transform.n_bins, range_transform.n_bins
    if not (is_plain and uses_compiled_kernels()):
        return None
    from dechirp.processing import simd_range_doppler

    if not simd_range_doppler.can_transform_sizes(*n_bins, samples.shape[2]):
        return None
    return (
        simd_range_doppler.AxisTransform(
            _amplitude_doppler_weights(doppler_transform), doppler_transform.n_bins
        ),
        simd_range_doppler.AxisTransform(
            amplitude_range_weights(range_transform, sampling), range_transform.n_bins
        ),
    )


def check_samples_were_finite(cells: np.ndarray) -> None:
    """Raise `InvalidSetting` unless cells are finite, one of each channel or of their mean power.

    One sample that is not finite reaches every cell of its channel.
    """
    if not np.isfinite(cells).all():
        raise InvalidSetting(
            "cube",
            value="samples that are not finite (NaN or infinite)",
            expected="finite samples throughout",
            fix="find what wrote them, or replace them by zeros",
        )


def noise_gain(range_transform: Transform, doppler_transform: Transform, chirp: Chirp) -> float:
    """Return the mean noise power in a cell of the map over that in one sample."""
    bandwidths = range_transform.noise_bandwidth_bins * doppler_transform.noise_bandwidth_bins
    gain = bandwidths / (range_transform.n_points * doppler_transform.n_points)
    return gain if chirp.sampling == "complex" else 2 * gain


@lru_cache(maxsize=32)
def _amplitude_doppler_weights(transform: Transform) -> np.ndarray:
    """Return the Doppler window, scaled so that a tone on a bin keeps its power."""
    return np.asarray(transform.weights / transform.weights.sum(), np.float32)


@lru_cache(maxsize=32)
def _centring_doppler_weights(transform: Transform) -> np.ndarray:
    """Return the Doppler window with a phase ramp that shifts zero velocity to the middle bin.

    +1, -1, +1 ... for an even number of bins. This saves a pass over the spectrum (0.2 ms of 4
    at 2200 x 128).
    """
    slow = transform.weights / transform.weights.sum()
    turns = np.arange(slow.size) * (transform.n_bins // 2) % transform.n_bins / transform.n_bins
    return np.asarray((slow * np.exp(2j * np.pi * turns)).astype(np.complex64))


@lru_cache(maxsize=32)
def amplitude_range_weights(transform: Transform, sampling: Sampling) -> np.ndarray:
    """Return the range window, scaled so that a tone on a bin keeps its power."""
    # A real tone puts half its power at negative frequencies, which are not kept.
    gain = 1.0 if sampling == "complex" else np.sqrt(2.0)
    return (gain * transform.weights / transform.weights.sum()).astype(np.float32)


def _apply_windows_in_numpy(
    numbers: np.ndarray, slow_weights: np.ndarray, fast_weights: np.ndarray
) -> np.ndarray:
    """Plain twin of `_apply_windows`: equal bits."""
    weights = np.multiply.outer(slow_weights, np.repeat(fast_weights, 2))
    return np.asarray(numbers * weights[:, None, :])


@kernel(plain=_apply_windows_in_numpy)
def _apply_windows(
    numbers: np.ndarray, slow_weights: np.ndarray, fast_weights: np.ndarray
) -> np.ndarray:
    """Copy samples times both windows in one pass: (chirp, rx, 2 sample), slow, fast."""
    out = np.empty(numbers.shape, np.float32)
    n_chirps, n_rx, n_numbers = numbers.shape
    twice = np.repeat(fast_weights, 2)
    for m in range(n_chirps):
        for k in range(n_rx):
            for n in range(n_numbers):
                out[m, k, n] = numbers[m, k, n] * (slow_weights[m] * twice[n])
    return out


def _add_scaled_power_in_numpy(
    out: np.ndarray, spectrum: np.ndarray, power_factor: np.float32
) -> None:
    """Plain twin of `_add_scaled_power`: equal within single precision."""
    out += power_factor * (spectrum.real**2 + spectrum.imag**2)


@kernel(plain=_add_scaled_power_in_numpy, fastmath={"contract", "reassoc"})
def _add_scaled_power(out: np.ndarray, spectrum: np.ndarray, power_factor: np.float32) -> None:
    """Add a share of the power of each cell, in place, both (velocity, range)."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            z = spectrum[i, j]
            out[i, j] += power_factor * (z.real * z.real + z.imag * z.imag)
