"""Noise gain of mitigation in a map, and equalisation of the map by it.

A filter over slow time colours the noise over velocity with a notch about zero. A CFAR detector
there would take the noise beside a notch for that within, or the reverse. Therefore the map is
divided by the gain of white noise in each cell, which follows exactly from the filter and the
windows; targets that the filter weakens as it does the noise recover their power.
"""

from collections.abc import Sequence
from functools import lru_cache
from itertools import product

import numpy as np

from dechirp.core.compiled_kernels import kernel
from dechirp.processing.mitigation.base import Mitigation
from dechirp.processing.spectrum import Transform
from dechirp.radar.chirp import Chirp

MIN_NOISE_GAIN = 0.1
"""Smallest noise gain of a usable cell: below it, the slopes of the notch are so steep that the
correlation between neighbours differs from that of the window."""
_BLOCK_VALUES = 2**20  # values transformed at a time


def mitigation_noise_gain(
    mitigation: Sequence[Mitigation],
    chirp: Chirp,
    range_transform: Transform,
    doppler_transform: Transform,
) -> np.ndarray:
    """Return the noise power in each cell of a map with mitigation over that without.

    float32 (velocity, range), velocities ascending and rows of range as
    `processing.spectrum.range_doppler_spectrum` gives them. Exact for white noise: the sum over
    chirps of the squared weights with which each of them, through the filters and the window,
    contributes to a velocity. In partly filtered ranges the filtered and unfiltered shares add up.
    """
    return _cached_mitigation_noise_gain(
        tuple(mitigation), chirp, range_transform, doppler_transform
    )


@lru_cache(maxsize=8)
def _cached_mitigation_noise_gain(
    mitigation: tuple[Mitigation, ...],
    chirp: Chirp,
    range_transform: Transform,
    doppler_transform: Transform,
) -> np.ndarray:
    filters = [method for method in mitigation if method.filters_slow_time]
    shares = [
        method.filtered_fraction_of_range_bins(
            range_transform.weights, chirp, range_transform.n_bins
        )
        for method in filters
    ]
    everywhere = [np.all(share == 1) for share in shares]
    n_rows = (
        range_transform.n_bins if chirp.sampling == "complex" else range_transform.n_bins // 2 + 1
    )
    gain = np.zeros((doppler_transform.n_bins, n_rows))
    # A filter for some ranges acts on a share of each bin: the shares with and without it add up.
    for activity in product(
        *((True,) if is_everywhere else (True, False) for is_everywhere in everywhere)
    ):
        share = np.ones(range_transform.n_bins)
        for filter_share, is_active in zip(shares, activity, strict=True):
            share = share * (filter_share if is_active else 1 - filter_share)
        active_filters = tuple(
            method for method, is_active in zip(filters, activity, strict=True) if is_active
        )
        gain += (
            _noise_gain_over_velocity(active_filters, doppler_transform)[:, None] * share[:n_rows]
        )
    gain = gain.astype(np.float32)
    gain.setflags(write=False)  # cached
    return gain


@lru_cache(maxsize=32)
def _noise_gain_over_velocity(filters: tuple[Mitigation, ...], transform: Transform) -> np.ndarray:
    """Return the noise power in each velocity after filters, over that without, (n_bins,).

    The response to a pulse in one chirp, windowed and transformed; noise is pulses in all chirps.
    """
    n, weights = transform.n_points, transform.weights
    if not filters:
        return np.ones(transform.n_bins)
    power = np.zeros(transform.n_bins)
    per_block = max(1, _BLOCK_VALUES // transform.n_bins)
    for first in range(0, n, per_block):
        series = np.eye(n, min(per_block, n - first), -first)
        for method in filters:
            series = method.filter_chirp_series(series)
        spectra = np.fft.fft(weights[:, None] * series, transform.n_bins, axis=0)
        power += np.sum(np.abs(spectra) ** 2, axis=1)
    return np.fft.fftshift(power) / np.sum(weights**2)


def sufficient_noise_gain_mask(noise_gain: np.ndarray) -> np.ndarray:
    """Return a mask of the cells whose noise gain allows detection, at least a tenth."""
    return np.asarray(noise_gain >= MIN_NOISE_GAIN)


def _equalise_map_noise_in_numpy(power: np.ndarray, noise_gain: np.ndarray) -> np.ndarray:
    """Plain twin of `equalise_map_noise`: equal within rounding."""
    is_usable = noise_gain >= MIN_NOISE_GAIN
    level = np.divide(power, noise_gain, out=np.zeros_like(power), where=is_usable)
    out = level.copy()
    for column in np.flatnonzero(~is_usable.all(axis=0)):
        usable, missing = (
            np.flatnonzero(is_usable[:, column]),
            np.flatnonzero(~is_usable[:, column]),
        )
        if not usable.size:
            continue
        after = usable[np.searchsorted(usable, missing) % usable.size]
        before = usable[np.searchsorted(usable, missing) - 1]
        out[missing, column] = (level[after, column] + level[before, column]) / 2
    return out


@kernel(plain=_equalise_map_noise_in_numpy)
def equalise_map_noise(power: np.ndarray, noise_gain: np.ndarray) -> np.ndarray:
    """Divide a map (velocity, range) by the noise gain, so that white noise is level; float32.

    Cells that are not usable get the mean of the nearest usable ones in velocity, so that as
    training cells they neither mask nor mimic targets; zeros where no velocity is usable.
    """
    n, n_rows = power.shape
    out = np.zeros((n, n_rows), np.float32)
    for i in range(n):
        for j in range(n_rows):
            if noise_gain[i, j] >= MIN_NOISE_GAIN:
                out[i, j] = power[i, j] / noise_gain[i, j]
                continue
            for step in (1, -1):
                for k in range(1, n):
                    neighbour = (i + step * k) % n
                    if noise_gain[neighbour, j] >= MIN_NOISE_GAIN:
                        out[i, j] += power[neighbour, j] / noise_gain[neighbour, j] / 2
                        break
    return out
