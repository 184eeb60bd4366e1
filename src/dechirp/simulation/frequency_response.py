"""Frequency response of analog electronics, applied to samples.

The samples cover one band: complex samples the beat frequencies from 0 to the sample rate, real
samples minus to plus half of it. Each frequency gets the response of the analog frequency in that
band, so a beat above half the sample rate is not treated as a negative frequency. A tenth of the
sample rate is a smooth transition from one end of the band to the other, since an abrupt change
would ring through all samples. From 0 to nine tenths of the band, the response is that of the
electronics within the tolerance. With complex samples, the last tenth is shared with frequencies
just below 0, over which echoes of short delay are spread.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy

from dechirp.radar.chirp import Chirp

_CROSSOVER = 0.1  # of the sample rate, half of it at each end of the band

TOLERANCE = 2e-3
"""Largest error of a response relative to its largest gain, 0.02 dB there; zero at frequency 0."""

FrequencyResponse = Callable[[np.ndarray], np.ndarray]
"""Complex gain at analog frequencies of both signs, Hz; conjugate-symmetric."""


class ImpulseExtent(NamedTuple):
    """Number of samples before and after, on which each filtered sample depends."""

    n_before: int
    n_after: int


def impulse_response(
    response: FrequencyResponse, chirp: Chirp, *, settling_time_s: float = 0.0
) -> np.ndarray:
    """Return the impulse response of the samples, (n,), with negative times last.

    It is long enough to settle in `settling_time_s`, and real for real samples.
    """
    n = 1 << int(np.ceil(np.log2(max(4096, 8 * settling_time_s * chirp.sample_rate_hz))))
    cycles = np.arange(n) / n
    low = -_CROSSOVER if chirp.sampling == "complex" else -(1 + _CROSSOVER) / 2
    total = np.zeros(n, complex)
    for alias in (-1, 0):
        analog_cycles = cycles + alias
        share = _smooth_step((analog_cycles - low) / _CROSSOVER) - _smooth_step(
            (analog_cycles - low - 1) / _CROSSOVER
        )
        total += share * response(analog_cycles * chirp.sample_rate_hz)
    impulse = scipy.fft.ifft(total)
    return impulse if chirp.sampling == "complex" else impulse.real


def significant_impulse_extent(impulse: np.ndarray, tolerance: float = TOLERANCE) -> ImpulseExtent:
    """Return the extent outside which all samples, added in phase, are within the tolerance."""
    size, half = np.abs(impulse), len(impulse) // 2
    least = tolerance / 2 * np.abs(scipy.fft.fft(impulse)).max()
    return ImpulseExtent(
        _index_before_negligible_tail(size[:half], least),
        _index_before_negligible_tail(size[:half:-1], least) + 1,
    )


def make_chirp_convolver(
    example_samples: np.ndarray, impulses: np.ndarray, extent: ImpulseExtent
) -> Callable[[np.ndarray], np.ndarray]:
    """Make the function that convolves some chirps, (n_chirps, n_rx, n_samples), with a response.

    `example_samples` is an example of its input; `impulses` is (n,) or (n_rx, n), from
    `impulse_response`. Output samples that depend on missing input samples are 0.
    """
    n_samples, is_real = example_samples.shape[-1], not np.iscomplexobj(example_samples)
    n = max(scipy.fft.next_fast_len(n_samples, real=is_real), extent.n_before + extent.n_after + 1)
    taps = np.zeros((*impulses.shape[:-1], n), impulses.dtype)
    residual = impulses[..., extent.n_before + 1 : impulses.shape[-1] - extent.n_after].sum(axis=-1)
    residual_per_tap = residual[..., None] / (extent.n_before + extent.n_after + 1)
    taps[..., : extent.n_before + 1] = impulses[..., : extent.n_before + 1] + residual_per_tap
    taps[..., n - extent.n_after :] = (
        impulses[..., impulses.shape[-1] - extent.n_after :] + residual_per_tap
    )
    gains = scipy.fft.rfft(taps) if is_real else scipy.fft.fft(taps)
    gains = gains.astype(np.result_type(example_samples, np.complex64))

    def convolve(chirps: np.ndarray) -> np.ndarray:
        spectrum = scipy.fft.rfft(chirps, n) if is_real else scipy.fft.fft(chirps, n)
        spectrum *= gains
        inverse_fft = scipy.fft.irfft if is_real else scipy.fft.ifft
        filtered = inverse_fft(spectrum, n, overwrite_x=True)[..., :n_samples]
        filtered[..., : extent.n_before] = 0
        filtered[..., max(n_samples - extent.n_after, 0) :] = 0
        return filtered

    return convolve


def _smooth_step(x: np.ndarray) -> np.ndarray:
    """Return a step from 0 below 0 to 1 above 1, whose slope is a Hann window."""
    x = np.clip(x, 0, 1)
    return x - np.sin(2 * np.pi * x) / (2 * np.pi)


def _index_before_negligible_tail(magnitudes: np.ndarray, max_tail_sum: float) -> int:
    """Return the first index after which the remaining sizes add up to at most `max_tail_sum`."""
    rest = np.cumsum(magnitudes[::-1])[::-1]
    return int(np.count_nonzero(rest[1:] > max_tail_sum))
