"""Motion models against Stone Soup and finite differences; interacting models against Bayes."""

from datetime import timedelta

import numpy as np
import pytest
from stonesoup.models.transition.linear import (
    CombinedLinearGaussianTransitionModel,
    ConstantVelocity,
)
from stonesoup.models.transition.nonlinear import ConstantTurn
from stonesoup.types.state import State

from dechirp.tracking.interacting_models import (
    combine_models,
    mix_models,
    switching_probabilities,
    update_model_probabilities,
)
from dechirp.tracking.motion_models import predict_coordinated_turn, predict_straight_motion

INTERVAL_S = 0.4
NOISE = {"process_noise_m2_per_s3": 0.7, "turn_rate_std_rad_per_s": 0.5}


def predict_turn(mean, covariance=None, turn_time_s=1e12):
    covariance = np.zeros((5, 5)) if covariance is None else covariance
    return predict_coordinated_turn(
        np.asarray(mean, float), covariance, INTERVAL_S, turn_time_s=turn_time_s, **NOISE
    )


@pytest.mark.parametrize("turn_rate", [-1.2, -1e-3, 1e-3, 0.4, 5.0])
def test_turn_equals_that_of_stone_soup(turn_rate):
    state = np.array([10.0, 3.0, -4.0, 2.0, turn_rate])
    model = ConstantTurn(linear_noise_coeffs=[0, 0], turn_noise_coeff=0)

    mean, _ = predict_turn(state)

    expected = model.function(
        State(state[:, None]), time_interval=timedelta(seconds=INTERVAL_S), noise=False
    )
    # Rounding: (1 - cos) / w loses half of the digits at the smallest rate.
    assert mean == pytest.approx(np.asarray(expected, float)[:, 0], abs=1e-9)


@pytest.mark.parametrize("turn_rate", [0.0, 1e-9, 2.4e-4, 2.6e-4, 0.7])
def test_turn_is_linearised_exactly(turn_rate):
    state = np.array([10.0, 3.0, -4.0, 2.0, turn_rate])
    step = 1e-5
    columns = [
        (predict_turn(state + step * axis)[0] - predict_turn(state - step * axis)[0]) / (2 * step)
        for axis in np.eye(5)
    ]
    jacobian = np.stack(columns, axis=-1)
    prior = np.diag([1.0, 2.0, 3.0, 4.0, 0.5])

    _, with_prior = predict_turn(state, prior)
    _, without = predict_turn(state)

    # Central differences: rounding of 1e-16 * 10 / 1e-5, and step^2.
    assert with_prior - without == pytest.approx(jacobian @ prior @ jacobian.T, abs=1e-8)


def test_straight_motion_equals_that_of_stone_soup_and_forgets_the_turn():
    axis_model = ConstantVelocity(NOISE["process_noise_m2_per_s3"])
    model = CombinedLinearGaussianTransitionModel([axis_model, axis_model])
    interval = timedelta(seconds=INTERVAL_S)
    transition = np.asarray(model.matrix(time_interval=interval), float)
    prior = np.diag([1.0, 2.0, 3.0, 4.0, 0.01])
    state = np.array([10.0, 3.0, -4.0, 2.0, 0.8])

    mean, covariance = predict_straight_motion(state, prior, INTERVAL_S, **NOISE)

    assert mean == pytest.approx([*(transition @ state[:4]), 0.0])
    noise = np.asarray(model.covar(time_interval=interval), float)
    expected = transition @ prior[:4, :4] @ transition.T + noise
    assert covariance[:4, :4] == pytest.approx(expected, rel=1e-12)
    assert covariance[4].tolist() == [0, 0, 0, 0, 0.25]


def test_turn_rate_is_stationary():
    # An Ornstein-Uhlenbeck process keeps its variance.
    prior = np.diag([1.0, 1.0, 1.0, 1.0, 0.25])

    mean, covariance = predict_turn([0.0, 1.0, 0.0, 0.0, 0.6], prior, turn_time_s=2.0)

    assert mean[4] == pytest.approx(0.6 * np.exp(-0.2))
    assert covariance[4, 4] == pytest.approx(0.25)


def test_models_switch_as_a_markov_chain_in_continuous_time():
    half, whole = (switching_probabilities(3, t, 3.0) for t in (0.2, 0.4))

    assert half @ half == pytest.approx(whole)
    assert whole.sum(axis=1) == pytest.approx(np.ones(3))
    # The rate of leaving is the inverse of the mean time.
    assert (1 - switching_probabilities(3, 1e-6, 3.0)[0, 0]) / 1e-6 == pytest.approx(1 / 3, 1e-5)


def test_mixed_models_have_the_moments_of_their_mixture():
    # Seeded samples of a mixture of two Gaussians, entered by two models.
    rng = np.random.default_rng(1)
    mean = np.array([[[0.0, 1.0], [2.0, -1.0]]])
    covariance = np.array([[[[1.0, 0.3], [0.3, 2.0]], [[0.5, -0.2], [-0.2, 0.7]]]])
    probability = np.array([[0.3, 0.7]])
    switching = np.array([[0.9, 0.1], [0.2, 0.8]])
    n = 400_000

    mixed, mixed_covariance, entered = mix_models(mean, covariance, probability, switching)

    before = rng.random(n) < 0.7
    after = np.where(before, rng.random(n) < 0.8, rng.random(n) < 0.1)
    root = np.linalg.cholesky(covariance[0])[before.astype(int)]
    samples = mean[0][before.astype(int)] + np.einsum(
        "nij,nj->ni", root, rng.standard_normal((n, 2))
    )
    for model in range(2):
        chosen = samples[after == model]
        # 5 standard errors of 1e5 samples or more, whose spread is below 2.
        assert entered[0, model] == pytest.approx(len(chosen) / n, abs=5 * 0.5 / np.sqrt(n))
        assert mixed[0, model] == pytest.approx(chosen.mean(axis=0), abs=5 * 2 / np.sqrt(1e5))
        assert mixed_covariance[0, model] == pytest.approx(
            np.cov(chosen.T), abs=5 * 6 / np.sqrt(1e5)
        )


def test_combination_of_one_certain_model_is_that_model():
    mean, covariance = np.array([[[1.0, 2.0], [9.0, 9.0]]]), np.array([[np.eye(2), 5 * np.eye(2)]])

    combined, combined_covariance = combine_models(mean, covariance, np.array([[1.0, 0.0]]))

    assert combined.tolist() == [[1.0, 2.0]]
    assert combined_covariance.tolist() == np.eye(2)[None].tolist()


def test_probabilities_follow_bayes_rule_without_underflow():
    probability = update_model_probabilities(
        np.array([[0.2, 0.8]]), np.array([[-5000.0, -5000.0 + np.log(2)]])
    )

    assert probability == pytest.approx(np.array([[0.2, 1.6]]) / 1.8)
