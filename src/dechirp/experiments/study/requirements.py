"""Verdicts on the requirements of a study, with their certainty.

A limit is shown to hold at a point when the one-sided bound of the score, at the requirement's
confidence c, lies on its right side. A requirement covers all of its points. It is

met         if every point is shown to meet it, each at c. Wherever one point truly fails, that
            point is shown to meet it with probability 1 - c at most, and so are all: the error
            probability need not be split (R. L. Berger, Multiparameter hypothesis testing and
            acceptance sampling, Technometrics 24, 1982).
not met     if some point is shown to fail. Of n points that all meet it, one might fail by
            chance, so each is tested at 1 - (1 - c) / n (Bonferroni).
undecided   otherwise. More trials would decide it.

The bounds assume a number of trials that was fixed in advance. Adding trials until a requirement
is met passes it more often than the confidence states.
"""

from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.evaluation.score.base import NO_ESTIMATE, Estimate
from dechirp.experiments.study.layout import ScoreColumnLayout
from dechirp.experiments.study.results import StudyResult
from dechirp.experiments.study.study import Requirement

Decision = Literal["met", "not met", "undecided"]
Side = Literal["at_least", "at_most"]
PointSums = Callable[[int], np.ndarray]
"""Return the sums of a point by its number, (n_trials, n_columns)."""

# Tails of certainty: further out, the assumed laws of the intervals no longer hold.
_SMALLEST_TAIL = 1e-9
# Forecasts of more trials are not reported.
_MAX_FORECAST = 1e12


@frozen_dataclass
class Verdict:
    """Verdict on one limit of a requirement, over all points that it covers."""

    requirement: Requirement
    side: Side
    limit: float
    """SI."""
    decision: Decision
    certainty: float
    """Highest confidence at which the limit is met, or not met; for an undecided limit, at which
    the side of its value is shown. At most 1 - 1e-9; NaN without measurements."""
    points: tuple[int, ...]
    """Numbers of the points that the requirement covers."""
    n_met: int
    """Number of points shown to meet the limit, each at the requirement's confidence."""
    point: int
    """Deciding point: the least certain one if met, else the one that fails most certainly."""
    value: float
    """Value at the deciding point."""
    bound: float
    """One-sided bound there, at the requirement's confidence (Bonferroni-corrected if not met)."""
    trials: int
    """Number of trials there, without failed ones."""
    more_trials: int | None
    """Approximate number of additional trials a point that would decide, at the present values;
    None where it is decided, or no number would."""

    @property
    def is_met(self) -> bool:
        """True if the limit is shown to be met."""
        return self.decision == "met"


def judge_requirements(result: StudyResult, trial_sums_of_point: PointSums) -> tuple[Verdict, ...]:
    """Judge each limit of a study's requirements, in order.

    Raises
    ------
    InvalidSetting
        If a requirement names a target that its score does not have, or a confidence of one half
        or less.
    """
    return tuple(
        _judge_limit_over_points(
            _LimitTest(requirement, side, result.layout, trial_sums_of_point),
            point_numbers_of_requirement(requirement, result),
        )
        for requirement in result.study.require
        for side in _SIDES
        if getattr(requirement, side) is not None
    )


def exit_status(verdicts: Sequence[Verdict]) -> int:
    """Return 0 if all limits are met, else 1: an undecided limit is not shown."""
    return 0 if all(verdict.is_met for verdict in verdicts) else 1


def point_numbers_of_requirement(requirement: Requirement, result: StudyResult) -> tuple[int, ...]:
    """Return the numbers of the points that a requirement covers; `Study` ensures one exists."""
    wanted = set(requirement.points)
    return tuple(
        point for point, settings in enumerate(result.settings) if wanted.issubset(settings)
    )


_SIDES: tuple[Side, ...] = ("at_least", "at_most")


class _LimitTest:
    """Test of one limit of a requirement at single points."""

    def __init__(
        self, requirement: Requirement, side: Side, layout: ScoreColumnLayout, sums: PointSums
    ) -> None:
        self.requirement, self.side, self.layout, self._sums = requirement, side, layout, sums
        self.limit = float(getattr(requirement, side))
        self.tail = 1 - requirement.confidence
        self._score = layout.scores[layout.index_of_score(requirement.score)]
        if not 0 < self.tail < 0.5:
            raise InvalidSetting(
                "require.confidence",
                value=requirement.confidence,
                expected="above 0.5 and below 1",
                fix="give the confidence of one side, such as 0.95",
            )
        self._check_target_is_scored()

    def _check_target_is_scored(self) -> None:
        label, target = self.requirement.score, self.requirement.target
        names = self.layout.scored_target_names[self.layout.index_of_score(label)]
        if target is not None and target not in names:
            raise InvalidSetting(
                "require.target",
                value=target,
                expected=f"one of {', '.join(names)}"
                if names
                else f"no target: {label} is not scored by target",
                fix="name a target that the score has" if names else "remove target",
            )

    def valid_trial_sums(self, point: int) -> np.ndarray:
        """Return the sums of the score in the valid trials of a point, (n_trials, n_sums)."""
        requirement, sums = self.requirement, self._sums(point)
        if not len(sums):  # no trials yet
            return np.empty((0, self._score.n_sums))
        rows = self.layout.select_score_sums(sums, requirement.score, requirement.target)
        return rows[~np.isnan(rows).any(axis=1)]

    def estimate_with_tail_probability(
        self, trial_sums: np.ndarray, tail_probability: float
    ) -> Estimate:
        """Estimate the value with bounds that leave `tail_probability` on each side."""
        if not len(trial_sums):
            return NO_ESTIMATE
        return self._score.estimate_with_interval(trial_sums, confidence=1 - 2 * tail_probability)

    def meets_limit(self, score_value: float) -> bool:
        """Return whether a number meets the limit; equality does."""
        return score_value >= self.limit if self.side == "at_least" else score_value <= self.limit

    def interval_ends_worst_first(self, estimate: Estimate) -> tuple[float, float]:
        """Return the ends of an interval, the worst for the requirement first."""
        return (
            (estimate.low, estimate.high)
            if self.side == "at_least"
            else (estimate.high, estimate.low)
        )

    def is_limit_shown_met_or_failed(
        self, trial_sums: np.ndarray, tail_probability: float, *, met: bool
    ) -> bool:
        """Return whether a point is shown to meet, or fail, the limit with this error."""
        worst, best = self.interval_ends_worst_first(
            self.estimate_with_tail_probability(trial_sums, tail_probability)
        )
        return (
            self.meets_limit(worst)
            if met
            else bool(np.isfinite(best)) and not self.meets_limit(best)
        )

    def smallest_conclusive_tail_probability(self, trial_sums: np.ndarray, *, met: bool) -> float:
        """Return the smallest tail for which a point is shown to meet, or fail; 0.5 if none."""
        if self.is_limit_shown_met_or_failed(trial_sums, _SMALLEST_TAIL, met=met):
            return _SMALLEST_TAIL
        log_hidden, log_shown = np.log(_SMALLEST_TAIL), np.log(0.5)
        for _ in range(30):  # bisection: the tail to eight digits
            middle = (log_hidden + log_shown) / 2
            if self.is_limit_shown_met_or_failed(trial_sums, float(np.exp(middle)), met=met):
                log_shown = middle
            else:
                log_hidden = middle
        return float(np.exp(log_shown))

    def predict_additional_trials(
        self, trial_sums: np.ndarray, tail_probability: float, *, met: bool
    ) -> float:
        """Predict the number of additional trials with which the bound would reach the limit.

        The convergence rate is that of the same trials repeated four times: 1 / sqrt(n) mostly,
        1 / n where every trial or no trial is a hit. Infinite if the limit is never reached.
        """
        once, fourfold = (
            self.estimate_with_tail_probability(np.tile(trial_sums, (times, 1)), tail_probability)
            if len(trial_sums)
            else NO_ESTIMATE
            for times in (1, 4)
        )
        reach, fourfold_reach = (
            abs(estimate.value - self.interval_ends_worst_first(estimate)[0 if met else 1])
            for estimate in (once, fourfold)
        )
        margin = abs(once.value - self.limit)
        if not (margin > 0 and reach > fourfold_reach > 0 and np.isfinite(reach)):
            return np.inf
        power = np.log(reach / fourfold_reach) / np.log(4)
        needed = len(trial_sums) * (reach / margin) ** (1 / power)
        return max(float(needed) - len(trial_sums), 1.0)


def _judge_limit_over_points(limit: _LimitTest, points: tuple[int, ...]) -> Verdict:
    bonferroni_tail_probability = limit.tail / len(points)
    failed, undecided = [], []
    for point in points:
        rows = limit.valid_trial_sums(point)
        if limit.is_limit_shown_met_or_failed(rows, limit.tail, met=True):
            continue
        if limit.is_limit_shown_met_or_failed(rows, bonferroni_tail_probability, met=False):
            failed.append(point)
        undecided.append(point)
    n_met = len(points) - len(undecided)
    more_trials: float | None = None
    if failed:
        decision: Decision = "not met"
        deciding, tail = _most_certainly_failed_point_and_tail(limit, failed)
        tail = min(tail * len(points), 1.0)
    elif undecided:
        decision = "undecided"
        deciding, tail = _worst_undecided_point_and_tail(
            limit, undecided, bonferroni_tail_probability
        )
        more_trials = max(
            _predict_trials_to_decide_point(limit, point, bonferroni_tail_probability)
            for point in undecided
        )
    else:
        decision = "met"
        deciding, tail = _least_certainly_met_point_and_tail(limit, points)
    sums = limit.valid_trial_sums(deciding)
    estimate = limit.estimate_with_tail_probability(
        sums, bonferroni_tail_probability if failed else limit.tail
    )
    return Verdict(
        requirement=limit.requirement,
        side=limit.side,
        limit=limit.limit,
        decision=decision,
        certainty=1 - tail,
        points=points,
        n_met=n_met,
        point=deciding,
        value=estimate.value,
        bound=limit.interval_ends_worst_first(estimate)[1 if failed else 0],
        trials=len(sums),
        more_trials=_round_up_to_two_digits(more_trials),
    )


def _least_certainly_met_point_and_tail(
    limit: _LimitTest, points: Sequence[int]
) -> tuple[int, float]:
    """Return the point shown to meet a limit with the largest tail, and that tail."""
    deciding, tail = (
        points[0],
        limit.smallest_conclusive_tail_probability(limit.valid_trial_sums(points[0]), met=True),
    )
    for point in points[1:]:
        if tail >= 0.5:  # no confidence is left for the other points
            break
        rows = limit.valid_trial_sums(point)
        # A point that fails at this tail may still be shown to meet the limit at its own.
        if not limit.is_limit_shown_met_or_failed(rows, tail, met=True):
            deciding, tail = point, limit.smallest_conclusive_tail_probability(rows, met=True)
    return deciding, tail


def _most_certainly_failed_point_and_tail(
    limit: _LimitTest, points: Sequence[int]
) -> tuple[int, float]:
    """Return the point shown to fail a limit with the smallest tail, and that tail."""
    deciding, tail = (
        points[0],
        limit.smallest_conclusive_tail_probability(limit.valid_trial_sums(points[0]), met=False),
    )
    for point in points[1:]:
        rows = limit.valid_trial_sums(point)
        if tail > _SMALLEST_TAIL and limit.is_limit_shown_met_or_failed(
            rows, 0.99 * tail, met=False
        ):
            deciding, tail = point, limit.smallest_conclusive_tail_probability(rows, met=False)
    return deciding, tail


def _worst_undecided_point_and_tail(
    limit: _LimitTest, points: Sequence[int], bonferroni_tail_probability: float
) -> tuple[int, float]:
    """Return the worst undecided point, and the tail at which the side of its value is shown."""
    wrong: list[int] = []
    right: list[int] = []
    empty: list[int] = []
    for point in points:
        measured = limit.estimate_with_tail_probability(
            limit.valid_trial_sums(point), bonferroni_tail_probability
        ).value
        kind = empty if np.isnan(measured) else right if limit.meets_limit(measured) else wrong
        kind.append(point)
    if empty:
        return empty[0], np.nan
    return (
        _most_certainly_failed_point_and_tail(limit, wrong)
        if wrong
        else _least_certainly_met_point_and_tail(limit, right)
    )


def _predict_trials_to_decide_point(
    limit: _LimitTest, point: int, bonferroni_tail_probability: float
) -> float:
    rows = limit.valid_trial_sums(point)
    met = limit.meets_limit(limit.estimate_with_tail_probability(rows, limit.tail).value)
    return limit.predict_additional_trials(
        rows, limit.tail if met else bonferroni_tail_probability, met=met
    )


def _round_up_to_two_digits(n_trials: float | None) -> int | None:
    """Round up to two digits, the precision of a forecast."""
    if n_trials is None or n_trials > _MAX_FORECAST:
        return None
    unit = 10 ** max(int(np.floor(np.log10(n_trials))) - 1, 0)
    return int(np.ceil(n_trials / unit)) * unit
