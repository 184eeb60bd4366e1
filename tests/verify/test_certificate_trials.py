"""Trials of the certificate: reproducibility, required numbers, checks and claims."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from scipy.stats import binom, chi2, norm

from dechirp.certificate.claim import CONFIDENCE, Check, Claim
from dechirp.certificate.trials import (
    Job,
    count_trials_to_prove_mean,
    count_trials_to_prove_probability,
    count_trials_to_prove_rms,
    run_jobs,
)
from dechirp.theory import confidence_intervals

TAIL = (1 - CONFIDENCE) / 2


def draw_normal(rng, n_trials, *, width):
    return rng.standard_normal((n_trials, width))


def make_jobs(n_trials):
    return {
        "one": Job(work=draw_normal, n_trials=n_trials, arguments={"width": 2}, block_size=7),
        "two": Job(work=draw_normal, n_trials=40, arguments={"width": 1}, block_size=40),
    }


def test_results_do_not_depend_on_workers_or_other_jobs():
    with ThreadPoolExecutor(1) as one_worker, ThreadPoolExecutor(4) as four_workers:
        serial = run_jobs(make_jobs(30), seed=5, executor=one_worker)
        parallel = run_jobs(make_jobs(30), seed=5, executor=four_workers)
        single_job = run_jobs({"one": make_jobs(30)["one"]}, seed=5, executor=one_worker)
        longer = run_jobs(make_jobs(50), seed=5, executor=four_workers)

    assert serial["one"].shape == (30, 2)
    np.testing.assert_array_equal(serial["one"], parallel["one"])
    np.testing.assert_array_equal(serial["one"], single_job["one"])
    np.testing.assert_array_equal(serial["one"][:28], longer["one"][:28])  # whole blocks
    assert len(np.unique(serial["one"])) == 60  # no block repeats another
    assert not np.isin(serial["two"], serial["one"]).any()


def test_other_seed_gives_other_numbers_and_progress_counts_blocks():
    progress = []
    with ThreadPoolExecutor(2) as workers:
        first = run_jobs(
            make_jobs(30), seed=5, executor=workers, progress=lambda *n: progress.append(n)
        )
        second = run_jobs(make_jobs(30), seed=6, executor=workers)

    assert not np.isin(first["one"], second["one"]).any()
    assert progress == [(n_done, 6) for n_done in range(1, 7)]


def test_failing_trial_ends_run_with_its_error():
    def fail(rng, n_trials):
        raise RuntimeError("no noise today")

    with ThreadPoolExecutor(1) as workers, pytest.raises(RuntimeError, match="no noise today"):
        run_jobs(
            {"broken": Job(work=fail, n_trials=3, arguments={}, block_size=1)},
            seed=1,
            executor=workers,
        )


@pytest.mark.parametrize(
    ("expected", "at_least"),
    [(1.0, 0.9), (1.0, 0.95), (0.998, 0.9), (0.93, 0.9), (0.96, 0.9), (0.6, 0.5)],
)
def test_number_of_trials_shows_probability_at_confidence(expected, at_least):
    n = count_trials_to_prove_probability(expected, at_least=at_least)

    def is_shown(hits):
        return confidence_intervals.binomial_interval(hits, n, confidence=CONFIDENCE)[0] >= at_least

    fewest = next(hits for hits in range(int(at_least * n), n + 1) if is_shown(hits))
    # The formula assumes a normal distribution; the error is below three times the tail.
    assert binom.cdf(fewest - 1, n, expected) < 3 * TAIL
    if expected < 1:  # the number of trials is not much larger than needed
        assert binom.cdf(fewest - 1, n, expected) > TAIL / 30


@pytest.mark.parametrize(("expected", "at_most"), [(1.0, 1.15), (1.03, 1.15), (1.0, 2.0)])
def test_number_of_trials_shows_rms(expected, at_most):
    n = count_trials_to_prove_rms(expected, at_most=at_most)
    highest_rms = at_most * np.sqrt(chi2.ppf(TAIL, n) / n)
    chance = chi2.sf(n * (highest_rms / expected) ** 2, n)
    assert TAIL / 30 < chance < 5 * TAIL


def test_number_of_trials_shows_mean():
    n = count_trials_to_prove_mean(2.0, tolerance=0.3)
    half_width = norm.isf(TAIL) * 2.0 / np.sqrt(n)
    assert half_width == pytest.approx(0.15, rel=1e-3)  # half for the interval, half for the spread


def make_check(**fields):
    return Check(**{"name": "a", "unit": "1", "measured": 1.0} | fields)


def test_check_passes_when_whole_interval_is_within_limits():
    assert make_check(low=0.9, high=1.1, at_least=0.9, at_most=1.1).passed
    assert not make_check(low=0.89, high=1.1, at_least=0.9).passed
    assert not make_check(low=0.9, high=1.11, at_most=1.1).passed
    assert make_check(at_least=1.0, at_most=1.0).passed
    assert not make_check(at_least=1.1).passed
    assert make_check().passed  # without limits, for comparison alone


@pytest.mark.parametrize("field", ["measured", "low", "high"])
def test_check_of_nan_fails(field):
    assert not make_check(**{"low": 0.9, "high": 1.1} | {field: float("nan")}).passed


def test_claim_passes_when_every_check_passes():
    passing_check, failing_check = make_check(), make_check(at_least=2.0)
    assert Claim(id="a", claim="b", checks=(passing_check, passing_check)).passed
    assert not Claim(id="a", claim="b", checks=(passing_check, failing_check)).passed
