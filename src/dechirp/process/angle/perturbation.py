"""Standard errors of subspace methods: what noise of first order does to their directions.

Noise turns the subspace of the sources, S, by W S^+, with W the noise in the windows; a method
then errs by a linear form of it, left^H W right (F. Li, H. Liu and R. J. Vaccaro, Performance
analysis for DOA estimation algorithms, IEEE Trans. AES 29(4), 1993). Exact for weak noise;
sources within a small part of a beam of each other, or few dB, are not that.
"""

from collections.abc import Iterator

import numpy as np

from dechirp.process.angle.aperture import Aperture
from dechirp.process.angle.base import Angles
from dechirp.process.angle.covariance import Windows


def by_count(azimuth_rad: np.ndarray) -> Iterator[tuple[np.ndarray, int]]:
    """Rows of the detections with k sources, and k, for each k there is; sources come first."""
    counts = np.sum(~np.isnan(azimuth_rad), axis=1)
    return ((np.flatnonzero(counts == k), int(k)) for k in np.unique(counts[counts > 0]))


def null_spectrum_errors(
    windows: Windows,
    snapshots: np.ndarray,
    aperture: Aperture,
    noise_power: np.ndarray,
    angles: Angles,
) -> np.ndarray:
    """Of zeros of the null spectrum, as MUSIC, root-MUSIC and Capon find them, (n, most, n_told).

    `angles` are (n, most) each, NaN where there are fewer.
    """
    n_told = sum(aperture.tells)
    out = np.full((*angles[0].shape, n_told), np.nan)
    for rows, k in by_count(angles[0]):
        at = angles[0][rows, :k], angles[1][rows, :k]
        steering = np.swapaxes(aperture.steering(*at)[..., windows.elements], 1, 2)
        slopes = aperture.derivatives(*at)[..., windows.elements]  # (n, k, n_told, size)
        basis = np.linalg.qr(steering)[0][:, None]
        slopes = slopes - (slopes @ basis.conj()) @ np.swapaxes(basis, 2, 3)
        # Newton's step: the inverse of the curvature times the slope that noise gives.
        curvature = np.real(slopes.conj() @ np.swapaxes(slopes, 2, 3))
        left = np.linalg.pinv(curvature, hermitian=True) @ slopes
        right = inverse_amplitudes(windows, snapshots[rows], steering)
        right = np.broadcast_to(right[:, :, None], (*left.shape[:3], right.shape[-1]))
        out[rows, :k] = np.sqrt(windows.noise_variance(left, right) * noise_power[rows, None, None])
    return out


def inverse_amplitudes(windows: Windows, snapshots: np.ndarray, steering: np.ndarray) -> np.ndarray:
    """S^+ as (n, k, columns): amplitudes of the sources in each window, inverted.

    `steering` is (n, size, k), that of the first window.
    """
    n, n_looks, _ = snapshots.shape
    inverse = np.linalg.pinv(steering).astype(snapshots.dtype)
    seen = [windows.seen(inverse[i], snapshots[i]) for i in windows.blocks(n, n_looks)]
    return np.swapaxes(np.linalg.pinv(np.concatenate(seen).astype(complex)), 1, 2)
