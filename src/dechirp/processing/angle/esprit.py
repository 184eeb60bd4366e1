"""ESPRIT: rotation of the signal subspace between adjacent elements."""

import numpy as np

from dechirp.core.values import frozen_dataclass
from dechirp.processing.angle.uniform_linear_array import UlaEstimator


@frozen_dataclass
class Esprit(UlaEstimator):
    """Phases by rotational invariance, in the sense of total least squares.

    References
    ----------
    R. Roy and T. Kailath, ESPRIT: estimation of signal parameters via rotational invariance
    techniques, IEEE Trans. ASSP 37(7), 1989.
    """

    def candidate_phase_factors(self, signal_basis: np.ndarray) -> np.ndarray:
        """Return the eigenvalues of the rotation."""
        k = signal_basis.shape[2]
        both = np.concatenate([signal_basis[:, :-1], signal_basis[:, 1:]], axis=2)
        # Total least squares: the k directions with the least of both.
        null = np.linalg.eigh(np.swapaxes(both, 1, 2).conj() @ both)[1][:, :, :k]
        # The addition gives snapshots of zeros an eigenvalue.
        first, last = null[:, :k], null[:, k:] + 1e-15 * np.eye(k)
        return np.linalg.eigvals(
            -np.swapaxes(
                np.linalg.solve(_transpose_last_axes(last), _transpose_last_axes(first)), 1, 2
            )
        )

    def phase_noise_weights(
        self, window_steering: np.ndarray, phase_factor: np.ndarray
    ) -> np.ndarray:
        """Return the left vectors; to first order an eigenvalue changes as under least squares."""
        inverse = np.linalg.pinv(window_steering[:, :-1])  # (n, k, size - 1)
        row = np.zeros(np.swapaxes(window_steering, 1, 2).shape, complex)
        row[:, :, 1:] = inverse / phase_factor[..., None]
        row[:, :, :-1] -= inverse
        # Im(change of z / z) = Re(-i change / z).
        return (-1j * row).conj()


def _transpose_last_axes(matrices: np.ndarray) -> np.ndarray:
    return np.swapaxes(matrices, 1, 2)
