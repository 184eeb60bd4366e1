"""Interference repaired by autoregression: in bursts, what moves goes on as it does around.

A. J. E. M. Janssen, R. N. J. Veldhuis and L. B. Vries, "Adaptive interpolation of discrete-time
signals that can be modeled as autoregressive processes", IEEE Trans. ASSP-34(2), 1986.
"""

import numpy as np
from scipy import sparse
from scipy.linalg import solveh_banded

from dechirp.core.values import value
from dechirp.process.mitigation.repair import Repair


@value
class InterferenceAutoregression(Repair):
    """Samples in bursts are interpolated by a linear predictor, from both sides.

    They become those that the samples before and behind predict with the least squared error, by
    a predictor fitted to the quieter half of the chirps (covariance method, 16 weights). So
    targets go on through a burst as far as they stand out of the noise: of a chirp that is noise
    but for weak targets, what is predicted fades to zero as in zeroing.
    """

    def repaired(self, moving: np.ndarray, is_burst: np.ndarray, taps: np.ndarray) -> np.ndarray:
        """Least squares of all errors of prediction, forwards and backwards."""
        n, order = is_burst.size, taps.size
        shape = (n - order, n)
        forward = sparse.diags([*-taps[::-1], 1], range(order + 1), shape, dtype=complex)
        backward = sparse.diags([1, *-taps.conj()], range(order + 1), shape, dtype=complex)
        errors = sparse.vstack([forward, backward]).tocsc()
        known = np.where(is_burst, 0, moving)
        unknown = errors[:, is_burst]
        square = (unknown.conj().T @ unknown).todia()
        right = -(unknown.conj().T @ (errors @ known.T))
        band = np.zeros((order + 1, right.shape[0]), complex)
        for k in range(order + 1):
            diagonal = square.diagonal(-k)
            band[k, : diagonal.size] = diagonal
        out = moving.copy()
        solved = solveh_banded(band, right, lower=True).T
        out[:, is_burst] = solved if np.iscomplexobj(moving) else solved.real
        return out
