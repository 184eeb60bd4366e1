"""Separation of a few tones from bursts: a low-rank Hankel matrix plus sparse samples.

The published method beside which the witness `im-sparkle-chirp` sets the package's own mitigation.

References
----------
J. Wang, M. Ding and A. Yarovoy, "Interference mitigation for FMCW radar with sparse and low-rank
Hankel matrix decomposition", IEEE Trans. Signal Process. 70, 822-834, 2022.
"""

import numpy as np

_MAX_STEPS = 1000
_STEPS_A_STAGE = 10  # after which the weight of the sum grows


def separate_tones_from_bursts(
    samples: np.ndarray,
    *,
    rank: int = 10,
    sum_weight: float = 0.1,
    rank_weight: float = 0.02,
    sparsity: float = 0.02,
    sum_growth: float = 1.6,
    rank_growth: float = 1.2,
    tolerance: float = 1e-6,
    seed: int = 0,
) -> np.ndarray:
    r"""Return the part of a complex signal whose Hankel matrix has a low rank, (sample,).

    Minimises

    .. math:: \tfrac{1}{2} (\|U\|_F^2 + \|V\|_F^2) + \tau \|i\|_1
              \quad \text{with} \quad y = x + i, \; H(x) = U V^H

    by alternating directions: `sum_weight` is the penalty beta of the first condition,
    `rank_weight` the penalty mu of the second, and `sparsity` tau. The step of x takes the mean of
    each antidiagonal. The dual Q of the second condition stays a Hankel matrix minus products of
    the factors of all steps, so no matrix is formed. The defaults are the settings of the paper's
    published demonstration, which starts at random factors.
    """
    n_samples = len(samples)
    n_rows = n_samples // 2
    n_columns = n_samples - n_rows + 1
    rng = np.random.default_rng(seed)
    left, right = (rng.standard_normal((n, rank)).astype(complex) for n in (n_rows, n_columns))
    counts = np.convolve(np.ones(n_rows), np.ones(n_columns))
    identity = np.eye(rank)
    tones, bursts, sum_dual = np.zeros((3, n_samples), complex)
    hankel_dual, dual_sums = np.zeros((2, n_samples), complex)
    left_history, right_history = left[:, :0], right[:, :0]
    beta, mu = sum_weight, rank_weight
    for step in range(1, _MAX_STEPS + 1):
        if step % _STEPS_A_STAGE == 0:
            beta *= sum_growth
        means = (mu * sum_antidiagonals(left, right) - dual_sums) / counts
        tones = (beta * (samples - bursts) + sum_dual + means) / (beta + mu)
        rest = samples - tones + sum_dual / beta
        magnitudes = np.maximum(np.abs(rest), np.finfo(float).tiny)
        bursts = rest * np.maximum(1 - sparsity / beta / magnitudes, 0)
        target = mu * tones + hankel_dual
        product = multiply_hankel(target, right) - left_history @ (right_history.conj().T @ right)
        left = product @ np.linalg.inv(identity + mu * right.conj().T @ right)
        product = multiply_hankel(target.conj(), left) - right_history @ (
            left_history.conj().T @ left
        )
        right = product @ np.linalg.inv(identity + mu * left.conj().T @ left)
        sum_dual = sum_dual + beta * (samples - tones - bursts)
        hankel_dual = target
        left_history = np.hstack([left_history, mu * left])
        right_history = np.hstack([right_history, right])
        dual_sums = dual_sums + mu * (counts * tones - sum_antidiagonals(left, right))
        mu *= rank_growth
        if np.linalg.norm(samples - tones - bursts) <= tolerance * np.linalg.norm(samples):
            break
    return tones


def multiply_hankel(values: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Return H(values) @ columns, H[m, n] = values[m + n], by one convolution a column."""
    n_columns = len(columns)
    from scipy.signal import fftconvolve  # 0.7 s of CPU time, of which `list` needs nothing

    full = fftconvolve(values[:, None], columns[::-1], axes=0)
    return np.asarray(full[n_columns - 1 : len(values)])


def sum_antidiagonals(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return the sums of `left @ right.conj().T` along all antidiagonals."""
    from scipy.signal import fftconvolve

    return np.asarray(fftconvolve(left, right.conj(), axes=0).sum(axis=1))
