"""Difference co-array: the lags on which spectra and covariances depend.

Power towards a direction, a^H M a, is a sum over pairs of elements; pairs with equal lags have
equal phase differences. A uniform line of N elements has N^2 pairs and 2 N - 1 lags.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from dechirp.core.compiled_kernels import AS_WRITTEN, kernel
from dechirp.processing.angle.aperture import Aperture

# Phases of all lags towards all directions of a grid: 64 MiB.
_MAX_CACHED_VALUES = 2**22


class DifferenceCoarray(NamedTuple):
    """Lags between elements of an array; every pair is a lag where elements are not on a grid."""

    lag_of_pair: np.ndarray
    """Lag index of each pair of elements, (n, n)."""
    pairs: tuple[np.ndarray, np.ndarray]
    """A pair of array elements with each lag, (n_lags,) each."""

    def lag_phase_factors(self, steering: np.ndarray) -> np.ndarray:
        """Return a_i conj(a_j) of a pair for each lag, (..., n_lags)."""
        first, second = self.pairs
        return np.asarray(steering[..., first] * steering[..., second].conj())

    def sum_over_equal_lags(self, hermitian_matrices: np.ndarray) -> np.ndarray:
        """Sum Hermitian (n, N, N) over the pairs of each lag, (n, n_lags).

        Real matrices over the rows of `SlidingWindows.real_valued_data_matrices` stand for complex
        ones. Only the lower half of each matrix is read.
        """
        kernel = (
            _sum_matrices_over_equal_lags
            if np.iscomplexobj(hermitian_matrices)
            else _sum_real_matrices_over_equal_lags
        )
        return np.asarray(kernel(hermitian_matrices, self.lag_of_pair, len(self.pairs[0])))


@lru_cache(maxsize=8)
def difference_coarray_of_elements(
    aperture: Aperture, elements: tuple[int, ...]
) -> DifferenceCoarray:
    """Return the difference co-array of some elements of an array."""
    indices, n = np.array(elements), len(elements)
    if aperture.element_grid is None:
        representative = lag_of_pair = np.arange(n * n)
    else:
        grid_indices = aperture.element_grid.indices[indices]
        lags = (grid_indices[:, None] - grid_indices).reshape(-1, 2)
        _, representative, lag_of_pair = np.unique(
            lags, axis=0, return_index=True, return_inverse=True
        )
    first, second = np.divmod(representative, n)
    return DifferenceCoarray(lag_of_pair.reshape(n, n), (indices[first], indices[second]))


@lru_cache(maxsize=4)
def cached_grid_lag_phase_factors(
    aperture: Aperture, elements: tuple[int, ...]
) -> np.ndarray | None:
    """Return the lag phases towards the grid directions, or None if too many to cache."""
    coarray, grid = difference_coarray_of_elements(aperture, elements), aperture.direction_grid
    if len(coarray.pairs[0]) * len(grid.steering) > _MAX_CACHED_VALUES:
        return None
    # The single-precision steering vectors of the grid would not do: the phases of two pairs of one
    # lag would differ by as much as Capon suppresses a strong source.
    steering = aperture.steering_vectors(grid.azimuth_rad, grid.elevation_rad[:, None])
    return coarray.lag_phase_factors(steering.reshape(-1, aperture.n_elements))


def quadratic_forms_from_lags(lag_sums: np.ndarray, lag_phase_factors: np.ndarray) -> np.ndarray:
    """Return a^H M a, (n, m), from lag sums (n, n_lags) and lag phases (m, n_lags)."""
    return np.asarray(
        lag_sums.real @ lag_phase_factors.real.T + lag_sums.imag @ lag_phase_factors.imag.T
    )


def _quadratic_forms_in_numpy(
    lag_sums: np.ndarray, steering: np.ndarray, pairs: tuple[np.ndarray, np.ndarray]
) -> np.ndarray:
    """Plain twin of `quadratic_forms_per_detection`: equal within rounding."""
    products = steering[:, :, pairs[0]] * steering[:, :, pairs[1]].conj()
    sums = lag_sums[:, None]
    return np.asarray(np.sum(sums.real * products.real + sums.imag * products.imag, axis=2))


@kernel(plain=_quadratic_forms_in_numpy, fastmath={"contract", "reassoc"})
def quadratic_forms_per_detection(
    lag_sums: np.ndarray, steering: np.ndarray, pairs: tuple[np.ndarray, np.ndarray]
) -> np.ndarray:
    """Return a^H M a, (n, m), towards own directions with steering (n, m, n_elements)."""
    n, m, _ = steering.shape
    first, second = pairs
    out = np.empty((n, m))
    for i in range(n):
        for k in range(m):
            total = 0.0
            for d in range(len(first)):
                a, b, s = steering[i, k, first[d]], steering[i, k, second[d]], lag_sums[i, d]
                total += s.real * (a.real * b.real + a.imag * b.imag)
                total += s.imag * (a.imag * b.real - a.real * b.imag)
            out[i, k] = total
    return out


def _sum_matrices_in_numpy(
    matrices: np.ndarray, lag_of_pair: np.ndarray, n_lags: int
) -> np.ndarray:
    """Plain twin of `_sum_matrices_over_equal_lags`: equal within rounding."""
    lower = np.tril(matrices, -1)
    diagonal = matrices * np.eye(matrices.shape[1])
    hermitian = lower + lower.conj().swapaxes(1, 2) + diagonal
    out = np.zeros((len(matrices), n_lags), complex)
    for i, matrix in enumerate(hermitian):
        np.add.at(out[i], lag_of_pair, matrix)
    return out


@kernel(plain=_sum_matrices_in_numpy)
def _sum_matrices_over_equal_lags(
    matrices: np.ndarray, lag_of_pair: np.ndarray, n_lags: int
) -> np.ndarray:
    n, n_elements, _ = matrices.shape
    out = np.zeros((n, n_lags), np.complex128)
    for i in range(n):
        for row in range(n_elements):
            for column in range(row):
                number = matrices[i, row, column]
                out[i, lag_of_pair[row, column]] += number
                out[i, lag_of_pair[column, row]] += np.conj(number)
            out[i, lag_of_pair[row, row]] += matrices[i, row, row]
    return out


@kernel(plain=AS_WRITTEN)
def _sum_real_matrices_over_equal_lags(
    matrices: np.ndarray, lag_of_pair: np.ndarray, n_lags: int
) -> np.ndarray:
    """Sum real matrices over rows of 2^0.5 cos, 1 (the middle) and 2^0.5 sin of element phases.

    Elements that mirror each other have opposite phases: cos a cos b is half of cos (a - b) and
    of cos (a - b'), b' the mirror of b, and so on.
    """
    n, size, _ = matrices.shape
    half = size // 2
    odd = size - half  # the first row of sines
    out = np.zeros((n, n_lags), np.complex128)
    for i in range(n):
        for row in range(size):
            row_element = row - odd if row >= odd else row
            per_row = 1.0 if row_element == half else 2**0.5
            for column in range(row + 1):
                column_element = column - odd if column >= odd else column
                number = (
                    matrices[i, row, column] * per_row * (1.0 if column_element == half else 2**0.5)
                )
                if row == column:
                    number *= 0.5
                value = 1j * number if column < odd <= row else complex(number)
                out[i, lag_of_pair[row_element, column_element]] += value
                out[i, lag_of_pair[row_element, size - 1 - column_element]] += (
                    -value if column >= odd else value
                )
    return out
