"""MUSIC: directions whose steering vectors lie in the signal subspace."""

import numpy as np

from dechirp.core.values import frozen_dataclass
from dechirp.processing.angle import subspace
from dechirp.processing.angle.aperture import Aperture
from dechirp.processing.angle.covariance import check_windows_separate_sources
from dechirp.processing.angle.smoothed import SmoothedEstimator


@frozen_dataclass
class Music(SmoothedEstimator):
    """Pseudospectrum: one over the distance of a steering vector from the signal subspace.

    Spatial smoothing separates as many sources in one snapshot as uniform lines and rectangles have
    windows; other arrays need a snapshot for each source.

    References
    ----------
    R. O. Schmidt, Multiple emitter location and signal parameter estimation, IEEE Trans. AP
    34(3), 1986.
    """

    def precompute_for_spectrum(
        self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray
    ) -> np.ndarray:
        """Return a basis of the signal subspace, (n, n_elements, n_sources), in one window.

        Zero in other elements, and beyond the sources of a detection.
        """
        windows = self.sliding_windows(aperture)
        check_windows_separate_sources("Music", self.n_sources, windows, snapshots.shape[1])
        counts = self.count_sources(snapshots, aperture, noise_power)
        max_count = int(counts.max(initial=1))
        _, vectors = subspace.leading_eigenpairs(windows, snapshots, max_count)
        vectors *= np.arange(max_count) < counts[:, None, None]
        basis = np.zeros((len(snapshots), aperture.n_elements, max_count), np.complex128)
        basis[:, windows.first_window_element_indices] = vectors / np.sqrt(windows.n_window_points)
        return basis

    def spectrum_at(self, precomputed: np.ndarray, steering: np.ndarray) -> np.ndarray:
        """Return 1 / (1 - part of the steering vector in the subspace)."""
        projections = steering.conj() @ precomputed.astype(steering.dtype)
        # Single precision resolves 1e-7.
        distance = 1 - np.sum(projections.real**2 + projections.imag**2, axis=-1)
        return np.asarray(1 / np.maximum(distance, np.finfo(distance.dtype).eps))
