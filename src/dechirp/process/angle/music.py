"""MUSIC: directions whose steering vectors lie in the subspace of the sources."""

import numpy as np

from dechirp.core.values import value
from dechirp.process.angle import subspace
from dechirp.process.angle.aperture import Aperture
from dechirp.process.angle.covariance import fits
from dechirp.process.angle.smoothed import SmoothedEstimator


@value
class Music(SmoothedEstimator):
    """One over the distance of a steering vector from the subspace of the sources.

    Spatial smoothing parts as many sources in one look as uniform lines and rectangles have
    windows; on other arrays there must be a look for each.

    References
    ----------
    R. O. Schmidt, Multiple emitter location and signal parameter estimation, IEEE Trans. AP
    34(3), 1986.
    """

    def prepared(
        self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray
    ) -> np.ndarray:
        """Basis of the subspace of the sources, (n, n_elements, most), in one window.

        Zero in other elements, and beyond the sources of a detection.
        """
        over = self.over(aperture)
        fits("Music", self.n_sources, over, snapshots.shape[1])
        counts = self.most(snapshots, aperture, noise_power)
        most = int(counts.max(initial=1))
        _, vectors = subspace.strongest(over, snapshots, most)
        vectors *= np.arange(most) < counts[:, None, None]
        basis = np.zeros((len(snapshots), aperture.n_elements, most), np.complex128)
        basis[:, over.elements] = vectors / np.sqrt(over.size)
        return basis

    def at(self, prepared: np.ndarray, steering: np.ndarray) -> np.ndarray:
        """1 / (1 - part of the steering vector in the subspace)."""
        inside = steering.conj() @ prepared.astype(steering.dtype)
        # Single precision tells 1e-7 of the whole.
        distance = 1 - np.sum(inside.real**2 + inside.imag**2, axis=-1)
        return np.asarray(1 / np.maximum(distance, np.finfo(distance.dtype).eps))
