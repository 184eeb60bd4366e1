"""What a search asks for next, and what is said of the gain."""

import numpy as np
import pytest
from scipy.stats import binomtest

from dechirp.experiments.study.study import SweptSetting
from dechirp.experiments.tune.gain import paired_gain
from dechirp.experiments.tune.sampler import next_choice, setting_importances
from dechirp.theory.confidence_intervals import binomial_interval

CERTAIN = 1 - 1e-6


def listed(path: str, n: int, *, words: bool = False) -> SweptSetting:
    texts = tuple(f"{path}{k}" for k in range(n))
    return SweptSetting(path=path, texts=texts, numbers=None if words else tuple(range(n)), unit="")


SPACE = (listed("a", 20), listed("b", 3, words=True), listed("c", 20))


def worth(choice: tuple[int, ...]) -> float:
    return -abs(choice[0] - 13) - 4 * (choice[1] != 1) - 0.1 * choice[2]


def searched(n: int, *, seed: int, space=SPACE) -> list[tuple[tuple[int, ...], float]]:
    tried: list[tuple[tuple[int, ...], float]] = []
    for _ in range(n):
        choice = next_choice(space, tried, seed=seed)
        if choice is None:
            break
        tried.append((choice, worth((*choice, 0, 0)[:3])))
    return tried


def test_the_search_does_better_than_as_many_choices_at_random():
    best = [max(of for _, of in searched(40, seed=seed)) for seed in range(5)]
    rng = np.random.default_rng(0)
    draws = rng.integers([20, 3, 20], size=(400, 5, 40, 3))
    at_random = [[max(worth(tuple(c)) for c in of) for of in five] for five in draws]

    assert np.mean(best) > np.mean(at_random, axis=1).max()


def test_no_choice_is_tried_twice_and_all_are_in_the_end():
    space = (listed("a", 7), listed("b", 3, words=True))
    tried = searched(100, seed=1, space=space)

    assert len(tried) == 21 == len({choice for choice, _ in tried})
    assert next_choice(space, tried, seed=1) is None


def test_a_choice_follows_from_the_past_and_the_seed_alone():
    tried = searched(25, seed=4)

    again = next_choice(SPACE, tried[:15], seed=4)
    assert again == tried[15][0]
    assert {next_choice(SPACE, tried, seed=seed) for seed in range(8)} != {again}


def test_the_setting_that_matters_most_is_told():
    shares = setting_importances(
        SPACE[::2], [((a, c), -abs(a - 10.0)) for a in range(20) for c in (3, 9)]
    )

    assert shares["a"] > 0.95
    assert sum(shares.values()) == pytest.approx(1)
    assert setting_importances(SPACE[::2], [((a, 0), 1.0) for a in range(20)]) == {}


def hits(p10: float, p01: float, both: float, n: int, rng) -> tuple[np.ndarray, np.ndarray]:
    kind = rng.choice(4, size=n, p=[p10, p01, both, 1 - p10 - p01 - both])
    after, before = np.isin(kind, (0, 2)), np.isin(kind, (1, 2))
    ones = np.ones(n)
    return np.stack([before, ones], axis=1), np.stack([after, ones], axis=1)


def share(sums: np.ndarray) -> float:
    return float(sums[:, 0].sum() / sums[:, 1].sum())


@pytest.mark.parametrize(("p10", "p01"), [(0.1, 0.05), (0.01, 0.0), (0.002, 0.002), (0.3, 0.3)])
def test_the_interval_of_a_gain_in_hits_covers_the_truth_as_often_as_stated(p10, p01):
    rng = np.random.default_rng(3)
    covered, surely = 0, 0
    for _ in range(1000):
        found = paired_gain(*hits(p10, p01, 0.3, 200, rng), share, confidence=0.9)
        covered += found.low <= p10 - p01 <= found.high
        surely += found.certainty > 0.9
    assert binomial_interval(covered, 1000, confidence=CERTAIN)[1] > 0.9
    if p10 == p01:  # where there is no gain, one is claimed no more often than stated
        assert binomial_interval(surely, 1000, confidence=CERTAIN)[0] < 0.1


def test_the_certainty_of_a_gain_in_hits_is_that_of_the_sign_test():
    before, after = hits(0.25, 0.04, 0.3, 150, np.random.default_rng(8))
    better = int((after > before)[:, 0].sum())
    apart = int((after != before)[:, 0].sum())

    found = paired_gain(before, after, share, confidence=0.95)

    assert found.certainty == pytest.approx(1 - binomtest(better, apart, 0.5, "greater").pvalue)
    assert found.value == pytest.approx((2 * better - apart) / 150)
    assert 0 < found.low < found.value < found.high


def test_trials_that_are_alike_in_both_say_that_there_is_no_gain():
    same, _ = hits(0.0, 0.0, 0.6, 300, np.random.default_rng(2))

    found = paired_gain(same, same, share, confidence=0.95)

    assert (found.value, found.certainty) == (0, 0)
    # No trial of 300 tells them apart: rule of three, for a one-sided tail of 0.0125.
    assert found.high == -found.low == pytest.approx(-np.log(0.0125) / 300, rel=0.02)


def rms(sums: np.ndarray) -> float:
    return -float(np.sqrt(sums[:, 0].sum() / sums[:, 1].sum()))


def test_chance_that_both_meet_cancels_in_the_gain_of_an_error():
    rng = np.random.default_rng(5)
    covered, widths, n = 0, [], 400
    for _ in range(400):
        common, own = rng.normal(size=(2, n))
        ones = np.ones(n)
        before = np.stack([common**2, ones], axis=1)
        after = np.stack([(0.8 * common + 0.1 * own) ** 2, ones], axis=1)
        found = paired_gain(before, after, rms, confidence=0.95)
        covered += found.low <= 1 - np.hypot(0.8, 0.1) <= found.high
        widths.append(found.high - found.low)
    low, high = binomial_interval(covered, 400, confidence=CERTAIN)
    assert low < 0.95 < high
    # Of two independent root mean squares the difference would be 1.28 / sqrt(2 n) uncertain.
    assert np.median(widths) < 0.5 * 2 * 1.96 * 1.28 / np.sqrt(2 * n)


def test_trials_that_failed_in_either_are_left_out_of_both():
    before, after = hits(0.2, 0.05, 0.3, 100, np.random.default_rng(9))
    broken_before, broken_after = before.copy(), after.copy()
    broken_before[:10], broken_after[20:25] = np.nan, np.nan
    whole = np.r_[10:20, 25:100]

    found = paired_gain(broken_before, broken_after, share, confidence=0.95)

    assert found == paired_gain(before[whole], after[whole], share, confidence=0.95)
