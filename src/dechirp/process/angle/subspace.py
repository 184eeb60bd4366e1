"""The subspace of the sources: the strongest directions in what the windows saw."""

import numpy as np

from dechirp.process.angle.covariance import Windows

# Up to so many elements all eigenvectors are found at once; beyond, only those asked for.
_ALL = 32
_SPARE = 4
_STEPS = 8


def strongest(windows: Windows, snapshots: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Largest k eigenvalues (n, k) and eigenvectors (n, size, k) of the covariance.

    In double precision for windows up to 32 elements. Beyond, by 8 steps of subspace iteration
    with 4 vectors to spare (G. W. Stewart, Numerische Mathematik 25, 1976) in the precision of
    the snapshots: an error falls to the 8th power of the ratio of the first eigenvalue left out
    to that of its vector, 4e-5 where the second of two sources is 5 dB above the noise.
    """
    n, n_looks, _ = snapshots.shape
    values = np.empty((n, k))
    vectors = np.empty((n, windows.size, k), np.complex128)
    for rows in windows.blocks(n, n_looks):
        x = snapshots[rows]
        if windows.size <= _ALL:
            x = x.astype(np.complex128)
        data = windows.real_data(x) if windows.backward else windows.data(x)
        values[rows], found = (_all if windows.size <= _ALL else _iterated)(data, k)
        vectors[rows] = windows.vectors_back(found) if windows.backward else found
    return values, vectors


def _all(data: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
    covariance = data @ np.swapaxes(data, 1, 2).conj() / data.shape[2]
    values, vectors = np.linalg.eigh(covariance)
    return values[:, : -k - 1 : -1], vectors[:, :, : -k - 1 : -1]


def _iterated(data: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
    adjoint = np.swapaxes(data, 1, 2).conj()
    n_columns = data.shape[2]
    # Any start will do that is not blind to a source.
    mix = np.random.default_rng(0).normal(size=(n_columns, min(k + _SPARE, n_columns)))
    basis = np.linalg.qr(data @ mix.astype(data.real.dtype))[0]
    for _ in range(_STEPS):
        basis = np.linalg.qr(data @ (adjoint @ basis))[0]
    inside = adjoint @ basis
    values, turns = np.linalg.eigh(np.swapaxes(inside, 1, 2).conj() @ inside / n_columns)
    return values[:, : -k - 1 : -1], basis @ turns[:, :, : -k - 1 : -1]
