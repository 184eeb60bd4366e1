"""Methods for uniform lines: directions from the turn of phase from element to element."""

from abc import abstractmethod

import numpy as np

from dechirp.core.findings import Finding
from dechirp.core.values import value
from dechirp.process.angle import order, perturbation, subspace
from dechirp.process.angle.aperture import Aperture
from dechirp.process.angle.base import Angles, DirectionEstimator, Directions
from dechirp.process.angle.covariance import Smoothing, Windows, fits, line_windows


@value
class LineEstimator(DirectionEstimator):
    """Finds phases per element of a uniform line; no grid, no search.

    Of other arrays it takes the longest row or column of evenly spaced elements. A column tells
    the elevation whatever the azimuth; a row tells the azimuth of a target at elevation 0, and
    of one above or below its cone, arcsin(cos elevation sin azimuth), nearer to boresight. The
    other angle is NaN, and a finding says so where the array would tell it.
    """

    smoothing: Smoothing = Smoothing()

    @abstractmethod
    def turns(self, basis: np.ndarray) -> np.ndarray:
        """Factors from element to element, (n, candidates) complex, likeliest first.

        `basis` (n, size, k) spans the subspace of k sources in a window.
        """

    def over(self, aperture: Aperture) -> tuple[Windows, int]:
        """Windows on the line, and whether it tells azimuth (0) or elevation (1)."""
        return line_windows(aperture, self.smoothing, type(self).__name__)

    def remarks(self, aperture: Aperture) -> list[Finding]:
        """Also a warning where the array tells two angles, of which a line tells one."""
        found = super().remarks(aperture)
        if not all(aperture.tells):
            return found
        axis = self.over(aperture)[1]
        if axis == 0:
            field = aperture.field_of_view
            high = field.elevation_rad
            left = min(field.azimuth_rad, np.pi / 3)
            short = np.degrees(left - np.arcsin(np.cos(high) * np.sin(left)))
            costs = (
                f"reads a row of the array, which takes elevations as 0, so azimuths come out"
                f" nearer to boresight: at azimuth {np.degrees(left):.3g} and elevation"
                f" {np.degrees(high):.3g} deg by {short:.2g} deg"
            )
        else:
            costs = "reads a column of the array, which tells no azimuth"
        return [
            *found,
            Finding(
                level="warning",
                setting="chain.angle.kind",
                got=f"{self.kind()} {costs}",
                need="a method for planes, where targets are not all at one height",
                fix="Take fft, bartlett, capon, music or maximum-likelihood for both angles.",
            ),
        ]

    def angles(self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray) -> Angles:
        """Those of the likeliest turns within the field of view."""
        over, axis = self.over(aperture)
        n, n_looks, _ = snapshots.shape
        fits(type(self).__name__, self.n_sources, over, n_looks)
        if isinstance(self.n_sources, int):
            counts = np.full(n, self.n_sources)
        else:
            counts = order.n_sources(snapshots, aperture, noise_power, self.n_sources, over)
        most = int(counts.max(initial=1))
        _, basis = subspace.strongest(over, snapshots, most)
        sines = np.full((n, most), np.nan)
        limit = aperture.field_of_view.sines[axis]
        for k in np.unique(counts):
            rows = np.flatnonzero(counts == k)
            found = -np.angle(self.turns(basis[rows, :, :k])) / (2 * np.pi * over.step)
            seen = np.argsort(np.abs(found) > limit, axis=1, kind="stable")[:, :k]
            taken = np.take_along_axis(found, seen, axis=1)
            sines[rows[:, None], np.arange(taken.shape[1])] = np.where(
                np.abs(taken) <= limit, taken, np.nan
            )
        told = np.arcsin(sines)
        other = np.where(np.isnan(told), np.nan, 0.0)
        return (told, other) if axis == 0 else (other, told)

    def directions(
        self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray
    ) -> Directions:
        """As of all estimators, with NaN for an angle that the line does not tell."""
        _, axis = self.over(aperture)
        found = super().directions(snapshots, aperture, noise_power)
        (found.elevation_rad if axis == 0 else found.azimuth_rad).fill(np.nan)
        return found

    def standard_errors(
        self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray, angles: Angles
    ) -> np.ndarray:
        """By perturbation of first order; NaN of an angle that the line does not tell."""
        over, axis = self.over(aperture)
        out = np.full((*angles[0].shape, 2), np.nan)
        for rows, k in perturbation.by_count(angles[0]):
            told = angles[axis][rows, :k]
            turn = np.exp(-2j * np.pi * over.step * np.sin(told))
            steering = turn[:, None] ** np.arange(over.size)[:, None]
            right = perturbation.inverse_amplitudes(over, snapshots[rows], steering)
            variance = over.noise_variance(self.left(steering, turn), right)
            per_rad = 2 * np.pi * over.step * np.cos(told)
            out[rows, :k, axis] = np.sqrt(variance * noise_power[rows, None]) / per_rad
        return out[..., list(aperture.tells)]

    @abstractmethod
    def left(self, steering: np.ndarray, turn: np.ndarray) -> np.ndarray:
        """What noise in a window adds to each phase: Re(left^H noise), (n, k, size).

        `steering` is (n, size, k) and `turn` (n, k) that from element to element.
        """
