"""What clean-up leaves of white noise in a map, and the map put right by it.

A filter over slow time colours the noise over velocity: a notch about zero. A detector of
constant false-alarm rate there would take the noise beside a notch for that within, or the other
way round. So the map is divided by what white noise has in each cell, which follows exactly from
the filter and the windows; targets that the filter weakens as it does the noise come back to
their power.
"""

from collections.abc import Sequence
from functools import lru_cache
from itertools import product

import numba
import numpy as np

from dechirp.process.mitigation.base import Mitigation
from dechirp.process.spectrum import Transform
from dechirp.radar.chirp import Chirp

LEAST = 0.1
"""Of white noise, that a cell must have left to be searched: of less, the slopes of the notch
are so steep that neighbours are tied together otherwise than the window ties them."""
_BLOCK_NUMBERS = 2**20  # transformed at a time


def noise_left(
    mitigation: Sequence[Mitigation],
    chirp: Chirp,
    over_range: Transform,
    over_velocity: Transform,
) -> np.ndarray:
    """Noise power in each cell of a map after clean-up, over that without, (velocity, range).

    float32, velocities ascending and rows of range as `process.spectrum.range_doppler` gives
    them. Exact of white noise: the sum over chirps of the squared weights with which each of
    them, through the filters and the window, arrives in a velocity. Of ranges only partly
    cleaned, what lies in the cleaned band and what does not add up.
    """
    return _noise_left(tuple(mitigation), chirp, over_range, over_velocity)


@lru_cache(maxsize=8)
def _noise_left(
    mitigation: tuple[Mitigation, ...],
    chirp: Chirp,
    over_range: Transform,
    over_velocity: Transform,
) -> np.ndarray:
    acting = [one for one in mitigation if one.filters_slow_time]
    shares = [one.share_of_ranges(over_range.weights, chirp, over_range.n_bins) for one in acting]
    everywhere = [np.all(share == 1) for share in shares]
    n_rows = over_range.n_bins if chirp.sampling == "complex" else over_range.n_bins // 2 + 1
    left = np.zeros((over_velocity.n_bins, n_rows))
    # Each filter acts, or does not where it is for some ranges only: the shares of both add up.
    for acts in product(*((True,) if whole else (True, False) for whole in everywhere)):
        share = np.ones(over_range.n_bins)
        for of_filter, active in zip(shares, acts, strict=True):
            share = share * (of_filter if active else 1 - of_filter)
        chosen = tuple(one for one, active in zip(acting, acts, strict=True) if active)
        left += _over_velocity(chosen, over_velocity)[:, None] * share[:n_rows]
    left = left.astype(np.float32)
    left.setflags(write=False)  # it is kept, and handed out again
    return left


@lru_cache(maxsize=32)
def _over_velocity(filters: tuple[Mitigation, ...], transform: Transform) -> np.ndarray:
    """Noise power in each velocity after some filters, over that without, (n_bins,).

    What a pulse in one chirp becomes, windowed and transformed; noise is pulses in all of them.
    """
    n, weights = transform.n_points, transform.weights
    if not filters:
        return np.ones(transform.n_bins)
    power = np.zeros(transform.n_bins)
    per_block = max(1, _BLOCK_NUMBERS // transform.n_bins)
    for first in range(0, n, per_block):
        series = np.eye(n, min(per_block, n - first), -first)
        for one in filters:
            series = one.over_chirps(series)
        spectra = np.fft.fft(weights[:, None] * series, transform.n_bins, axis=0)
        power += np.sum(np.abs(spectra) ** 2, axis=1)
    return np.fft.fftshift(power) / np.sum(weights**2)


def searched(left: np.ndarray) -> np.ndarray:
    """Cells in which targets can be looked for, bool: those with a tenth of the noise left."""
    return np.asarray(left >= LEAST)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def evened(power: np.ndarray, left: np.ndarray) -> np.ndarray:
    """A map (velocity, range) over the noise that is left, float32: white noise has one level.

    Cells that are not `searched` get the mean of the nearest in velocity that are, so that as
    training cells they neither hide nor make targets; zeros where no velocity is searched.
    """
    n, n_rows = power.shape
    out = np.zeros((n, n_rows), np.float32)
    for i in range(n):
        for j in range(n_rows):
            if left[i, j] >= LEAST:
                out[i, j] = power[i, j] / left[i, j]
                continue
            for step in (1, -1):
                for k in range(1, n):
                    near = (i + step * k) % n
                    if left[near, j] >= LEAST:
                        out[i, j] += power[near, j] / left[near, j] / 2
                        break
    return out
