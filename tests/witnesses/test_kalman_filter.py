"""Kalman filter of many tracks against Stone Soup, one track at a time."""

from datetime import datetime, timedelta

import numpy as np
import pytest
from stonesoup.models.measurement.nonlinear import CartesianToBearingRangeRate2D
from stonesoup.models.transition.linear import (
    CombinedLinearGaussianTransitionModel,
    ConstantVelocity,
)
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.types.detection import Detection, MissedDetection
from stonesoup.types.hypothesis import SingleProbabilityHypothesis
from stonesoup.types.multihypothesis import MultipleHypothesis
from stonesoup.types.state import GaussianState
from stonesoup.updater.kalman import ExtendedKalmanUpdater, UnscentedKalmanUpdater
from stonesoup.updater.probability import PDAUpdater

from dechirp.tracking.kalman_filter import (
    StateEstimates,
    predict_linearised_measurements,
    predict_sigma_point_measurements,
    predict_states,
    states_relative_to_radar,
    update_states,
)
from dechirp.tracking.poses import RadarPose

NOW, INTERVAL_S, PROCESS_NOISE = datetime(2000, 1, 1), 0.05, 2.0
MODEL = CartesianToBearingRangeRate2D(
    ndim_state=4, mapping=(0, 2), velocity_mapping=(1, 3), noise_covar=np.eye(3)
)
N_TRACKS = 12
ROUNDING = {"rel": 1e-9, "abs": 1e-9}


def draw_states() -> StateEstimates:
    """Draw states all around the origin, so that some azimuths are beside the cut at pi."""
    rng = np.random.default_rng(5)
    angle = np.linspace(0, 2 * np.pi, N_TRACKS, endpoint=False)
    x, y = 30 * np.cos(angle), 30 * np.sin(angle)
    vx, vy = rng.normal(size=(2, N_TRACKS), scale=10)
    factors = rng.normal(size=(N_TRACKS, 4, 4))
    return StateEstimates(
        np.stack([x, vx, y, vy], axis=-1), factors @ factors.swapaxes(1, 2) + 0.1 * np.eye(4)
    )


def to_gaussian_states(states: StateEstimates) -> list[GaussianState]:
    return [
        GaussianState(mean[:, None], covariance, timestamp=NOW)
        for mean, covariance in zip(*states, strict=True)
    ]


def test_prediction_equals_that_of_stone_soup():
    motion = CombinedLinearGaussianTransitionModel([ConstantVelocity(PROCESS_NOISE)] * 2)
    states, later = draw_states(), NOW + timedelta(seconds=INTERVAL_S)

    predicted = predict_states(states, INTERVAL_S, PROCESS_NOISE)

    for index, state in enumerate(to_gaussian_states(states)):
        expected = KalmanPredictor(motion).predict(state, timestamp=later)
        assert predicted.mean[index] == pytest.approx(expected.state_vector[:, 0], **ROUNDING)
        assert predicted.covariance[index] == pytest.approx(expected.covar, **ROUNDING)


@pytest.mark.parametrize(
    ("predict", "updater", "accuracy"),
    [
        # Stone Soup differentiates numerically.
        (predict_linearised_measurements, ExtendedKalmanUpdater(MODEL), {"rel": 1e-4, "abs": 1e-4}),
        (
            predict_sigma_point_measurements,
            UnscentedKalmanUpdater(MODEL, alpha=1, beta=2, kappa=0),
            ROUNDING,
        ),
    ],
)
def test_predicted_measurements_equal_those_of_stone_soup(predict, updater, accuracy):
    states = draw_states()

    measured = predict(states)

    for index, state in enumerate(to_gaussian_states(states)):
        expected = updater.predict_measurement(state, measurement_noise=False)
        difference = measured.mean[index] - np.asarray(expected.state_vector[:, 0], float)
        difference[0] = np.angle(np.exp(1j * difference[0]))
        assert difference == pytest.approx(np.zeros(3), **accuracy)
        assert measured.covariance[index] == pytest.approx(expected.covar.astype(float), **accuracy)
        assert measured.cross_covariance[index] == pytest.approx(
            expected.cross_covar.astype(float), **accuracy
        )


@pytest.mark.parametrize("shares", [(0.0, 1.0), (0.3, 0.6), (0.2, 0.8)])
def test_update_with_shares_equals_mixture_of_stone_soup(shares):
    states = draw_states()
    expected_measurement = predict_sigma_point_measurements(states)
    rng = np.random.default_rng(6)
    noise = np.diag([1e-4, 0.02, 0.01])
    innovation_covariance = expected_measurement.covariance + noise
    residual = rng.normal(size=(N_TRACKS, 2, 3)) * [0.01, 0.2, 0.2]

    # Pairs of all tracks but the last one, which has no detection.
    track, detection = np.divmod(np.arange(2 * (N_TRACKS - 1)), 2)
    updated = update_states(
        states,
        track,
        residual[track, detection],
        innovation_covariance[track],
        expected_measurement.cross_covariance[track],
        np.array(shares)[detection],
    )

    updater = PDAUpdater(MODEL, gm_method=True)
    missed = MissedDetection(timestamp=NOW)
    for index, state in enumerate(to_gaussian_states(states)[:-1]):
        prediction = updater.predict_measurement(state)
        prediction.covar = innovation_covariance[index]
        prediction.cross_covar = expected_measurement.cross_covariance[index]
        hypotheses = [SingleProbabilityHypothesis(state, missed, probability=1 - sum(shares))]
        for share, its_residual in zip(shares, residual[index], strict=True):
            detection_there = Detection(
                np.asarray(prediction.state_vector, float) + its_residual[:, None], timestamp=NOW
            )
            hypotheses.append(
                SingleProbabilityHypothesis(
                    state, detection_there, measurement_prediction=prediction, probability=share
                )
            )
        expected = updater.update(MultipleHypothesis(hypotheses))
        assert updated.mean[index] == pytest.approx(
            np.asarray(expected.state_vector[:, 0], float), **ROUNDING
        )
        assert updated.covariance[index] == pytest.approx(expected.covar.astype(float), **ROUNDING)
    assert np.array_equal(updated.mean[-1], states.mean[-1])
    assert np.allclose(updated.covariance[-1], states.covariance[-1], rtol=1e-15)


def test_covariance_without_cholesky_factor_still_has_sigma_points():
    states = draw_states()
    singular = StateEstimates(states.mean, states.covariance.copy())
    singular.covariance[0] = np.diag([1.0, 0.0, 1.0, -1e-17])
    near = StateEstimates(states.mean, singular.covariance + 1e-12 * np.eye(4))

    measured, expected = map(predict_sigma_point_measurements, (singular, near))

    assert measured.covariance[0] == pytest.approx(expected.covariance[0], rel=1e-6, abs=1e-9)


def test_states_relative_to_radar_are_shifted():
    states = draw_states()
    pose = RadarPose(position_m=(3.0, -2.0), velocity_m_per_s=(10.0, 1.0), yaw_rad=1.0)

    relative = states_relative_to_radar(states, pose)

    assert relative.mean == pytest.approx(states.mean - [3.0, 10.0, -2.0, 1.0], rel=1e-13)
    assert relative.covariance is states.covariance
