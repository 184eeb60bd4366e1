"""Confidence intervals of scores: coverage with independent and dependent attempts."""

import numpy as np
import pytest
from scipy.special import gammaincinv

from dechirp.evaluation.proportions import estimate_proportion
from dechirp.evaluation.score.errors import RangeBias, RangeRmse
from dechirp.theory.confidence_intervals import binomial_interval

NEAR_CERTAINTY = 1 - 1e-6
N_REPEATS = 400


def draw_independent(rng, n):
    return rng.binomial(20, 0.9, n), 0.9


def draw_identical(rng, n):
    return 20 * rng.binomial(1, 0.9, n), 0.9


def draw_overdispersed(rng, n):
    return rng.binomial(20, rng.beta(1.8, 0.2, n)), 0.9


def draw_rarely_missed(rng, n):
    """Draw trials that miss a target in all frames with 1 % probability, rare among few trials."""
    return np.where(rng.random(n) < 0.01, 0, rng.binomial(20, 0.99, n)), 0.99 * 0.99


@pytest.mark.parametrize(
    "draw", [draw_independent, draw_identical, draw_overdispersed, draw_rarely_missed]
)
@pytest.mark.parametrize("n_trials", [20, 100])
def test_interval_of_dependent_attempts_covers_proportion(draw, n_trials):
    rng, n_misses = np.random.default_rng(1), np.zeros(2, int)
    for _ in range(N_REPEATS):
        hits, truth = draw(rng, n_trials)
        estimate = estimate_proportion(hits.astype(float), np.full(n_trials, 20.0), confidence=0.95)
        assert 0 <= estimate.low <= estimate.value <= estimate.high <= 1
        n_misses += estimate.low > truth, estimate.high < truth

    # Nominal 0.025 per end; the spread of skewed proportions is not known better than this.
    for n in n_misses.tolist():
        assert binomial_interval(n, N_REPEATS, confidence=NEAR_CERTAINTY)[0] < 0.03


def test_trials_of_one_attempt_have_exact_interval():
    hits, ones = np.repeat([1.0, 0.0], [37, 3]), np.ones(40)

    assert estimate_proportion(hits, ones, confidence=0.95)[1:] == binomial_interval(
        37, 40, confidence=0.95
    )
    with_failed_trial = np.append(hits, np.nan), np.append(ones, np.nan)
    assert estimate_proportion(*with_failed_trial, confidence=0.95)[1:] == binomial_interval(
        37, 40, confidence=0.95
    )


@pytest.mark.parametrize(("proportion", "end"), [(1.0, 1), (0.0, 2)])
def test_hits_alone_count_trials_and_not_attempts(proportion, end):
    attempts = np.full(50, 1000.0)

    estimate = estimate_proportion(proportion * attempts, attempts, confidence=0.95)

    exact = binomial_interval(int(50 * proportion), 50, confidence=0.95)
    assert estimate.low <= exact[0] + 1e-12 and estimate.high >= exact[1] - 1e-12
    assert estimate[end] == pytest.approx(exact[end - 1], abs=0.03)
    assert estimate[3 - end] == proportion


def test_independent_attempts_count_nearly_all():
    rng = np.random.default_rng(3)
    hits = rng.binomial(10, 0.5, 2000).astype(float)

    estimate = estimate_proportion(hits, np.full(2000, 10.0), confidence=0.95)

    low, high = binomial_interval(int(hits.sum()), 20_000, confidence=0.95)
    assert estimate.high - estimate.low == pytest.approx(high - low, rel=0.1)


def test_no_trials_give_no_estimate():
    assert np.isnan(
        estimate_proportion(np.full(3, np.nan), np.full(3, np.nan), confidence=0.9)
    ).all()
    for score in (RangeRmse(), RangeBias()):
        assert np.isnan(score.estimate_with_interval(np.zeros((3, 2)), confidence=0.9)).all()


def test_interval_of_single_normal_errors_follows_chi_square():
    rng = np.random.default_rng(4)
    sums = np.stack([rng.standard_normal(20_000) ** 2, np.ones(20_000)], axis=1)

    estimate = RangeRmse().estimate_with_interval(sums, confidence=0.95)

    high = np.sqrt(sums[:, 0].sum() / 2 / gammaincinv(10_000, 0.025))
    assert estimate.high - estimate.value == pytest.approx(high - estimate.value, rel=0.06)


def draw_single_errors(rng, n):
    return rng.standard_normal((n, 1))


def draw_correlated_errors(rng, n):
    """Draw errors that the frames of a trial have mostly in common."""
    return rng.standard_normal((n, 1)) + 0.3 * rng.standard_normal((n, 10))


def draw_outliers(rng, n):
    """Draw errors of which one in ten has three times the spread."""
    return rng.standard_normal((n, 2)) * np.where(rng.random((n, 2)) < 0.1, 3.0, 1.0)


@pytest.mark.parametrize(
    ("draw", "truth"),
    [
        (draw_single_errors, 1.0),
        (draw_correlated_errors, np.sqrt(1.09)),
        (draw_outliers, np.sqrt(1.8)),
    ],
)
def test_interval_of_errors_covers_their_rmse(draw, truth):
    rng, n_misses = np.random.default_rng(5), np.zeros(2, int)
    for _ in range(N_REPEATS):
        errors = draw(rng, 200)
        sums = np.stack([np.sum(errors**2, axis=1), np.full(200, errors.shape[1])], axis=1)
        estimate = RangeRmse().estimate_with_interval(sums, confidence=0.95)
        n_misses += estimate.low > truth, estimate.high < truth

    # 200 trials underestimate the spread of outliers: 0.05 instead of 0.025.
    for n in n_misses.tolist():
        assert binomial_interval(n, N_REPEATS, confidence=NEAR_CERTAINTY)[0] < (
            0.05 if draw is draw_outliers else 0.03
        )


def test_interval_of_bias_counts_trials_and_not_correlated_frames():
    rng, n_misses = np.random.default_rng(6), 0
    for _ in range(N_REPEATS):
        errors = draw_correlated_errors(rng, 30) + 0.5
        sums = np.stack([errors.sum(axis=1), np.full(30, 10)], axis=1)
        estimate = RangeBias().estimate_with_interval(sums, confidence=0.95)
        n_misses += not estimate.low < 0.5 < estimate.high

    low, high = binomial_interval(n_misses, N_REPEATS, confidence=NEAR_CERTAINTY)
    assert low < 0.05 < high
