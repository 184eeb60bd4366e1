"""Requirements of studies: decisions, certainty and forecast numbers of trials."""

import numpy as np
import pytest
from scipy import stats

from dechirp.core.errors import InvalidSetting
from dechirp.experiments.study.requirements import exit_status, judge_requirements
from dechirp.experiments.study.results import PointData, estimate_scores_of_points
from dechirp.experiments.study.study import Requirement
from dechirp.theory import confidence_intervals
from sample_studies import RCS, WINDOW, HitProbability, make_layout, make_result, make_study

PD = "detection_probability"


def make_sums(hits, n):
    """Make sums of n trials, of which `hits` are hits."""
    return np.stack([np.arange(n) < hits, np.ones(n)], axis=1).astype(float)


def judge_points(points, *, axes=(), **limits):
    """Judge requirements on points given as (hits, trials)."""
    requirement = Requirement(score=PD, **limits)
    tested_study = make_study(*axes, scores=(HitProbability(),), require=(requirement,))
    point_sums = [make_sums(*counts) for counts in points]
    paths = [((axes[0].path, text),) for text in axes[0].texts] if axes else [()]
    numbers = [(x,) for x in axes[0].numbers or axes[0].texts] if axes else [()]
    point_data = [
        PointData(settings=settings, numbers=x, sums=sums, theory=np.array([np.nan]))
        for settings, x, sums in zip(paths, numbers, point_sums, strict=True)
    ]
    study_result = estimate_scores_of_points(
        tested_study, make_layout(scores=(HitProbability(),)), point_data
    )
    return judge_requirements(study_result, lambda point: point_sums[point])


@pytest.mark.parametrize(
    ("hits", "decision"), [(100, "met"), (97, "met"), (90, "undecided"), (80, "not met")]
)
def test_at_least_is_decided_by_one_sided_bound(hits, decision):
    (verdict,) = judge_points([(hits, 100)], at_least=0.9)

    # One-sided Clopper-Pearson bounds at 95 % from the beta distribution.
    low = stats.beta.ppf(0.05, hits, 101 - hits)
    high = 1.0 if hits == 100 else stats.beta.ppf(0.95, hits + 1, 100 - hits)
    assert verdict.decision == decision
    assert verdict.bound == pytest.approx(high if decision == "not met" else low, rel=1e-9)
    assert (low >= 0.9) == (decision == "met")
    assert (high < 0.9) == (decision == "not met")


@pytest.mark.parametrize(("hits", "decision"), [(0, "met"), (3, "undecided"), (20, "not met")])
def test_at_most_is_decided_by_upper_bound(hits, decision):
    (verdict,) = judge_points([(hits, 100)], at_most=0.05)

    assert verdict.decision == decision


def test_bound_on_limit_meets_it():
    high = 1 - 0.05 ** (1 / 59)  # upper bound for 0 hits in 59
    (loose_verdict,) = judge_points([(0, 59)], at_most=high * (1 + 1e-12))
    (tight_verdict,) = judge_points([(0, 59)], at_most=high * (1 - 1e-12))

    assert (loose_verdict.decision, tight_verdict.decision) == ("met", "undecided")
    assert loose_verdict.certainty == pytest.approx(0.95, abs=1e-6)


def test_no_number_of_trials_shows_probability_of_one():
    (all_hits,) = judge_points([(1000, 1000)], at_least=1.0)
    (one_miss,) = judge_points([(999, 1000)], at_least=1.0)

    assert (all_hits.decision, all_hits.more_trials) == ("undecided", None)
    assert one_miss.decision == "not met"


def test_certainty_is_confidence_at_which_bound_meets_limit():
    (verdict,) = judge_points([(97, 100)], at_least=0.9)

    # The tail is the probability of 97 hits or more if the limit is the true value.
    assert 1 - verdict.certainty == pytest.approx(stats.binom.sf(96, 100, 0.9), rel=1e-6)


def test_certainty_of_failure_is_binomial_tail():
    (verdict,) = judge_points([(80, 100)], at_least=0.9)

    assert 1 - verdict.certainty == pytest.approx(stats.binom.cdf(80, 100, 0.9), rel=1e-6)


def test_both_limits_are_decided_separately():
    low, high = judge_points([(90, 100)], at_least=0.5, at_most=0.91)

    assert (low.side, low.decision) == ("at_least", "met")
    assert (high.side, high.decision) == ("at_most", "undecided")
    assert exit_status([low]) == 0
    assert exit_status([low, high]) == 1
    assert exit_status([]) == 0


def test_all_points_must_meet_limit_and_least_certain_is_reported():
    hits = [99, 98, 97, 100, 100, 99, 98]
    (verdict,) = judge_points([(n, 100) for n in hits], axes=(RCS,), at_least=0.9)

    assert verdict.decision == "met"
    assert (verdict.point, verdict.n_met, len(verdict.points)) == (2, 7, 7)
    # No correction for several points: all pass wrongly only if the failing one does.
    assert 1 - verdict.certainty == pytest.approx(stats.binom.sf(96, 100, 0.9), rel=1e-6)


def test_failure_of_one_point_is_corrected_for_number_of_points():
    # 83 of 100 fail for a single point (p = 0.021), but not for the worst of seven.
    assert stats.binom.cdf(83, 100, 0.9) < 0.05 < 7 * stats.binom.cdf(83, 100, 0.9)
    (single_verdict,) = judge_points([(83, 100)], at_least=0.9)
    (verdict_of_seven,) = judge_points([(83, 100), *[(100, 100)] * 6], axes=(RCS,), at_least=0.9)
    (worse_verdict,) = judge_points([(75, 100), *[(100, 100)] * 6], axes=(RCS,), at_least=0.9)

    assert single_verdict.decision == "not met"
    assert (verdict_of_seven.decision, verdict_of_seven.n_met) == ("undecided", 6)
    assert worse_verdict.decision == "not met"
    assert 1 - worse_verdict.certainty == pytest.approx(7 * stats.binom.cdf(75, 100, 0.9), rel=1e-5)


def test_requirement_covers_points_that_it_names():
    study_result, point_sums = make_result(
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

    verdicts = judge_requirements(study_result, lambda point: point_sums[point])

    assert [verdict.points for verdict in verdicts] == [(12, 13), (0,), tuple(range(14))]
    assert [verdict.decision for verdict in verdicts] == ["met", "met", "not met"]


def test_forecast_number_of_trials_decides_requirement():
    """The forecast assumes a constant proportion and is accurate within a fifth."""
    (verdict,) = judge_points([(185, 200)], at_least=0.9)
    assert verdict.decision == "undecided"

    def is_met(n):
        low, _ = confidence_intervals.binomial_interval(round(0.925 * n), n, confidence=0.9)
        return low >= 0.9

    n = 200 + verdict.more_trials
    assert is_met(round(1.2 * n))
    assert not is_met(round(0.8 * n))


def test_bound_without_hits_falls_as_one_over_trials():
    (verdict,) = judge_points([(0, 50)], at_most=0.01)

    # No hit in n trials shows less than 3.0 / n: 299 trials, so 249 more.
    assert verdict.decision == "undecided"
    assert verdict.more_trials == pytest.approx(249, rel=0.1)


def test_point_without_trials_leaves_requirement_undecided():
    (verdict,) = judge_points([(0, 0)], at_least=0.9)

    assert (verdict.decision, verdict.trials, verdict.more_trials) == ("undecided", 0, None)
    assert np.isnan(verdict.certainty)
    assert np.isnan(verdict.value)


def test_failed_trials_are_not_counted():
    requirement = Requirement(score=PD, at_least=0.9)
    tested_study = make_study(scores=(HitProbability(),), require=(requirement,))
    sums = make_sums(100, 100)
    sums[40:] = np.nan
    point_data = [PointData(settings=(), numbers=(), sums=sums, theory=np.array([np.nan]))]
    study_result = estimate_scores_of_points(
        tested_study, make_layout(scores=(HitProbability(),)), point_data
    )

    (verdict,) = judge_requirements(study_result, lambda _: sums)

    # 40 of 40 show at least 0.928.
    assert (verdict.decision, verdict.trials) == ("met", 40)
    assert verdict.bound == pytest.approx(0.05 ** (1 / 40))


def test_requirement_is_met_by_chance_no_more_often_than_stated():
    """At most 5 % of points exactly on the limit are judged met, and at most 5 % not met."""
    rng = np.random.default_rng(5)
    counts = {"met": 0, "not met": 0, "undecided": 0}
    hits = rng.binomial(60, 0.9, 2000)
    decisions = {
        int(k): judge_points([(int(k), 60)], at_least=0.9)[0].decision for k in set(hits.tolist())
    }
    for k in hits.tolist():
        counts[decisions[k]] += 1

    for decision in ("met", "not met"):
        low, _ = confidence_intervals.binomial_interval(counts[decision], 2000, confidence=1 - 1e-6)
        assert low < 0.05
        assert counts[decision] > 0


def test_rejects_target_of_score_without_targets():
    study_result, point_sums = make_result(
        require=(Requirement(score="false_alarm_probability", target="car", at_most=1e-2),)
    )

    with pytest.raises(InvalidSetting, match="not scored by target"):
        judge_requirements(study_result, lambda point: point_sums[point])


@pytest.mark.parametrize("confidence", [0.5, 0.3])
def test_rejects_confidence_of_half_or_less(confidence):
    with pytest.raises(InvalidSetting, match="above 0.5"):
        judge_points([(90, 100)], at_least=0.9, confidence=confidence)
