"""Standard errors of subspace methods, by first-order perturbation.

Noise changes the signal subspace, S, by W S^+, with W the noise in the windows; the error of a
method is then a linear form of it, left^H W right (F. Li, H. Liu and R. J. Vaccaro, Performance
analysis for DOA estimation algorithms, IEEE Trans. AES 29(4), 1993). Exact for weak noise; not
for sources within a small part of a beam of each other, or of few dB.
"""

from collections.abc import Callable, Iterator

import numpy as np

from dechirp.processing.angle.aperture import Aperture
from dechirp.processing.angle.base import Angles
from dechirp.processing.angle.covariance import SlidingWindows


def group_detections_by_source_count(azimuth_rad: np.ndarray) -> Iterator[tuple[np.ndarray, int]]:
    """Yield the rows of the detections with k sources, and k, for each k present."""
    counts = np.sum(~np.isnan(azimuth_rad), axis=1)
    return ((np.flatnonzero(counts == k), int(k)) for k in np.unique(counts[counts > 0]))


def null_spectrum_angle_standard_errors(
    windows: SlidingWindows,
    snapshots: np.ndarray,
    aperture: Aperture,
    noise_power: np.ndarray,
    angles: Angles,
    *,
    weigh: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None,
) -> np.ndarray:
    """Return standard errors of minima of a null spectrum, (n, n_sources, n_angles).

    `angles` are (n, n_sources) each, NaN where there are fewer. MUSIC and root-MUSIC weight all of
    the noise subspace equally; Capon weights it by the inverse of the covariance, which few windows
    leave uneven: that costs up to a fifth of the variance. `weigh` multiplies vectors (n, size, k)
    of the given rows by that inverse.
    """
    n_angles = sum(aperture.resolves_azimuth_and_elevation)
    out = np.full((*angles[0].shape, n_angles), np.nan)
    for rows, k in group_detections_by_source_count(angles[0]):
        directions = angles[0][rows, :k], angles[1][rows, :k]
        steering = np.swapaxes(
            aperture.steering_vectors(*directions)[..., windows.first_window_element_indices], 1, 2
        )
        # Shape (n, k, n_angles, window size).
        slopes = aperture.steering_derivatives(*directions)[
            ..., windows.first_window_element_indices
        ]
        basis = np.linalg.qr(steering)[0][:, None]
        slopes = slopes - (slopes @ basis.conj()) @ np.swapaxes(basis, 2, 3)
        weighted = slopes
        if weigh is not None:
            columns = np.swapaxes(slopes.reshape(len(slopes), -1, slopes.shape[-1]), 1, 2)
            weighted = np.swapaxes(weigh(rows, columns), 1, 2).reshape(slopes.shape)
        # Newton's step: the inverse of the curvature times the slope caused by noise.
        curvature = np.real(slopes.conj() @ np.swapaxes(weighted, 2, 3))
        left_vectors = np.linalg.pinv(curvature, hermitian=True) @ weighted
        right_vectors = pseudoinverse_of_source_amplitudes(windows, snapshots[rows], steering)
        right_vectors = np.broadcast_to(
            right_vectors[:, :, None], (*left_vectors.shape[:3], right_vectors.shape[-1])
        )
        out[rows, :k] = np.sqrt(
            windows.bilinear_noise_variance(left_vectors, right_vectors)
            * noise_power[rows, None, None]
        )
    return out


def pseudoinverse_of_source_amplitudes(
    windows: SlidingWindows, snapshots: np.ndarray, steering: np.ndarray
) -> np.ndarray:
    """Return S^+ as (n, k, columns): inverse amplitudes of the sources in each window.

    `steering` is (n, size, k), that of the first window.
    """
    n, n_snapshots, _ = snapshots.shape
    inverse = np.linalg.pinv(steering).astype(snapshots.dtype)
    amplitudes = [
        windows.multiply_data_matrices_from_left(inverse[i], snapshots[i])
        for i in windows.memory_limited_slices(n, n_snapshots)
    ]
    return np.swapaxes(np.linalg.pinv(np.concatenate(amplitudes).astype(complex)), 1, 2)
