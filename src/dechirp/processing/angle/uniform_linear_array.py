"""Direction estimators for uniform linear arrays: base class."""

from abc import abstractmethod

import numpy as np

from dechirp.core.checks import check_field_classes
from dechirp.core.findings import Finding
from dechirp.core.values import frozen_dataclass
from dechirp.processing.angle import model_order, perturbation, subspace
from dechirp.processing.angle.aperture import Aperture
from dechirp.processing.angle.base import Angles, DirectionEstimator, Directions
from dechirp.processing.angle.covariance import (
    SlidingWindows,
    Smoothing,
    check_windows_separate_sources,
    longest_ula_windows_and_axis,
)


@frozen_dataclass
class UlaEstimator(DirectionEstimator):
    """Search-free estimator of phases per element of a uniform linear array.

    Other arrays use their longest row or column of evenly spaced elements. A column gives the
    elevation at any azimuth; a row gives the azimuth of a target at elevation 0, and that of the
    cone of a target above or below, arcsin(cos elevation sin azimuth), nearer to boresight. The
    other angle is NaN, with a finding if the array would resolve it.
    """

    smoothing: Smoothing = Smoothing()
    """Windows that slide over the array, whose covariances are averaged."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_field_classes(self, smoothing=Smoothing)

    @abstractmethod
    def candidate_phase_factors(self, signal_basis: np.ndarray) -> np.ndarray:
        """Return candidate factors from element to element, (n, candidates), likeliest first.

        `signal_basis` (n, size, k) spans the subspace of k sources in a window.
        """

    def sliding_windows_and_axis(self, aperture: Aperture) -> tuple[SlidingWindows, int]:
        """Return windows on the line, and its angle: 0 for azimuth, 1 for elevation."""
        return longest_ula_windows_and_axis(aperture, self.smoothing, type(self).__name__)

    def array_ambiguity_findings(self, aperture: Aperture) -> list[Finding]:
        """Warn if the array resolves two angles, of which the line gives one."""
        findings = super().array_ambiguity_findings(aperture)
        if not all(aperture.resolves_azimuth_and_elevation):
            return findings
        axis = self.sliding_windows_and_axis(aperture)[1]
        if axis == 0:
            field = aperture.field_of_view
            elevation = field.elevation_rad
            azimuth = min(field.azimuth_rad, np.pi / 3)
            error_deg = np.degrees(azimuth - np.arcsin(np.cos(elevation) * np.sin(azimuth)))
            limitation = (
                f"reads a row of the array, which takes elevations as 0, so azimuths come out"
                f" nearer to boresight: at azimuth {np.degrees(azimuth):.3g} and elevation"
                f" {np.degrees(elevation):.3g} deg by {error_deg:.2g} deg"
            )
        else:
            limitation = "reads a column of the array, which does not resolve azimuth"
        return [
            *findings,
            Finding(
                level="warning",
                setting="chain.angle.kind",
                value=f"{self.kind()} {limitation}",
                expected="a method for planes, where targets differ in height",
                fix="use fft, bartlett, capon, music or maximum-likelihood for both angles",
            ),
        ]

    def find_angles(
        self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray
    ) -> Angles:
        """Find the angles of the likeliest phase factors within the field of view."""
        windows, axis = self.sliding_windows_and_axis(aperture)
        n, n_snapshots, _ = snapshots.shape
        check_windows_separate_sources(type(self).__name__, self.n_sources, windows, n_snapshots)
        if isinstance(self.n_sources, int):
            counts = np.full(n, self.n_sources)
        else:
            counts = model_order.estimate_n_sources(
                snapshots, aperture, noise_power, self.n_sources, windows
            )
        max_count = int(counts.max(initial=1))
        _, basis = subspace.leading_eigenpairs(windows, snapshots, max_count)
        sines = np.full((n, max_count), np.nan)
        limit = aperture.field_of_view.max_angle_sines[axis]
        for k in np.unique(counts):
            rows = np.flatnonzero(counts == k)
            candidates = -np.angle(self.candidate_phase_factors(basis[rows, :, :k])) / (
                2 * np.pi * windows.spacing
            )
            visible = np.argsort(np.abs(candidates) > limit, axis=1, kind="stable")[:, :k]
            chosen_sines = np.take_along_axis(candidates, visible, axis=1)
            sines[rows[:, None], np.arange(chosen_sines.shape[1])] = np.where(
                np.abs(chosen_sines) <= limit, chosen_sines, np.nan
            )
        angle = np.arcsin(sines)
        other = np.where(np.isnan(angle), np.nan, 0.0)
        return (angle, other) if axis == 0 else (other, angle)

    def find_directions(
        self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray
    ) -> Directions:
        """Estimate directions, with NaN for the angle that the line does not resolve."""
        _, axis = self.sliding_windows_and_axis(aperture)
        directions = super().find_directions(snapshots, aperture, noise_power)
        (directions.elevation_rad if axis == 0 else directions.azimuth_rad).fill(np.nan)
        return directions

    def standard_errors(
        self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray, angles: Angles
    ) -> np.ndarray:
        """Return standard errors by first-order perturbation; NaN for an unresolved angle."""
        windows, axis = self.sliding_windows_and_axis(aperture)
        out = np.full((*angles[0].shape, 2), np.nan)
        for rows, k in perturbation.group_detections_by_source_count(angles[0]):
            angle = angles[axis][rows, :k]
            phase_factor = np.exp(-2j * np.pi * windows.spacing * np.sin(angle))
            steering = phase_factor[:, None] ** np.arange(windows.n_window_points)[:, None]
            right = perturbation.pseudoinverse_of_source_amplitudes(
                windows, snapshots[rows], steering
            )
            variance = windows.bilinear_noise_variance(
                self.phase_noise_weights(steering, phase_factor), right
            )
            per_rad = 2 * np.pi * windows.spacing * np.cos(angle)
            out[rows, :k, axis] = np.sqrt(variance * noise_power[rows, None]) / per_rad
        return out[..., list(aperture.resolves_azimuth_and_elevation)]

    @abstractmethod
    def phase_noise_weights(
        self, window_steering: np.ndarray, phase_factor: np.ndarray
    ) -> np.ndarray:
        """Return the effect of window noise on each phase: Re(left^H noise), (n, k, size).

        `window_steering` is (n, size, k) and `phase_factor` (n, k) that from element to element.
        """
