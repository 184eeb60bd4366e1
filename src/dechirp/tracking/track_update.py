"""Update of all tracks with the detections of a frame: prediction, gates, association, update."""

import math
from typing import NamedTuple

import numpy as np
import scipy

from dechirp.core.memory import check_free_memory
from dechirp.tracking.kalman_filter import (
    BodyOffsets,
    PredictedMeasurements,
    StateEstimates,
    near_side_offsets_m,
    predict_linearised_measurements,
    predict_sigma_point_measurements,
    predict_states,
    states_relative_to_radar,
    update_states,
    wrap_angles,
)
from dechirp.tracking.measurements import Measurements
from dechirp.tracking.poses import AT_ORIGIN, RadarPose
from dechirp.tracking.tracker import Tracker

_LATERAL_ACCELERATION_M_PER_S2, _TURN_RADIUS_M = 2.0, 8.0  # of usual and of the tightest turns
MAX_TURN_RATE_RAD_PER_S = math.sqrt(_LATERAL_ACCELERATION_M_PER_S2 / _TURN_RADIUS_M)
"""Largest standard deviation of turn rates of vehicles, at 4 m/s."""
_PAIR_BYTES = 200.0  # per track and detection: covariances, also scaled, and residuals


class UpdateResult(NamedTuple):
    """Result of an update of some tracks with a frame."""

    states: StateEstimates
    """States after the frame."""
    shares: np.ndarray
    """(n_tracks, n_detections): probability, or 0 and 1, that a detection belongs to a track."""


def predict_associate_and_update(
    tracker: Tracker,
    states: StateEstimates,
    interval_s: float,
    measurements: Measurements,
    pose: RadarPose = AT_ORIGIN,
    size_m2: np.ndarray | None = None,
) -> UpdateResult:
    """Predict states over an interval, associate the measurements of a radar, and update.

    `size_m2`, (n_tracks, 2, 2), are the covariances of the offsets of bodies, if states have them.
    """
    offsets = None
    if size_m2 is not None:
        near_m = near_side_offsets_m(states.mean, pose, tracker.target_size_m)
        offsets = BodyOffsets(near_m, size_m2)
    predicted = predict_states(states, interval_s, tracker.process_noise_m2_per_s3, offsets)
    shares = np.zeros((len(states.mean), len(measurements.z)))
    if not shares.size:
        return UpdateResult(predicted, shares)
    predict_measurements = (
        predict_linearised_measurements
        if tracker.filter == "extended"
        else predict_sigma_point_measurements
    )
    expected = predict_measurements(states_relative_to_radar(predicted, pose))
    expected.mean[:, 0] -= pose.yaw_rad
    residual, covariance, has_rate = _innovations_and_covariances(
        expected, measurements, tracker, predicted.mean[:, [1, 3]]
    )
    distance2 = np.einsum(
        "tni,tni->tn", residual, np.linalg.solve(covariance, residual[..., None])[..., 0]
    )
    log_density = -distance2 / 2 - np.linalg.slogdet(2 * np.pi * covariance)[1] / 2
    weight = tracker.detection_probability / tracker.false_alarms.density_per_m_rad_m_per_s
    is_gated = distance2 <= scipy.special.chdtri(3, 1 - tracker.gate_probability)
    log_weight = np.where(is_gated, np.log(weight) + log_density, -np.inf)
    missed_log_weight = np.log(1 - tracker.hit_probability)
    if tracker.association == "joint":
        from dechirp.tracking.stone_soup import joint_association_probabilities

        shares = joint_association_probabilities(log_weight, missed_log_weight)
    else:
        shares = _likeliest_assignment(log_weight, missed_log_weight)
    pairs = np.nonzero(shares)
    track = pairs[0]
    cross_covariance = expected.cross_covariance[track]
    cross_covariance[..., 2] *= has_rate[pairs][:, None]
    updated = update_states(
        predicted, track, residual[pairs], covariance[pairs], cross_covariance, shares[pairs]
    )
    return UpdateResult(updated, shares)


def _likeliest_assignment(log_weight: np.ndarray, missed_log_weight: float) -> np.ndarray:
    """Return 1 for the pairs of the likeliest assignment of detections to tracks, else 0."""
    n_tracks, n_detections = log_weight.shape
    missed = np.where(np.eye(n_tracks, dtype=bool), missed_log_weight, -np.inf)
    track, choice = scipy.optimize.linear_sum_assignment(
        np.hstack([log_weight, missed]), maximize=True
    )
    shares = np.zeros((n_tracks, n_detections))
    is_hit = choice < n_detections
    shares[track[is_hit], choice[is_hit]] = 1.0
    return shares


def _typical_turn_rates_rad_per_s(velocities: np.ndarray) -> np.ndarray:
    """Return the standard deviations of turn rates of vehicles at velocities (n, 2), (n,)."""
    speeds = np.hypot(*velocities.T)
    fast = np.maximum(speeds, np.sqrt(_LATERAL_ACCELERATION_M_PER_S2 * _TURN_RADIUS_M))
    return np.asarray(_LATERAL_ACCELERATION_M_PER_S2 * speeds / fast**2)


def _innovations_and_covariances(
    expected: PredictedMeasurements,
    measurements: Measurements,
    tracker: Tracker,
    velocities: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compute residuals (n_tracks, n, 3), their covariances, and the mask of usable rates.

    An ambiguous rate is usable if 4 standard deviations are within half a span. Other rates have
    no residual and no gain, and the likelihood of a false alarm. `velocities` are those of the
    tracks, along x and y.
    """
    check_free_memory(
        "the pairs of tracks and detections",
        needed_bytes=_PAIR_BYTES * len(expected.mean) * len(measurements.z),
        fix="raise the threshold of the detector, or cluster its detections",
    )
    residual = measurements.z - expected.mean[:, None]
    residual[..., 0] = wrap_angles(residual[..., 0])
    covariance = np.repeat(expected.covariance[:, None], len(measurements.z), axis=1)
    np.einsum("tnii->tni", covariance)[:] += measurements.variance
    # The echo of a body that turns has another velocity than its centre.
    turn_rates = _typical_turn_rates_rad_per_s(velocities)
    covariance[..., 2, 2] += turn_rates[:, None] ** 2 * measurements.size_m2[:, 1]
    span = measurements.span_m_per_s
    finite_span = np.where(np.isfinite(span), span, 0)
    residual[..., 2] -= finite_span * np.round(residual[..., 2] / span)
    with np.errstate(invalid="ignore"):
        has_rate = 4 * np.sqrt(covariance[..., 2, 2]) < span / 2
    lacks_rate = ~has_rate
    residual[lacks_rate, 2] = 0
    covariance[lacks_rate, 2, :] = covariance[lacks_rate, :, 2] = 0
    covariance[lacks_rate, 2, 2] = tracker.false_alarms.velocity_span_m_per_s**2 / (2 * np.pi)
    return residual, covariance, has_rate
