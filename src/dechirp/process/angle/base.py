"""Direction estimators: what all of them share."""

from abc import abstractmethod
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np

from dechirp.core.checks import ratios, whole
from dechirp.core.errors import InvalidSetting
from dechirp.core.families import Family
from dechirp.core.findings import Finding
from dechirp.core.values import value
from dechirp.process.angle import likelihood, order, peaks, repeats
from dechirp.process.angle.aperture import Aperture

# Spectra of so many directions and looks at once: 32 MiB of beams.
_MOST_NUMBERS = 2**22

Angles = tuple[np.ndarray, np.ndarray]
"""Azimuths and elevations, (n, most) each, in rad; NaN in both where a snapshot has no more
sources, 0 where the array does not tell one of them."""


class Directions(NamedTuple):
    """Sources of each snapshot, strongest first; arrays (n, most), NaN where there are fewer."""

    azimuth_rad: np.ndarray
    """Left positive; NaN too where the array tells none."""
    elevation_rad: np.ndarray
    """Up positive; NaN too where the array tells none."""
    azimuth_std_rad: np.ndarray
    elevation_std_rad: np.ndarray
    power: np.ndarray
    """Of each source in one element, in the unit of |snapshot|^2."""


@value
class DirectionEstimator(Family):
    """Finds from where the echoes in a cell of the map come."""

    group: ClassVar[str] = "dechirp.angle"

    n_sources: int | Literal["mdl", "aic"] = 1
    """Directions sought in each detection; mdl or aic: as many as that criterion finds."""

    def __post_init__(self) -> None:
        if self.n_sources not in ("mdl", "aic"):
            whole(f"{type(self).__name__}.n_sources", self.n_sources, at_least=1)

    @abstractmethod
    def angles(self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray) -> Angles:
        """Directions in each of n snapshots, in any order; see `directions`."""

    def remarks(self, aperture: Aperture) -> list[Finding]:
        """What a user should know about directions that are found with an array."""
        return repeats.remark(aperture)

    def standard_errors(
        self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray, angles: Angles
    ) -> np.ndarray:
        """Of each direction, (n, most, n_told): the Cramer-Rao bound at the estimates."""
        return likelihood.standard_errors(snapshots, aperture, noise_power, *angles)

    def directions(
        self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray
    ) -> Directions:
        """Directions, powers and standard errors of the sources of each snapshot.

        Parameters
        ----------
        snapshots : array (n, n_looks, n_elements), complex
            Amplitudes in the virtual elements; looks see the same directions.
        aperture : Aperture
            Where the elements are.
        noise_power : array (n,)
            In one element, E|w|^2, after the transforms.

        Returns
        -------
        Directions
            NaN throughout for a snapshot that is not finite, or zero. A standard error is no
            more than that of a direction somewhere in the field of view.

        Raises
        ------
        InvalidSetting
            For as many sources as elements, or more, for arrays of other shapes, and for
            noise that is not finite or below 0.
        """
        self._must_fit(snapshots, aperture, noise_power)
        finite = np.isfinite(snapshots).all(axis=(1, 2))
        snapshots = np.where(finite[:, None, None], snapshots, 0)
        tells = np.any(snapshots != 0, axis=(1, 2))
        azimuth, elevation = self.angles(snapshots, aperture, noise_power)
        azimuth = np.where(tells[:, None], azimuth, np.nan)
        power = likelihood.powers(snapshots, aperture, azimuth, elevation)
        # Strongest first; NaN sorts last.
        order = np.argsort(-power, axis=1, kind="stable")
        azimuth, elevation, power = (
            np.take_along_axis(array, order, axis=1) for array in (azimuth, elevation, power)
        )
        told = self.standard_errors(snapshots, aperture, noise_power, (azimuth, elevation))
        field = aperture.field_of_view
        most = np.array([field.azimuth_rad, field.elevation_rad]) / np.sqrt(3)
        std = np.full((*azimuth.shape, 2), np.nan)
        std[..., list(aperture.tells)] = np.minimum(told, most[list(aperture.tells)])
        std[np.isnan(azimuth)] = np.nan
        for angle, is_told in zip((azimuth, elevation), aperture.tells, strict=True):
            if not is_told:
                angle.fill(np.nan)
        return Directions(azimuth, elevation, std[..., 0], std[..., 1], power)

    def _must_fit(self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray) -> None:
        if snapshots.ndim != 3 or snapshots.shape[2] != aperture.n_elements:
            raise InvalidSetting(
                "snapshots",
                got=f"an array {snapshots.shape}",
                need=f"(n, n_looks, {aperture.n_elements}): a number for each element",
                fix="Give the amplitudes of the virtual elements of this array.",
            )
        if noise_power.shape != snapshots.shape[:1]:
            raise InvalidSetting(
                "noise_power",
                got=f"an array {noise_power.shape}",
                need=f"{snapshots.shape[:1]}: one for each snapshot",
                fix="Give the noise in one element of each.",
            )
        ratios("noise_power", noise_power)
        if isinstance(self.n_sources, int) and self.n_sources >= aperture.n_elements:
            raise InvalidSetting(
                f"{type(self).__name__}.n_sources",
                got=self.n_sources,
                need=f"fewer than the {aperture.n_elements} elements of the virtual array",
                fix="Seek fewer directions, or give the array more elements.",
            )


@value
class SpectralEstimator(DirectionEstimator):
    """Directions are the highest peaks of a spectrum over directions.

    A member says what it keeps of the snapshots (`prepared`) and what that gives towards a
    direction (`at`).
    """

    def prepared(self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray) -> Any:
        """What `at` needs of each snapshot, (n, ...): the snapshots themselves by default.

        Called once, before all directions: inverses and subspaces are found here.
        """
        return snapshots

    @abstractmethod
    def at(self, prepared: Any, steering: np.ndarray) -> np.ndarray:
        """Spectrum of each snapshot, (n, m), at m steering vectors.

        `steering` is (m, n_elements), the same for all, or (n, m, n_elements).
        """

    def over_grid(self, prepared: Any, aperture: Aperture) -> np.ndarray:
        """Spectrum at all directions of the grid, (n, n_directions)."""
        return self.at(prepared, aperture.grid.steering)

    def spectrum(
        self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray
    ) -> np.ndarray:
        """Spectrum of each snapshot, (n, n_elevations, n_azimuths), over the grid."""
        prepared = self.prepared(snapshots, aperture, noise_power)
        return self.over_grid(prepared, aperture).reshape(len(snapshots), *aperture.grid.shape)

    def most(
        self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray
    ) -> np.ndarray:
        """How many sources are sought in each snapshot, (n,)."""
        if isinstance(self.n_sources, int):
            return np.full(len(snapshots), self.n_sources)
        return order.n_sources(snapshots, aperture, noise_power, self.n_sources)

    def angles(self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray) -> Angles:
        """The highest local maxima of the spectrum, found between grid points."""
        most = self.most(snapshots, aperture, noise_power)
        found = np.full((2, len(snapshots), int(most.max(initial=1))), np.nan)
        each = max(1, _MOST_NUMBERS // (snapshots.shape[1] * len(aperture.grid.steering)))
        for first in range(0, len(snapshots), each):
            rows = slice(first, first + each)
            prepared = self.prepared(snapshots[rows], aperture, noise_power[rows])
            spectrum = self.over_grid(prepared, aperture)
            coarse = peaks.highest(spectrum, aperture.grid, most[rows], found.shape[2])
            found[:, rows] = self.refined(snapshots[rows], prepared, aperture, coarse)
        return found[0], found[1]

    def refined(
        self, snapshots: np.ndarray, prepared: Any, aperture: Aperture, coarse: Angles
    ) -> Angles:
        """Directions between grid points, by a search that halves its steps."""
        return peaks.climbed(lambda steering: self.at(prepared, steering), aperture, *coarse)
