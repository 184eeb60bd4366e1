"""Search of tune: choice of the next candidate, importance of settings and paired gain."""

import numpy as np
import pytest
from scipy.stats import binomtest

from dechirp.experiments.study.study import SweptSetting
from dechirp.experiments.tune.gain import estimate_paired_gain
from dechirp.experiments.tune.sampler import choose_next_untried_settings, setting_importances
from dechirp.theory.confidence_intervals import binomial_interval
from nightly import nightly

NEAR_CERTAINTY = 1 - 1e-6


def make_swept_setting(path: str, n: int, *, is_text: bool = False) -> SweptSetting:
    texts = tuple(f"{path}{k}" for k in range(n))
    return SweptSetting(
        path=path, texts=texts, numbers=None if is_text else tuple(range(n)), unit=""
    )


SPACE = (
    make_swept_setting("a", 20),
    make_swept_setting("b", 3, is_text=True),
    make_swept_setting("c", 20),
)


def compute_objective(choice: tuple[int, ...]) -> float:
    return -abs(choice[0] - 13) - 4 * (choice[1] != 1) - 0.1 * choice[2]


def run_search(n: int, *, seed: int, space=SPACE) -> list[tuple[tuple[int, ...], float]]:
    trials: list[tuple[tuple[int, ...], float]] = []
    for _ in range(n):
        choice = choose_next_untried_settings(space, trials, seed=seed)
        if choice is None:
            break
        trials.append((choice, compute_objective((*choice, 0, 0)[:3])))
    return trials


@nightly
def test_search_beats_random_choices():
    best = [max(objective for _, objective in run_search(40, seed=seed)) for seed in range(5)]
    rng = np.random.default_rng(0)
    draws = rng.integers([20, 3, 20], size=(400, 5, 40, 3))
    at_random = [
        [max(compute_objective(tuple(c)) for c in objective) for objective in five]
        for five in draws
    ]

    assert np.mean(best) > np.mean(at_random, axis=1).max()


def test_search_tries_every_choice_once():
    space = (make_swept_setting("a", 7), make_swept_setting("b", 3, is_text=True))
    trials = run_search(100, seed=1, space=space)

    assert len(trials) == 21 == len({choice for choice, _ in trials})
    assert choose_next_untried_settings(space, trials, seed=1) is None


def test_choice_depends_on_history_and_seed_alone():
    trials = run_search(25, seed=4)

    choice = choose_next_untried_settings(SPACE, trials[:15], seed=4)
    assert choice == trials[15][0]
    assert {choose_next_untried_settings(SPACE, trials, seed=seed) for seed in range(8)} != {choice}


def test_most_influential_setting_has_largest_importance():
    shares = setting_importances(
        SPACE[::2], [((a, c), -abs(a - 10.0)) for a in range(20) for c in (3, 9)]
    )

    assert shares["a"] > 0.95
    assert sum(shares.values()) == pytest.approx(1)
    assert setting_importances(SPACE[::2], [((a, 0), 1.0) for a in range(20)]) == {}


def draw_paired_hits(
    p10: float, p01: float, p11: float, n: int, rng
) -> tuple[np.ndarray, np.ndarray]:
    kind = rng.choice(4, size=n, p=[p10, p01, p11, 1 - p10 - p01 - p11])
    candidate_hits, default_hits = np.isin(kind, (0, 2)), np.isin(kind, (1, 2))
    ones = np.ones(n)
    return np.stack([default_hits, ones], axis=1), np.stack([candidate_hits, ones], axis=1)


def compute_proportion(sums: np.ndarray) -> float:
    return float(sums[:, 0].sum() / sums[:, 1].sum())


@nightly
@pytest.mark.parametrize(("p10", "p01"), [(0.1, 0.05), (0.01, 0.0), (0.002, 0.002), (0.3, 0.3)])
def test_interval_of_gain_in_hits_covers_truth_as_often_as_stated(p10, p01):
    rng = np.random.default_rng(3)
    n_covered, n_certain = 0, 0
    for _ in range(1000):
        gain = estimate_paired_gain(
            *draw_paired_hits(p10, p01, 0.3, 200, rng), compute_proportion, confidence=0.9
        )
        n_covered += gain.low <= p10 - p01 <= gain.high
        n_certain += gain.certainty > 0.9
    assert binomial_interval(n_covered, 1000, confidence=NEAR_CERTAINTY)[1] > 0.9
    if p10 == p01:  # without a true gain, a gain is claimed no more often than stated
        assert binomial_interval(n_certain, 1000, confidence=NEAR_CERTAINTY)[0] < 0.1


def test_certainty_of_gain_in_hits_matches_sign_test():
    default_sums, candidate_sums = draw_paired_hits(0.25, 0.04, 0.3, 150, np.random.default_rng(8))
    n_better = int((candidate_sums > default_sums)[:, 0].sum())
    n_different = int((candidate_sums != default_sums)[:, 0].sum())

    gain = estimate_paired_gain(default_sums, candidate_sums, compute_proportion, confidence=0.95)

    assert gain.certainty == pytest.approx(
        1 - binomtest(n_better, n_different, 0.5, "greater").pvalue
    )
    assert gain.value == pytest.approx((2 * n_better - n_different) / 150)
    assert 0 < gain.low < gain.value < gain.high


def test_identical_trials_give_no_gain():
    trial_sums, _ = draw_paired_hits(0.0, 0.0, 0.6, 300, np.random.default_rng(2))

    gain = estimate_paired_gain(trial_sums, trial_sums, compute_proportion, confidence=0.95)

    assert (gain.value, gain.certainty) == (0, 0)
    # None of 300 trials differs: rule of three for a one-sided tail of 0.0125.
    assert gain.high == -gain.low == pytest.approx(-np.log(0.0125) / 300, rel=0.02)


def compute_negative_rms(sums: np.ndarray) -> float:
    return -float(np.sqrt(sums[:, 0].sum() / sums[:, 1].sum()))


@nightly
def test_common_randomness_cancels_in_gain_of_error():
    rng = np.random.default_rng(5)
    n_covered, widths, n = 0, [], 400
    for _ in range(400):
        common, independent = rng.normal(size=(2, n))
        ones = np.ones(n)
        default_sums = np.stack([common**2, ones], axis=1)
        candidate_sums = np.stack([(0.8 * common + 0.1 * independent) ** 2, ones], axis=1)
        gain = estimate_paired_gain(
            default_sums, candidate_sums, compute_negative_rms, confidence=0.95
        )
        n_covered += gain.low <= 1 - np.hypot(0.8, 0.1) <= gain.high
        widths.append(gain.high - gain.low)
    low, high = binomial_interval(n_covered, 400, confidence=NEAR_CERTAINTY)
    assert low < 0.95 < high
    # The difference of two independent RMS values has a standard error of 1.28 / sqrt(2 n).
    assert np.median(widths) < 0.5 * 2 * 1.96 * 1.28 / np.sqrt(2 * n)


def test_trials_that_failed_in_one_are_omitted_from_both():
    default_sums, candidate_sums = draw_paired_hits(0.2, 0.05, 0.3, 100, np.random.default_rng(9))
    failed_default_sums, failed_candidate_sums = default_sums.copy(), candidate_sums.copy()
    failed_default_sums[:10], failed_candidate_sums[20:25] = np.nan, np.nan
    completed_trials = np.r_[10:20, 25:100]

    gain = estimate_paired_gain(
        failed_default_sums, failed_candidate_sums, compute_proportion, confidence=0.95
    )

    assert gain == estimate_paired_gain(
        default_sums[completed_trials],
        candidate_sums[completed_trials],
        compute_proportion,
        confidence=0.95,
    )
