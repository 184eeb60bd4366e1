"""Motion models of targets in the plane: straight motion and the coordinated turn.

States are x, vx, y, vy and the turn rate w, in m, m/s and rad/s. All functions take stacks of
means (..., 5) and covariances (..., 5, 5).
"""

import numpy as np

N_STATES = 5
X, VX, Y, VY, TURN_RATE = range(N_STATES)


def predict_straight_motion(
    mean: np.ndarray,
    covariance: np.ndarray,
    interval_s: float,
    *,
    process_noise_m2_per_s3: float,
    turn_rate_std_rad_per_s: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Predict states that keep their velocity but for white acceleration.

    The turn rate has no effect. Its estimate is replaced by the prior of a turn that may start
    later: zero mean, and the given standard deviation.
    """
    transition = np.eye(N_STATES)
    transition[[X, Y], [VX, VY]] = interval_s
    transition[TURN_RATE, TURN_RATE] = 0.0
    noise = white_acceleration_covariance(interval_s, process_noise_m2_per_s3, N_STATES)
    noise[TURN_RATE, TURN_RATE] = turn_rate_std_rad_per_s**2
    return mean @ transition.T, transition @ covariance @ transition.T + noise


def predict_coordinated_turn(
    mean: np.ndarray,
    covariance: np.ndarray,
    interval_s: float,
    *,
    process_noise_m2_per_s3: float,
    turn_rate_std_rad_per_s: float,
    turn_time_s: float,
) -> tuple[np.ndarray, np.ndarray]:
    r"""Predict states on a circle, linearised at the mean.

    .. math:: \dot x = v_x,\quad \dot v_x = -\omega v_y,\quad
              \dot y = v_y,\quad \dot v_y = \omega v_x

    White acceleration is added. The turn rate is an Ornstein-Uhlenbeck process of the given
    standard deviation and correlation time.

    References
    ----------
    Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and
    Navigation, Wiley, 2001, 11.7.
    """
    decay = np.exp(-interval_s / turn_time_s)
    vx, vy, turn_rate = mean[..., VX], mean[..., VY], mean[..., TURN_RATE]
    angle = turn_rate * interval_s
    cos, sin = np.cos(angle), np.sin(angle)
    along = interval_s * np.sinc(angle / np.pi)  # sin(w T) / w
    across = interval_s * angle / 2 * np.sinc(angle / (2 * np.pi)) ** 2  # (1 - cos(w T)) / w
    # The series replaces 0 / 0; its error is below 1e-9 T^2.
    is_small = np.abs(angle) < 1e-4
    divisor = np.where(is_small, 1.0, turn_rate)
    along_slope = np.where(
        is_small, -(interval_s**2) * angle / 3, (interval_s * cos - along) / divisor
    )
    across_slope = np.where(is_small, interval_s**2 / 2, (interval_s * sin - across) / divisor)

    jacobian = np.zeros((*mean.shape, N_STATES))
    jacobian[..., X, X] = jacobian[..., Y, Y] = 1.0
    jacobian[..., X, VX] = jacobian[..., Y, VY] = along
    jacobian[..., X, VY], jacobian[..., Y, VX] = -across, across
    jacobian[..., VX, VX] = jacobian[..., VY, VY] = cos
    jacobian[..., VX, VY], jacobian[..., VY, VX] = -sin, sin
    jacobian[..., TURN_RATE, TURN_RATE] = decay
    # The motion is linear but for the turn rate, so its column does not enter the mean.
    predicted = np.einsum("...ij,...j->...i", jacobian, mean)
    jacobian[..., X, TURN_RATE] = along_slope * vx - across_slope * vy
    jacobian[..., Y, TURN_RATE] = across_slope * vx + along_slope * vy
    jacobian[..., VX, TURN_RATE] = -interval_s * (sin * vx + cos * vy)
    jacobian[..., VY, TURN_RATE] = interval_s * (cos * vx - sin * vy)

    noise = white_acceleration_covariance(interval_s, process_noise_m2_per_s3, N_STATES)
    noise[TURN_RATE, TURN_RATE] = turn_rate_std_rad_per_s**2 * (1 - decay**2)
    return predicted, jacobian @ covariance @ jacobian.swapaxes(-1, -2) + noise


def white_acceleration_covariance(
    interval_s: float, density_m2_per_s3: float, n_states: int
) -> np.ndarray:
    """Compute the covariance that white acceleration along x and y adds in an interval.

    For the first `n_states` of the states of this module.
    """
    covariance = np.zeros((n_states, n_states))
    for position, velocity in ((X, VX), (Y, VY)):
        covariance[position, position] = density_m2_per_s3 * interval_s**3 / 3
        covariance[position, velocity] = density_m2_per_s3 * interval_s**2 / 2
        covariance[velocity, position] = covariance[position, velocity]
        covariance[velocity, velocity] = density_m2_per_s3 * interval_s
    return covariance
