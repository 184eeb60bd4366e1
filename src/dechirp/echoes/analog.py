"""A frequency response of analog electronics, made on samples.

What is sampled lies in one band: of complex samples that of the beats, 0 to the sample rate; of
real ones minus to plus half of it. Each frequency of the samples has the response of the analog
frequency in that band, so that a beat above half the sample rate is what it is, and no negative
frequency. A tenth of the sample rate passes smoothly from one end of the band to the other, as
an abrupt change would ring through all samples. From 0 to nine tenths of the band the response is
that of the electronics, within the tolerance. Of complex samples the last tenth is shared with
frequencies just below 0, over which what comes after short delays is spread.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy import fft

from dechirp.radar.chirp import Chirp

_CROSSOVER = 0.1  # of the sample rate, half of it at each end of the band

TOLERANCE = 2e-3
"""Largest error of a response, over its largest gain: 0.02 dB there. None at frequency 0."""

Response = Callable[[np.ndarray], np.ndarray]
"""Complex gain at analog frequencies of both signs, Hz; conjugate where the sign turns."""


class Reach(NamedTuple):
    """How many samples before and after it each one depends on."""

    before: int
    after: int


def impulse_response(response: Response, chirp: Chirp, *, settles_s: float = 0.0) -> np.ndarray:
    """Response of samples to a 1 among zeros: (n,), from its instant on, the end before it.

    Long enough for what settles in `settles_s`; real for real samples.
    """
    n = 1 << int(np.ceil(np.log2(max(4096, 8 * settles_s * chirp.sample_rate_hz))))
    cycles = np.arange(n) / n
    low = -_CROSSOVER if chirp.sampling == "complex" else -(1 + _CROSSOVER) / 2
    total = np.zeros(n, complex)
    for alias in (-1, 0):
        there = cycles + alias
        share = _step((there - low) / _CROSSOVER) - _step((there - low - 1) / _CROSSOVER)
        total += share * response(there * chirp.sample_rate_hz)
    impulse = fft.ifft(total)
    return impulse if chirp.sampling == "complex" else impulse.real


def reach(impulse: np.ndarray, tolerance: float = TOLERANCE) -> Reach:
    """Samples that matter: all others together, in phase, are within the tolerance."""
    size, half = np.abs(impulse), len(impulse) // 2
    least = tolerance / 2 * np.abs(fft.fft(impulse)).max()
    return Reach(_last(size[:half], least), _last(size[:half:-1], least) + 1)


def convolution(
    samples: np.ndarray, impulses: np.ndarray, far: Reach
) -> Callable[[np.ndarray], np.ndarray]:
    """Make the function that convolves some chirps, (n_chirps, n_rx, n_samples), with a response.

    `samples` are some that it will be given, `impulses` (n,) or (n_rx, n) as of
    `impulse_response`. Samples that lack others which they depend on are 0 in what it returns.
    """
    n_samples, is_real = samples.shape[-1], not np.iscomplexobj(samples)
    n = max(fft.next_fast_len(n_samples, real=is_real), far.before + far.after + 1)
    taps = np.zeros((*impulses.shape[:-1], n), impulses.dtype)
    missing = impulses[..., far.before + 1 : impulses.shape[-1] - far.after].sum(axis=-1)
    even = missing[..., None] / (far.before + far.after + 1)
    taps[..., : far.before + 1] = impulses[..., : far.before + 1] + even
    taps[..., n - far.after :] = impulses[..., impulses.shape[-1] - far.after :] + even
    gains = fft.rfft(taps) if is_real else fft.fft(taps)
    gains = gains.astype(np.result_type(samples, np.complex64))

    def convolved(chirps: np.ndarray) -> np.ndarray:
        spectrum = fft.rfft(chirps, n) if is_real else fft.fft(chirps, n)
        spectrum *= gains
        back = fft.irfft if is_real else fft.ifft
        made = back(spectrum, n, overwrite_x=True)[..., :n_samples]
        made[..., : far.before] = 0
        made[..., max(n_samples - far.after, 0) :] = 0
        return made

    return convolved


def _step(x: np.ndarray) -> np.ndarray:
    """From 0 below 0 to 1 above 1, its slope a Hann window."""
    x = np.clip(x, 0, 1)
    return x - np.sin(2 * np.pi * x) / (2 * np.pi)


def _last(size: np.ndarray, least: float) -> int:
    """The first place whose followers together are no more than what matters."""
    rest = np.cumsum(size[::-1])[::-1]
    return int(np.count_nonzero(rest[1:] > least))
