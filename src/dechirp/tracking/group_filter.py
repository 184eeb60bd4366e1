r"""Filter of extended objects: random-matrix extent, interacting motion models.

An object has a centre, which moves, and an extent X, the covariance of its points about the
centre. Of n points in a frame, with errors R, the mean has the covariance Y / n, Y = X + R. Their
range rates are those of a rigid object, with a spread. A point p of an object with the centre c
that turns with the rate w moves with v + w J (p - c), J = ((0, -1), (1, 0)). Its position is along
its line of sight u, so u' J p = 0, and the range rate is

    d = u' (v - w J c),

which differs from point to point as if the object moved with the velocity v - w J c of the rigid
body extended to the radar. Rates alone cannot separate the two terms: a turn of 0.35 rad/s at 21 m
is like a velocity of 7 m/s across the line of sight. The extended Kalman filter of the coordinated
turn uses the turn rate of its state; other models do not turn. All enters the filter as information
about the states, so any number of points costs one update of five states.

The extent follows from the scatter of the points and of the innovation about it, each scaled from
its covariance to X: with the scatter matrix Z and W = X^(1/2) Y^(-1/2), n points add W Z W'.
Earlier points fade with the time constant of the extent. A few points of the expected size are
the prior.

J. W. Koch, Bayesian approach to extended object and cluster tracking using random matrices, IEEE
Transactions on Aerospace and Electronic Systems 44(3), 2008. M. Feldmann, D. Fraenken, W. Koch,
Tracking of extended objects and group targets using random matrices, IEEE Transactions on Signal
Processing 59(4), 2011.

Stone Soup 1.9 has neither random matrices nor interacting models, so all groups and models are
updated here at once, as stacks of small matrices.
"""

from typing import NamedTuple

import numpy as np
import scipy

from dechirp.core.memory import check_free_memory
from dechirp.tracking.group_points import GroupPoints
from dechirp.tracking.group_tracker import GroupTracker
from dechirp.tracking.interacting_models import (
    combine_models,
    mix_models,
    switching_probabilities,
    update_model_probabilities,
)
from dechirp.tracking.motion_models import (
    N_STATES,
    TURN_RATE,
    VX,
    VY,
    X,
    Y,
    predict_coordinated_turn,
    predict_straight_motion,
)

_N_MODELS = 3  # straight, turning, manoeuvring
_TURNS = np.array([0.0, 1.0, 0.0])  # 1 for models of objects that turn
_POSITION = [X, Y]
_PRIOR_POINTS = 10.0  # points that the expected size and spread count for
_EXTENT_TIME_S = 1.0
_MIN_SHARE = 0.01
_MIN_RANGE_M = 1e-6  # of points with a line of sight
_PAIR_BYTES = 150.0  # per pair of a point with a group or a point


class Groups(NamedTuple):
    """Estimates of extended objects; the first axis of all arrays counts groups."""

    mean: np.ndarray
    """(n, model, 5): x, vx, y, vy, turn rate."""
    covariance: np.ndarray
    """(n, model, 5, 5)."""
    probability: np.ndarray
    """(n, model)."""
    scatter_m2: np.ndarray
    """(n, 2, 2): sum over faded points of their scatter about the centre, without errors."""
    rate_scatter: np.ndarray
    """(n,): the same of range rates."""
    n_faded: np.ndarray
    """(n,): number of points in these sums."""
    n_faded_frames: np.ndarray
    """(n,): number of frames in these sums."""

    def select_groups(self, rows: np.ndarray) -> "Groups":
        """Return the groups of a mask or of indices."""
        return Groups(*(column[rows] for column in self))

    def append_groups(self, others: "Groups") -> "Groups":
        """Return these groups followed by others."""
        return Groups(*(np.concatenate(pair) for pair in zip(self, others, strict=True)))

    def combined_states(self) -> tuple[np.ndarray, np.ndarray]:
        """Return mean (n, 5) and covariance (n, 5, 5) over all motion models."""
        return combine_models(self.mean, self.covariance, self.probability)


def estimate_extents(groups: Groups, tracker: GroupTracker) -> np.ndarray:
    """Estimate the covariance of the points of each object about its centre, (n, 2, 2)."""
    prior = _PRIOR_POINTS * tracker.size_std_m**2 * np.eye(2)
    extent: np.ndarray = (prior + groups.scatter_m2) / (_PRIOR_POINTS + groups.n_faded)[
        :, None, None
    ]
    return extent


def _rate_spread_variances(groups: Groups, tracker: GroupTracker) -> np.ndarray:
    prior = _PRIOR_POINTS * tracker.velocity_spread_m_per_s**2
    variance: np.ndarray = (prior + groups.rate_scatter) / (_PRIOR_POINTS + groups.n_faded)
    return variance


def predict_groups(groups: Groups, interval_s: float, tracker: GroupTracker) -> Groups:
    """Predict groups over an interval; extents turn with their objects, and fade."""
    mean, covariance, probability = mix_models(
        groups.mean,
        groups.covariance,
        groups.probability,
        switching_probabilities(_N_MODELS, interval_s, tracker.model_time_s),
    )
    turn_rate_std = {"turn_rate_std_rad_per_s": tracker.turn_rate_std_rad_per_s}
    predictions = (
        predict_straight_motion(
            mean[:, 0],
            covariance[:, 0],
            interval_s,
            process_noise_m2_per_s3=tracker.process_noise_m2_per_s3,
            **turn_rate_std,
        ),
        predict_coordinated_turn(
            mean[:, 1],
            covariance[:, 1],
            interval_s,
            process_noise_m2_per_s3=tracker.process_noise_m2_per_s3,
            turn_time_s=tracker.model_time_s,
            **turn_rate_std,
        ),
        predict_straight_motion(
            mean[:, 2],
            covariance[:, 2],
            interval_s,
            process_noise_m2_per_s3=tracker.manoeuvre_noise_m2_per_s3,
            **turn_rate_std,
        ),
    )
    angle = interval_s * np.einsum("tm,tm->t", probability, mean[:, :, TURN_RATE])
    cos, sin = np.cos(angle), np.sin(angle)
    rotation = np.stack([cos, -sin, sin, cos], axis=-1).reshape(-1, 2, 2)
    fade = np.exp(-interval_s / _EXTENT_TIME_S)
    return Groups(
        mean=np.stack([mean for mean, _ in predictions], axis=1),
        covariance=np.stack([covariance for _, covariance in predictions], axis=1),
        probability=probability,
        scatter_m2=fade * rotation @ groups.scatter_m2 @ rotation.swapaxes(1, 2),
        rate_scatter=fade * groups.rate_scatter,
        n_faded=fade * groups.n_faded,
        n_faded_frames=fade * groups.n_faded_frames,
    )


def associate_points(groups: Groups, points: GroupPoints, tracker: GroupTracker) -> np.ndarray:
    """Compute the probability that each point belongs to each group, (n_groups, n).

    The probabilities of a point add up to 1, or are 0 outside all gates. A gate is that of any
    motion model, so that an object that swerves keeps its points.
    """
    n_points, n_groups = len(points.position_m), len(groups.mean)
    if not n_points or not n_groups:
        return np.zeros((n_groups, n_points))
    check_free_memory(
        "the pairs of groups and points",
        needed_bytes=_PAIR_BYTES * n_points * n_groups,
        fix="raise the threshold of the detector",
    )
    velocity, velocity_covariance, _ = _velocities_at_radar(groups)
    offset = points.position_m - groups.mean[..., None, _POSITION]
    expected = (
        groups.covariance[..., [[X], [Y]], _POSITION] + estimate_extents(groups, tracker)[:, None]
    )
    spread = expected[:, :, None] + points.position_covariance
    determinant = spread[..., 0, 0] * spread[..., 1, 1] - spread[..., 0, 1] ** 2
    distance2 = (
        spread[..., 1, 1] * offset[..., 0] ** 2
        + spread[..., 0, 0] * offset[..., 1] ** 2
        - 2 * spread[..., 0, 1] * offset[..., 0] * offset[..., 1]
    ) / determinant
    residual = _rate_residuals(velocity, points)
    spread_variance = _rate_spread_variances(groups, tracker)[:, None, None]
    variance = _rate_variances(velocity, velocity_covariance, points, spread_variance)
    is_known = np.isfinite(points.rate_m_per_s)
    is_usable = is_known & (4 * np.sqrt(variance) < points.span_m_per_s / 2)
    distance2 += np.where(is_usable, residual**2 / variance, 0.0)
    gates = scipy.special.chdtri([2, 3], 1 - tracker.gate_probability)
    gate = np.where(is_usable, gates[1], gates[0])
    # A known rate that a group cannot unfold is uniform over its span.
    rate_width2 = np.where(is_usable, 2 * np.pi * variance, points.span_m_per_s**2)
    log_density = (
        -(distance2 + np.log(determinant) + np.where(is_known, np.log(rate_width2), 0.0)) / 2
    )
    # An object has a Poisson number of points, with the mean of the frames before.
    mean_count = (groups.n_faded + tracker.min_points) / (groups.n_faded_frames + 1)
    weight = groups.probability * mean_count[:, None]
    score = scipy.special.logsumexp(log_density, axis=1, b=weight[..., None])
    score[~(distance2 <= gate).any(axis=1)] = -np.inf
    is_gated = np.isfinite(score).any(axis=0)
    share = np.zeros_like(score)
    share[:, is_gated] = scipy.special.softmax(score[:, is_gated], axis=0)
    # Shares below 1 % are noise of the model, but would count as points.
    share[share < _MIN_SHARE] = 0.0
    share[:, is_gated] /= share[:, is_gated].sum(axis=0)
    return share


def _velocities_at_radar(groups: Groups) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compute the velocity v - w J c of each rigid body extended to the radar.

    Returns
    -------
    velocity : array (n, model, 2)
    covariance : array (n, model, 2, 2)
    jacobian : array (n, model, 2, 5)
        Derivatives of the velocity with respect to the states.
    """
    x, vx, y, vy, turn_rate = np.moveaxis(groups.mean, -1, 0)
    turn_rate = turn_rate * _TURNS
    jacobian = np.zeros((*groups.mean.shape[:2], 2, N_STATES))
    jacobian[..., 0, VX] = jacobian[..., 1, VY] = 1.0
    jacobian[..., 0, Y], jacobian[..., 1, X] = turn_rate, -turn_rate
    jacobian[..., 0, TURN_RATE], jacobian[..., 1, TURN_RATE] = y * _TURNS, -x * _TURNS
    velocity = np.stack([vx + turn_rate * y, vy - turn_rate * x], axis=-1)
    return velocity, jacobian @ groups.covariance @ jacobian.swapaxes(-1, -2), jacobian


def _combined_velocities_at_radar(groups: Groups) -> tuple[np.ndarray, np.ndarray]:
    """Compute their mean (n, 2) and covariance (n, 2, 2) over all motion models."""
    velocity, covariance, _ = _velocities_at_radar(groups)
    return combine_models(velocity, covariance, groups.probability)


def _range_rates(velocity: np.ndarray, line_of_sight: np.ndarray) -> np.ndarray:
    """Compute the rates (..., n) of velocities (..., 2) along lines of sight (..., n, 2)."""
    rate: np.ndarray = (line_of_sight @ velocity[..., None])[..., 0]
    return rate


def _rate_residuals(velocity: np.ndarray, points: GroupPoints) -> np.ndarray:
    """Compute measured minus expected rates of points (..., n), modulo ambiguous spans."""
    residual = points.rate_m_per_s - _range_rates(velocity, points.line_of_sight)
    is_ambiguous = np.isfinite(points.span_m_per_s)
    if is_ambiguous.any():
        span = np.where(is_ambiguous, points.span_m_per_s, 1.0)
        residual -= np.where(is_ambiguous, span * np.round(residual / span), 0.0)
    return residual


def _rate_variances(
    velocity: np.ndarray,
    covariance: np.ndarray | None,
    points: GroupPoints,
    spread_variance: np.ndarray,
) -> np.ndarray:
    """Compute variances of rates about those of a rigid object, (..., n).

    An azimuth error d changes the rate by the speed across the line of sight times d. The
    covariance of the velocities, if given, adds that of the expected rate.
    """
    ux, uy = np.moveaxis(points.line_of_sight, -1, 0)
    across = velocity[..., 1:] * ux - velocity[..., :1] * uy
    variance: np.ndarray = (
        points.rate_variance + spread_variance + across**2 * points.azimuth_variance
    )
    if covariance is not None:
        variance += covariance[..., 0, 0, None] * ux**2 + covariance[..., 1, 1, None] * uy**2
        variance += 2 * covariance[..., 0, 1, None] * ux * uy
    return variance


def _likely_points(
    points: GroupPoints, centroid: np.ndarray, extent: np.ndarray, error: np.ndarray
) -> GroupPoints:
    """Return the points with the lines of sight (n_groups, n, 2) that are likely in each group.

    An azimuth error is a part of the distance from the centre. With lines of sight as measured, the
    regression of rates would give a slope over azimuth that is too small. Of points with the
    covariance X about the centre and errors R, a share X (X + R)^-1 of the distance remains, with
    errors of the covariance X (X + R)^-1 R.
    """
    gain = extent @ np.linalg.inv(extent + error)
    position = centroid[:, None] + (points.position_m - centroid[:, None]) @ gain.swapaxes(1, 2)
    range_m = np.maximum(np.hypot(position[..., 0], position[..., 1]), _MIN_RANGE_M)
    line_of_sight = position / range_m[..., None]
    across = np.stack([-line_of_sight[..., 1], line_of_sight[..., 0]], axis=-1)
    variance_m2 = np.einsum("tni,tij,tnj->tn", across, gain @ error, across)
    return points._replace(line_of_sight=line_of_sight, azimuth_variance=variance_m2 / range_m**2)


def update_groups(
    groups: Groups, points: GroupPoints, share: np.ndarray, tracker: GroupTracker
) -> Groups:
    """Update groups with their points; groups without points are as predicted.

    Parameters
    ----------
    share : array (n_groups, n)
        Probability that a point belongs to a group, from `associate_points`.
    """
    count = share.sum(axis=1)
    n = np.where(count > 0, count, 1.0)
    extent = estimate_extents(groups, tracker)
    centroid = share @ points.position_m / n[:, None]
    error = np.tensordot(share, points.position_covariance, axes=1) / n[:, None, None]
    point_covariance = extent + error
    predicted, predicted_covariance = groups.combined_states()
    likely_points = _likely_points(points, centroid, extent, error)
    line_of_sight = likely_points.line_of_sight
    velocity, velocity_covariance = _combined_velocities_at_radar(groups)
    spread_variance = _rate_spread_variances(groups, tracker)
    # Ambiguous rates are unfolded about the combined prediction, for all models alike; those
    # that it cannot unfold are not used.
    rate = _rate_residuals(velocity, likely_points) + _range_rates(velocity, line_of_sight)
    variance = _rate_variances(velocity, None, likely_points, spread_variance[:, None])
    total = _rate_variances(velocity, velocity_covariance, likely_points, spread_variance[:, None])
    is_usable = np.isfinite(rate) & (4 * np.sqrt(total) < points.span_m_per_s / 2)
    rate_weight = np.where(is_usable, share / variance, 0.0)
    rate = np.where(is_usable, rate, 0.0)
    updated = _update_states(
        groups,
        line_of_sight,
        centroid=centroid,
        position_information=count[:, None, None] * np.linalg.inv(point_covariance),
        rate=rate,
        rate_weight=rate_weight,
    )
    # Scatter of the points and of the innovation of their mean, scaled to the extent.
    deviation = points.position_m - centroid[:, None]
    innovation = (centroid - predicted[:, _POSITION]) * (count > 0)[:, None]
    centroid_covariance = point_covariance / n[:, None, None]
    centroid_covariance += predicted_covariance[:, [[X], [Y]], _POSITION]
    root = _matrix_powers(extent, 0.5)
    scatter = _congruence(
        root @ _matrix_powers(point_covariance, -0.5),
        (share[..., None] * deviation).swapaxes(1, 2) @ deviation,
    ) + _congruence(
        root @ _matrix_powers(centroid_covariance, -0.5),
        innovation[:, :, None] * innovation[:, None],
    )
    velocity, _ = _combined_velocities_at_radar(updated)
    residual = rate - _range_rates(velocity, line_of_sight)
    # Rates that are not used leave the spread as it is.
    relative_square = np.sum(np.where(is_usable, rate_weight * residual**2, share), axis=1)
    return updated._replace(
        scatter_m2=groups.scatter_m2 + scatter,
        rate_scatter=groups.rate_scatter + spread_variance * relative_square,
        n_faded=groups.n_faded + count,
        n_faded_frames=groups.n_faded_frames + 1,
    )


def _update_states(
    groups: Groups,
    line_of_sight: np.ndarray,
    *,
    centroid: np.ndarray,
    position_information: np.ndarray,
    rate: np.ndarray,
    rate_weight: np.ndarray,
) -> Groups:
    """Update states and probabilities of all motion models.

    With the information J of the points and its gradient g at the mean of a model, the covariance
    becomes (P^-1 + J)^-1 = (1 + P J)^-1 P, and the mean moves by that times g.
    """
    velocity, _, jacobian = _velocities_at_radar(groups)
    rate_information = (rate_weight[..., None] * line_of_sight).swapaxes(1, 2) @ line_of_sight
    information = jacobian.swapaxes(-1, -2) @ rate_information[:, None] @ jacobian
    information[..., [[X], [Y]], _POSITION] += position_information[:, None]
    offset = centroid[:, None] - groups.mean[..., _POSITION]
    residual = rate[:, None] - _range_rates(velocity, line_of_sight[:, None])
    weighted = rate_weight[:, None] * residual
    gradient = np.einsum("tmi,tmij->tmj", weighted @ line_of_sight, jacobian)
    gradient[..., _POSITION] += offset @ position_information
    gain = np.eye(N_STATES) + groups.covariance @ information
    covariance = np.linalg.solve(gain, groups.covariance)
    covariance = (covariance + covariance.swapaxes(-1, -2)) / 2
    step = np.einsum("tmij,tmj->tmi", covariance, gradient)
    mismatch = np.sum(weighted * residual, axis=-1)
    mismatch += np.einsum("tmi,tij,tmj->tm", offset, position_information, offset)
    log_likelihood = (
        np.einsum("tmi,tmi->tm", gradient, step) - mismatch - np.linalg.slogdet(gain)[1]
    ) / 2
    return groups._replace(
        mean=groups.mean + step,
        covariance=covariance,
        probability=update_model_probabilities(groups.probability, log_likelihood),
    )


def _congruence(matrices: np.ndarray, inner: np.ndarray) -> np.ndarray:
    product: np.ndarray = matrices @ inner @ matrices.swapaxes(1, 2)
    return product


def _matrix_powers(matrices: np.ndarray, exponent: float) -> np.ndarray:
    """Compute powers of symmetric positive definite matrices (n, 2, 2)."""
    values, vectors = np.linalg.eigh(matrices)
    powers: np.ndarray = (vectors * values[:, None] ** exponent) @ vectors.swapaxes(1, 2)
    return powers


def start_groups(points: GroupPoints, index: np.ndarray, tracker: GroupTracker) -> Groups:
    """Start a group from the points of each index, 0 and above."""
    n = int(index.max(initial=-1)) + 1
    share = (index == np.arange(n)[:, None]).astype(float)
    count = share.sum(axis=1)
    centroid = share @ points.position_m / count[:, None]
    error = np.tensordot(share, points.position_covariance, axes=1) / count[:, None, None]
    mean = np.zeros((n, _N_MODELS, N_STATES))
    covariance = np.zeros((n, _N_MODELS, N_STATES, N_STATES))
    for axis, state in enumerate(_POSITION):
        mean[..., state] = centroid[:, axis, None]
        # Almost no prior knowledge of the position: 100 times the error of the first centroid.
        variance = (tracker.size_std_m**2 + error[:, axis, axis]) / count
        covariance[..., state, state] = 1e4 * variance[:, None]
    covariance[..., VX, VX] = covariance[..., VY, VY] = tracker.speed_std_m_per_s**2
    covariance[..., TURN_RATE, TURN_RATE] = tracker.turn_rate_std_rad_per_s**2
    prior = Groups(
        mean=mean,
        covariance=covariance,
        probability=np.full((n, _N_MODELS), 1 / _N_MODELS),
        scatter_m2=np.zeros((n, 2, 2)),
        rate_scatter=np.zeros(n),
        n_faded=np.zeros(n),
        n_faded_frames=np.zeros(n),
    )
    return update_groups(prior, points, share, tracker)
