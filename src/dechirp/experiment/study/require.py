"""Requirements: whether they are met, and how certain that is.

A limit is shown to hold at a point when the one-sided bound of the score, at the requirement's
confidence c, lies on its right side. A requirement speaks of all of its points. It is

met         if every point is shown to meet it, each at c. Wherever one point truly fails, that
            point is shown to meet it with chance 1 - c at most, and so are all: no share of the
            doubt is needed for each (R. L. Berger, Multiparameter hypothesis testing and
            acceptance sampling, Technometrics 24, 1982).
not met     if some point is shown to fail. Of n points that all meet it, one might be by
            chance, so each is asked at 1 - (1 - c) / n (Bonferroni).
undecided   otherwise. More trials would tell.

The bounds are those of a number of trials that was fixed before. Whoever adds trials until a
requirement is met passes more often than the confidence says.
"""

from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.evaluate.score.base import NOTHING, Estimate
from dechirp.experiment.study.layout import Layout
from dechirp.experiment.study.results import StudyResult
from dechirp.experiment.study.study import Requirement

Decision = Literal["met", "not met", "undecided"]
Side = Literal["at_least", "at_most"]
Sums = Callable[[int], np.ndarray]
"""Sums of a point by its number, (n_trials, n_columns)."""

# Tails of certainty: further out, the laws behind the intervals are no longer those of trials.
_SMALLEST_TAIL = 1e-9
# More trials than this are not foretold.
_MOST_TRIALS = 1e12


@value
class Judged:
    """One limit of a requirement, over all points that it names."""

    requirement: Requirement
    side: Side
    limit: float
    """SI."""
    decision: Decision
    certainty: float
    """Highest confidence at which it is met, or not met; of one that is undecided, at which the
    side is shown on which its value lies. At most 1 - 1e-9; NaN where nothing was measured."""
    points: tuple[int, ...]
    """Numbers of the points that are meant."""
    n_met: int
    """Points that are shown to meet it, each at the requirement's confidence."""
    point: int
    """The one that decides: the least certain if met, else the one that fails most certainly."""
    value: float
    """There."""
    bound: float
    """There, one-sided, at the requirement's confidence (that of one of n points if not met)."""
    trials: int
    """There, without those that failed."""
    more_trials: int | None
    """Roughly how many more trials a point would decide it, if values stay as they are; None
    where it is decided, or none would."""

    @property
    def met(self) -> bool:
        """Whether it is shown."""
        return self.decision == "met"


def judge(result: StudyResult, sums: Sums) -> tuple[Judged, ...]:
    """Decide on each limit of a study's requirements, in their order.

    Raises
    ------
    InvalidSetting
        If a requirement names a target that its score is not of, or a confidence that is not
        above one half.
    """
    return tuple(
        _judged(_Limit(requirement, side, result.layout, sums), named_points(requirement, result))
        for requirement in result.study.require
        for side in _SIDES
        if getattr(requirement, side) is not None
    )


def exit_status(judged: Sequence[Judged]) -> int:
    """0 if all is met, else 1: what is undecided is not shown."""
    return 0 if all(one.met for one in judged) else 1


def named_points(requirement: Requirement, result: StudyResult) -> tuple[int, ...]:
    """Numbers of the points that a requirement names; `Study` has seen to it that there are."""
    wanted = set(requirement.at)
    return tuple(
        point for point, settings in enumerate(result.settings) if wanted.issubset(settings)
    )


_SIDES: tuple[Side, ...] = ("at_least", "at_most")


class _Limit:
    """One limit of a requirement, to be asked about one point after the other."""

    def __init__(self, requirement: Requirement, side: Side, layout: Layout, sums: Sums) -> None:
        self.requirement, self.side, self.layout, self._sums = requirement, side, layout, sums
        self.limit = float(getattr(requirement, side))
        self.tail = 1 - requirement.confidence
        self._score = layout.scores[layout.index(requirement.score)]
        if not 0 < self.tail < 0.5:
            raise InvalidSetting(
                "require.confidence",
                got=requirement.confidence,
                need="above 0.5 and below 1",
                fix="Give the confidence of one side, such as 0.95.",
            )
        self._must_have_the_target()

    def _must_have_the_target(self) -> None:
        label, target = self.requirement.score, self.requirement.target
        names = self.layout.subjects[self.layout.index(label)]
        if target is not None and target not in names:
            raise InvalidSetting(
                "require.target",
                got=target,
                need=f"one of {', '.join(names)}" if names else f"left out: {label} has no targets",
                fix="Name a target that the score is of, or none for the whole.",
            )

    def rows(self, point: int) -> np.ndarray:
        """Sums of the score in the trials of a point that did not fail, (n_trials, n_sums)."""
        asked, sums = self.requirement, self._sums(point)
        if not len(sums):  # not tried yet
            return np.empty((0, self._score.n_sums))
        own = self.layout.sums_of(sums, asked.score, asked.target)
        return own[~np.isnan(own).any(axis=1)]

    def estimate(self, rows: np.ndarray, tail: float) -> Estimate:
        """Value with the bounds beyond each of which lies a tail."""
        if not len(rows):
            return NOTHING
        return self._score.estimate(rows, confidence=1 - 2 * tail)

    def holds(self, number: float) -> bool:
        """Whether a number is on the right side; one that is on the limit is."""
        return number >= self.limit if self.side == "at_least" else number <= self.limit

    def bounds(self, told: Estimate) -> tuple[float, float]:
        """The end of an interval that is worst for the requirement, and the one that is best."""
        return (told.low, told.high) if self.side == "at_least" else (told.high, told.low)

    def shown(self, rows: np.ndarray, tail: float, *, met: bool) -> bool:
        """Whether the point is shown to meet the limit, or to fail it, but for a tail."""
        worst, best = self.bounds(self.estimate(rows, tail))
        return self.holds(worst) if met else bool(np.isfinite(best)) and not self.holds(best)

    def smallest_tail(self, rows: np.ndarray, *, met: bool) -> float:
        """Least tail for which the point is shown to meet the limit, or to fail it; 0.5: none."""
        if self.shown(rows, _SMALLEST_TAIL, met=met):
            return _SMALLEST_TAIL
        hidden, shown = np.log(_SMALLEST_TAIL), np.log(0.5)
        for _ in range(30):  # halvings: the tail to eight digits
            middle = (hidden + shown) / 2
            if self.shown(rows, float(np.exp(middle)), met=met):
                shown = middle
            else:
                hidden = middle
        return float(np.exp(shown))

    def more_trials(self, rows: np.ndarray, tail: float, *, met: bool) -> float:
        """Trials beside those that there are with which the bound would reach the limit.

        How fast it does is taken from the same trials four times over: as 1 / sqrt(n) mostly,
        as 1 / n where nothing was missed or nothing seen. Infinite where it never would.
        """
        once, often = (
            self.estimate(np.tile(rows, (times, 1)), tail) if len(rows) else NOTHING
            for times in (1, 4)
        )
        reach, reach_of_four = (
            abs(one.value - self.bounds(one)[0 if met else 1]) for one in (once, often)
        )
        room = abs(once.value - self.limit)
        if not (room > 0 and reach > reach_of_four > 0 and np.isfinite(reach)):
            return np.inf
        power = np.log(reach / reach_of_four) / np.log(4)
        needed = len(rows) * (reach / room) ** (1 / power)
        return max(float(needed) - len(rows), 1.0)


def _judged(limit: _Limit, points: tuple[int, ...]) -> Judged:
    tail_of_one = limit.tail / len(points)
    failed, open_ = [], []
    for point in points:
        rows = limit.rows(point)
        if limit.shown(rows, limit.tail, met=True):
            continue
        if limit.shown(rows, tail_of_one, met=False):
            failed.append(point)
        open_.append(point)
    n_met = len(points) - len(open_)
    more: float | None = None
    if failed:
        decision: Decision = "not met"
        deciding, tail = _most_certain(limit, failed)
        tail = min(tail * len(points), 1.0)
    elif open_:
        decision = "undecided"
        deciding, tail = _most_doubtful(limit, open_, tail_of_one)
        more = max(_more(limit, point, tail_of_one) for point in open_)
    else:
        decision = "met"
        deciding, tail = _least_certain(limit, points)
    sums = limit.rows(deciding)
    told = limit.estimate(sums, tail_of_one if failed else limit.tail)
    return Judged(
        requirement=limit.requirement,
        side=limit.side,
        limit=limit.limit,
        decision=decision,
        certainty=1 - tail,
        points=points,
        n_met=n_met,
        point=deciding,
        value=told.value,
        bound=limit.bounds(told)[1 if failed else 0],
        trials=len(sums),
        more_trials=_rounded(more),
    )


def _least_certain(limit: _Limit, points: Sequence[int]) -> tuple[int, float]:
    """The point that is shown to meet a limit with the largest tail, and that tail."""
    deciding, tail = points[0], limit.smallest_tail(limit.rows(points[0]), met=True)
    for point in points[1:]:
        if tail >= 0.5:  # not even that: no confidence is left to ask the others at
            break
        rows = limit.rows(point)
        if not limit.shown(rows, tail, met=True):  # so few points are asked for more than that
            deciding, tail = point, limit.smallest_tail(rows, met=True)
    return deciding, tail


def _most_certain(limit: _Limit, points: Sequence[int]) -> tuple[int, float]:
    """The point that is shown to fail a limit with the smallest tail, and that tail."""
    deciding, tail = points[0], limit.smallest_tail(limit.rows(points[0]), met=False)
    for point in points[1:]:
        rows = limit.rows(point)
        if tail > _SMALLEST_TAIL and limit.shown(rows, 0.99 * tail, met=False):
            deciding, tail = point, limit.smallest_tail(rows, met=False)
    return deciding, tail


def _most_doubtful(limit: _Limit, points: Sequence[int], tail_of_one: float) -> tuple[int, float]:
    """Of undecided points the worst, and the tail with which the side of its value is shown."""
    wrong: list[int] = []
    right: list[int] = []
    empty: list[int] = []
    for point in points:
        measured = limit.estimate(limit.rows(point), tail_of_one).value
        kind = empty if np.isnan(measured) else right if limit.holds(measured) else wrong
        kind.append(point)
    if empty:
        return empty[0], np.nan
    return _most_certain(limit, wrong) if wrong else _least_certain(limit, right)


def _more(limit: _Limit, point: int, tail_of_one: float) -> float:
    rows = limit.rows(point)
    met = limit.holds(limit.estimate(rows, limit.tail).value)
    return limit.more_trials(rows, limit.tail if met else tail_of_one, met=met)


def _rounded(trials: float | None) -> int | None:
    """Up, to two digits: it is a forecast."""
    if trials is None or trials > _MOST_TRIALS:
        return None
    unit = 10 ** max(int(np.floor(np.log10(trials))) - 1, 0)
    return int(np.ceil(trials / unit)) * unit
