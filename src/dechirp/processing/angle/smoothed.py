"""Spectral estimators with a spatially smoothed covariance: base class."""

import numpy as np

from dechirp.core.values import frozen_dataclass
from dechirp.processing.angle import model_order, perturbation
from dechirp.processing.angle.aperture import Aperture
from dechirp.processing.angle.base import Angles, SpectralEstimator
from dechirp.processing.angle.covariance import SlidingWindows, Smoothing, array_smoothing_windows


@frozen_dataclass
class SmoothedEstimator(SpectralEstimator):
    """Spectral estimator from the covariance of sliding windows."""

    smoothing: Smoothing = Smoothing()
    """Windows that slide over the array, whose covariances are averaged."""

    def sliding_windows(self, aperture: Aperture) -> SlidingWindows:
        """Return the windows of an array."""
        return array_smoothing_windows(aperture, self.smoothing)

    def count_sources(
        self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray
    ) -> np.ndarray:
        if isinstance(self.n_sources, int):
            return np.full(len(snapshots), self.n_sources)
        sliding = self.sliding_windows(aperture)
        return model_order.estimate_n_sources(
            snapshots, aperture, noise_power, self.n_sources, sliding
        )

    def standard_errors(
        self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray, angles: Angles
    ) -> np.ndarray:
        """Return standard errors by first-order perturbation."""
        sliding = self.sliding_windows(aperture)
        return perturbation.null_spectrum_angle_standard_errors(
            sliding, snapshots, aperture, noise_power, angles
        )
