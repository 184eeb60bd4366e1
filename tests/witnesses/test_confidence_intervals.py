"""Confidence intervals: coverage against published, exact and simulated values, and SciPy."""

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from dechirp.core.errors import InvalidSetting
from dechirp.theory.confidence_intervals import (
    binomial_interval,
    mean_interval,
    rate_interval,
    rms_interval,
)
from nightly import nightly, nightly_except

CONFIDENCES = [0.5, 0.95, 1 - 1e-4, 1 - 1e-9]


def test_interval_of_45_hits_in_50_ends_at_0_967():
    low, high = binomial_interval(45, 50, confidence=0.95)
    assert high == pytest.approx(0.9667249064109775, rel=1e-12)
    assert low == pytest.approx(0.78186463, rel=1e-7)


@pytest.mark.parametrize("confidence", CONFIDENCES)
@pytest.mark.parametrize(("hits", "trials"), [(0, 1), (1, 1), (0, 50), (50, 50), (3, 4000)])
def test_ends_are_missed_as_often_as_stated_in_forty_digits(hits, trials, confidence):
    low, high = binomial_interval(hits, trials, confidence=confidence)
    with mpmath.workdps(40):
        tail = (1 - mpmath.mpf(confidence)) / 2
        for end, is_extreme, hit_counts in (
            (low, hits == 0, range(hits, trials + 1)),
            (high, hits == trials, range(hits + 1)),
        ):
            if is_extreme:
                assert end == (0.0 if end is low else 1.0)
                continue
            p = mpmath.mpf(end)
            # 200 of up to 4,001 terms suffice: the others are below 1e-40.
            chance = sum(
                mpmath.binomial(trials, k) * p**k * (1 - p) ** (trials - k)
                for k in hit_counts[:200]
            )
            assert float(chance / tail) == pytest.approx(
                1, rel=1e-6 if confidence > 0.9999 else 1e-9
            )


@pytest.mark.parametrize("trials", [10**7, 10**8, 10**9, 10**12])
@pytest.mark.parametrize("hits", [998, 999, 1000, 1001])
def test_thousand_hits_in_many_trials_follow_poisson_interval(hits, trials):
    # SciPy's inverse of the incomplete beta function has errors of one half at 1,000 hits.
    low, high = binomial_interval(hits, trials, confidence=0.99)
    # Rare hits follow a Poisson distribution up to the probability itself, at most 1e-4.
    assert low * trials == pytest.approx(stats.chi2.ppf(0.005, 2 * hits) / 2, rel=2e-4)
    assert high * trials == pytest.approx(stats.chi2.isf(0.005, 2 * hits + 2) / 2, rel=2e-4)


@pytest.mark.parametrize("trials", [5, 40, 500])
@pytest.mark.parametrize("confidence", [0.5, 0.9, 0.99])
def test_no_probability_is_missed_more_often_than_stated(trials, confidence):
    ends = np.array(
        [binomial_interval(k, trials, confidence=confidence) for k in range(trials + 1)]
    )
    for p in np.linspace(0, 1, 101):
        chance = stats.binom.pmf(np.arange(trials + 1), trials, p)
        assert chance[p < ends[:, 0]].sum() <= (1 - confidence) / 2 + 1e-12
        assert chance[p > ends[:, 1]].sum() <= (1 - confidence) / 2 + 1e-12


@given(st.integers(1, 10**6), st.data())
def test_hits_and_misses_mirror_each_other(trials, data):
    hits = data.draw(st.integers(0, trials))
    low, high = binomial_interval(hits, trials, confidence=0.9)
    assert 0 <= low <= hits / trials <= high <= 1
    mirrored_low, mirrored_high = binomial_interval(trials - hits, trials, confidence=0.9)
    assert mirrored_low == pytest.approx(1 - high, abs=1e-12)
    assert mirrored_high == pytest.approx(1 - low, abs=1e-12)


@pytest.mark.parametrize("confidence", CONFIDENCES)
@pytest.mark.parametrize("n", [2, 3, 50, 3000])
def test_mean_and_rms_intervals_match_scipy(n, confidence):
    values = np.random.default_rng(n).normal(3.0, 2.0, n)
    tail = (1 - confidence) / 2

    reach = stats.t.isf(tail, n - 1) * stats.sem(values)
    expected = (values.mean() - reach, values.mean() + reach)
    assert mean_interval(values, confidence=confidence) == pytest.approx(expected, rel=1e-9)

    total = np.sum(values**2)
    expected = (total / stats.chi2.isf(tail, n), total / stats.chi2.ppf(tail, n))
    assert np.square(rms_interval(values, confidence=confidence)) == pytest.approx(
        expected, rel=1e-9
    )


# 4,000 intervals at 0.9 have a standard error of 0.0047. A tolerance of five of them fails for
# correct intervals once in 1.7 million.
N_TRIALS, FIVE_ERRORS = 4000, 5 * 0.0047


def coverage(truth, intervals):
    return np.mean([low <= truth <= high for low, high in intervals])


@pytest.mark.parametrize("n", nightly_except(1, [2, 5, 40]))
def test_nine_intervals_in_ten_cover_truth(n):
    rng = np.random.default_rng(31)
    errors = rng.normal(0.0, 3.0, (N_TRIALS, n))

    covered_fraction = coverage(3.0, [rms_interval(row, confidence=0.9) for row in errors])
    assert covered_fraction == pytest.approx(0.9, abs=FIVE_ERRORS)
    covered_fraction = coverage(7.0, [mean_interval(row + 7.0, confidence=0.9) for row in errors])
    assert covered_fraction == pytest.approx(0.9, abs=FIVE_ERRORS)


def test_interval_of_clustered_event_rate_covers_as_often_as_stated():
    # 200 clusters per block with 1, 2, 3 ... events, mean 4: seven times the variance of single
    # events.
    rng = np.random.default_rng(32)
    clusters = rng.poisson(200.0, (N_TRIALS, 20))
    counts = clusters + rng.negative_binomial(np.maximum(clusters, 1), 0.25)
    assert counts.var() / counts.mean() == pytest.approx(7.0, rel=0.1)

    covered_fraction = coverage(
        800.0 / 1e6, [rate_interval(row, 1e6, confidence=0.9) for row in counts]
    )
    assert covered_fraction == pytest.approx(0.9, abs=FIVE_ERRORS)
    # Poisson intervals would cover 4 to 5 times in ten.
    as_singles = 1.645 * np.sqrt(counts.sum(axis=1)) / 20
    assert np.mean(abs(counts.mean(axis=1) - 800) < as_singles) < 0.55


@nightly
def test_interval_of_few_single_events_covers_at_least_as_stated():
    rng = np.random.default_rng(33)
    for per_block in (0.05, 0.5, 5.0):
        counts = rng.poisson(per_block, (N_TRIALS, 20))
        covered_fraction = coverage(
            per_block / 7.0, [rate_interval(row, 7.0, confidence=0.9) for row in counts]
        )
        # The coverage is 0.92 or more, because the scatter is at least that of single events.
        assert covered_fraction > 0.9 - FIVE_ERRORS


@pytest.mark.parametrize(
    ("n_expected", "high_end_misses"), [(10, 2.7e-3), (100, 4.9e-5), (1000, 8.0e-6), (3140, 5.4e-6)]
)
def test_interval_of_single_event_rate_misses_as_tabled_at_1e_5(n_expected, high_end_misses):
    # Events spread evenly over the blocks have the narrowest interval for their total, so the
    # sum over all totals gives the largest possible miss probability.
    n_blocks, half_width = 200, int(12 * np.sqrt(n_expected))
    totals = np.arange(max(n_expected - half_width, 0), n_expected + half_width)
    ends = np.array(
        [
            rate_interval(
                total // n_blocks + (np.arange(n_blocks) < total % n_blocks),
                1 / n_blocks,
                confidence=1 - 1e-5,
            )
            for total in totals
        ]
    )  # fmt: skip
    chance = stats.poisson.pmf(totals, n_expected)
    assert chance[ends[:, 1] < n_expected].sum() == pytest.approx(high_end_misses, rel=0.02)
    # The low end misses at most at its nominal 5e-6.
    assert chance[ends[:, 0] > n_expected].sum() < 5e-6


def test_rate_without_events_is_below_three_over_exposure():
    low, high = rate_interval([0, 0, 0, 0], 250.0, confidence=0.9)
    assert low == 0
    # Three expected events give none once in twenty.
    assert high == pytest.approx(2.9957 / 1000, rel=1e-4)


def test_equal_counts_have_at_least_poisson_scatter():
    low, high = rate_interval([9, 9, 9, 9], 1.0, confidence=0.95)
    reach = stats.t.isf(0.025, 3) * 3 / 2
    assert (low, high) == pytest.approx((9 - reach, 9 + reach))


@given(st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=30), st.floats(0.01, 0.98))
def test_interval_widens_with_confidence(values, confidence):
    for interval in (rms_interval, mean_interval):
        low, high = interval(values, confidence=confidence)
        lower, higher = interval(values, confidence=confidence + 0.01)
        assert lower <= low <= high <= higher


def test_intervals_scale_with_their_unit():
    values = np.random.default_rng(34).normal(size=20)
    for interval in (rms_interval, mean_interval):
        in_metres = np.array(interval(values, confidence=0.95))
        assert 1e3 * in_metres == pytest.approx(interval(1e3 * values, confidence=0.95))
    assert rate_interval([5, 9], 2.0, confidence=0.5) == pytest.approx(
        np.array(rate_interval([5, 9], 1.0, confidence=0.5)) / 2
    )


@pytest.mark.parametrize(
    ("setting", "call"),
    [
        ("hits", lambda: binomial_interval(51, 50, confidence=0.95)),
        ("hits", lambda: binomial_interval(-1, 50, confidence=0.95)),
        ("trials", lambda: binomial_interval(0, 0, confidence=0.95)),
        ("hits", lambda: binomial_interval(4.5, 50, confidence=0.95)),
        ("confidence", lambda: binomial_interval(4, 50, confidence=1.0)),
        ("confidence", lambda: rms_interval([1.0, 2.0], confidence=0.0)),
        ("confidence", lambda: mean_interval([1.0, 2.0], confidence=95)),
        ("confidence", lambda: rate_interval([1, 2], 1.0, confidence=float("nan"))),
        ("values", lambda: rms_interval([1.0], confidence=0.95)),
        ("values", lambda: mean_interval([], confidence=0.95)),
        ("values", lambda: mean_interval([1.0, float("nan")], confidence=0.95)),
        ("values", lambda: mean_interval(np.ones((2, 2)), confidence=0.95)),
        ("counts", lambda: rate_interval([3, -1], 1.0, confidence=0.95)),
        ("exposure", lambda: rate_interval([3, 1], 0.0, confidence=0.95)),
        ("exposure", lambda: rate_interval([0, 0], -1.0, confidence=0.95)),
        ("exposure", lambda: rate_interval([3, 1], "7", confidence=0.95)),
        ("exposure", lambda: rate_interval([3, 1], None, confidence=0.95)),
        ("exposure", lambda: rate_interval([3, 1], [1.0, 2.0], confidence=0.95)),
        ("exposure", lambda: rate_interval([3, 1], float("inf"), confidence=0.95)),
    ],
)
def test_rejects_invalid_interval_settings(setting, call):
    with pytest.raises(InvalidSetting, match=f"^{setting}: "):
        call()
