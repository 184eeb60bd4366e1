"""Direction estimators: base classes."""

from abc import abstractmethod
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np

from dechirp.core.checks import check_integer, check_non_negative_ratios
from dechirp.core.errors import InvalidSetting
from dechirp.core.families import Family
from dechirp.core.findings import Finding
from dechirp.core.values import frozen_dataclass
from dechirp.processing.angle import grating_lobes, likelihood, model_order, spectrum_peaks
from dechirp.processing.angle.aperture import Aperture

# Values of a block, directions times snapshots: 32 MiB of beams.
_MAX_BLOCK_VALUES = 2**22

Angles = tuple[np.ndarray, np.ndarray]
"""Azimuths and elevations, (n, n_sources) each, in rad; NaN where a detection has fewer sources,
0 for an unresolved angle."""


class Directions(NamedTuple):
    """Sources of each detection, strongest first, (n, n_sources); NaN where there are fewer."""

    azimuth_rad: np.ndarray
    """Azimuth, left positive; NaN where the array does not resolve it."""
    elevation_rad: np.ndarray
    """Elevation, up positive; NaN where the array does not resolve it."""
    azimuth_std_rad: np.ndarray
    elevation_std_rad: np.ndarray
    power: np.ndarray
    """Power of each source in one element, in the unit of |snapshot|^2."""


@frozen_dataclass
class DirectionEstimator(Family):
    """Estimator of the directions of the echoes in a cell of the map."""

    group: ClassVar[str] = "dechirp.angle"

    n_sources: int | Literal["mdl", "aic"] = 1
    """Number of directions in each detection; mdl or aic: estimated by that criterion."""

    def __post_init__(self) -> None:
        setting = f"{type(self).__name__}.n_sources"
        if isinstance(self.n_sources, str):
            if self.n_sources not in ("mdl", "aic"):
                raise InvalidSetting(
                    setting,
                    value=repr(self.n_sources),
                    expected="a number of sources, or mdl or aic",
                    fix="choose one of them",
                )
        else:
            check_integer(setting, self.n_sources, at_least=1)

    @abstractmethod
    def find_angles(
        self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray
    ) -> Angles:
        """Estimate the directions of the sources of n detections; see `find_directions`."""

    def array_ambiguity_findings(self, aperture: Aperture) -> list[Finding]:
        """Return findings on directions that the array cannot resolve or confuses."""
        return grating_lobes.grating_lobe_findings(aperture)

    def standard_errors(
        self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray, angles: Angles
    ) -> np.ndarray:
        """Return the Cramer-Rao bound at the estimates, (n, n_sources, n_angles)."""
        return likelihood.crlb_standard_errors(snapshots, aperture, noise_power, *angles)

    def find_directions(
        self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray
    ) -> Directions:
        """Estimate directions, powers and standard errors of the sources of each detection.

        Parameters
        ----------
        snapshots : array (n, n_snapshots, n_elements), complex
            Amplitudes in the virtual elements. All snapshots of a detection have the same sources.
        aperture : Aperture
            Element positions.
        noise_power : array (n,)
            Noise power in one element, E|w|^2, after the transforms.

        Returns
        -------
        Directions
            NaN throughout for snapshots that are not finite, or zero. Standard errors are limited
            to that of a uniform distribution over the field of view.

        Raises
        ------
        InvalidSetting
            For at least as many sources as elements, for arrays of other shapes, and for noise
            that is not finite or below 0.
        """
        self._check_snapshots_noise_and_source_count(snapshots, aperture, noise_power)
        is_finite = np.isfinite(snapshots).all(axis=(1, 2))
        snapshots = np.where(is_finite[:, None, None], snapshots, 0)
        has_signal = np.any(snapshots != 0, axis=(1, 2))
        azimuth, elevation = self.find_angles(snapshots, aperture, noise_power)
        azimuth = np.where(has_signal[:, None], azimuth, np.nan)
        power = likelihood.least_squares_source_powers(snapshots, aperture, azimuth, elevation)
        if power.shape[1] > 1:
            # Strongest first; NaN sorts last.
            order = np.argsort(-power, axis=1, kind="stable")
            azimuth, elevation, power = (
                np.take_along_axis(array, order, axis=1) for array in (azimuth, elevation, power)
            )
        bounds = self.standard_errors(snapshots, aperture, noise_power, (azimuth, elevation))
        field_of_view = aperture.field_of_view
        uniform_std = np.array([field_of_view.azimuth_rad, field_of_view.elevation_rad]) / np.sqrt(
            3
        )
        std = np.full((*azimuth.shape, 2), np.nan)
        std[..., list(aperture.resolves_azimuth_and_elevation)] = np.minimum(
            bounds, uniform_std[list(aperture.resolves_azimuth_and_elevation)]
        )
        std[np.isnan(azimuth)] = np.nan
        for angle, is_resolved in zip(
            (azimuth, elevation), aperture.resolves_azimuth_and_elevation, strict=True
        ):
            if not is_resolved:
                angle.fill(np.nan)
        return Directions(azimuth, elevation, std[..., 0], std[..., 1], power)

    def _check_snapshots_noise_and_source_count(
        self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray
    ) -> None:
        if snapshots.ndim != 3 or snapshots.shape[2] != aperture.n_elements:
            raise InvalidSetting(
                "snapshots",
                value=f"an array {snapshots.shape}",
                expected=f"(n, n_snapshots, {aperture.n_elements}): a value for each element",
                fix="give the amplitudes of the virtual elements of this array",
            )
        if noise_power.shape != snapshots.shape[:1]:
            raise InvalidSetting(
                "noise_power",
                value=f"an array {noise_power.shape}",
                expected=f"{snapshots.shape[:1]}: one for each detection",
                fix="give the noise in one element of each",
            )
        check_non_negative_ratios("noise_power", noise_power, may_be_empty=True)
        if isinstance(self.n_sources, int) and self.n_sources >= aperture.n_elements:
            raise InvalidSetting(
                f"{type(self).__name__}.n_sources",
                value=self.n_sources,
                expected=f"fewer than the {aperture.n_elements} elements of the virtual array",
                fix="lower n_sources, or use an array with more elements",
            )


@frozen_dataclass
class SpectralEstimator(DirectionEstimator):
    """Estimator that takes the highest peaks of a spectrum over directions.

    A member computes data from the snapshots once (`precompute_for_spectrum`) and the spectrum from
    them (`spectrum_at`).
    """

    def precompute_for_spectrum(
        self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray
    ) -> Any:
        """Return the data of each detection that `spectrum_at` needs; by default the snapshots.

        Called once, before all directions: inverses and subspaces are computed here.
        """
        return snapshots

    @abstractmethod
    def spectrum_at(self, precomputed: Any, steering: np.ndarray) -> np.ndarray:
        """Return the spectrum of each detection, (n, m), at m steering vectors.

        `steering` is (m, n_elements), common to all, or (n, m, n_elements).
        """

    def spectrum_on_direction_grid(self, precomputed: Any, aperture: Aperture) -> np.ndarray:
        """Return the spectrum at all directions of the grid, (n, n_directions)."""
        return self.spectrum_at(precomputed, aperture.direction_grid.steering)

    def spectrum(
        self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray
    ) -> np.ndarray:
        """Return the spectrum of each detection over the grid, (n, n_elevations, n_azimuths)."""
        precomputed = self.precompute_for_spectrum(snapshots, aperture, noise_power)
        return self.spectrum_on_direction_grid(precomputed, aperture).reshape(
            len(snapshots), *aperture.direction_grid.shape
        )

    def count_sources(
        self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray
    ) -> np.ndarray:
        """Return the number of sources of each detection, (n,)."""
        if isinstance(self.n_sources, int):
            return np.full(len(snapshots), self.n_sources)
        return model_order.estimate_n_sources(snapshots, aperture, noise_power, self.n_sources)

    def find_angles(
        self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray
    ) -> Angles:
        """Find the highest local maxima of the spectrum, between grid points."""
        n_sources = self.count_sources(snapshots, aperture, noise_power)
        angles = np.full((2, len(snapshots), int(n_sources.max(initial=1))), np.nan)
        block_size = max(
            1, _MAX_BLOCK_VALUES // (snapshots.shape[1] * len(aperture.direction_grid.steering))
        )
        for first in range(0, len(snapshots), block_size):
            rows = slice(first, first + block_size)
            precomputed = self.precompute_for_spectrum(snapshots[rows], aperture, noise_power[rows])
            spectrum = self.spectrum_on_direction_grid(precomputed, aperture)
            coarse_angles = self.find_peaks_on_direction_grid(
                snapshots[rows], spectrum, aperture, n_sources[rows], angles.shape[2]
            )
            angles[:, rows] = self.refine_peak_angles(
                snapshots[rows], precomputed, aperture, coarse_angles
            )
        return angles[0], angles[1]

    def find_peaks_on_direction_grid(
        self,
        snapshots: np.ndarray,
        spectrum: np.ndarray,
        aperture: Aperture,
        n_sources: np.ndarray,
        max_peaks: int,
    ) -> Angles:
        """Return the directions of the highest peaks of spectra, (n, max_peaks)."""
        return spectrum_peaks.find_grid_peak_directions(
            spectrum, aperture.direction_grid, n_sources, max_peaks
        )

    def refine_peak_angles(
        self, snapshots: np.ndarray, precomputed: Any, aperture: Aperture, coarse_angles: Angles
    ) -> Angles:
        """Refine peaks between grid points by a search with halving steps."""
        return spectrum_peaks.refine_spectrum_peaks(
            lambda steering: self.spectrum_at(precomputed, steering), aperture, *coarse_angles
        )
