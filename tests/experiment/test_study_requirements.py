"""Requirements: met, not met or undecided, each as rarely wrong as it says."""

import numpy as np
import pytest
from scipy import stats

from dechirp.core.errors import InvalidSetting
from dechirp.experiments.study.requirements import exit_status, judge_requirements
from dechirp.experiments.study.results import PointData, estimate_points
from dechirp.experiments.study.study import Requirement
from dechirp.theory import confidence_intervals
from study_made import RCS, WINDOW, Share, layout, result, study

PD = "detection_probability"


def trials(hits, n):
    """Sums of n looks of which some are hits."""
    return np.stack([np.arange(n) < hits, np.ones(n)], axis=1).astype(float)


def decided(points, *, axes=(), **asked):
    """Judgement on points of (hits, trials)."""
    requirement = Requirement(score=PD, **asked)
    what = study(*axes, scores=(Share(),), require=(requirement,))
    kept = [trials(*one) for one in points]
    paths = [((axes[0].path, text),) for text in axes[0].texts] if axes else [()]
    numbers = [(x,) for x in axes[0].numbers or axes[0].texts] if axes else [()]
    made = [
        PointData(settings=at, numbers=x, sums=of, theory=np.array([np.nan]))
        for at, x, of in zip(paths, numbers, kept, strict=True)
    ]
    found = estimate_points(what, layout(scores=(Share(),)), made)
    return judge_requirements(found, lambda point: kept[point])


@pytest.mark.parametrize(
    ("hits", "decision"), [(100, "met"), (97, "met"), (90, "undecided"), (80, "not met")]
)
def test_at_least_is_decided_by_the_one_sided_bound(hits, decision):
    (one,) = decided([(hits, 100)], at_least=0.9)

    # Clopper and Pearson, one-sided at 95 %, from the beta distribution.
    low = stats.beta.ppf(0.05, hits, 101 - hits)
    high = 1.0 if hits == 100 else stats.beta.ppf(0.95, hits + 1, 100 - hits)
    assert one.decision == decision
    assert one.bound == pytest.approx(high if decision == "not met" else low, rel=1e-9)
    assert (low >= 0.9) == (decision == "met")
    assert (high < 0.9) == (decision == "not met")


@pytest.mark.parametrize(("hits", "decision"), [(0, "met"), (3, "undecided"), (20, "not met")])
def test_at_most_is_decided_by_the_other_bound(hits, decision):
    (one,) = decided([(hits, 100)], at_most=0.05)

    assert one.decision == decision


def test_a_bound_on_the_limit_itself_meets_it():
    high = 1 - 0.05 ** (1 / 59)  # that of none in 59
    (on,) = decided([(0, 59)], at_most=high * (1 + 1e-12))
    (below,) = decided([(0, 59)], at_most=high * (1 - 1e-12))

    assert (on.decision, below.decision) == ("met", "undecided")
    assert on.certainty == pytest.approx(0.95, abs=1e-6)


def test_no_number_of_trials_shows_certainty_itself():
    (all_hits,) = decided([(1000, 1000)], at_least=1.0)
    (one_miss,) = decided([(999, 1000)], at_least=1.0)

    assert (all_hits.decision, all_hits.more_trials) == ("undecided", None)
    assert one_miss.decision == "not met"


def test_certainty_is_the_confidence_at_which_the_bound_meets_the_limit():
    (one,) = decided([(97, 100)], at_least=0.9)

    # Its tail is the chance of 97 hits or more where the limit is the truth.
    assert 1 - one.certainty == pytest.approx(stats.binom.sf(96, 100, 0.9), rel=1e-6)


def test_certainty_that_it_is_not_met_is_the_chance_of_so_few_hits():
    (one,) = decided([(80, 100)], at_least=0.9)

    assert 1 - one.certainty == pytest.approx(stats.binom.cdf(80, 100, 0.9), rel=1e-6)


def test_both_limits_are_decided_on_their_own():
    low, high = decided([(90, 100)], at_least=0.5, at_most=0.91)

    assert (low.side, low.decision) == ("at_least", "met")
    assert (high.side, high.decision) == ("at_most", "undecided")
    assert exit_status([low]) == 0
    assert exit_status([low, high]) == 1
    assert exit_status([]) == 0


def test_all_points_must_meet_it_and_the_least_certain_one_is_told():
    hits = [99, 98, 97, 100, 100, 99, 98]
    (one,) = decided([(n, 100) for n in hits], axes=(RCS,), at_least=0.9)

    assert one.decision == "met"
    assert (one.point, one.n_met, len(one.points)) == (2, 7, 7)
    # No share of the doubt for each: all pass wrongly only if the one that fails does.
    assert 1 - one.certainty == pytest.approx(stats.binom.sf(96, 100, 0.9), rel=1e-6)


def test_one_point_that_fails_is_shown_only_beyond_the_chance_of_any():
    # 83 of 100 are too few for one point alone (p = 0.021), but not for the worst of seven.
    assert stats.binom.cdf(83, 100, 0.9) < 0.05 < 7 * stats.binom.cdf(83, 100, 0.9)
    (alone,) = decided([(83, 100)], at_least=0.9)
    (of_seven,) = decided([(83, 100), *[(100, 100)] * 6], axes=(RCS,), at_least=0.9)
    (worse,) = decided([(75, 100), *[(100, 100)] * 6], axes=(RCS,), at_least=0.9)

    assert alone.decision == "not met"
    assert (of_seven.decision, of_seven.n_met) == ("undecided", 6)
    assert worse.decision == "not met"
    assert 1 - worse.certainty == pytest.approx(7 * stats.binom.cdf(75, 100, 0.9), rel=1e-5)


def test_a_requirement_is_of_the_points_that_it_names():
    found, kept = result(
        RCS,
        WINDOW,
        require=(
            Requirement(score=PD, points=((RCS.path, "20 dBsm"),), at_least=0.8),
            Requirement(
                score=PD, points=((RCS.path, "-10 dBsm"), (WINDOW.path, "hann")), at_most=0.3
            ),
            Requirement(score=PD, at_least=0.8),
        ),
    )

    judged = judge_requirements(found, lambda point: kept[point])

    assert [one.points for one in judged] == [(12, 13), (0,), tuple(range(14))]
    assert [one.decision for one in judged] == ["met", "met", "not met"]


def test_more_trials_as_foretold_decide_it():
    """If the share stays as it is; within a fifth, as a forecast by a square root is."""
    (one,) = decided([(185, 200)], at_least=0.9)
    assert one.decision == "undecided"

    def met(n):
        low, _ = confidence_intervals.binomial_interval(round(0.925 * n), n, confidence=0.9)
        return low >= 0.9

    n = 200 + one.more_trials
    assert met(round(1.2 * n))
    assert not met(round(0.8 * n))


def test_where_nothing_was_seen_the_bound_falls_as_one_over_the_trials():
    (one,) = decided([(0, 50)], at_most=0.01)

    # None in n shows less than 3.0 / n: 299 trials, so 249 more.
    assert one.decision == "undecided"
    assert one.more_trials == pytest.approx(249, rel=0.1)


def test_a_point_without_trials_leaves_it_undecided():
    (one,) = decided([(0, 0)], at_least=0.9)

    assert (one.decision, one.trials, one.more_trials) == ("undecided", 0, None)
    assert np.isnan(one.certainty)
    assert np.isnan(one.value)


def test_trials_that_failed_are_no_trials():
    requirement = Requirement(score=PD, at_least=0.9)
    what = study(scores=(Share(),), require=(requirement,))
    kept = trials(100, 100)
    kept[40:] = np.nan
    made = [PointData(settings=(), numbers=(), sums=kept, theory=np.array([np.nan]))]
    found = estimate_points(what, layout(scores=(Share(),)), made)

    (one,) = judge_requirements(found, lambda _: kept)

    # 40 of 40 show 0.928 at least.
    assert (one.decision, one.trials) == ("met", 40)
    assert one.bound == pytest.approx(0.05 ** (1 / 40))


def test_it_is_met_by_chance_no_more_often_than_said():
    """Of points exactly on the limit, 5 % at most are said to meet it, and to fail it."""
    rng = np.random.default_rng(5)
    counts = {"met": 0, "not met": 0, "undecided": 0}
    hits = rng.binomial(60, 0.9, 2000)
    known = {int(k): decided([(int(k), 60)], at_least=0.9)[0].decision for k in set(hits.tolist())}
    for k in hits.tolist():
        counts[known[k]] += 1

    for decision in ("met", "not met"):
        low, _ = confidence_intervals.binomial_interval(counts[decision], 2000, confidence=1 - 1e-6)
        assert low < 0.05
        assert counts[decision] > 0


def test_a_target_that_the_score_is_not_of_is_named():
    found, kept = result(
        require=(Requirement(score="false_alarm_probability", target="car", at_most=1e-2),)
    )

    with pytest.raises(InvalidSetting, match="left out"):
        judge_requirements(found, lambda point: kept[point])


@pytest.mark.parametrize("confidence", [0.5, 0.3])
def test_a_confidence_of_one_side_is_above_one_half(confidence):
    with pytest.raises(InvalidSetting, match="above 0.5"):
        decided([(90, 100)], at_least=0.9, confidence=confidence)
