"""Gain and position errors of array elements, fitted to echoes from known directions."""

from dataclasses import dataclass

import numpy as np

_MAX_ITERATIONS = 30
# Spread of directions, in sines, below which a position error equals a phase error: 1 degree.
_MIN_SPREAD = 0.017
# Singular value ratio below which two axes count as one.
_MIN_SINGULAR_RATIO = 0.05


@dataclass(frozen=True)
class ElementErrors:
    """Differences between the actual and the expected elements of an array."""

    channel: np.ndarray
    """Complex factor of each channel on the echo, except for a common factor, (n,)."""
    channel_std: np.ndarray
    """Relative standard deviation of the amplitude, and of the phase in radians, (n,)."""
    position_m: np.ndarray
    """Position errors (n, 3); 0 along unobservable axes, and 0 in the mean."""
    position_std_m: np.ndarray
    """Standard deviations (n, 3); 0 where nothing was estimated."""
    residual: float
    """Unbiased root mean square of the misfit relative to the echo; noise only if there are as
    many unknowns as values."""
    noise: float
    """Root mean square of the noise relative to the echo."""


def fit_element_errors(
    snapshots: np.ndarray,
    noise_power: np.ndarray,
    expected: np.ndarray,
    unit_vectors: np.ndarray,
    wavelength_m: float,
) -> ElementErrors:
    r"""Fit channels and positions to echoes from known directions by least squares.

    .. math:: x_{k,i} = s_k\, c_i\, b_{k,i}\, e^{-2\pi\mathrm{i}\, u_k \cdot d_i / \lambda} + w

    with the echo amplitude s of each snapshot k, the channel c and the position error d of each
    element i. With d known, the leading singular vectors of x / b are s and c; with both known, d
    is a weighted least-squares fit to phases; both in turn, about the mean direction, so that
    channels and positions hardly depend on each other. Errors must be small: d across the spread of
    directions changes phases by less than half a cycle.

    Not observable: a factor common to all channels and a shift common to all positions, both of
    which are the phase of the echo; and positions along an axis on which the directions do not
    differ, as on all axes for a single direction. Forward errors are taken as 0: across a board
    they are negligible, and directions hardly differ along x. A rotation common to all given
    directions appears as a rotation of the array.

    Parameters
    ----------
    snapshots : array (n_snapshots, n), complex
    noise_power : array (n_snapshots,)
        Noise power E|w|^2 in each value.
    expected : array (n_snapshots, n), complex
        b, the snapshots of an ideal array, near-field effects included.
    unit_vectors : array (n_snapshots, 3)
        u, unit vectors to the reflector.

    References
    ----------
    B. C. Ng and C. M. S. See, Sensor-array calibration using a maximum-likelihood approach, IEEE
    Trans. Antennas and Propagation 44(6), 1996.
    """
    n_snapshots, n = snapshots.shape
    per_m = 2 * np.pi / wavelength_m
    is_observable = (
        np.sqrt(np.mean((unit_vectors - unit_vectors.mean(axis=0)) ** 2, axis=0)) > _MIN_SPREAD
    )
    is_observable[0] = False
    # Snapshots are weighted by their SNR.
    normalised = snapshots / expected / np.sqrt(noise_power)[:, None]
    position_m, step_m = np.zeros((n, 3)), np.full((n, 3), np.inf)
    mean_vector = unit_vectors.mean(axis=0)
    for _ in range(_MAX_ITERATIONS):
        corrected = normalised * np.exp(1j * per_m * (unit_vectors - mean_vector) @ position_m.T)
        left_vectors, singular_values, right_vectors = np.linalg.svd(corrected, full_matrices=False)
        echo, channel = left_vectors[:, 0] * singular_values[0], right_vectors[0]
        if not is_observable.any() or abs(step_m).max() * per_m < 1e-6:
            break
        weight = abs(echo) ** 2 / np.sum(abs(echo) ** 2)
        mean_vector = weight @ unit_vectors
        spread = (unit_vectors - mean_vector)[:, is_observable] * np.sqrt(weight)[:, None]
        phases = np.angle(corrected / np.outer(echo, channel)) * np.sqrt(weight)[:, None]
        step = np.linalg.pinv(spread, rcond=_MIN_SINGULAR_RATIO) @ phases / -per_m
        step_m = np.zeros((n, 3))
        step_m[:, is_observable] = step.T - step.T.mean(axis=0)
        position_m += step_m
    misfit = abs(corrected - np.outer(echo, channel)) ** 2 / abs(echo[:, None]) ** 2 * n

    snr = abs(np.outer(echo, channel)) ** 2
    phase_variance = 1 / (2 * snr.sum(axis=0))
    covariance, rank = np.zeros((3, 3)), 0
    if is_observable.any():
        rank = int(
            np.linalg.matrix_rank(spread, tol=_MIN_SINGULAR_RATIO * np.linalg.norm(spread, 2))
        )
        covariance[np.ix_(is_observable, is_observable)] = np.linalg.pinv(
            spread.T @ spread, rcond=_MIN_SINGULAR_RATIO**2
        )
    n_free = 2 * n_snapshots * n - 2 * (n_snapshots + n - 1) - (n - 1) * rank
    noise = float(np.sqrt(np.mean(1 / snr)))
    return ElementErrors(
        # convert from the mean direction back to boresight
        channel=channel * np.exp(1j * per_m * position_m @ mean_vector),
        channel_std=np.sqrt(phase_variance * (1 + mean_vector @ covariance @ mean_vector)),
        position_m=position_m,
        position_std_m=np.sqrt(np.outer(phase_variance, np.diag(covariance))) / per_m,
        residual=float(np.sqrt(2 * misfit.sum() / n_free)) if n_free > 0 else noise,
        noise=noise,
    )
