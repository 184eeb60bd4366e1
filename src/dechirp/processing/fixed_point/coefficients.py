"""Fixed-point coefficients: twiddle factors, windows, logarithms and threshold factors.

All are small tables that are stored before the first sample.
"""

import numpy as np

from dechirp.processing.spectrum import Transform

INTEGER_BITS = 2
"""Integer bits of a coefficient: its sign, and 1."""


def integer_twiddle_factors(n_points: int, bits: int) -> np.ndarray:
    """Return real and imaginary part of exp(-2 pi i k / n_points), k < n_points / 2, (n, 2)."""
    phase = -2 * np.pi * np.arange(n_points // 2) / n_points
    factors = np.stack([np.cos(phase), np.sin(phase)], axis=-1)
    return np.rint(factors * 2 ** (bits - INTEGER_BITS)).astype(np.int64)


def integer_range_window(transform: Transform, bits: int) -> np.ndarray:
    """Return the integer window, 1 in its middle, (n_points,)."""
    return np.rint(transform.weights * 2 ** (bits - INTEGER_BITS)).astype(np.int64)


def integer_doppler_window(transform: Transform, bits: int) -> np.ndarray:
    """Return the integer window with alternating signs, (n_points,).

    The signs move zero velocity to the middle of an even number of bins.
    """
    signs = 1 - 2 * (np.arange(transform.n_points) % 2) * (transform.n_bins > 1)
    return integer_range_window(transform, bits) * signs


def integer_log2_table(table_bits: int, fraction_bits: int) -> np.ndarray:
    """Return log2(1 + f) in the middle of each of 2^table_bits intervals of f from 0 to 1."""
    middles = (np.arange(2**table_bits) + 0.5) / 2**table_bits
    return np.rint(np.log2(1 + middles) * 2**fraction_bits).astype(np.int64)


def quantise_factors_with_common_shift(ratios: np.ndarray, bits: int) -> tuple[np.ndarray, int]:
    """Return integers F and a shift s with ratios F / 2^s, the largest F of all bits."""
    shift = bits - int(np.frexp(ratios.max())[1])
    return np.minimum(np.rint(np.ldexp(ratios, shift)), 2**bits - 1).astype(np.int64), shift
