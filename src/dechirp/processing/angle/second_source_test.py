r"""Test of a second source against errors of the channels.

Channels of a real array differ in phase and gain, so the amplitudes of its elements deviate from
one plane wave even if there is one target. Noise averages over a frame, these errors do not: at
30 dB, criteria of the noise alone find a second source in nearly every echo.

A second source, 10 dB weaker or less, deviates otherwise. It changes gains as much as phases,
steadily over the array, whereas channels change phases more than gains, and those of a product
array in a pattern of transmitters times receivers. With amplitudes x of m elements, stacked as 2 m
real numbers, the deviations x log(x / f) from a fit f are linear in gains (in neper) and phases of
the channels, whatever their size. Their covariance is

.. math::

    C = \sigma^2 \sum_k (i x \circ b_k)(i x \circ b_k)^T
        + \sigma_g^2 \sum_k (x \circ b_k)(x \circ b_k)^T
        + \Bigl( \sigma_w^2 \frac{\|x\|^2}{m} + \frac{N}{2} \Bigr) I

where b_k marks the elements of antenna k, sigma is the phase of an antenna, sigma_g its gain, and
sigma_w, of each element, stands for coupling, patterns and clutter; N is the noise power. Let q_k
be the residual of k sources, fitted by generalised least squares. Of m elements and n angles, one
source leaves 2 m - 2 - n residuals. If it is alone, a second one at a given direction reduces q_1
as two of them do, and at the best of D separate directions the probability of the reduction is at
most

.. math::

    P = D \max \left( e^{(q_2 - q_1) / 2},
        \left( \frac{q_2}{q_1} \right)^{(2 m - 4 - n) / 2} \right).

The first term holds if the errors are at most those of C, the second if they are larger in
proportion: it is that of an F-test, which does not know their power. Both have to be small.
"""

import numpy as np

from dechirp.processing.angle.aperture import Aperture

# Largest P. Clutter from all directions, 6 to 16 dB below an echo, is not in proportion to C: of
# such single echoes the test finds a second source in up to 1 %, and else in less than 0.1 %.
_MAX_PROBABILITY = 3e-5
# Errors in proportion to the phases: gains of 1 dB and deviations of single elements of 9 % (each
# part) at 20 degrees.
_GAIN_SHARE, _ELEMENT_SHARE = 0.36, 0.27
# Separate directions in a beam, 1 / length in sines, between which the best one is found.
_DIRECTIONS_PER_BEAM = 2.5


def exceeds_channel_errors_mask(
    snapshots: np.ndarray,
    single: tuple[np.ndarray, np.ndarray],
    pair: tuple[np.ndarray, np.ndarray],
    aperture: Aperture,
    noise_power: np.ndarray,
    phase_std_rad: float,
) -> np.ndarray:
    """Return True where channels of such phases do not explain what a second source does, (n,).

    Snapshots (n, n_snapshots, n_elements), most likely directions of one source (n, 1) and of two
    (n, 2), noise power of an element (n,), and the standard deviation of the phase of an antenna.
    Several snapshots have the same channels, so that they are worth one.
    """
    n, n_snapshots, n_elements = snapshots.shape
    n_angles = sum(aperture.resolves_azimuth_and_elevation)
    exponent = (2 * n_elements - 4 - n_angles) / 2
    factor = np.linalg.cholesky(
        _channel_error_covariance(
            snapshots.reshape(-1, n_elements),
            aperture,
            np.repeat(noise_power, n_snapshots),
            phase_std_rad,
        )
    )
    residual_1, residual_2 = (
        _weighted_residuals(
            snapshots.reshape(-1, n_elements),
            tuple(np.repeat(angle, n_snapshots, axis=0) for angle in angles),
            aperture,
            factor,
        )
        .reshape(n, n_snapshots)
        .mean(axis=1)
        for angles in (single, pair)
    )
    n_directions = _count_separate_directions(aperture)
    by_power = np.exp(np.minimum(residual_2 - residual_1, 0) / 2)
    by_shape = (residual_2 / np.maximum(residual_1, np.finfo(float).tiny)) ** exponent
    return np.asarray(n_directions * np.maximum(by_power, by_shape) < _MAX_PROBABILITY)


def _count_separate_directions(aperture: Aperture) -> float:
    """Return the number of separate directions in the field of view."""
    lengths = np.ptp(aperture.positions[:, 1:], axis=0)
    return float(
        np.prod(
            [
                1 + _DIRECTIONS_PER_BEAM * 2 * max_sine * length
                for length, max_sine, is_resolved in zip(
                    lengths,
                    aperture.field_of_view.max_angle_sines,
                    aperture.resolves_azimuth_and_elevation,
                    strict=True,
                )
                if is_resolved
            ]
        )
    )


def _channel_error_covariance(
    snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray, phase_std_rad: float
) -> np.ndarray:
    """Return the covariance of the stacked errors of snapshots (n, n_elements)."""
    antennas = snapshots[:, :, None] * aperture.antenna_indicators
    columns = phase_std_rad * np.concatenate(
        [stack_real_and_imaginary(1j * antennas), _GAIN_SHARE * stack_real_and_imaginary(antennas)],
        axis=2,
    )
    power = np.mean(np.abs(snapshots) ** 2, axis=1)
    element_variance = (_ELEMENT_SHARE * phase_std_rad) ** 2 * power + noise_power / 2
    # Relative rounding errors where there is neither: snapshots of zeros have no factor otherwise.
    element_variance = np.maximum(
        element_variance, np.finfo(float).eps * power + np.finfo(float).tiny
    )
    return np.asarray(
        columns @ columns.swapaxes(1, 2)
        + element_variance[:, None, None] * np.eye(2 * snapshots.shape[1])
    )


def _weighted_residuals(
    snapshots: np.ndarray,
    angles: tuple[np.ndarray, ...],
    aperture: Aperture,
    factor: np.ndarray,
) -> np.ndarray:
    """Return the weighted residual of sources (n, k) in snapshots (n, n_elements), (n,).

    `factor` is the Cholesky factor of the covariance. One step of generalised least squares from
    amplitudes and angles of ordinary ones.
    """
    fitted, derivatives = linearise_sources(snapshots, angles, aperture)
    ratio = snapshots / np.where(fitted == 0, np.finfo(float).tiny, fitted)
    ratio = np.where(ratio == 0, np.finfo(float).tiny, ratio)
    columns = np.concatenate(
        [derivatives * ratio[:, :, None], (snapshots * np.log(ratio))[:, :, None]], axis=2
    )
    weighted = np.linalg.solve(factor, stack_real_and_imaginary(columns))
    basis = np.linalg.qr(weighted[:, :, :-1])[0]
    residual = weighted[:, :, -1:]
    residual = residual - basis @ (basis.swapaxes(1, 2) @ residual)
    return np.asarray(np.sum(residual**2, axis=(1, 2)))


def linearise_sources(
    snapshots: np.ndarray, angles: tuple[np.ndarray, ...], aperture: Aperture
) -> tuple[np.ndarray, np.ndarray]:
    """Fit amplitudes of k sources at angles (n, k) each to snapshots (n, n_elements).

    Returns the fitted snapshots, and their derivatives by the amplitudes and angles of all sources:
    real parts, imaginary parts, angles; (n, n_elements, 2 k + k n_angles).
    """
    azimuth, elevation = (np.nan_to_num(angle) for angle in angles)
    n, n_elements = snapshots.shape
    steering = aperture.steering_vectors(azimuth, elevation).swapaxes(1, 2)
    amplitudes = np.linalg.pinv(steering) @ snapshots[:, :, None]
    derivatives = aperture.steering_derivatives(azimuth, elevation) * amplitudes[..., None]
    derivatives = derivatives.reshape(n, -1, n_elements).swapaxes(1, 2)
    columns = np.concatenate([steering, 1j * steering, derivatives], axis=2)
    return (steering @ amplitudes)[:, :, 0], columns


def stack_real_and_imaginary(values: np.ndarray) -> np.ndarray:
    """Stack real and imaginary parts of columns (n, n_elements, n_columns)."""
    return np.concatenate([values.real, values.imag], axis=1)
