"""Trials do not depend on who runs them, and are as many as their claims need."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from scipy.stats import binom, chi2, norm

from dechirp.certificate.claim import CONFIDENCE, Check, Claim
from dechirp.certificate.trials import (
    Job,
    run_jobs,
    trials_for_mean,
    trials_for_probability,
    trials_for_rms,
)
from dechirp.theory import confidence_intervals

TAIL = (1 - CONFIDENCE) / 2


def draws(rng, n_trials, *, width):
    return rng.standard_normal((n_trials, width))


def jobs(n_trials):
    return {
        "one": Job(work=draws, n_trials=n_trials, arguments={"width": 2}, block_size=7),
        "two": Job(work=draws, n_trials=40, arguments={"width": 1}, block_size=40),
    }


def test_the_numbers_do_not_depend_on_the_workers_nor_on_other_jobs():
    with ThreadPoolExecutor(1) as alone, ThreadPoolExecutor(4) as crowd:
        one = run_jobs(jobs(30), seed=5, executor=alone)
        many = run_jobs(jobs(30), seed=5, executor=crowd)
        without = run_jobs({"one": jobs(30)["one"]}, seed=5, executor=alone)
        longer = run_jobs(jobs(50), seed=5, executor=crowd)

    assert one["one"].shape == (30, 2)
    np.testing.assert_array_equal(one["one"], many["one"])
    np.testing.assert_array_equal(one["one"], without["one"])
    np.testing.assert_array_equal(one["one"][:28], longer["one"][:28])  # whole blocks
    assert len(np.unique(one["one"])) == 60  # no block repeats another
    assert not np.isin(one["two"], one["one"]).any()


def test_another_seed_gives_other_numbers_and_progress_counts_blocks():
    seen = []
    with ThreadPoolExecutor(2) as workers:
        first = run_jobs(jobs(30), seed=5, executor=workers, progress=lambda *n: seen.append(n))
        second = run_jobs(jobs(30), seed=6, executor=workers)

    assert not np.isin(first["one"], second["one"]).any()
    assert seen == [(done, 6) for done in range(1, 7)]


def test_a_trial_that_fails_ends_the_run_with_its_error():
    def broken(rng, n_trials):
        raise RuntimeError("no noise today")

    with ThreadPoolExecutor(1) as workers, pytest.raises(RuntimeError, match="no noise today"):
        run_jobs(
            {"broken": Job(work=broken, n_trials=3, arguments={}, block_size=1)},
            seed=1,
            executor=workers,
        )


@pytest.mark.parametrize(
    ("expected", "at_least"),
    [(1.0, 0.9), (1.0, 0.95), (0.998, 0.9), (0.93, 0.9), (0.96, 0.9), (0.6, 0.5)],
)
def test_so_many_trials_show_a_probability_but_for_one_time_in_sixty_thousand(expected, at_least):
    n = trials_for_probability(expected, at_least=at_least)

    def shown(hits):
        return confidence_intervals.binomial_interval(hits, n, confidence=CONFIDENCE)[0] >= at_least

    fewest = next(hits for hits in range(int(at_least * n), n + 1) if shown(hits))
    # The formula is for normal spread: three times the tail is what it neglects.
    assert binom.cdf(fewest - 1, n, expected) < 3 * TAIL
    if expected < 1:  # and no more of them than that takes
        assert binom.cdf(fewest - 1, n, expected) > TAIL / 30


@pytest.mark.parametrize(("expected", "at_most"), [(1.0, 1.15), (1.03, 1.15), (1.0, 2.0)])
def test_so_many_trials_show_a_root_mean_square(expected, at_most):
    n = trials_for_rms(expected, at_most=at_most)
    highest_shown = at_most * np.sqrt(chi2.ppf(TAIL, n) / n)
    chance = chi2.sf(n * (highest_shown / expected) ** 2, n)
    assert TAIL / 30 < chance < 5 * TAIL


def test_so_many_trials_show_a_mean():
    n = trials_for_mean(2.0, within=0.3)
    half = norm.isf(TAIL) * 2.0 / np.sqrt(n)
    assert half == pytest.approx(0.15, rel=1e-3)  # the interval takes half, the spread the other


def check(**given):
    return Check(**{"name": "a", "unit": "1", "measured": 1.0} | given)


def test_a_check_passes_when_all_of_its_interval_is_within_what_is_required():
    assert check(low=0.9, high=1.1, at_least=0.9, at_most=1.1).passed
    assert not check(low=0.89, high=1.1, at_least=0.9).passed
    assert not check(low=0.9, high=1.11, at_most=1.1).passed
    assert check(at_least=1.0, at_most=1.0).passed
    assert not check(at_least=1.1).passed
    assert check().passed  # for comparison alone


@pytest.mark.parametrize("lost", ["measured", "low", "high"])
def test_a_check_of_what_is_not_a_number_fails(lost):
    assert not check(**{"low": 0.9, "high": 1.1} | {lost: float("nan")}).passed


def test_a_claim_holds_when_every_check_does():
    good, bad = check(), check(at_least=2.0)
    assert Claim(id="a", claim="b", checks=(good, good)).passed
    assert not Claim(id="a", claim="b", checks=(good, bad)).passed
