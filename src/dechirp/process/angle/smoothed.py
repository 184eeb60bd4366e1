"""Spectra of the covariance over windows of the array."""

import numpy as np

from dechirp.core.values import value
from dechirp.process.angle import order, perturbation
from dechirp.process.angle.aperture import Aperture
from dechirp.process.angle.base import Angles, SpectralEstimator
from dechirp.process.angle.covariance import Smoothing, Windows, windows


@value
class SmoothedEstimator(SpectralEstimator):
    """Has peaks where a steering vector is nearest to the subspace of the sources."""

    smoothing: Smoothing = Smoothing()

    def over(self, aperture: Aperture) -> Windows:
        """The windows of an array."""
        return windows(aperture, self.smoothing)

    def most(
        self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray
    ) -> np.ndarray:
        """How many sources are sought in each snapshot, (n,)."""
        if isinstance(self.n_sources, int):
            return np.full(len(snapshots), self.n_sources)
        over = self.over(aperture)
        return order.n_sources(snapshots, aperture, noise_power, self.n_sources, over)

    def standard_errors(
        self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray, angles: Angles
    ) -> np.ndarray:
        """By perturbation of first order."""
        over = self.over(aperture)
        return perturbation.null_spectrum_errors(over, snapshots, aperture, noise_power, angles)
