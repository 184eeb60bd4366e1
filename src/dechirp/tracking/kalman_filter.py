"""Kalman filter of many tracks at once, with azimuth, range and range rate as measurements.

States are x, vx, y, vy over the plane, in m and m/s. Motion is straight but for white acceleration.
States of bodies have two more: the offset of the echo from the centre of the body, along x and y.
It stays nearly the same from frame to frame, so that it does not average out like a white
measurement error: it is a Gauss-Markov process with the covariance of the body's size. Its mean is
on the side of the radar, since bodies hide their far side.

Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation,
Wiley, 2001, 8.4 (autocorrelated measurement errors, by augmented states).
"""

from typing import NamedTuple

import numpy as np

from dechirp.tracking.motion_models import white_acceleration_covariance
from dechirp.tracking.poses import RadarPose

N_BODY_STATES = 6
_OFFSETS = [4, 5]
_OFFSET_TIME_S = 4.0  # in which a vehicle that passes or turns shows other parts


class StateEstimates(NamedTuple):
    """Means (n, 4) and covariances (n, 4, 4) of x, vx, y, vy; of bodies (n, 6) and (n, 6, 6)."""

    mean: np.ndarray
    covariance: np.ndarray


class BodyOffsets(NamedTuple):
    """Distribution of the offsets of echoes from the centres of their bodies, along x and y."""

    mean_m: np.ndarray
    """(n, 2)."""
    covariance_m2: np.ndarray
    """(n, 2, 2)."""


class PredictedMeasurements(NamedTuple):
    """Measurements (azimuth, range, rate) expected of tracks, without the errors of detections."""

    mean: np.ndarray
    """(n_tracks, 3)."""
    covariance: np.ndarray
    """(n_tracks, 3, 3)."""
    cross_covariance: np.ndarray
    """(n_tracks, n_states, 3): of the states and the measurements."""


def predict_states(
    states: StateEstimates,
    interval_s: float,
    process_noise_m2_per_s3: float,
    offsets: BodyOffsets | None = None,
) -> StateEstimates:
    """Predict states over an interval; offsets of bodies tend to `offsets`."""
    n_states = states.mean.shape[1]
    transition = np.eye(n_states)
    transition[[0, 2], [1, 3]] = interval_s
    noise = white_acceleration_covariance(interval_s, process_noise_m2_per_s3, n_states)
    decay = np.exp(-interval_s / _OFFSET_TIME_S)
    if offsets is not None:
        transition[_OFFSETS, _OFFSETS] = decay
        noise = np.repeat(noise[None], len(offsets.mean_m), axis=0)
        noise[:, 4:, 4:] += (1 - decay**2) * offsets.covariance_m2
    mean = states.mean @ transition.T
    if offsets is not None:
        mean[:, 4:] += (1 - decay) * offsets.mean_m
    return StateEstimates(mean, transition @ states.covariance @ transition.T + noise)


def near_side_offsets_m(means: np.ndarray, pose: RadarPose, target_size_m: float) -> np.ndarray:
    """Return offsets (n, 2) of the length `target_size_m` from the echoes of states to the radar.

    `means` are those of bodies, (n, 6), or of their echoes, (n, 4). A body hides its far side, so
    its echo is nearer than its centre: by half the width of a vehicle beside the radar, half the
    length of one ahead.
    """
    from_radar_m = _echo_states(means)[:, [0, 2]] - pose.position_m
    range_m = np.maximum(np.linalg.norm(from_radar_m, axis=1, keepdims=True), 1e-9)
    return np.asarray(-target_size_m * from_radar_m / range_m)


def states_relative_to_radar(states: StateEstimates, pose: RadarPose) -> StateEstimates:
    """Return states with position and velocity relative to a radar, in axes that are not turned."""
    (x_m, y_m), (vx, vy) = pose.position_m, pose.velocity_m_per_s
    mean = states.mean.copy()
    mean[:, :4] -= [x_m, vx, y_m, vy]
    return StateEstimates(mean, states.covariance)


def predict_linearised_measurements(states: StateEstimates) -> PredictedMeasurements:
    """Predict the measurement of each state to first order, with exact derivatives."""
    x, vx, y, vy = _echo_states(states.mean).T
    range_m = np.hypot(x, y)
    cosine, sine = x / range_m, y / range_m
    turn_rad_per_s = (cosine * vy - sine * vx) / range_m
    zero = np.zeros_like(x)
    rows = [
        [-sine / range_m, zero, cosine / range_m, zero],
        [cosine, zero, sine, zero],
        [-sine * turn_rad_per_s, cosine, cosine * turn_rad_per_s, sine],
    ]
    if states.mean.shape[1] == N_BODY_STATES:
        rows = [[*row, row[0], row[2]] for row in rows]
    jacobian = np.moveaxis(np.array(rows), -1, 0)
    cross_covariance = states.covariance @ jacobian.swapaxes(1, 2)
    return PredictedMeasurements(
        mean=_measure(states.mean),
        covariance=jacobian @ cross_covariance,
        cross_covariance=cross_covariance,
    )


def predict_sigma_point_measurements(states: StateEstimates) -> PredictedMeasurements:
    r"""Predict the measurement of each state from sigma points (unscented transform).

    The points are the mean and, for each column :math:`\sigma_i` of the Cholesky factor of the
    covariance of n states, :math:`\mu \pm \sqrt n \sigma_i`, with equal weights of 1 / 2n. The mean
    itself has weight 0 in the mean and 2 in the covariance: alpha 1, beta 2, kappa 0. No weight is
    negative, or covariances could lose their sign: those with kappa -1 did, once in 4,000 frames.

    References
    ----------
    E. A. Wan, R. van der Merwe, The Unscented Kalman Filter for Nonlinear Estimation, 2000.
    """
    n_states = states.mean.shape[1]
    steps = np.sqrt(n_states) * _square_roots(states.covariance).swapaxes(1, 2)
    offsets = np.concatenate([np.zeros_like(steps[:, :1]), steps, -steps], axis=1)
    measured = _measure(states.mean[:, None] + offsets)
    mean = measured[:, 1:].mean(axis=1)
    mean[:, 0] = np.angle(np.exp(1j * measured[:, 1:, 0]).sum(axis=1))
    residual = measured - mean[:, None]
    residual[..., 0] = wrap_angles(residual[..., 0])
    weighted = residual / (2 * n_states)
    weighted[:, 0] = 2 * residual[:, 0]
    return PredictedMeasurements(
        mean=mean,
        covariance=residual.swapaxes(1, 2) @ weighted,
        cross_covariance=offsets.swapaxes(1, 2) @ weighted,
    )


def update_states(
    states: StateEstimates,
    track: np.ndarray,
    residual: np.ndarray,
    covariance: np.ndarray,
    cross_covariance: np.ndarray,
    share: np.ndarray,
) -> StateEstimates:
    """Update predicted states with pairs of a track and a detection, (n_pairs, ...) each.

    A state becomes the mean and the covariance of a mixture: of the updates with its detections,
    weighted by their shares, and of the prediction with the remaining probability. Pairs of a track
    have a residual (3,), its covariance (3, 3), and the cross-covariance (n_states, 3) of state and
    measurement.
    """
    gain = np.linalg.solve(covariance, cross_covariance.swapaxes(1, 2)).swapaxes(1, 2)
    shift = np.einsum("pij,pj->pi", gain, residual)
    mean_shift = np.zeros_like(states.mean)
    np.add.at(mean_shift, track, share[:, None] * shift)
    weight = share[:, None, None]
    second_moment = np.zeros_like(states.covariance)
    np.add.at(
        second_moment,
        track,
        weight * (shift[:, :, None] * shift[:, None] - gain @ cross_covariance.swapaxes(1, 2)),
    )
    # Moments about the prediction, then about the mean of the mixture.
    updated = states.covariance + second_moment - mean_shift[:, :, None] * mean_shift[:, None]
    return StateEstimates(states.mean + mean_shift, (updated + updated.swapaxes(1, 2)) / 2)


def wrap_angles(angles_rad: np.ndarray) -> np.ndarray:
    """Return angles in [-pi, pi)."""
    return np.mod(angles_rad + np.pi, 2 * np.pi) - np.pi


def _measure(states: np.ndarray) -> np.ndarray:
    """Return azimuth, range and range rate (..., 3) of states (..., 4 or 6)."""
    x, vx, y, vy = np.moveaxis(_echo_states(states), -1, 0)
    range_m = np.hypot(x, y)
    return np.stack([np.arctan2(y, x), range_m, (x * vx + y * vy) / range_m], axis=-1)


def _echo_states(states: np.ndarray) -> np.ndarray:
    """Return position and velocity (..., 4) of the echoes of states (..., 4 or 6)."""
    if states.shape[-1] != N_BODY_STATES:
        return states
    echoes = states[..., :4].copy()
    echoes[..., [0, 2]] += states[..., _OFFSETS]
    return echoes


def _square_roots(covariance: np.ndarray) -> np.ndarray:
    """Return square matrices whose product with their transpose is the covariance, per state."""
    try:
        return np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:  # rounding has left one without its sign
        variance, axes = np.linalg.eigh(covariance)
        return np.asarray(axes * np.sqrt(np.maximum(variance, 0))[:, None])
