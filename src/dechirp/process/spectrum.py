"""From samples to range, from chirps to velocity: tapered Fourier transforms with axes."""

from collections.abc import Callable
from functools import cached_property, lru_cache, partial

import numba
import numpy as np
import scipy.fft
import xarray as xr

from dechirp.core.conventions import axis
from dechirp.core.errors import InvalidSetting
from dechirp.core.threads import in_threads, slices
from dechirp.core.values import value
from dechirp.process import channel_power
from dechirp.radar.chirp import Chirp, Sampling
from dechirp.theory.windows import (
    Window,
    bin_correlation,
    main_lobe_bins,
    noise_bandwidth_bins,
    taper,
)

# Maps that are summed side by side: half of the samples at most, for one channel as for many.
_PARTS = 4


@value
class Transform:
    """One windowed discrete Fourier transform, zero-padded where bins outnumber points."""

    window: Window
    n_points: int
    n_bins: int

    def __post_init__(self) -> None:
        taper(self.window, 1)
        if self.n_bins < self.n_points:
            raise InvalidSetting(
                "Transform.n_bins",
                got=self.n_bins,
                need=f"at least {self.n_points}, the number of points",
                fix="Leave the number of bins out, or pad to a larger one.",
            )
        if self.n_points == 1 < self.n_bins:
            raise InvalidSetting(
                "Transform.n_bins",
                got=self.n_bins,
                need="1: one point has the same power in every bin",
                fix="Leave the number of bins out.",
            )

    @cached_property
    def weights(self) -> np.ndarray:
        """The window, (n_points,)."""
        return taper(self.window, self.n_points)

    @cached_property
    def noise_bandwidth_bins(self) -> float:
        """SNR that the window costs, as a ratio: 1.5 for Hann."""
        return noise_bandwidth_bins(self.weights)

    @property
    def keeps_noise_white(self) -> bool:
        """Whether noise in different bins stays independent."""
        return self.window == "rectangular" and self.n_bins == self.n_points

    @property
    def main_lobe_bins(self) -> float:
        """Half the width of the main lobe of a tone, in bins of the transform."""
        return main_lobe_bins(self.window) * self.n_bins / self.n_points

    def straddle(self, cycles_per_point: float) -> float:
        """Power in the nearest bin to a tone, relative to a tone on a bin: at most 1."""
        off = cycles_per_point * self.n_bins
        off -= round(off)
        turns = np.exp(2j * np.pi * off / self.n_bins * np.arange(self.n_points))
        return float(abs(self.weights @ turns) ** 2 / self.weights.sum() ** 2)

    def covariance(self, n: int) -> np.ndarray:
        """Correlation of white noise among n neighbouring bins, (n, n), Hermitian."""
        if self.keeps_noise_white and n <= self.n_bins:
            return np.eye(n)
        bins = np.arange(n)
        by_lag = bin_correlation(self.weights, self.n_bins, np.arange(1 - n, n))
        return by_lag[bins[:, None] - bins + n - 1]


def independent_rows(chirp: Chirp, transform: Transform) -> slice:
    """Range rows whose noise is circular, so that the laws of false alarms hold there.

    Complex samples: all. Real samples: noise in the rows about DC and about half the sample
    rate correlates with its own conjugate (wholly in the rows 0 and N / 2, 1 / 6 in row 1
    under a Hann window); rows above 0.1 are left out of detection.
    """
    if chirp.sampling == "complex":
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


def range_profiles(cube: xr.DataArray, chirp: Chirp, transform: Transform) -> xr.DataArray:
    """Transform (..., sample) to (..., range), complex; a tone keeps its power.

    |.|^2 of a tone on a bin is its mean power, for complex and for real samples.
    """
    array = cube.transpose(..., "sample")
    profiles = over_range(array.values, chirp.sampling, transform)
    coords = {name: c for name, c in array.coords.items() if "sample" not in c.dims}
    coords["range"] = axis("range", chirp.range_bins_m(transform.n_bins))
    return xr.DataArray(
        profiles, dims=(*array.dims[:-1], "range"), coords=coords, attrs=dict(cube.attrs)
    )


def over_range(samples: np.ndarray, sampling: Sampling, transform: Transform) -> np.ndarray:
    """`range_profiles` of an array without labels, (..., sample) to (..., range)."""
    tapered = samples * amplitude_weights(transform, sampling)
    if sampling == "complex":
        return np.asarray(scipy.fft.fft(tapered, transform.n_bins, axis=-1))
    return np.asarray(scipy.fft.rfft(tapered, transform.n_bins, axis=-1))


def range_doppler(
    samples: np.ndarray, sampling: Sampling, over_range: Transform, over_velocity: Transform
) -> np.ndarray:
    """Transform one frame, (chirp, channel, sample), to (velocity, channel, range).

    A tone on a bin keeps its power. Velocities ascend, receding positive. Needs one more cube
    of memory.
    """
    slow = _turned_weights(over_velocity)
    fast = amplitude_weights(over_range, sampling)
    if sampling == "real":
        spectrum = scipy.fft.rfft(samples * fast, over_range.n_bins, axis=-1)
        spectrum *= slow[:, None, None]
        return np.asarray(scipy.fft.fft(spectrum, over_velocity.n_bins, axis=0, overwrite_x=True))
    if over_velocity.n_bins % 2 == 0:
        # Numbers in a row, two to a sample, times real weights: a fifth of the time.
        numbers = np.ascontiguousarray(samples, np.complex64).view(np.float32)
        spectrum = _tapered(numbers, slow.real, fast).view(np.complex64)
    else:
        spectrum = samples * slow[:, None, None] * fast
    # Zeros that pad the range are never transformed over chirps; without them range goes first,
    # which takes a quarter less for 256 x 128 samples.
    transforms = [(0, over_velocity.n_bins), (2, over_range.n_bins)]
    if over_range.n_bins == over_range.n_points:
        transforms.reverse()
    for along, n_bins in transforms:
        spectrum = scipy.fft.fft(spectrum, n_bins, axis=along, overwrite_x=True)
    return np.asarray(spectrum)


FrameTransform = Callable[[np.ndarray, Sampling, Transform, Transform], np.ndarray]
"""As `range_doppler`: samples of a frame to a spectrum."""


def mean_power(
    samples: np.ndarray,
    sampling: Sampling,
    over_range: Transform,
    over_velocity: Transform,
    transform: FrameTransform = range_doppler,
) -> np.ndarray:
    """Power of each cell of one frame, (chirp, channel, sample) to (velocity, range) float32.

    Mean over the channels; a tone on a bin keeps its power. Channels are transformed one by
    one: a spectrum has a size that stays in the cache, where that of all takes a third longer
    (512 x 256 x 16). Several threads share the channels, in four parts at most, or the rows of
    one: the cut, and with it the rounding of the sum, is the same for any number of threads.
    """
    n_channels = samples.shape[1]
    n_rows = over_range.n_bins if sampling == "complex" else over_range.n_bins // 2 + 1
    n_threads = numba.get_num_threads()
    parts = slices(n_channels, _PARTS)
    each = max(n_threads // len(parts), 1)
    shape = len(parts), over_velocity.n_bins, n_rows
    share = 1 / n_channels
    axes = _channel_axes(samples, sampling, over_range, over_velocity, transform)
    if axes is not None:
        slow, fast = axes
        given = np.ascontiguousarray(samples, np.complex64)
        sums = np.empty(shape, np.float32)

        def add(part: int) -> None:
            first, *others = range(n_channels)[parts[part]]
            add_power = partial(channel_power.add_power, sums[part], given, n_threads=each)
            add_power(first, slow, fast, share, is_first=True)
            for k in others:
                add_power(k, slow, fast, share, is_first=False)
    else:
        sums = np.zeros(shape, np.float32)

        def add(part: int) -> None:
            for k in range(n_channels)[parts[part]]:
                spectrum = transform(samples[:, k : k + 1], sampling, over_range, over_velocity)
                _add_power(sums[part], spectrum[:, 0], np.float32(share))

    with scipy.fft.set_workers(each):
        in_threads(n_threads, add, range(len(parts)))
    for other in sums[1:]:
        sums[0] += other
    return np.asarray(sums[0])


def split_spectrum(
    samples: np.ndarray,
    sampling: Sampling,
    over_range: Transform,
    over_velocity: Transform,
    transform: FrameTransform = range_doppler,
) -> np.ndarray:
    """As `range_doppler`, real parts apart from imaginary: (velocity, channel, 2, range) float32.

    So that compiled loops over ranges make vectors of them.
    """
    n_threads = numba.get_num_threads()
    axes = _channel_axes(samples, sampling, over_range, over_velocity, transform)
    if axes is None:
        with scipy.fft.set_workers(n_threads):
            spectrum = transform(samples, sampling, over_range, over_velocity)
        return np.stack([spectrum.real, spectrum.imag], axis=2, dtype=np.float32)
    slow, fast = axes
    given = np.ascontiguousarray(samples, np.complex64)
    n_channels = samples.shape[1]
    out = np.empty((slow.n_bins, n_channels, 2, fast.n_bins), np.float32)

    def put(channel: int) -> None:
        channel_power.put_spectrum(out, given, channel, slow, fast)

    in_threads(n_threads, put, range(n_channels))
    return out


def _channel_axes(
    samples: np.ndarray,
    sampling: Sampling,
    over_range: Transform,
    over_velocity: Transform,
    transform: FrameTransform,
) -> tuple[channel_power.Axis, channel_power.Axis] | None:
    """Chirps and samples as `channel_power` transforms them; None where it cannot."""
    is_plain = transform is range_doppler and sampling == "complex"
    n_bins = over_velocity.n_bins, over_range.n_bins
    if not is_plain or not channel_power.can(*n_bins, samples.shape[2]):
        return None
    return (
        channel_power.Axis(_slow_weights(over_velocity), over_velocity.n_bins),
        channel_power.Axis(amplitude_weights(over_range, sampling), over_range.n_bins),
    )


def noise_gain(over_range: Transform, over_velocity: Transform, chirp: Chirp) -> float:
    """Mean noise power in a cell of the map over the noise power in one sample."""
    bandwidths = over_range.noise_bandwidth_bins * over_velocity.noise_bandwidth_bins
    gain = bandwidths / (over_range.n_points * over_velocity.n_points)
    return gain if chirp.sampling == "complex" else 2 * gain


@lru_cache(maxsize=32)
def _slow_weights(transform: Transform) -> np.ndarray:
    """Window of the Doppler transform, scaled so that a tone on a bin keeps its power."""
    return np.asarray(transform.weights / transform.weights.sum(), np.float32)


@lru_cache(maxsize=32)
def _turned_weights(transform: Transform) -> np.ndarray:
    """Window of the Doppler transform, which moves zero velocity to the middle bin.

    By a phase ramp: +1, -1, +1 ... for an even number of bins. This saves a pass over the
    spectrum (0.2 ms of 4 at 2200 x 128).
    """
    slow = transform.weights / transform.weights.sum()
    turns = np.arange(slow.size) * (transform.n_bins // 2) % transform.n_bins / transform.n_bins
    return np.asarray((slow * np.exp(2j * np.pi * turns)).astype(np.complex64))


@lru_cache(maxsize=32)
def amplitude_weights(transform: Transform, sampling: Sampling) -> np.ndarray:
    """Window of the range transform, scaled so that a tone on a bin keeps its power."""
    # A real tone puts half its power at negative frequencies, which are not kept.
    gain = 1.0 if sampling == "complex" else np.sqrt(2.0)
    return (gain * transform.weights / transform.weights.sum()).astype(np.float32)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _tapered(numbers: np.ndarray, slow: np.ndarray, fast: np.ndarray) -> np.ndarray:
    """Windowed copy, one pass: numbers (chirp, rx, 2 sample) x slow (chirp) x fast (sample)."""
    out = np.empty(numbers.shape, np.float32)
    n_chirps, n_rx, n_numbers = numbers.shape
    twice = np.repeat(fast, 2)
    for m in range(n_chirps):
        for k in range(n_rx):
            for n in range(n_numbers):
                out[m, k, n] = numbers[m, k, n] * (slow[m] * twice[n])
    return out


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})
def _add_power(out: np.ndarray, spectrum: np.ndarray, share: np.float32) -> None:
    """Add a share of the power of each cell, in place, both (velocity, range)."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            z = spectrum[i, j]
            out[i, j] += share * (z.real * z.real + z.imag * z.imag)
