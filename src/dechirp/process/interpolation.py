r"""Between the bins: where the top of a peak is, from the cells beside the highest.

A tone d bins from its cell has in the cell beside it, on the nearer side, the amplitude

.. math:: \frac{|W(1 - d)|}{|W(d)|}, \quad W(d) = \sum_n w_n e^{2\pi\mathrm{i} d n / N}

relative to the highest: it rises with d from 0 to 1/2, for every window and padding, and is
read backwards from the window's own transform. No bias is left but that of other tones: the image
of a real tone puts 0.005 of an unpadded bin where it is six bins off, under a rectangular
window. Noise moves it as little as a parabola through three cells, and under a rectangular window
without padding less, by a third at 30 dB: the cell on the other side may hold noise alone.
"""

from functools import lru_cache

import numpy as np

from dechirp.process.cfar.base import Noise
from dechirp.process.spectrum import Transform

# Steps of half a bin at which W is taken: between them ratios are straight within 1e-4 bins.
_STEPS = 64
_AWAY = np.linspace(0, 0.5, _STEPS + 1)
# A window whose transform falls less than this in a bin has one weight that counts: no lobe.
_FLAT = 1e-9


def between_bins(
    power: np.ndarray, found: np.ndarray, noise: Noise
) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies of the peaks of a map, rad per chirp and rad per sample, (n,) each.

    `power` is (velocity, range), `found` (n, 2) the cells of the peaks.
    """
    velocity, row = found[:, 0], found[:, 1]
    (n_velocity, n_rows), n_bins = power.shape, noise.over_range.n_bins

    def at(at_velocity: np.ndarray, at_row: np.ndarray) -> np.ndarray:
        # Rows wrap round as velocities do; those of real samples end before they would.
        return power[at_velocity % n_velocity, np.minimum(at_row % n_bins, n_rows - 1)]

    top = at(velocity, row)
    d_velocity = offsets(at(velocity - 1, row), top, at(velocity + 1, row), noise.over_velocity)
    d_row = offsets(at(velocity, row - 1), top, at(velocity, row + 1), noise.over_range)
    turn_velocity = 2 * np.pi / noise.over_velocity.n_bins
    turn_range = 2 * np.pi / noise.over_range.n_bins
    slow = (velocity - noise.over_velocity.n_bins // 2 + d_velocity) * turn_velocity
    return slow, (row + d_row) * turn_range


def offsets(
    before: np.ndarray, top: np.ndarray, after: np.ndarray, transform: Transform
) -> np.ndarray:
    """How far tones are from their cells, in bins, -1/2 to 1/2; 0 where the cell has no power.

    `before`, `top` and `after` are powers of three cells in a row, the highest in the middle.
    """
    ratios = _ratios(transform)
    if ratios[0] > 1 - _FLAT:
        return np.zeros(top.shape)
    power = np.maximum(before, after) / np.where(top > 0, top, np.inf)
    away = np.interp(np.sqrt(power), ratios, _AWAY)
    return np.asarray(np.sign(after - before) * away)


@lru_cache(maxsize=32)
def _ratios(transform: Transform) -> np.ndarray:
    """Amplitude in the cell beside over that in the highest, for tones 0 to 1/2 bin away."""
    turns = 2j * np.pi / transform.n_bins * np.arange(transform.n_points)
    at, beside = (
        abs(np.exp(np.outer(off, turns)) @ transform.weights) for off in (_AWAY, 1 - _AWAY)
    )
    return np.asarray(beside / at)
