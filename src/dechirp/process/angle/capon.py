"""Capon's beam: towards each direction the least power that lets it pass."""

from typing import NamedTuple

import numba
import numpy as np

from dechirp.core.checks import positive
from dechirp.core.values import value
from dechirp.process.angle.aperture import Aperture
from dechirp.process.angle.covariance import Windows
from dechirp.process.angle.smoothed import SmoothedEstimator

# Of the mean power: what single precision leaves of a triangular factor.
_LEAST_LOADING = 1e-5
# Directions at a time: the work for 128 elements then stays within 32 KiB.
_TILE = 64


class Factors(NamedTuple):
    """Triangular factors of the covariances, made real, and what they are of."""

    lower: np.ndarray
    """(n, p, p) float32."""
    over: Windows


@value
class Capon(SmoothedEstimator):
    """1 / a^H (R + d)^-1 a, of the covariance over windows.

    The loading d keeps the inverse of few snapshots finite, and errors of the array from
    being taken for interference (B. D. Carlson, Covariance matrix estimation errors and
    diagonal loading in adaptive arrays, IEEE Trans. AES 24(4), 1988). On arrays that are not
    uniform, one look has the peaks of a Bartlett spectrum.

    References
    ----------
    J. Capon, High-resolution frequency-wavenumber spectrum analysis, Proc. IEEE 57(8), 1969.
    """

    loading: float = 0.1
    """Over the noise power of one element; at least 1e-5 of the mean power of the snapshots."""

    def __post_init__(self) -> None:
        super().__post_init__()
        positive(self, "loading")

    def prepared(
        self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray
    ) -> Factors:
        """Cholesky's factor of each covariance."""
        over = self.over(aperture)
        n, n_looks, _ = snapshots.shape
        size = over.size if over.backward else 2 * over.size
        lower = np.empty((n, size, size), np.float32)
        for rows in over.blocks(n, n_looks):
            x = snapshots[rows].astype(np.complex64)
            data = over.real_data(x) if over.backward else _doubled(over.data(x))
            covariance = data @ np.swapaxes(data, 1, 2) / data.shape[2]
            power = np.einsum("nii->n", covariance) / size
            # A snapshot of zeros has no direction, but must not end the others.
            loading = np.fmax(self.loading * noise_power[rows], _LEAST_LOADING * power + 1e-30)
            np.einsum("nii->ni", covariance)[:] += loading[:, None]
            lower[rows] = np.linalg.cholesky(covariance)
        return Factors(lower, over)

    def at(self, prepared: Factors, steering: np.ndarray) -> np.ndarray:
        """Power in the beam towards each direction, as of one element."""
        columns = np.swapaxes(steering[..., prepared.over.elements], -1, -2)
        sets = columns.reshape(-1, *columns.shape[-2:])
        if prepared.over.backward:
            each = _turned(sets)
        else:
            each = np.concatenate([sets.real, sets.imag], axis=1)
        return np.asarray(1 / _solved(prepared.lower, np.ascontiguousarray(each, np.float32)))


def _doubled(data: np.ndarray) -> np.ndarray:
    """Real columns with the covariance of complex ones, real parts above imaginary parts."""
    real, imaginary = 2**0.5 * data.real, 2**0.5 * data.imag
    there = np.concatenate([real, imaginary], axis=1)
    return np.concatenate([there, np.concatenate([-imaginary, real], axis=1)], axis=2)


def _turned(steering: np.ndarray) -> np.ndarray:
    """Steering vectors of symmetric windows as columns of `Windows.real_data`, (n, size, m).

    From the middle of a window, elements that mirror each other have opposite phases.
    """
    size = steering.shape[1]
    half = size // 2
    middle = np.exp(-0.5j * np.angle(steering[:, :1] * steering[:, -1:])).astype(steering.dtype)
    centred = steering * middle
    top, between = centred[:, :half], centred[:, half : size - half]
    return np.concatenate([2**0.5 * top.real, between.real, 2**0.5 * top.imag], axis=1)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})
def _solved(lower: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Squared lengths of lower^-1 a, (n, m), for columns a of (n or 1, size, m)."""
    n, size, _ = lower.shape
    sets, _, m = columns.shape
    out = np.zeros((n, m), np.float32)
    x = np.zeros((size, _TILE), np.float32)
    for i in range(n):
        own = i if sets > 1 else 0
        for start in range(0, m, _TILE):
            width = min(_TILE, m - start)
            for row in range(size):
                u = x[row]
                u[:width] = columns[own, row, start : start + width]
                # Four rows before it at a time: a number is loaded and stored once for four.
                column = 0
                while column + 4 <= row:
                    l0, l1 = lower[i, row, column], lower[i, row, column + 1]
                    l2, l3 = lower[i, row, column + 2], lower[i, row, column + 3]
                    x0, x1, x2, x3 = x[column], x[column + 1], x[column + 2], x[column + 3]
                    for a in range(_TILE):
                        u[a] -= l0 * x0[a] + l1 * x1[a] + l2 * x2[a] + l3 * x3[a]
                    column += 4
                while column < row:
                    factor, before = lower[i, row, column], x[column]
                    for a in range(_TILE):
                        u[a] -= factor * before[a]
                    column += 1
                scale = np.float32(1.0) / lower[i, row, row]
                for a in range(_TILE):
                    u[a] *= scale
                for a in range(width):
                    out[i, start + a] += u[a] * u[a]
    return out
