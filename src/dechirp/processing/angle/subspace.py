"""Signal subspace: leading eigenvectors of the smoothed covariance."""

import numpy as np

from dechirp.processing.angle.covariance import SlidingWindows

# Up to this size all eigenvectors are computed; beyond it only the leading ones.
_MAX_FULL_SIZE = 32
_N_SPARE_VECTORS = 4
_N_STEPS = 8


def leading_eigenvectors(
    windows: SlidingWindows, snapshots: np.ndarray, k: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the k largest eigenvalues (n, k) and eigenvectors (n, size, k) of the covariance.

    In double precision for windows up to 32 elements. Beyond, by 8 steps of subspace iteration
    with 4 vectors to spare (G. W. Stewart, Numerische Mathematik 25, 1976) in the precision of
    the snapshots: an error falls to the 8th power of the ratio of the first eigenvalue left out
    to that of its vector, 4e-5 where the second of two sources is 5 dB above the noise.
    """
    n, n_looks, _ = snapshots.shape
    values = np.empty((n, k))
    vectors = np.empty((n, windows.size, k), np.complex128)
    for rows in windows.detection_blocks(n, n_looks):
        x = snapshots[rows]
        if windows.size <= _MAX_FULL_SIZE:
            x = x.astype(np.complex128)
        data = windows.real_data(x) if windows.backward else windows.window_data(x)
        values[rows], eigenvectors = (
            _all_eigenvectors if windows.size <= _MAX_FULL_SIZE else _iterate_subspace
        )(data, k)
        vectors[rows] = (
            windows.to_complex_vectors(eigenvectors) if windows.backward else eigenvectors
        )
    return values, vectors


def _all_eigenvectors(data: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
    covariance = data @ np.swapaxes(data, 1, 2).conj() / data.shape[2]
    values, vectors = np.linalg.eigh(covariance)
    return values[:, : -k - 1 : -1], vectors[:, :, : -k - 1 : -1]


def _iterate_subspace(data: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
    adjoint = np.swapaxes(data, 1, 2).conj()
    n_columns = data.shape[2]
    # Any start works that is not orthogonal to a source.
    mix = np.random.default_rng(0).normal(size=(n_columns, min(k + _N_SPARE_VECTORS, n_columns)))
    basis = np.linalg.qr(data @ mix.astype(data.real.dtype))[0]
    for _ in range(_N_STEPS):
        basis = np.linalg.qr(data @ (adjoint @ basis))[0]
    projected = adjoint @ basis
    values, turns = np.linalg.eigh(np.swapaxes(projected, 1, 2).conj() @ projected / n_columns)
    return values[:, : -k - 1 : -1], basis @ turns[:, :, : -k - 1 : -1]
