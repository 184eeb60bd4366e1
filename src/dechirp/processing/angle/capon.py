"""Capon beamformer: least power that passes a signal from each direction undistorted."""

from functools import partial
from typing import Any, NamedTuple

import numpy as np
import scipy

from dechirp.core.checks import check_positive_fields
from dechirp.core.values import frozen_dataclass
from dechirp.processing.angle import perturbation
from dechirp.processing.angle.aperture import Aperture
from dechirp.processing.angle.base import Angles
from dechirp.processing.angle.covariance import SlidingWindows
from dechirp.processing.angle.difference_coarray import (
    DifferenceCoarray,
    cached_grid_lag_phase_factors,
    difference_coarray_of_elements,
    quadratic_forms_from_lags,
    quadratic_forms_per_detection,
)
from dechirp.processing.angle.smoothed import SmoothedEstimator

# Relative to the mean power: the accuracy of a covariance in single precision.
_MIN_LOADING = 1e-5
# Lag phases at a time: 16 MiB.
_MAX_BLOCK_VALUES = 2**20


class InverseCovariances(NamedTuple):
    """Inverse covariances, summed over the pairs of elements with equal lags."""

    lag_sums: np.ndarray
    """(n, n_differences) complex."""
    coarray: DifferenceCoarray


@frozen_dataclass
class Capon(SmoothedEstimator):
    """1 / a^H (R + d)^-1 a, of the covariance over windows.

    The loading d keeps the inverse of few snapshots finite, and errors of the array from
    being taken for interference (B. D. Carlson, Covariance matrix estimation errors and
    diagonal loading in adaptive arrays, IEEE Trans. AES 24(4), 1988). On arrays that are not
    uniform, one snapshot has the peaks of a Bartlett spectrum.

    References
    ----------
    J. Capon, High-resolution frequency-wavenumber spectrum analysis, Proc. IEEE 57(8), 1969.
    """

    loading: float = 0.1
    """Diagonal loading relative to the noise power of one element; at least 1e-5 of the mean
    power."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_positive_fields(self, "loading")

    def precompute_for_spectrum(
        self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray
    ) -> InverseCovariances:
        """Invert each covariance in double precision: a beam is a small difference of its terms."""
        windows = self.sliding_windows(aperture)
        n, n_snapshots, _ = snapshots.shape
        coarray = difference_coarray_of_elements(aperture, _first_window_element_indices(windows))
        lag_sums = np.empty((n, len(coarray.pairs[0])), np.complex128)
        for rows in windows.memory_limited_slices(n, n_snapshots):
            covariance = self._loaded_covariances(windows, snapshots[rows], noise_power[rows])
            lag_sums[rows] = coarray.sum_over_equal_lags(
                _inverse_covariance_lower_halves(covariance)
            )
        return InverseCovariances(lag_sums, coarray)

    def standard_errors(
        self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray, angles: Angles
    ) -> np.ndarray:
        """Return standard errors by first-order perturbation, weighted by the inverse covariance.

        The noise that makes the weights uneven is also that of the error: the variance is up to
        7 % too large for a few windows.
        """
        windows = self.sliding_windows(aperture)
        n, n_snapshots, _ = snapshots.shape
        parts = []
        for rows in windows.memory_limited_slices(n, n_snapshots):
            covariances = self._loaded_covariances(windows, snapshots[rows], noise_power[rows])
            errors = perturbation.null_spectrum_angle_standard_errors(
                windows,
                snapshots[rows],
                aperture,
                noise_power[rows],
                (angles[0][rows], angles[1][rows]),
                weigh=partial(_apply_inverse_covariances, windows, covariances),
            )
            parts.append(errors)
        n_angles = sum(aperture.resolves_azimuth_and_elevation)
        return np.concatenate([np.empty((0, angles[0].shape[1], n_angles)), *parts])

    def _loaded_covariances(
        self, windows: SlidingWindows, snapshots: np.ndarray, noise_power: np.ndarray
    ) -> np.ndarray:
        """Return the covariances with their loading, (n, size, size).

        Those of windows that are also read backwards are rotated and real.
        """
        x = snapshots.astype(np.complex64)
        data = (
            windows.real_valued_data_matrices(x)
            if windows.backward
            else windows.window_data_matrices(x)
        )
        covariance = data @ np.swapaxes(data, 1, 2).conj() / data.shape[2]
        power = np.einsum("nii->n", covariance).real / windows.n_window_points
        # A snapshot of zeros has no direction, but must not raise for the others.
        loading = np.fmax(self.loading * noise_power, _MIN_LOADING * power + 1e-30)
        np.einsum("nii->ni", covariance)[:] += loading[:, None]
        return np.asarray(covariance)

    def spectrum_at(self, precomputed: InverseCovariances, steering: np.ndarray) -> np.ndarray:
        """Return the power in the beam towards each direction, as of one element."""
        lag_sums, coarray = precomputed
        if steering.ndim == 3:
            return np.asarray(1 / quadratic_forms_per_detection(lag_sums, steering, coarray.pairs))
        block_size = max(1, _MAX_BLOCK_VALUES // lag_sums.shape[1])
        parts = [
            quadratic_forms_from_lags(
                lag_sums, coarray.lag_phase_factors(steering[first : first + block_size])
            )
            for first in range(0, len(steering), block_size)
        ]
        return 1 / np.concatenate(parts, axis=1)

    def spectrum_on_direction_grid(
        self, precomputed: InverseCovariances, aperture: Aperture
    ) -> np.ndarray:
        lag_phases = cached_grid_lag_phase_factors(
            aperture, _first_window_element_indices(self.sliding_windows(aperture))
        )
        if lag_phases is not None:
            return np.asarray(1 / quadratic_forms_from_lags(precomputed.lag_sums, lag_phases))
        grid = aperture.direction_grid
        return np.concatenate(
            [
                self.spectrum_at(
                    precomputed, aperture.steering_vectors(grid.azimuth_rad, elevation)
                )
                for elevation in grid.elevation_rad
            ],
            axis=1,
        )


def _apply_inverse_covariances(
    windows: SlidingWindows, covariances: np.ndarray, rows: np.ndarray, vectors: np.ndarray
) -> np.ndarray:
    """Return inverse covariances, of the given rows, times vectors (n, size, k)."""
    matrices = covariances[rows].astype(np.result_type(covariances, float))
    if not windows.backward:
        return np.linalg.solve(matrices, vectors)
    rotated = windows.rotated_vectors(vectors)
    solved = np.linalg.solve(matrices, np.concatenate([rotated.real, rotated.imag], axis=2))
    real, imaginary = np.split(solved, 2, axis=2)
    return windows.complex_vectors_from_rotated(real + 1j * imaginary)


def _first_window_element_indices(windows: SlidingWindows) -> tuple[int, ...]:
    return tuple(windows.first_window_element_indices.tolist())


def _inverse_covariance_lower_halves(covariances: np.ndarray) -> np.ndarray:
    """Return the lower halves of the inverses of Hermitian (n, size, size), in double precision."""
    out = np.ascontiguousarray(covariances, np.result_type(covariances, float))
    # The stubs of SciPy 1.17 know no sequence of functions here, those of 1.18 do.
    lapack: Any = scipy.linalg.lapack
    factor, invert = lapack.get_lapack_funcs(("potrf", "potri"), (out,))
    for matrix in out:
        # LAPACK reads the upper halves of the transposed matrices.
        upper = factor(matrix.T, overwrite_a=True, clean=False)[0]
        matrix[:] = invert(upper, overwrite_c=True)[0].T
    return out
