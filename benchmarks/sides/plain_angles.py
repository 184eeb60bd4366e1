"""Plain direction estimators with NumPy and LAPACK, on a grid of 181 angles."""

import numpy as np
from scipy.linalg import blas, lapack

from sides.spectra import directions


def covariances(x: np.ndarray, load: float) -> np.ndarray:
    """Compute covariances of single snapshots, (n, n_elements) to (n, elements, elements)."""
    products = x[:, :, None] * x.conj()[:, None, :]
    return np.asarray(products + np.float32(load) * np.eye(x.shape[1], dtype=np.complex64))


def solve_covariance(covariance: np.ndarray, steering: np.ndarray) -> np.ndarray:
    """Solve the Cholesky factor of a covariance for steering vectors (n_elements, n_directions)."""
    # LAPACK expects column order. The transposed covariance has this order and is the conjugate;
    # the steering vectors are conjugated as well.
    factor, _ = lapack.cpotrf(covariance.T, lower=1)
    return np.asarray(blas.ctrsm(1, factor, steering, lower=1))


def capon(x: np.ndarray, steering: np.ndarray, sines: np.ndarray, load: float) -> np.ndarray:
    """Estimate the azimuth of one source per row of x from the Capon spectrum."""
    conjugated = np.asfortranarray(steering.conj().T)
    whitened_steering = (
        solve_covariance(covariance, conjugated) for covariance in covariances(x, load)
    )
    spectra = [
        1 / np.sum(whitened.real**2 + whitened.imag**2, axis=0) for whitened in whitened_steering
    ]
    return directions(np.array(spectra), sines)


def music(x: np.ndarray, steering: np.ndarray, sines: np.ndarray) -> np.ndarray:
    """Estimate the azimuth of one source per row of x from the MUSIC spectrum."""
    strongest = np.linalg.eigh(covariances(x, 0.0))[1][:, :, -1]
    projections = strongest @ steering.conj().T
    return directions(1 / (x.shape[1] - projections.real**2 - projections.imag**2 + 1e-3), sines)


def beam_power(x: np.ndarray, steering: np.ndarray) -> np.ndarray:
    """Compute the beam power of snapshots (n, n_elements) in each direction."""
    return np.abs(x @ steering.conj().T) ** 2
