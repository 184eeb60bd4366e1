"""Capon's beam: towards each direction the least power that lets it pass."""

from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack

from dechirp.core.checks import positive
from dechirp.core.values import value
from dechirp.process.angle.aperture import Aperture
from dechirp.process.angle.covariance import Windows
from dechirp.process.angle.differences import (
    Differences,
    differences,
    over_grid,
    powers,
    powers_of_each,
)
from dechirp.process.angle.smoothed import SmoothedEstimator

# Of the mean power: what single precision leaves of a covariance.
_LEAST_LOADING = 1e-5
# Phases of ways towards directions at a time: 16 MiB.
_MOST_NUMBERS = 2**20


class Inverses(NamedTuple):
    """Inverse covariances, summed over the pairs of elements that see the same phases."""

    sums: np.ndarray
    """(n, n_differences) complex."""
    between: Differences


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
    ) -> Inverses:
        """Inverse of each covariance, in double precision: a beam is a small rest of its terms."""
        over = self.over(aperture)
        n, n_looks, _ = snapshots.shape
        between = differences(aperture, _elements(over))
        sums = np.empty((n, len(between.pairs[0])), np.complex128)
        for rows in over.blocks(n, n_looks):
            x = snapshots[rows].astype(np.complex64)
            data = over.real_data(x) if over.backward else over.data(x)
            covariance = data @ np.swapaxes(data, 1, 2).conj() / data.shape[2]
            power = np.einsum("nii->n", covariance).real / over.size
            # A snapshot of zeros has no direction, but must not end the others.
            loading = np.fmax(self.loading * noise_power[rows], _LEAST_LOADING * power + 1e-30)
            np.einsum("nii->ni", covariance)[:] += loading[:, None]
            sums[rows] = between.sums(_inverted(covariance))
        return Inverses(sums, between)

    def at(self, prepared: Inverses, steering: np.ndarray) -> np.ndarray:
        """Power in the beam towards each direction, as of one element."""
        sums, between = prepared
        if steering.ndim == 3:
            return np.asarray(1 / powers_of_each(sums, steering, between.pairs))
        each = max(1, _MOST_NUMBERS // sums.shape[1])
        parts = [
            powers(sums, between.towards(steering[first : first + each]))
            for first in range(0, len(steering), each)
        ]
        return 1 / np.concatenate(parts, axis=1)

    def over_grid(self, prepared: Inverses, aperture: Aperture) -> np.ndarray:
        """The same at all directions of the grid."""
        towards = over_grid(aperture, _elements(self.over(aperture)))
        if towards is not None:
            return np.asarray(1 / powers(prepared.sums, towards))
        grid = aperture.grid
        return np.concatenate(
            [
                self.at(prepared, aperture.steering(grid.azimuth_rad, elevation))
                for elevation in grid.elevation_rad
            ],
            axis=1,
        )


def _elements(over: Windows) -> tuple[int, ...]:
    return tuple(over.elements.tolist())


def _inverted(covariances: np.ndarray) -> np.ndarray:
    """Lower halves of the inverses of Hermitian (n, size, size), in double precision."""
    factor, invert = lapack.dpotrf, lapack.dpotri
    if np.iscomplexobj(covariances):
        factor, invert = lapack.zpotrf, lapack.zpotri
    out = np.ascontiguousarray(covariances, np.result_type(covariances, float))
    for matrix in out:
        # Upper halves of the transposed, which lie in memory as LAPACK reads them.
        upper = factor(matrix.T, overwrite_a=True, clean=False)[0]
        matrix[:] = invert(upper, overwrite_c=True)[0].T
    return out
