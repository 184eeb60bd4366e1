"""Two settings tried again and again in turn, and counted against each other and against theory.

The scores, their intervals and their theory are those of studies: the same settings, seed and
trial number give the same sums there.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from dechirp.config.texts import as_text
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import heard
from dechirp.core.threads import alone
from dechirp.evaluate.look import Case
from dechirp.evaluate.score.azimuth_rmse import AzimuthRmse
from dechirp.evaluate.score.base import Score
from dechirp.evaluate.score.detection_probability import DetectionProbability
from dechirp.evaluate.score.false_alarm_probability import FalseAlarmProbability
from dechirp.evaluate.score.frame_false_alarm_probability import FrameFalseAlarmProbability
from dechirp.evaluate.score.range_rmse import RangeRmse
from dechirp.evaluate.score.velocity_rmse import VelocityRmse
from dechirp.experiment.scenario import Scenario
from dechirp.experiment.study.case import case_of
from dechirp.experiment.study.results import estimate
from dechirp.experiment.study.trial import Prepared
from dechirp.experiment.tune.gain import Gain, paired_gain

SCORES: tuple[Score, ...] = (
    DetectionProbability(),
    FrameFalseAlarmProbability(),
    FalseAlarmProbability(),
    RangeRmse(),
    VelocityRmse(),
    AzimuthRmse(),
)
"""What is counted, where the settings have it."""
MOST_TRIALS = 20_000
"""Then it stops: shares are known to 0.007 by then, and sums of ten targets take 13 MB."""

# Trials are added in so many groups, each of which is left out in turn to see how a difference
# scatters. More take longer, and a hundred would make Student's quantile smaller by 0.1 of 2.09.
_GROUPS = 20


class Told(NamedTuple):
    """A score of one setting."""

    value: float
    low: float
    high: float
    theory: float


@dataclass(frozen=True)
class Row:
    """A score of one target, or of the whole, under both settings."""

    score: Score
    target: str | None
    """None for the whole."""
    a: Told | None
    """None where there is nothing that could be scored so."""
    b: Told | None
    change: Gain | None
    """From A to B, in the same trials; its certainty is that of its own sign. None before two
    trials, and where one of them has no such score."""


@dataclass(frozen=True)
class Setting:
    """One that differs."""

    path: str
    a: str
    b: str


class Comparison:
    """Trials of A and B by turns, with the same chance in both: that of A's seed and the trial.

    What is tried is the first frame, without tracks. Work is done by `go_on` alone.

    Parameters
    ----------
    a, b : Scenario
        The settings.
    confidence : float
        Of all intervals, two-sided.

    Raises
    ------
    InvalidSetting
        If one is a recording: nobody knows its truth, and it has one trial only.
    """

    def __init__(self, a: Scenario, b: Scenario, *, confidence: float = 0.95) -> None:
        self._confidence = confidence
        with alone(), heard():
            self._a, self._b = _Side(a, a.seed), _Side(b, a.seed)
        self._work = self._steps()
        self.n_trials = 0
        """That both have."""

    @property
    def is_done(self) -> bool:
        """Whether there is nothing left to do."""
        return self.n_trials == MOST_TRIALS

    def go_on(self, within_s: float) -> None:
        """Work for so long, and to the end of the step that is then under way.

        A step is one trial of one setting, or one law, which is found once.

        Raises
        ------
        DechirpError
            If a trial cannot be.
        """
        until_s = perf_counter() + within_s
        with alone(), heard():
            for _ in self._work:
                if perf_counter() >= until_s:
                    return

    def rows(self) -> list[Row]:
        """What was counted so far, score by score and target by target."""
        keys = dict.fromkeys(
            (score, target)
            for score in SCORES
            for side in (self._a, self._b)
            for target in side.targets(score)
        )
        rows = (self._row(score, target) for score, target in keys)
        return [row for row in rows if row.a or row.b]

    def _steps(self) -> Iterator[None]:
        sides = (self._a, self._b)
        for side in sides:
            for score in side.scores:
                side.find_law(score)
                yield
        for trial in range(MOST_TRIALS):
            for side in sides:
                side.run(trial)
                yield
            self.n_trials += 1

    def _row(self, score: Score, target: str | None) -> Row:
        a, b = (self._told(side, score, target) for side in (self._a, self._b))
        return Row(score, target, a, b, self._change(score, target) if a and b else None)

    def _told(self, side: "_Side", score: Score, target: str | None) -> Told | None:
        if target not in side.targets(score):
            return None
        found = side.told(score, target, self.n_trials, self._confidence)
        return None if np.isnan([found.value, found.theory]).all() else found

    def _change(self, score: Score, target: str | None) -> Gain | None:
        if self.n_trials < 2:
            return None
        before, after = (side.sums(score, target, self.n_trials) for side in (self._a, self._b))
        if not isinstance(score, DetectionProbability | FrameFalseAlarmProbability):
            before, after = _in_groups(before), _in_groups(after)

        def value_of(sums: np.ndarray) -> float:
            return score.estimate(
                sums.sum(axis=0, keepdims=True), confidence=self._confidence
            ).value

        change = paired_gain(before, after, value_of, confidence=self._confidence)
        if change.value < 0:
            back = paired_gain(after, before, value_of, confidence=self._confidence)
            return change._replace(certainty=back.certainty)
        return change


class _Side:
    """One of the two settings, and the sums of its trials."""

    def __init__(self, scenario: Scenario, seed: int) -> None:
        first = replace(scenario, n_frames=1, tracker=None, ego_motion=None)
        case = case_of(first)
        self.scores = tuple(score for score in SCORES if _fits(score, case))
        self._prepared = Prepared(first, self.scores, seed=seed)
        self._layout = self._prepared.layout
        self._laws = {
            score: np.full(max(len(names), 1), np.nan)
            for score, names in zip(self.scores, self._layout.subjects, strict=True)
        }
        # Memory that no trial has written yet is not taken.
        self._sums = np.empty((MOST_TRIALS, self._layout.n_columns))

    def targets(self, score: Score) -> tuple[str | None, ...]:
        """Whom it has a value of; None is the whole."""
        return score.subjects(self._prepared.case) or (None,) if score in self.scores else ()

    def find_law(self, score: Score) -> None:
        """What theory gives."""
        self._laws[score] = score.theory(self._prepared.case)

    def run(self, trial: int) -> None:
        """One trial."""
        self._sums[trial] = self._prepared.sums(trial)

    def sums(self, score: Score, target: str | None, n_trials: int) -> np.ndarray:
        """Of one score, (n_trials, n_sums)."""
        return self._layout.sums_of(self._sums[:n_trials], score.label(), target)

    def told(self, score: Score, target: str | None, n_trials: int, confidence: float) -> Told:
        """What was counted, beside theory."""
        layout, label = self._layout, score.label()
        found = estimate(layout, label, target, self._sums[:n_trials], confidence=confidence)
        laws = np.concatenate(list(self._laws.values()))
        return Told(*found, layout.theory_of(laws, label, target))


def _fits(score: Score, case: Case) -> bool:
    """Whether there is anything that could be scored so."""
    try:
        score.check(case)
    except InvalidSetting:
        return False
    return True


def _in_groups(sums: np.ndarray) -> np.ndarray:
    """Sums of trials, added in groups that are as equal as can be, (n_groups, n_sums)."""
    n_groups = min(len(sums), _GROUPS)
    starts = np.arange(n_groups) * len(sums) // n_groups
    return np.asarray(np.add.reduceat(sums, starts))


def differences(a: Scenario, b: Scenario) -> list[Setting]:
    """Settings in which two scenarios differ, as settings files write them."""
    texts = [dict(_leaves("", as_text(one, None))) for one in (a, b)]
    paths = dict.fromkeys([*texts[0], *texts[1]])
    both = (Setting(path, *(of.get(path, "none") for of in texts)) for path in paths)
    return [one for one in both if one.a != one.b]


def _leaves(path: str, written: Any) -> Iterator[tuple[str, str]]:
    if isinstance(written, dict):
        for name, member in written.items():
            yield from _leaves(f"{path}.{name}" if path else name, member)
    elif isinstance(written, list) and any(isinstance(member, dict) for member in written):
        for at, member in enumerate(written):
            name = member.get("name") or member.get("kind") or at
            yield from _leaves(f"{path}.{name}", member)
    else:
        yield path, ", ".join(map(str, written)) if isinstance(written, list) else str(written)
