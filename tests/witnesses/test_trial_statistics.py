"""Confidence intervals from trials: coverage with independent and clustered events."""

import numpy as np
import pytest

from dechirp.evaluation.proportions import estimate_proportion
from dechirp.evaluation.trial_statistics import estimate_mean, estimate_rate
from dechirp.theory import confidence_intervals
from nightly import nightly

N_REPEATS = 3000
"""Number of repetitions; misses of each end are counted."""


def compute_max_misses(tail):
    """Return the number of misses that a nominal tail exceeds with probability 1e-7 (normal)."""
    return N_REPEATS * tail + 5.2 * np.sqrt(N_REPEATS * tail * (1 - tail)) + 5


def count_misses(estimates, truth):
    low, high = np.array([(estimate.low, estimate.high) for estimate in estimates]).T
    return np.sum(low > truth), np.sum(high < truth)


@pytest.mark.parametrize("hits", [0, 3, 40])
def test_proportion_of_single_attempts_has_clopper_pearson_interval(hits):
    trial_hits = np.zeros(40)
    trial_hits[:hits] = 1
    estimate = estimate_proportion(trial_hits, np.ones(40), confidence=0.95)
    assert estimate.value == hits / 40
    assert (estimate.low, estimate.high) == confidence_intervals.binomial_interval(
        hits, 40, confidence=0.95
    )


@nightly
@pytest.mark.parametrize("probability", [0.5, 0.9])
def test_identical_attempts_of_a_trial_count_once(probability):
    rng, n_trials, n_attempts = np.random.default_rng(91), 40, 8
    hits = n_attempts * (rng.random((N_REPEATS, n_trials)) < probability)
    attempts = np.full(n_trials, float(n_attempts))
    estimates = [estimate_proportion(row.astype(float), attempts, confidence=0.9) for row in hits]
    # Intervals for independent attempts would miss in a third of all cases.
    assert max(count_misses(estimates, probability)) < compute_max_misses(0.05)
    naive_intervals = [
        confidence_intervals.binomial_interval(
            int(row.sum()), n_trials * n_attempts, confidence=0.9
        )
        for row in hits
    ]
    assert np.sum([not low <= probability <= high for low, high in naive_intervals]) > N_REPEATS / 4


def test_interval_of_hits_alone_counts_trials_and_not_attempts():
    estimate = estimate_proportion(np.full(20, 50.0), np.full(20, 50.0), confidence=0.95)
    assert estimate.value == estimate.high == 1
    # The scatter of 20 trials is uncertain, so they count as slightly fewer.
    low_of_16, low_of_20 = (
        confidence_intervals.binomial_interval(n, n, confidence=0.95)[0] for n in (16, 20)
    )
    assert low_of_16 < estimate.low <= low_of_20


def test_interval_of_ratio_of_sums_misses_as_often_as_stated():
    rng = np.random.default_rng(92)
    numbers = rng.integers(0, 6, size=(N_REPEATS, 200)).astype(float)
    # Errors of one trial are correlated: 200 trials of up to five are not 500 errors.
    totals = numbers * (4 + rng.standard_normal((N_REPEATS, 200)))
    estimates = [estimate_mean(*row, confidence=0.9) for row in zip(totals, numbers, strict=True)]
    assert max(count_misses(estimates, 4.0)) < 1.2 * compute_max_misses(0.05)
    assert min(count_misses(estimates, 4.0)) > 0.6 * N_REPEATS * 0.05


@pytest.mark.parametrize("expected", [4, 20, 200])
def test_interval_of_single_event_rate_misses_no_more_than_stated(expected):
    rng = np.random.default_rng(93)
    counts = rng.poisson(expected / 100, size=(N_REPEATS, 100)).astype(float)
    estimates = [estimate_rate(row, np.full(100, 10.0), confidence=0.9) for row in counts]
    assert max(count_misses(estimates, expected / 1000)) < compute_max_misses(0.05)


def test_interval_of_clustered_event_rate_counts_clusters():
    rng = np.random.default_rng(94)
    counts = 4.0 * rng.poisson(1.0, size=(N_REPEATS, 100))
    estimates = [estimate_rate(row, np.ones(100), confidence=0.9) for row in counts]
    assert max(count_misses(estimates, 4.0)) < 1.3 * compute_max_misses(0.05)
    widths = [estimate.high - estimate.low for estimate in estimates]
    # 100 clusters give 3.3 standard errors of a tenth; 400 single events would give half of it.
    assert np.median(widths) == pytest.approx(2 * 1.645 * 4 / 10, rel=0.1)


def test_failed_trials_are_omitted_and_one_trial_has_no_interval():
    column, ones = np.array([1.0, np.nan, 3.0, 2.0]), np.array([4.0, np.nan, 4.0, 4.0])
    is_completed = np.isfinite(column)
    for estimator in (estimate_proportion, estimate_mean, estimate_rate):
        result = estimator(column, ones, confidence=0.9)
        assert result == estimator(column[is_completed], ones[is_completed], confidence=0.9)
        assert result.value == 0.5 and result.low < 0.5 < result.high
        single_estimate = estimator(column[:1], ones[:1], confidence=0.9)
        assert single_estimate.value == 0.25
        if estimator is estimate_proportion:
            assert (single_estimate.low, single_estimate.high) == (0.0, 1.0)
        else:
            assert np.isnan([single_estimate.low, single_estimate.high]).all()
        assert np.isnan(estimator(column[1:2], ones[1:2], confidence=0.9)).all()
