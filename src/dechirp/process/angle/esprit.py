"""ESPRIT: how the subspace of the sources turns from each element to the next."""

import numpy as np

from dechirp.core.values import value
from dechirp.process.angle.line import LineEstimator


@value
class Esprit(LineEstimator):
    """Phases by rotational invariance, in the sense of total least squares.

    References
    ----------
    R. Roy and T. Kailath, ESPRIT: estimation of signal parameters via rotational invariance
    techniques, IEEE Trans. ASSP 37(7), 1989.
    """

    def turns(self, basis: np.ndarray) -> np.ndarray:
        """Eigenvalues of the rotation."""
        k = basis.shape[2]
        both = np.concatenate([basis[:, :-1], basis[:, 1:]], axis=2)
        # Both have errors: the k directions that they have least in.
        null = np.linalg.eigh(np.swapaxes(both, 1, 2).conj() @ both)[1][:, :, :k]
        # Snapshots of zeros, too, have some eigenvalue.
        first, last = null[:, :k], null[:, k:] + 1e-15 * np.eye(k)
        return np.linalg.eigvals(-np.swapaxes(np.linalg.solve(_t(last), _t(first)), 1, 2))

    def left(self, steering: np.ndarray, turn: np.ndarray) -> np.ndarray:
        """The change of an eigenvalue is that of least squares to first order."""
        inverse = np.linalg.pinv(steering[:, :-1])  # (n, k, size - 1)
        row = np.zeros(np.swapaxes(steering, 1, 2).shape, complex)
        row[:, :, 1:] = inverse / turn[..., None]
        row[:, :, :-1] -= inverse
        # Im(change of z / z) = Re(-i change / z).
        return (-1j * row).conj()


def _t(matrix: np.ndarray) -> np.ndarray:
    return np.swapaxes(matrix, 1, 2)
