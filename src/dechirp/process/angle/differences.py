"""Ways from element to element: what spectra and covariances of an array are made of.

Power towards a direction, a^H M a, is a sum over pairs of elements; pairs that share a way see
the same phase between them. On an even line of N there are N^2 pairs and 2 N - 1 ways.
"""

from functools import lru_cache
from typing import NamedTuple

import numba
import numpy as np

from dechirp.process.angle.aperture import Aperture

# Phases of all ways towards all directions of a grid: 64 MiB.
_MOST_NUMBERS = 2**22


class Differences(NamedTuple):
    """Ways between some elements of an array; each pair its own where they are not even."""

    of_pair: np.ndarray
    """(n, n): which way it is from one element to another."""
    pairs: tuple[np.ndarray, np.ndarray]
    """(n_differences,) each: elements of the array that are so far apart."""

    def towards(self, steering: np.ndarray) -> np.ndarray:
        """a_i conj(a_j) of a pair for each way, (..., n_differences)."""
        to, away = self.pairs
        return np.asarray(steering[..., to] * steering[..., away].conj())

    def sums(self, matrices: np.ndarray) -> np.ndarray:
        """Sums of Hermitian (n, N, N) over the pairs of each way, (n, n_differences).

        Of real matrices over the rows of `Windows.real_data`, those of what they stand for. Half
        of each matrix, the lower one, is read.
        """
        work = _summed if np.iscomplexobj(matrices) else _summed_turned
        return np.asarray(work(matrices, self.of_pair, len(self.pairs[0])))


@lru_cache(maxsize=8)
def differences(aperture: Aperture, elements: tuple[int, ...]) -> Differences:
    """Those of some elements of an array."""
    taken, n = np.array(elements), len(elements)
    if aperture.places is None:
        one = of_pair = np.arange(n * n)
    else:
        place = aperture.places.place[taken]
        ways = (place[:, None] - place).reshape(-1, 2)
        _, one, of_pair = np.unique(ways, axis=0, return_index=True, return_inverse=True)
    to, away = np.divmod(one, n)
    return Differences(of_pair.reshape(n, n), (taken[to], taken[away]))


@lru_cache(maxsize=4)
def over_grid(aperture: Aperture, elements: tuple[int, ...]) -> np.ndarray | None:
    """`Differences.towards` the directions of the grid, where they are few enough to keep."""
    between, grid = differences(aperture, elements), aperture.grid
    if len(between.pairs[0]) * len(grid.steering) > _MOST_NUMBERS:
        return None
    # Not from the steering vectors kept with the grid: in single precision, those of two pairs
    # of one way differ by as much as a strong source's power is above what Capon leaves of it.
    steering = aperture.steering(grid.azimuth_rad, grid.elevation_rad[:, None])
    return between.towards(steering.reshape(-1, aperture.n_elements))


def powers(sums: np.ndarray, towards: np.ndarray) -> np.ndarray:
    """a^H M a, (n, m), of `sums` (n, n_differences) `towards` (m, n_differences)."""
    return np.asarray(sums.real @ towards.real.T + sums.imag @ towards.imag.T)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})
def powers_of_each(
    sums: np.ndarray, steering: np.ndarray, pairs: tuple[np.ndarray, np.ndarray]
) -> np.ndarray:
    """The same, (n, m), each towards directions of its own: steering vectors (n, m, n_elements)."""
    n, m, _ = steering.shape
    to, away = pairs
    out = np.empty((n, m))
    for i in range(n):
        for k in range(m):
            total = 0.0
            for d in range(len(to)):
                a, b, s = steering[i, k, to[d]], steering[i, k, away[d]], sums[i, d]
                total += s.real * (a.real * b.real + a.imag * b.imag)
                total += s.imag * (a.imag * b.real - a.real * b.imag)
            out[i, k] = total
    return out


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _summed(matrices: np.ndarray, of_pair: np.ndarray, n_differences: int) -> np.ndarray:
    n, n_elements, _ = matrices.shape
    out = np.zeros((n, n_differences), np.complex128)
    for i in range(n):
        for row in range(n_elements):
            for column in range(row):
                number = matrices[i, row, column]
                out[i, of_pair[row, column]] += number
                out[i, of_pair[column, row]] += np.conj(number)
            out[i, of_pair[row, row]] += matrices[i, row, row]
    return out


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _summed_turned(matrices: np.ndarray, of_pair: np.ndarray, n_differences: int) -> np.ndarray:
    """The same, of rows that see 2^0.5 cos, 1 (the middle) and 2^0.5 sin of an element's phase.

    Elements that mirror each other have opposite phases: cos a cos b is half of cos (a - b) and
    of cos (a - b'), b' the mirror of b, and so on.
    """
    n, size, _ = matrices.shape
    half = size // 2
    odd = size - half  # the first row of sines
    out = np.zeros((n, n_differences), np.complex128)
    for i in range(n):
        for row in range(size):
            of = row - odd if row >= odd else row
            per_row = 1.0 if of == half else 2**0.5
            for column in range(row + 1):
                by = column - odd if column >= odd else column
                number = matrices[i, row, column] * per_row * (1.0 if by == half else 2**0.5)
                if row == column:
                    number *= 0.5
                turned = 1j * number if column < odd <= row else complex(number)
                out[i, of_pair[of, by]] += turned
                out[i, of_pair[of, size - 1 - by]] += -turned if column >= odd else turned
    return out
