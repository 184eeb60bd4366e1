"""Angle FFT: beams towards all directions at once, for elements on an even grid."""

from typing import Any

import numpy as np
import scipy

from dechirp.core.values import frozen_dataclass
from dechirp.processing.angle import likelihood
from dechirp.processing.angle.aperture import Aperture
from dechirp.processing.angle.bartlett import bartlett_spectrum, mean_beam_power_over_snapshots
from dechirp.processing.angle.base import Angles, SpectralEstimator
from dechirp.processing.angle.element_grid import ElementGrid
from dechirp.theory.windows import Window, check_window_name, window_weights


@frozen_dataclass
class Fft(SpectralEstimator):
    """Power in tapered beams, by a zero-padded FFT over the elements.

    Elements lie on an even grid, a line or a rectangle, possibly with holes. Without such a grid,
    as after a calibration of positions, the same beams come from the product with steering
    vectors. The taper only affects which peaks are detected: their tops are refined without it,
    where standard errors are smallest (a Hann taper would raise them by half).
    """

    window: Window = "rectangular"
    """Taper over the array: lower sidelobes, so that weak sources appear next to strong ones, for
    a wider beam."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_window_name("window", self.window)

    def precompute_for_spectrum(
        self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray
    ) -> np.ndarray:
        """Return the tapered snapshots."""
        if self.window == "rectangular":
            return snapshots
        return snapshots * _element_taper(self.window, aperture).astype(np.float32)

    def spectrum_at(self, precomputed: np.ndarray, steering: np.ndarray) -> np.ndarray:
        return bartlett_spectrum(precomputed, steering)

    def spectrum_on_direction_grid(self, precomputed: np.ndarray, aperture: Aperture) -> np.ndarray:
        """Compute the spectrum by a transform where the elements lie on a grid."""
        if aperture.element_grid is None:
            return self.spectrum_at(precomputed, aperture.direction_grid.steering)
        return _fft_beam_power(precomputed, aperture, aperture.element_grid)

    def refine_peak_angles(
        self,
        snapshots: np.ndarray,
        precomputed: np.ndarray,
        aperture: Aperture,
        coarse_angles: Angles,
    ) -> Angles:
        """Refine all peaks together, without the taper, to the most likely directions."""
        return likelihood.maximise_direction_likelihood(snapshots, aperture, *coarse_angles)


def _fft_beam_power(
    snapshots: np.ndarray, aperture: Aperture, element_grid: ElementGrid
) -> np.ndarray:
    """Return the power in the beams of the grid, (n, n_directions), mean over the snapshots.

    Bins are even in the direction cosines along y and z. On one axis they are the directions of
    the grid; on two, azimuths at an elevation are read at the nearest bin, within an eighth of a
    beam.
    """
    n, n_snapshots, n_elements = snapshots.shape
    grid = aperture.direction_grid
    elevation_cosines = np.sin(grid.elevation_rad)
    azimuth_cosines = np.cos(grid.elevation_rad)[:, None] * np.sin(grid.azimuth_rad)
    n_bins = [
        round(1 / (step * spacing)) if step else 1
        for step, spacing in zip(
            aperture.direction_grid_sine_steps, element_grid.spacing, strict=True
        )
    ]
    # Grids finer than a wavelength may have fewer bins than grid points, which then alias.
    padded = np.zeros((n, n_snapshots, n_bins[1], n_bins[0]), np.complex64)
    column, row = (element_grid.indices % n_bins).T
    cells: Any = (slice(None), slice(None), row, column)
    np.add.at(padded, cells, snapshots)
    # Sums of x exp(2 pi i u p): an unscaled inverse transform.
    beams = scipy.fft.ifft2(padded, norm="forward", overwrite_x=True)
    left_bins = (
        np.rint(azimuth_cosines * element_grid.spacing[0] * n_bins[0]).astype(int) % n_bins[0]
    )
    up_bins = (
        np.rint(elevation_cosines * element_grid.spacing[1] * n_bins[1]).astype(int)[:, None]
        % n_bins[1]
    )
    return mean_beam_power_over_snapshots(
        beams[:, :, up_bins, left_bins].reshape(n, n_snapshots, -1), n_elements
    )


def _element_taper(window: Window, aperture: Aperture) -> np.ndarray:
    """Return the taper over the elements, (n_elements,), of mean 1; along y times along z."""
    spacings = aperture.element_grid.spacing if aperture.element_grid else (0.5, 0.5)
    weights = np.ones(aperture.n_elements)
    for coordinates, spacing in zip(aperture.positions[:, 1:].T, spacings, strict=True):
        index = (coordinates - coordinates.min()) / spacing
        n = round(float(index.max())) + 1
        weights *= np.interp(index, np.arange(n), _symmetric_taper(window, n))
    return weights / weights.mean()


def _symmetric_taper(window: Window, n: int) -> np.ndarray:
    """Return the window with equal ends: a periodic one without its first, smallest weight."""
    longer = window_weights(window, n + 1)
    return longer[1:] if longer[-1] - longer[0] > 1e-9 else window_weights(window, n)
