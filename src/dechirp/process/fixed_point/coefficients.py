"""Coefficients in words: cosines and sines, windows, logarithms, and factors of thresholds.

All of them are small tables that a machine holds before the first sample.
"""

import numpy as np

from dechirp.process.spectrum import Transform

POINT = 2
"""Bits of a coefficient before the point: its sign, and 1."""


def twiddles(n_points: int, bits: int) -> np.ndarray:
    """Real and imaginary part of exp(-2 pi i k / n_points), k < n_points / 2, (n, 2) integers."""
    phase = -2 * np.pi * np.arange(n_points // 2) / n_points
    turns = np.stack([np.cos(phase), np.sin(phase)], axis=-1)
    return np.rint(turns * 2 ** (bits - POINT)).astype(np.int64)


def range_weights(transform: Transform, bits: int) -> np.ndarray:
    """The window, 1 in its middle, (n_points,) integers."""
    return np.rint(transform.weights * 2 ** (bits - POINT)).astype(np.int64)


def doppler_weights(transform: Transform, bits: int) -> np.ndarray:
    """The window, the sign of every other weight turned, (n_points,) integers.

    That moves zero velocity to the middle of an even number of bins.
    """
    signs = 1 - 2 * (np.arange(transform.n_points) % 2) * (transform.n_bins > 1)
    return range_weights(transform, bits) * signs


def logarithms(table_bits: int, fraction_bits: int) -> np.ndarray:
    """log2(1 + f) in the middle of each of 2^table_bits intervals of f from 0 to 1, integers."""
    middles = (np.arange(2**table_bits) + 0.5) / 2**table_bits
    return np.rint(np.log2(1 + middles) * 2**fraction_bits).astype(np.int64)


def factors(ratios: np.ndarray, bits: int) -> tuple[np.ndarray, int]:
    """Whole numbers F and one shift s so that F / 2^s are the ratios, the largest F of all bits."""
    shift = bits - int(np.frexp(ratios.max())[1])
    return np.minimum(np.rint(np.ldexp(ratios, shift)), 2**bits - 1).astype(np.int64), shift
