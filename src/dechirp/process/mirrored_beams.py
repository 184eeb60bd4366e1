r"""Power of beams to all directions of a grid, from elements and directions in mirrored pairs.

Seen from the middle of the array, the weights of a beam to a direction u are

.. math:: e^{2\pi\mathrm{i}\, \mathbf{u} \cdot \mathbf{p}_k} = c_k (\cos \psi_k +
    \mathrm{i} \sin \psi_k), \quad \psi_k = 2\pi (u_y y_k + u_z z_k), \quad c_k =
    e^{2\pi\mathrm{i}\, u_x x_k}

and those to its mirror image, on the other side of boresight both ways, the same with minus. So
two sums make both beams, P + iQ and P - iQ:

.. math:: P = \sum_k c_k \cos \psi_k\, a_k, \quad Q = \sum_k c_k \sin \psi_k\, a_k

and elements at mirrored places are added for P and subtracted for Q first. On a flat array all c
are 1, and the weights are real. A line of 12 elements takes 12 products of real numbers for each
beam, where weights by themselves take 48.
"""

from functools import lru_cache
from typing import NamedTuple

import numba
import numpy as np

from dechirp.process.angle.aperture import Aperture
from dechirp.theory.direction_bounds import towards

# Ranges at once: what 20 elements of a line hear, 40 KiB, stays in L1.
_BLOCK = 256


class Beams(NamedTuple):
    """Beams of an array to the directions of its grid."""

    folded: np.ndarray
    """From elements to what P, then what Q, is summed of, (n_elements, 2 n) complex64."""
    weights: np.ndarray
    """Of P, then of Q, (2, n_pairs, n) float32; n is even. A direction comes with the one so far
    from the other end of the grid; the last, boresight, with itself."""


@lru_cache(maxsize=8)
def beams(seen: Aperture) -> Beams:
    """For beams that have the power of one element."""
    middle = (seen.positions.min(axis=0) + seen.positions.max(axis=0)) / 2
    at = np.round(seen.positions - middle, 9)  # rounding keeps no pair apart
    _, y, z = at.T
    side = np.where((y < 0) | ((y == 0) & (z < 0)), -1, 1)
    at[:, 1:] *= side[:, None]
    places, of = np.unique(at, axis=0, return_inverse=True)
    to_p = np.eye(len(places))[of]
    to_q = side[:, None] * to_p

    directions = towards(seen.grid.azimuth_rad, seen.grid.elevation_rad[:, None]).reshape(-1, 3)
    directions = directions[: len(directions) // 2 + 1]
    psi = 2 * np.pi * directions[:, 1:] @ places[:, 1:].T
    c = np.exp(2j * np.pi * np.outer(directions[:, 0], places[:, 0])) / seen.n_elements
    p, q = c * np.cos(psi), c * np.sin(psi)
    if places[:, 0].any():  # imaginary parts of weights count what is heard a quarter cycle on
        p, q = (np.hstack([one.real, one.imag]) for one in (p, q))
        to_p, to_q = (np.hstack([one, 1j * one]) for one in (to_p, to_q))
    odd = p.shape[1] % 2
    weights = np.pad(np.stack([p.real, q.real]), [(0, 0), (0, 0), (0, odd)])
    folded = np.hstack([np.pad(one, [(0, 0), (0, odd)]) for one in (to_p, to_q)])
    return Beams(folded.astype(np.complex64), weights.astype(np.float32))


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def keep_strongest(
    power: np.ndarray,
    spectrum: np.ndarray,
    still: np.ndarray,
    folding: np.ndarray,
    weights: np.ndarray,
) -> None:
    """Raise powers (azimuth, range) to those of beams at all velocities and elevations, in place.

    Parameters
    ----------
    power : array (n_azimuths, n_ranges) float32
    spectrum : array (n_velocities, n_channels, 2, n_ranges) float32
        Real parts apart from imaginary.
    still : array (n_velocities, n_channels) complex64
        What each channel is turned by at each velocity.
    folding : array (n_channels, 2 n) complex64
        From channels to elements, times `Beams.folded`.
    weights : array (2, n_pairs, n) float32
        Of `Beams`.

    Notes
    -----
    For 128 velocities, 256 ranges, 12 elements on a line and 87 directions: 35 million products
    are added, 0.8 ms at 16 a cycle of 2.6 GHz. It takes 2.3: 1.5 for them, since sums of two
    products go through L1, 0.4 for squares and maxima of 2.9 million beams, 0.2 for the folding.
    Read once are 3 MiB of spectrum.
    """
    n_velocities, _, _, n_ranges = spectrum.shape
    _, n_pairs, n = weights.shape
    last = len(power) - 1
    for first in range(0, n_ranges, _BLOCK):
        block = slice(first, min(first + _BLOCK, n_ranges))
        size = block.stop - first
        heard = np.empty((2, n, 2 * size), np.float32)
        sums = np.empty((2, 2 * size), np.float32)
        for v in range(n_velocities):
            _fold(heard.reshape(2 * n, 2, size), spectrum[v, :, :, block], still[v], folding)
            for pair in range(n_pairs):
                for part in range(2):
                    _weigh(sums[part], heard[part], weights[part, pair])
                azimuth = pair % len(power)
                _raise(power[azimuth, block], power[last - azimuth, block], sums)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _fold(out: np.ndarray, spectrum: np.ndarray, still: np.ndarray, folding: np.ndarray) -> None:
    """What is summed, real parts apart from imaginary ones: (2 n, 2, range)."""
    out[:] = 0
    for c in range(len(spectrum)):
        for k in range(len(out)):
            factor = still[c] * folding[c, k]
            if factor == 0:  # most are, where transmitters take turns
                continue
            real, imag = out[k, 0], out[k, 1]
            x, y = spectrum[c, 0], spectrum[c, 1]
            for i in range(len(real)):
                real[i] += factor.real * x[i] - factor.imag * y[i]
                imag[i] += factor.real * y[i] + factor.imag * x[i]


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _weigh(total: np.ndarray, rows: np.ndarray, weights: np.ndarray) -> None:
    """Sum of an even number of rows times their weights."""
    for k in range(0, len(weights), 2):
        a, b, x, y = weights[k], weights[k + 1], rows[k], rows[k + 1]
        for i in range(len(total)):
            before = total[i] if k else np.float32(0)
            total[i] = before + a * x[i] + b * y[i]


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _raise(there: np.ndarray, mirrored: np.ndarray, sums: np.ndarray) -> None:
    """Raise powers to those of P + iQ and of P - iQ."""
    n = len(there)
    for i in range(n):
        p, q = (sums[0, i], sums[0, n + i]), (sums[1, i], sums[1, n + i])
        plus = (p[0] - q[1]) ** 2 + (p[1] + q[0]) ** 2
        minus = (p[0] + q[1]) ** 2 + (p[1] - q[0]) ** 2
        there[i] = max(there[i], plus)
        mirrored[i] = max(mirrored[i], minus)
