"""Bartlett: a beam towards each direction, the power in it; for arrays of any shape."""

import numba
import numpy as np

from dechirp.core.values import value
from dechirp.process.angle import likelihood
from dechirp.process.angle.aperture import Aperture
from dechirp.process.angle.base import Angles, SpectralEstimator


@value
class Bartlett(SpectralEstimator):
    r"""Power in a beam towards each direction, `|a^H x|^2 / N^2`, mean over the looks.

    One source far enough from others it finds as well as can be: the top of the beam is the
    maximum-likelihood estimate. Sources within a beamwidth of each other are one to it. The
    tops are refined together, so that beyond that sidelobes of one do not move the other.

    References
    ----------
    M. S. Bartlett, Smoothing periodograms from time series with continuous spectra, Nature
    161, 1948. H. L. Van Trees, Optimum Array Processing, 2002, 9.2.
    """

    def at(self, prepared: np.ndarray, steering: np.ndarray) -> np.ndarray:
        """Power in a beam towards each direction."""
        return beam_power(prepared, steering)

    def refined(
        self, snapshots: np.ndarray, prepared: np.ndarray, aperture: Aperture, coarse: Angles
    ) -> Angles:
        """The tops of the beams' peaks, together: the most likely directions."""
        return likelihood.maximised(snapshots, aperture, *coarse)


def beam_power(snapshots: np.ndarray, steering: np.ndarray) -> np.ndarray:
    """Power in beams at steering vectors, |a^H x|^2 / N^2, (n, m); mean over the looks.

    `snapshots` (n, n_looks, n_elements); `steering` (m, n_elements) or (n, m, n_elements).
    Beams of all snapshots towards the same directions are one product in single precision.
    """
    n, n_looks, n_elements = snapshots.shape
    if steering.ndim == 2:
        rows = snapshots.reshape(-1, n_elements).astype(np.complex64, copy=False)
        beams = (rows @ steering.conj().T.astype(np.complex64, copy=False)).reshape(n, n_looks, -1)
    else:
        beams = snapshots @ np.swapaxes(steering.conj(), 1, 2)
    return mean_power(beams, n_elements)


def mean_power(beams: np.ndarray, n_elements: int) -> np.ndarray:
    """Power in beams of so many elements, (n, n_looks, m), mean over the looks, (n, m)."""
    scale = beams.real.dtype.type(1 / (beams.shape[1] * n_elements**2))
    return np.asarray(_summed_power(beams, scale))


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _summed_power(beams: np.ndarray, scale: float) -> np.ndarray:
    """Sum over looks of |beam|^2, times a scale, (n, m); half the time of NumPy's."""
    n, n_looks, m = beams.shape
    out = np.zeros((n, m), beams.real.dtype)
    for i in range(n):
        for look in range(n_looks):
            for j in range(m):
                beam = beams[i, look, j]
                out[i, j] += (beam.real * beam.real + beam.imag * beam.imag) * scale
    return out
