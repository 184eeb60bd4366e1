"""Samples of a narrow band, from every so-manieth of them.

Between two known samples a tone is a weighted sum of the ten around it. The weights are those
with the least mean square error over the band,

    sum_b sinc(W (a - b)) h_b = sinc(W (a - x)),    sinc(y) = sin(pi y) / (pi y),

W the width of the band over the rate of the known samples (Laakso et al. 1996, 4.3).
"""

from functools import cache, lru_cache
from typing import NamedTuple

import numba
import numpy as np

TAPS = 10
_FIRST = 1 - TAPS // 2

OUTSIDE = 1 / 4
"""How far outside the window known samples lie at most, of its half: what is known of echoes
there is a series about the middle, which needs more terms the farther it reaches."""


class Between(NamedTuple):
    """Which samples are known, and how those between follow from them."""

    every: int
    """Every so-manieth sample is known, one of them the sample 0."""
    tone: float
    """Middle of the band, cycles a sample: taken off the known ones."""
    weights: np.ndarray
    """(every, TAPS) float32."""

    def needed(self, first: int, stop: int) -> tuple[int, int]:
        """First known one, and the one after the last, for samples from `first` to `stop`."""
        return first // self.every + _FIRST, (stop - 1) // self.every + TAPS // 2 + 1

    def fill(self, out: np.ndarray, rows: np.ndarray, known: np.ndarray) -> None:
        """Add to some rows of `out` (., n_samples), the middle one sample 0, from known ones.

        `known`: (len(rows), n_known) complex64.
        """
        n = out.shape[1]
        samples = np.arange(n) - n // 2
        tone = np.exp(2j * np.pi * (self.tone * samples % 1)).astype(np.complex64)
        known = np.ascontiguousarray(known).view(np.float32)
        _fill(out, rows, known, self.weights, tone, samples[0] % self.every)


def fewest_times(low: float, high: float, *, n_samples: int, tolerance: float) -> Between | None:
    """The fewest known samples from which a band, cycles a sample, follows; None: all of them.

    Of a window of `n_samples`; where these are few, more are known than the band needs.

    `tolerance`: root mean square over the band, of tones of size 1.
    """
    every = int(_widest(tolerance) / max(high - low, 1e-3))
    every = min(every, int(OUTSIDE * n_samples / TAPS))
    if every < 2:
        return None
    return Between(every, (low + high) / 2, _weights(every, round((high - low) * every + 5e-4, 3)))


@lru_cache(64)
def _weights(every: int, width: float) -> np.ndarray:
    return _least_squares(every, width)[0].astype(np.float32)


@cache
def _widest(tolerance: float) -> float:
    """Band, cycles a known sample, within which what lies between is right to the tolerance."""
    widths = np.linspace(0.5, 0.05, 91)
    return float(next(w for w in widths if _least_squares(2, w)[1] <= tolerance))


def _least_squares(every: int, width: float) -> tuple[np.ndarray, float]:
    taps = np.arange(TAPS) + _FIRST
    between = np.arange(every) / every
    overlaps = np.sinc(width * (taps[:, None] - taps))
    wanted = np.sinc(width * (taps[:, None] - between))
    weights = np.linalg.lstsq(overlaps, wanted, rcond=1e-13)[0]
    left = 1 - 2 * np.sum(weights * wanted, 0) + np.sum(weights * (overlaps @ weights), 0)
    return weights.T, float(np.sqrt(max(left.max(), 0.0)))


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})
def _fill(
    out: np.ndarray,
    rows: np.ndarray,
    known: np.ndarray,
    weights: np.ndarray,
    tone: np.ndarray,
    phase: int,
) -> None:
    every, n_samples = len(weights), out.shape[1]
    n_groups = known.shape[1] // 2 - TAPS + 1
    got = np.empty(2 * n_groups, np.float32)
    for m in range(len(rows)):
        line, row = known[m], rows[m]
        for r in range(every):
            w = weights[r]
            w0, w1, w2, w3, w4 = w[0], w[1], w[2], w[3], w[4]
            w5, w6, w7, w8, w9 = w[5], w[6], w[7], w[8], w[9]
            # In parts one after the other, real and imaginary: plain loops over numbers.
            for j in range(2 * n_groups):
                early = w0 * line[j] + w1 * line[j + 2] + w2 * line[j + 4] + w3 * line[j + 6]
                late = w6 * line[j + 12] + w7 * line[j + 14] + w8 * line[j + 16] + w9 * line[j + 18]
                got[j] = early + w4 * line[j + 8] + w5 * line[j + 10] + late
            first = 1 if r < phase else 0
            at = np.uint64(first * every + r - phase)
            for j in range(np.uint64(first), np.uint64(n_groups)):
                if at >= n_samples:
                    break
                two = np.uint64(2) * j
                out[row, at] += tone[at] * complex(got[two], got[two + np.uint64(1)])
                at += np.uint64(every)
