"""Spectral estimators with a spatially smoothed covariance: base class."""

import numpy as np

from dechirp.core.checks import check_field_classes
from dechirp.core.values import frozen_dataclass
from dechirp.processing.angle import model_order, perturbation
from dechirp.processing.angle.aperture import Aperture
from dechirp.processing.angle.bartlett import bartlett_spectrum
from dechirp.processing.angle.base import Angles, SpectralEstimator
from dechirp.processing.angle.covariance import SlidingWindows, Smoothing, array_smoothing_windows

# Peaks that are tried for a single source. Phases of 13 degrees RMS in 12 elements make up to four
# peaks of Capon higher than that of a strong echo, which its beams then suppress.
_N_CANDIDATES = 8


@frozen_dataclass
class SmoothedEstimator(SpectralEstimator):
    """Spectral estimator from the covariance of sliding windows."""

    smoothing: Smoothing = Smoothing()
    """Windows that slide over the array, whose covariances are averaged."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_field_classes(self, smoothing=Smoothing)

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

    def find_peaks_on_direction_grid(
        self,
        snapshots: np.ndarray,
        spectrum: np.ndarray,
        aperture: Aperture,
        n_sources: np.ndarray,
        max_peaks: int,
    ) -> Angles:
        """Return the highest peaks; of a single source the one from which a beam has most power.

        The height of a peak depends on how exactly the array is known. The covariance of a strong
        echo in an array with phase errors nulls the echo itself.
        """
        is_single = n_sources == 1
        azimuth, elevation = super().find_peaks_on_direction_grid(
            snapshots,
            spectrum,
            aperture,
            np.where(is_single, _N_CANDIDATES, n_sources),
            max(max_peaks, _N_CANDIDATES),
        )
        candidates = np.stack([azimuth, elevation])[:, is_single, :_N_CANDIDATES]
        steering = aperture.steering_vectors(*np.nan_to_num(candidates))
        power = bartlett_spectrum(snapshots[is_single], steering)
        power[np.isnan(candidates[0])] = -1
        strongest = np.argmax(power, axis=1)[:, None]
        for angle, peaks in zip((azimuth, elevation), candidates, strict=True):
            angle[is_single] = np.nan
            angle[is_single, :1] = np.take_along_axis(peaks, strongest, axis=1)
        return azimuth[:, :max_peaks], elevation[:, :max_peaks]

    def standard_errors(
        self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray, angles: Angles
    ) -> np.ndarray:
        """Return standard errors by first-order perturbation."""
        sliding = self.sliding_windows(aperture)
        return perturbation.null_spectrum_angle_standard_errors(
            sliding, snapshots, aperture, noise_power, angles
        )
