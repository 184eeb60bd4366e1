"""Bartlett beamformer: power in a beam towards each direction, for arrays of any shape."""

import numpy as np

from dechirp.core.compiled_kernels import kernel
from dechirp.core.values import frozen_dataclass
from dechirp.processing.angle import likelihood
from dechirp.processing.angle.aperture import Aperture
from dechirp.processing.angle.base import Angles, SpectralEstimator


@frozen_dataclass
class Bartlett(SpectralEstimator):
    r"""Power in a beam towards each direction, `|a^H x|^2 / N^2`, mean over the snapshots.

    For a single source far from others the top of the beam is the maximum-likelihood estimate.
    Sources within a beamwidth of each other are not resolved. All tops are refined together, so
    that sidelobes of more distant sources do not bias each other.

    References
    ----------
    M. S. Bartlett, Smoothing periodograms from time series with continuous spectra, Nature
    161, 1948. H. L. Van Trees, Optimum Array Processing, 2002, 9.2.
    """

    def spectrum_at(self, precomputed: np.ndarray, steering: np.ndarray) -> np.ndarray:
        return bartlett_spectrum(precomputed, steering)

    def refine_peak_angles(
        self,
        snapshots: np.ndarray,
        precomputed: np.ndarray,
        aperture: Aperture,
        coarse_angles: Angles,
    ) -> Angles:
        """Refine all peaks together to the most likely directions."""
        return likelihood.maximise_direction_likelihood(snapshots, aperture, *coarse_angles)


def bartlett_spectrum(snapshots: np.ndarray, steering: np.ndarray) -> np.ndarray:
    """Return the power in beams at steering vectors, |a^H x|^2 / N^2, (n, m); mean of snapshots.

    `snapshots` (n, n_snapshots, n_elements); `steering` (m, n_elements) or (n, m, n_elements).
    Beams of all snapshots towards the same directions are one product in single precision.
    """
    n, n_snapshots, n_elements = snapshots.shape
    if steering.ndim == 2:
        rows = snapshots.reshape(-1, n_elements).astype(np.complex64, copy=False)
        beams = (rows @ steering.conj().T.astype(np.complex64, copy=False)).reshape(
            n, n_snapshots, -1
        )
    else:
        beams = snapshots @ np.swapaxes(steering.conj(), 1, 2)
    return mean_beam_power_over_snapshots(beams, n_elements)


def mean_beam_power_over_snapshots(beams: np.ndarray, n_elements: int) -> np.ndarray:
    """Return the power in beams, (n, n_snapshots, m), averaged over the snapshots, (n, m)."""
    scale = beams.real.dtype.type(1 / (beams.shape[1] * n_elements**2))
    return np.asarray(_sum_beam_power_over_snapshots(beams, scale))


def _sum_beam_power_in_numpy(beams: np.ndarray, scale: float) -> np.ndarray:
    """Plain twin of `_sum_beam_power_over_snapshots`: equal within rounding."""
    return np.asarray(np.sum((beams.real**2 + beams.imag**2) * scale, axis=1))


@kernel(plain=_sum_beam_power_in_numpy, fastmath={"contract"})
def _sum_beam_power_over_snapshots(beams: np.ndarray, scale: float) -> np.ndarray:
    """Sum scaled |beam|^2 over snapshots, (n, m), in half the time of NumPy."""
    n, n_snapshots, m = beams.shape
    out = np.zeros((n, m), beams.real.dtype)
    for i in range(n):
        for snapshot in range(n_snapshots):
            for j in range(m):
                beam = beams[i, snapshot, j]
                out[i, j] += (beam.real * beam.real + beam.imag * beam.imag) * scale
    return out
