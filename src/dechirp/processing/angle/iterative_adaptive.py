"""Iterative adaptive approach (IAA): a sharp spectrum from a single snapshot, for any array."""

import numpy as np

from dechirp.core.checks import check_integer_fields
from dechirp.core.values import frozen_dataclass
from dechirp.processing.angle import difference_coarray, likelihood
from dechirp.processing.angle.aperture import Aperture
from dechirp.processing.angle.bartlett import bartlett_spectrum
from dechirp.processing.angle.base import Angles, SpectralEstimator

# Steering vectors times powers of a block of snapshots: 64 MiB.
_MAX_BLOCK_VALUES = 2**22
# Of the sum of powers; four rounding errors of double precision keep a covariance invertible.
_ROUNDING = 4 * np.finfo(float).eps


@frozen_dataclass
class IterativeAdaptive(SpectralEstimator):
    r"""IAA-APES: power of each direction with the others suppressed by their last estimates.

    .. math:: R = \sum_k P_k a_k a_k^\mathsf{H} + \sigma^2 I, \quad
        P_k = \left| \frac{a_k^\mathsf{H} R^{-1} x}{a_k^\mathsf{H} R^{-1} a_k} \right|^2

    in turn, beginning with Bartlett's powers. A single snapshot suffices, sources may be coherent
    and elements anywhere; sidelobes are far below those of beams. The grid biases peaks towards its
    points, so the peaks are refined by likelihood, as the paper does by RELAX. On two axes the grid
    has four points to a beam, and a source between them appears as several coherent ones. Two arms
    do not determine which azimuth belongs to which elevation: on an L of six and five elements at
    20 dB, 1 in 200 sources is assigned to such a ghost. Use maximum-likelihood there.

    On an even grid of elements an iteration takes a product for each direction and lag, 2 N - 1 on
    a line, and elsewhere N^2; and an inverse.

    References
    ----------
    T. Yardibi, J. Li, P. Stoica, M. Xue and A. B. Baggeroer, Source localization and sensing: a
    nonparametric iterative adaptive approach based on weighted least squares, IEEE Trans.
    AES 46(1), 2010.
    """

    n_iterations: int = 10
    """Number of iterations; the paper finds no change beyond 15."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_integer_fields(self, "n_iterations", at_most=1000)

    def precompute_for_spectrum(
        self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray
    ) -> np.ndarray:
        """Return inverse covariances and their products with the data, (n, N, N + n_snapshots)."""
        n, n_snapshots, n_elements = snapshots.shape
        out = np.empty((n, n_elements, n_elements + n_snapshots), complex)
        block_size = max(1, _MAX_BLOCK_VALUES // aperture.direction_grid.steering.size)
        for start in range(0, n, block_size):
            block = slice(start, start + block_size)
            out[block] = self._iterate_inverse_covariances_and_filtered_snapshots(
                snapshots[block], aperture, noise_power[block]
            )
        return out

    def _iterate_inverse_covariances_and_filtered_snapshots(
        self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray
    ) -> np.ndarray:
        steering, elements = (
            aperture.direction_grid.steering.astype(complex),
            _all_element_indices(aperture),
        )
        lag_phases = difference_coarray.cached_grid_lag_phase_factors(aperture, elements)
        lag_of_pair = difference_coarray.difference_coarray_of_elements(
            aperture, elements
        ).lag_of_pair
        columns = np.swapaxes(snapshots, 1, 2)
        power = bartlett_spectrum(snapshots, steering).astype(float)
        unit = np.eye(snapshots.shape[2])
        # Without noise, the rounding error keeps the covariance invertible.
        energy = np.mean(np.abs(snapshots) ** 2, axis=(1, 2))
        floor = np.maximum(noise_power, 1e-12 * energy + 1e-300)
        for _ in range(self.n_iterations):
            if lag_phases is None:
                covariance = steering.T @ (power[:, :, None] * steering.conj())
            else:
                covariance = (power @ lag_phases)[:, lag_of_pair]
            # Large grids sum to powers whose own rounding errors exceed this floor.
            rounding = _ROUNDING * power.sum(axis=1)
            covariance += np.maximum(floor, rounding)[:, None, None] * unit
            inverse = np.linalg.inv(covariance)
            inverse_and_snapshots = np.concatenate([inverse, inverse @ columns], axis=2)
            power = self.spectrum_on_direction_grid(inverse_and_snapshots, aperture)
        return inverse_and_snapshots

    def spectrum_on_direction_grid(self, precomputed: np.ndarray, aperture: Aperture) -> np.ndarray:
        """Return the power at all directions of the grid, by lags where elements are on a grid."""
        steering, elements = (
            aperture.direction_grid.steering.astype(complex),
            _all_element_indices(aperture),
        )
        lag_phases = difference_coarray.cached_grid_lag_phase_factors(aperture, elements)
        if lag_phases is None:
            return self.spectrum_at(precomputed, steering)
        n_elements = aperture.n_elements
        amplitudes = steering.conj() @ precomputed[..., n_elements:]
        inverse = difference_coarray.difference_coarray_of_elements(
            aperture, elements
        ).sum_over_equal_lags(precomputed[..., :n_elements])
        return _mean_power_over_snapshots(
            amplitudes, difference_coarray.quadratic_forms_from_lags(inverse, lag_phases)
        )

    def spectrum_at(self, precomputed: np.ndarray, steering: np.ndarray) -> np.ndarray:
        """Return the power of each direction, with the others suppressed."""
        n_elements = precomputed.shape[1]
        responses = steering.conj() @ precomputed
        gain = np.einsum("...mi,...mi->...m", responses[..., :n_elements], steering).real
        return _mean_power_over_snapshots(responses[..., n_elements:], gain)

    def refine_peak_angles(
        self,
        snapshots: np.ndarray,
        precomputed: np.ndarray,
        aperture: Aperture,
        coarse_angles: Angles,
    ) -> Angles:
        """Refine all peaks together to the most likely directions."""
        return likelihood.maximise_direction_likelihood(snapshots, aperture, *coarse_angles)


def _all_element_indices(aperture: Aperture) -> tuple[int, ...]:
    return tuple(range(aperture.n_elements))


def _mean_power_over_snapshots(amplitudes: np.ndarray, gains: np.ndarray) -> np.ndarray:
    """Return the mean power over snapshots of amplitudes (n, m, n_snapshots) over gains (n, m)."""
    return np.asarray(np.mean(np.abs(amplitudes / gains[..., None]) ** 2, axis=-1))
