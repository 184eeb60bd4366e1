"""Angle FFT: beams towards all directions at once, for elements at even steps."""

from typing import Any

import numpy as np
import scipy.fft

from dechirp.core.values import value
from dechirp.process.angle import likelihood
from dechirp.process.angle.aperture import Aperture
from dechirp.process.angle.bartlett import beam_power, mean_power
from dechirp.process.angle.base import Angles, SpectralEstimator
from dechirp.process.angle.lattice import Places
from dechirp.theory.windows import Window, taper


@value
class Fft(SpectralEstimator):
    """Power in tapered beams, by a zero-padded FFT over the elements.

    Elements stand on an even grid, a line or a rectangle, with holes where there are none.
    Without such a grid, as after a calibration of positions, the same beams come from the
    product with steering vectors. The taper only decides which peaks are seen: their tops
    are found again without it, where standard errors are smallest (a Hann taper costs half of
    them as much again).
    """

    window: Window = "rectangular"
    """Taper over the array: lower sidelobes, so that weak sources show beside strong ones, for
    a wider beam."""

    def __post_init__(self) -> None:
        super().__post_init__()
        taper(self.window, 1)  # refuses another name

    def prepared(
        self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray
    ) -> np.ndarray:
        """The snapshots, tapered."""
        if self.window == "rectangular":
            return snapshots
        return snapshots * _weights(self.window, aperture).astype(np.float32)

    def at(self, prepared: np.ndarray, steering: np.ndarray) -> np.ndarray:
        """Power in a tapered beam towards each direction."""
        return beam_power(prepared, steering)

    def over_grid(self, prepared: np.ndarray, aperture: Aperture) -> np.ndarray:
        """The same at all directions of the grid, by a transform where the elements allow."""
        if aperture.places is None:
            return self.at(prepared, aperture.grid.steering)
        return _transformed(prepared, aperture, aperture.places)

    def refined(
        self, snapshots: np.ndarray, prepared: np.ndarray, aperture: Aperture, coarse: Angles
    ) -> Angles:
        """The tops of the peaks without the taper, together: the most likely directions."""
        return likelihood.maximised(snapshots, aperture, *coarse)


def _transformed(snapshots: np.ndarray, aperture: Aperture, on: Places) -> np.ndarray:
    """Power in the beams of the grid, (n, n_directions), mean over the looks.

    Bins are even in the direction cosines along y and z. On one axis they are the directions
    of the grid; on two, azimuths at an elevation are read at the nearest bin, within an
    eighth of a beam.
    """
    n, n_looks, n_elements = snapshots.shape
    grid = aperture.grid
    towards_up = np.sin(grid.elevation_rad)
    towards_left = np.cos(grid.elevation_rad)[:, None] * np.sin(grid.azimuth_rad)
    n_bins = [
        round(1 / (step * apart)) if step else 1
        for step, apart in zip(aperture.steps, on.step, strict=True)
    ]
    # Grids of less than a wavelength's step may have fewer bins than places: those fold.
    filled = np.zeros((n, n_looks, n_bins[1], n_bins[0]), np.complex64)
    column, row = (on.place % n_bins).T
    cells: Any = (slice(None), slice(None), row, column)
    np.add.at(filled, cells, snapshots)
    # Sums of x exp(2 pi i u p): an inverse transform, unscaled. Over the shorter axis first,
    # whose other rows are zero still.
    beams = scipy.fft.ifft2(filled, norm="forward", overwrite_x=True)
    left = np.rint(towards_left * on.step[0] * n_bins[0]).astype(int) % n_bins[0]
    up = np.rint(towards_up * on.step[1] * n_bins[1]).astype(int)[:, None] % n_bins[1]
    return mean_power(beams[:, :, up, left].reshape(n, n_looks, -1), n_elements)


def _weights(window: Window, aperture: Aperture) -> np.ndarray:
    """Taper over the elements, (n_elements,), of mean 1; along y times along z."""
    apart = aperture.places.step if aperture.places else (0.5, 0.5)
    weights = np.ones(aperture.n_elements)
    for along, step in zip(aperture.positions[:, 1:].T, apart, strict=True):
        place = (along - along.min()) / step
        n = round(float(place.max())) + 1
        weights *= np.interp(place, np.arange(n), _symmetric(window, n))
    return weights / weights.mean()


def _symmetric(window: Window, n: int) -> np.ndarray:
    """The window with equal ends: a periodic one without its first weight, its least."""
    longer = taper(window, n + 1)
    return longer[1:] if longer[-1] - longer[0] > 1e-9 else taper(window, n)
