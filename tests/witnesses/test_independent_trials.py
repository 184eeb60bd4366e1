"""Intervals of what trials tell hold the truth as often as stated, however trials cluster."""

import numpy as np
import pytest

from dechirp.evaluation.proportions import estimate_proportion
from dechirp.evaluation.trial_statistics import estimate_mean, estimate_rate
from dechirp.theory import confidence_intervals

N = 3000
"""Repeats; misses of each end are counted."""


def most_misses(tail):
    """So many a stated tail makes with a chance of 1e-7: normal, of N repeats."""
    return N * tail + 5.2 * np.sqrt(N * tail * (1 - tail)) + 5


def misses(estimates, true):
    low, high = np.array([(one.low, one.high) for one in estimates]).T
    return np.sum(low > true), np.sum(high < true)


@pytest.mark.parametrize("hits", [0, 3, 40])
def test_a_share_of_single_looks_has_clopper_and_pearsons_interval(hits):
    column = np.zeros(40)
    column[:hits] = 1
    found = estimate_proportion(column, np.ones(40), confidence=0.95)
    assert found.value == hits / 40
    assert (found.low, found.high) == confidence_intervals.binomial_interval(
        hits, 40, confidence=0.95
    )


@pytest.mark.parametrize("probability", [0.5, 0.9])
def test_looks_that_are_alike_within_a_trial_count_as_one(probability):
    rng, n_trials, n_looks = np.random.default_rng(91), 40, 8
    hits = n_looks * (rng.random((N, n_trials)) < probability)
    looks = np.full(n_trials, float(n_looks))
    found = [estimate_proportion(row.astype(float), looks, confidence=0.9) for row in hits]
    # As if all looks were independent, a third of all intervals would miss at either end.
    assert max(misses(found, probability)) < most_misses(0.05)
    naive = [
        confidence_intervals.binomial_interval(int(row.sum()), n_trials * n_looks, confidence=0.9)
        for row in hits
    ]
    assert np.sum([not low <= probability <= high for low, high in naive]) > N / 4


def test_a_target_always_found_is_no_surer_than_its_trials():
    found = estimate_proportion(np.full(20, 50.0), np.full(20, 50.0), confidence=0.95)
    assert found.value == found.high == 1
    # Of 20 trials the scatter is not known well: they are worth some fewer.
    fewer, all_of_them = (
        confidence_intervals.binomial_interval(n, n, confidence=0.95)[0] for n in (16, 20)
    )
    assert fewer < found.low <= all_of_them


def test_a_ratio_of_sums_misses_as_often_as_stated():
    rng = np.random.default_rng(92)
    numbers = rng.integers(0, 6, size=(N, 200)).astype(float)
    # Errors of a trial share a part: 200 trials of up to five are not 500 errors.
    totals = numbers * (4 + rng.standard_normal((N, 200)))
    found = [estimate_mean(*row, confidence=0.9) for row in zip(totals, numbers, strict=True)]
    assert max(misses(found, 4.0)) < 1.2 * most_misses(0.05)
    assert min(misses(found, 4.0)) > 0.6 * N * 0.05


@pytest.mark.parametrize("expected", [4, 20, 200])
def test_a_rate_of_single_events_misses_no_more_than_stated_however_few(expected):
    rng = np.random.default_rng(93)
    counts = rng.poisson(expected / 100, size=(N, 100)).astype(float)
    found = [estimate_rate(row, np.full(100, 10.0), confidence=0.9) for row in counts]
    assert max(misses(found, expected / 1000)) < most_misses(0.05)


def test_a_rate_of_events_in_fours_knows_that_they_are_a_quarter_of_them():
    rng = np.random.default_rng(94)
    counts = 4.0 * rng.poisson(1.0, size=(N, 100))
    found = [estimate_rate(row, np.ones(100), confidence=0.9) for row in counts]
    assert max(misses(found, 4.0)) < 1.3 * most_misses(0.05)
    widths = [one.high - one.low for one in found]
    # Of 100 clusters: 3.3 standard errors of a tenth; of 400 single events, half of it.
    assert np.median(widths) == pytest.approx(2 * 1.645 * 4 / 10, rel=0.1)


def test_trials_that_failed_are_left_out_and_one_alone_tells_nothing_of_its_error():
    column, ones = np.array([1.0, np.nan, 3.0, 2.0]), np.array([4.0, np.nan, 4.0, 4.0])
    ran = np.isfinite(column)
    for estimate in (estimate_proportion, estimate_mean, estimate_rate):
        whole = estimate(column, ones, confidence=0.9)
        assert whole == estimate(column[ran], ones[ran], confidence=0.9)
        assert whole.value == 0.5 and whole.low < 0.5 < whole.high
        alone = estimate(column[:1], ones[:1], confidence=0.9)
        assert alone.value == 0.25
        if estimate is estimate_proportion:
            assert (alone.low, alone.high) == (0.0, 1.0)
        else:
            assert np.isnan([alone.low, alone.high]).all()
        assert np.isnan(estimate(column[1:2], ones[1:2], confidence=0.9)).all()
