"""Intervals of scores hold what they are made for, also where looks of a trial are alike."""

import numpy as np
import pytest
from scipy.special import gammaincinv

from dechirp.evaluation.proportions import estimate_proportion
from dechirp.evaluation.score.errors import RangeBias, RangeRmse
from dechirp.theory.confidence_intervals import binomial_interval

SURE = 1 - 1e-6
REPEATS = 400


def independent(rng, n):
    return rng.binomial(20, 0.9, n), 0.9


def alike(rng, n):
    return 20 * rng.binomial(1, 0.9, n), 0.9


def spread(rng, n):
    return rng.binomial(20, rng.beta(1.8, 0.2, n)), 0.9


def rarely_lost(rng, n):
    """Now and then a target is missed in all frames, which few trials do not show."""
    return np.where(rng.random(n) < 0.01, 0, rng.binomial(20, 0.99, n)), 0.99 * 0.99


@pytest.mark.parametrize("drawn", [independent, alike, spread, rarely_lost])
@pytest.mark.parametrize("n_trials", [20, 100])
def test_a_share_of_looks_that_belong_together_is_held(drawn, n_trials):
    rng, missed = np.random.default_rng(1), np.zeros(2, int)
    for _ in range(REPEATS):
        hits, truth = drawn(rng, n_trials)
        found = estimate_proportion(hits.astype(float), np.full(n_trials, 20.0), confidence=0.95)
        assert 0 <= found.low <= found.value <= found.high <= 1
        missed += found.low > truth, found.high < truth

    # Stated are 0.025 for each end; the spread of skew shares is not known better than this.
    for n in missed.tolist():
        assert binomial_interval(n, REPEATS, confidence=SURE)[0] < 0.03


def test_trials_of_one_look_have_the_exact_interval():
    hits, ones = np.repeat([1.0, 0.0], [37, 3]), np.ones(40)

    assert estimate_proportion(hits, ones, confidence=0.95)[1:] == binomial_interval(
        37, 40, confidence=0.95
    )
    failed = np.append(hits, np.nan), np.append(ones, np.nan)
    assert estimate_proportion(*failed, confidence=0.95)[1:] == binomial_interval(
        37, 40, confidence=0.95
    )


@pytest.mark.parametrize(("share_of_hits", "end"), [(1.0, 1), (0.0, 2)])
def test_hits_alone_are_worth_the_trials_and_not_their_looks(share_of_hits, end):
    looks = np.full(50, 1000.0)

    found = estimate_proportion(share_of_hits * looks, looks, confidence=0.95)

    exact = binomial_interval(int(50 * share_of_hits), 50, confidence=0.95)
    assert found.low <= exact[0] + 1e-12 and found.high >= exact[1] - 1e-12
    assert found[end] == pytest.approx(exact[end - 1], abs=0.03)
    assert found[3 - end] == share_of_hits


def test_looks_that_are_independent_are_worth_nearly_all_of_them():
    rng = np.random.default_rng(3)
    hits = rng.binomial(10, 0.5, 2000).astype(float)

    found = estimate_proportion(hits, np.full(2000, 10.0), confidence=0.95)

    low, high = binomial_interval(int(hits.sum()), 20_000, confidence=0.95)
    assert found.high - found.low == pytest.approx(high - low, rel=0.1)


def test_nothing_is_told_of_no_trial():
    assert np.isnan(
        estimate_proportion(np.full(3, np.nan), np.full(3, np.nan), confidence=0.9)
    ).all()
    for score in (RangeRmse(), RangeBias()):
        assert np.isnan(score.estimate(np.zeros((3, 2)), confidence=0.9)).all()


def test_the_interval_of_single_normal_errors_is_that_of_chi_square():
    rng = np.random.default_rng(4)
    sums = np.stack([rng.standard_normal(20_000) ** 2, np.ones(20_000)], axis=1)

    found = RangeRmse().estimate(sums, confidence=0.95)

    high = np.sqrt(sums[:, 0].sum() / 2 / gammaincinv(10_000, 0.025))
    assert found.high - found.value == pytest.approx(high - found.value, rel=0.06)


def single(rng, n):
    return rng.standard_normal((n, 1))


def of_one_trial(rng, n):
    """Frames of a trial share most of their error."""
    return rng.standard_normal((n, 1)) + 0.3 * rng.standard_normal((n, 10))


def far_out(rng, n):
    """One in ten has three times the error."""
    return rng.standard_normal((n, 2)) * np.where(rng.random((n, 2)) < 0.1, 3.0, 1.0)


@pytest.mark.parametrize(
    ("drawn", "truth"), [(single, 1.0), (of_one_trial, np.sqrt(1.09)), (far_out, np.sqrt(1.8))]
)
def test_the_interval_of_errors_holds_their_root_mean_square(drawn, truth):
    rng, missed = np.random.default_rng(5), np.zeros(2, int)
    for _ in range(REPEATS):
        errors = drawn(rng, 200)
        sums = np.stack([np.sum(errors**2, axis=1), np.full(200, errors.shape[1])], axis=1)
        found = RangeRmse().estimate(sums, confidence=0.95)
        missed += found.low > truth, found.high < truth

    # Of errors that are far out the spread is told too small by 200 trials: 0.05 for 0.025.
    for n in missed.tolist():
        assert binomial_interval(n, REPEATS, confidence=SURE)[0] < (
            0.05 if drawn is far_out else 0.03
        )


def test_the_interval_of_a_mean_error_knows_that_frames_of_a_trial_are_alike():
    rng, missed = np.random.default_rng(6), 0
    for _ in range(REPEATS):
        errors = of_one_trial(rng, 30) + 0.5
        sums = np.stack([errors.sum(axis=1), np.full(30, 10)], axis=1)
        found = RangeBias().estimate(sums, confidence=0.95)
        missed += not found.low < 0.5 < found.high

    low, high = binomial_interval(missed, REPEATS, confidence=SURE)
    assert low < 0.05 < high
