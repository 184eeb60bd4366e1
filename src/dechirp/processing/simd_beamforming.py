r"""Vectorised twin of `angle.bartlett`: beam powers from mirrored elements and directions.

Relative to the middle of the array, the weights of a beam to a direction u are

.. math:: e^{2\pi\mathrm{i}\, \mathbf{u} \cdot \mathbf{p}_k} = c_k (\cos \psi_k +
    \mathrm{i} \sin \psi_k), \quad \psi_k = 2\pi (u_y y_k + u_z z_k), \quad c_k =
    e^{2\pi\mathrm{i}\, u_x x_k}

and those to its mirror image, through boresight, the same with -i. So two sums give both beams,
P + iQ and P - iQ:

.. math:: P = \sum_k c_k \cos \psi_k\, a_k, \quad Q = \sum_k c_k \sin \psi_k\, a_k

and elements at mirrored positions are first added for P and subtracted for Q. On a planar array all
c are 1, and the weights are real. A linear array of 12 elements takes 12 real products for each
beam, where plain complex weights take 48.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from dechirp.core.compiled_kernels import uses_compiled_kernels
from dechirp.processing.angle.aperture import Aperture
from dechirp.theory.direction_bounds import unit_vectors

# A vector of the compiled loop: fewer ranges, as of eight samples, do not fill it.
_MIN_RANGES = 16


class MirroredBeams(NamedTuple):
    """Weights of beams to the directions of a grid, for mirrored pairs."""

    pair_sums: np.ndarray
    """From elements to the terms of P, then of Q, (n_elements, 2 n) complex64."""
    weights: np.ndarray
    """Of P, then of Q, (2, n_pairs, n) float32. Each direction is paired with its mirror image,
    counted from the other end of the grid; the last, boresight, with itself."""


@lru_cache(maxsize=8)
def mirrored_beam_weights(aperture: Aperture) -> MirroredBeams:
    """Compute the weights of beams with the power of one element."""
    middle = (aperture.positions.min(axis=0) + aperture.positions.max(axis=0)) / 2
    offsets = np.round(aperture.positions - middle, 9)  # so that rounding errors separate no pair
    _, y, z = offsets.T
    side = np.where((y < 0) | ((y == 0) & (z < 0)), -1, 1)
    offsets[:, 1:] *= side[:, None]
    pair_positions, place_of_element = np.unique(offsets, axis=0, return_inverse=True)
    to_p = np.eye(len(pair_positions))[place_of_element]
    to_q = side[:, None] * to_p

    directions = unit_vectors(
        aperture.direction_grid.azimuth_rad, aperture.direction_grid.elevation_rad[:, None]
    ).reshape(-1, 3)
    directions = directions[: len(directions) // 2 + 1]
    psi = 2 * np.pi * directions[:, 1:] @ pair_positions[:, 1:].T
    c = np.exp(2j * np.pi * np.outer(directions[:, 0], pair_positions[:, 0])) / aperture.n_elements
    p, q = c * np.cos(psi), c * np.sin(psi)
    if pair_positions[:, 0].any():  # imaginary weights act on amplitudes rotated by a quarter cycle
        p, q = (np.hstack([matrix.real, matrix.imag]) for matrix in (p, q))
        to_p, to_q = (np.hstack([matrix, 1j * matrix]) for matrix in (to_p, to_q))
    return MirroredBeams(
        np.hstack([to_p, to_q]).astype(np.complex64), np.stack([p.real, q.real]).astype(np.float32)
    )


def _raise_to_largest_beam_power_in_numpy(
    power: np.ndarray,
    spectrum: np.ndarray,
    compensation: np.ndarray,
    pair_sums: np.ndarray,
    weights: np.ndarray,
) -> None:
    """Plain twin of `raise_to_largest_beam_power`: equal within single precision."""
    n_pairs, n = weights.shape[1:]
    azimuths = np.arange(n_pairs) % len(power)
    for factors, channels in zip(compensation, spectrum, strict=True):
        amplitudes = channels[:, 0] + 1j * channels[:, 1]
        terms = (factors[:, None] * pair_sums).T @ amplitudes
        p, q = weights[0] @ terms[:n], 1j * (weights[1] @ terms[n:])
        np.maximum.at(power, azimuths, abs(p + q) ** 2)
        np.maximum.at(power, len(power) - 1 - azimuths, abs(p - q) ** 2)


def raise_to_largest_beam_power(
    power: np.ndarray,
    spectrum: np.ndarray,
    compensation: np.ndarray,
    pair_sums: np.ndarray,
    weights: np.ndarray,
) -> None:
    """Raise powers (azimuth, range) to those of beams at all velocities and elevations, in place.

    Parameters
    ----------
    power : array (n_azimuths, n_ranges) float32
    spectrum : array (n_velocities, n_channels, 2, n_ranges) float32
        Real parts apart from imaginary.
    compensation : array (n_velocities, n_channels) complex64
        Phase factor of each channel at each velocity.
    pair_sums : array (n_channels, 2 n) complex64
        From channels to elements, times `MirroredBeams.pair_sums`.
    weights : array (2, n_pairs, n) float32
        Of `MirroredBeams`.

    Notes
    -----
    For 128 velocities, 256 ranges, 12 elements on a line and 87 directions: 35 million products
    are added, 0.4 ms at 32 per cycle of 2.6 GHz. It takes 1.0 ms: 0.7 for the beams, 0.2 for the
    pair sums. 3 MiB of spectrum are read once. Samples that are not finite are not searched for.
    """
    if not uses_compiled_kernels() or power.shape[1] < _MIN_RANGES:
        _raise_to_largest_beam_power_in_numpy(power, spectrum, compensation, pair_sums, weights)
        return
    from dechirp.processing import simd_beam_powers

    n_pairs, n = weights.shape[1:]
    terms = pair_sums.reshape(-1, 2, n).swapaxes(1, 2).reshape(len(pair_sums), 2 * n)
    columns, channels = np.nonzero(terms.T)  # few entries, under time-division multiplexing
    group = simd_beam_powers.GROUP
    padded = np.pad(weights, [(0, 0), (0, -n_pairs % group), (0, 0)])  # beams of zero power
    simd_beam_powers.raise_to_powers_of_groups(
        power,
        np.ascontiguousarray(spectrum),
        compensation,
        channels,
        terms[channels, columns],
        np.searchsorted(columns, np.arange(2 * n + 1)),
        np.ascontiguousarray(padded.reshape(2, -1, group, n).transpose(1, 3, 0, 2)),
    )
