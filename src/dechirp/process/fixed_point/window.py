"""Windows in whole numbers: words times weights, onto the words of the next transform."""

import numba
import numpy as np

from dechirp.process.fixed_point.rounding import saturated, shifted


@numba.njit(cache=True, nogil=True, error_model="numpy")
def weighted(
    points: np.ndarray, weights: np.ndarray, shifts: np.ndarray, n_bins: int, bits: int, mode: int
) -> tuple[np.ndarray, int]:
    """Words (a, b, n_points, 2) times weights (n_points,), shifted right, zeros behind.

    Parameters
    ----------
    points : integer array
        Any strides: of a transposed one this is the corner turn.
    weights : int64 array
    shifts : int64 array (a, b, n_points)
        Bits to shift each product right: those of a weight behind the point, and what brings
        words of several exponents to one.
    n_bins : int
        Points of the transform.
    bits : int
        Of the result; what does not fit is saturated.
    mode : int
        Of `rounding.MODES`.

    Returns
    -------
    int32 array (a, b, n_bins, 2), and how many parts of numbers were saturated.
    """
    n_a, n_b, n_points, _ = points.shape
    out = np.zeros((n_a, n_b, n_bins, 2), np.int32)
    n_overflows = 0
    for a in range(n_a):
        for b in range(n_b):
            for k in range(n_points):
                for part in range(2):
                    product = points[a, b, k, part] * weights[k]
                    word = shifted(product, shifts[a, b, k], mode)
                    kept = saturated(word, bits)
                    n_overflows += kept != word
                    out[a, b, k, part] = kept
    return out, n_overflows
