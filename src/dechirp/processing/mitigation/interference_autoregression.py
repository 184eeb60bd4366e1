"""Interference repair by autoregression: interpolation of bursts from the samples around.

A. J. E. M. Janssen, R. N. J. Veldhuis and L. B. Vries, "Adaptive interpolation of discrete-time
signals that can be modeled as autoregressive processes", IEEE Trans. ASSP-34(2), 1986.
"""

import numpy as np
from scipy import sparse
from scipy.linalg import solveh_banded

from dechirp.core.values import frozen_dataclass
from dechirp.processing.mitigation.interference_repair import InterferenceRepair


@frozen_dataclass
class InterferenceAutoregression(InterferenceRepair):
    """Interpolation of samples in bursts by a linear predictor from both sides.

    The interpolated samples minimise the squared prediction error from the samples before and
    after, with a predictor fitted to the quieter half of the chirps (covariance method, 16
    weights). Targets continue through a burst as far as they stand out of the noise: in a chirp
    of noise and weak targets, the prediction fades to zero as in zeroing.
    """

    def repair_chirp(
        self, moving: np.ndarray, is_burst: np.ndarray, predictor: np.ndarray
    ) -> np.ndarray:
        """Minimise the squared errors of forward and backward prediction."""
        n, order = is_burst.size, predictor.size
        shape = (n - order, n)
        forward = sparse.diags([*-predictor[::-1], 1], range(order + 1), shape, dtype=complex)
        backward = sparse.diags([1, *-predictor.conj()], range(order + 1), shape, dtype=complex)
        errors = sparse.vstack([forward, backward]).tocsc()
        burst_free = np.where(is_burst, 0, moving)
        unknown = errors[:, is_burst]
        normal_matrix = (unknown.conj().T @ unknown).todia()
        right_side = -(unknown.conj().T @ (errors @ burst_free.T))
        band = np.zeros((order + 1, right_side.shape[0]), complex)
        for k in range(order + 1):
            diagonal = normal_matrix.diagonal(-k)
            band[k, : diagonal.size] = diagonal
        out = moving.copy()
        solved = solveh_banded(band, right_side, lower=True).T
        out[:, is_burst] = solved if np.iscomplexobj(moving) else solved.real
        return out
