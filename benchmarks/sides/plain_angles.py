"""Plain direction estimators with NumPy and LAPACK: spectra on a grid of 181 angles."""

import numpy as np
from scipy.linalg import blas, lapack

from sides.spectra import directions


def covariances(x: np.ndarray, load: float) -> np.ndarray:
    """Compute covariances of single snapshots, (n, n_elements) to (n, elements, elements)."""
    products = x[:, :, None] * x.conj()[:, None, :]
    return np.asarray(products + np.float32(load) * np.eye(x.shape[1], dtype=np.complex64))


def solves(covariance: np.ndarray, steering: np.ndarray) -> np.ndarray:
    """Inverse of Cholesky's factor times steering vectors, (n_elements, n_directions)."""
    # The transpose is in the order of LAPACK, and the conjugate: so are the steering vectors.
    factor, _ = lapack.cpotrf(covariance.T, lower=1)
    return np.asarray(blas.ctrsm(1, factor, steering, lower=1))


def capon(x: np.ndarray, towards: np.ndarray, sines: np.ndarray, load: float) -> np.ndarray:
    """Azimuths of Capon's spectrum, a source for each row of x."""
    steering = np.asfortranarray(towards.conj().T)
    solved = (solves(whitened, steering) for whitened in covariances(x, load))
    spectra = [1 / np.sum(whitened.real**2 + whitened.imag**2, axis=0) for whitened in solved]
    return directions(np.array(spectra), sines)


def music(x: np.ndarray, towards: np.ndarray, sines: np.ndarray) -> np.ndarray:
    """Azimuths of MUSIC's spectrum, one source in each row of x."""
    strongest = np.linalg.eigh(covariances(x, 0.0))[1][:, :, -1]
    projections = strongest @ towards.conj().T
    return directions(1 / (x.shape[1] - projections.real**2 - projections.imag**2 + 1e-3), sines)


def beams(x: np.ndarray, steering: np.ndarray) -> np.ndarray:
    """Power of snapshots (n, n_elements) towards each direction."""
    return np.abs(x @ steering.conj().T) ** 2
