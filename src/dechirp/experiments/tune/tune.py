"""Settings of a search: varied settings, objective, limits, and number of trials."""

import math
from typing import ClassVar, Literal

import numpy as np

from dechirp.core.checks import check_integer_fields, check_probability
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.evaluation.score.base import Estimate, Score
from dechirp.experiments.scenario import Scenario
from dechirp.experiments.study.study import SweptSetting
from dechirp.scene.scene import Scene

__all__ = ["LabelledRecording", "Limit", "Objective"]


def __dir__() -> list[str]:
    return __all__


Decision = Literal["met", "not met", "undecided"]


@frozen_dataclass
class Limit:
    """Upper or lower limit of a score; one of the two."""

    score: Score
    at_most: float | None = None
    """SI."""
    at_least: float | None = None

    def __post_init__(self) -> None:
        if (self.at_most is None) == (self.at_least is None):
            raise InvalidSetting(
                "Limit.at_most",
                value="missing, and at_least as well"
                if self.at_most is None
                else "cannot be combined with at_least",
                expected="one limit, at_most or at_least",
                fix="add one of them" if self.at_most is None else "remove one of them",
            )
        for name, limit in (("at_most", self.at_most), ("at_least", self.at_least)):
            if limit is not None and self.score.kind().endswith("probability"):
                check_probability(f"Limit.{name}", limit)

    def decide(self, estimate: Estimate) -> Decision:
        """Decide whether the whole interval is within the limit, beyond it, or neither."""
        if self.at_most is not None:
            is_met, is_exceeded = estimate.high <= self.at_most, estimate.low > self.at_most
        else:
            assert self.at_least is not None
            is_met, is_exceeded = estimate.low >= self.at_least, estimate.high < self.at_least
        return "met" if is_met else "not met" if is_exceeded else "undecided"

    def relative_excess(self, estimate: Estimate) -> float:
        """Return the relative distance of the interval's near end beyond the limit; 0 within it.

        Infinite where there is no estimate.
        """
        if self.at_most is not None:
            bound, difference = self.at_most, estimate.low - self.at_most
        else:
            assert self.at_least is not None
            bound, difference = self.at_least, self.at_least - estimate.high
        if np.isnan(difference):
            return math.inf
        return max(difference, 0.0) / (abs(bound) or 1.0)


@frozen_dataclass
class Objective:
    """Score to maximise or minimise within limits."""

    direction: Literal["maximise", "minimise"]
    score: Score
    limits: tuple[Limit, ...] = ()

    def __post_init__(self) -> None:
        better_direction = {"more": "maximise", "less": "minimise", None: None}[self.score.better]
        if self.direction != better_direction:
            label = self.score.kind()
            raise InvalidSetting(
                f"objective.{self.direction}",
                value=label,
                expected="a score that should be large"
                if self.direction == "maximise"
                else "a score that should be small",
                fix=f"write {better_direction}: {label}"
                if better_direction
                else "set limits to it, and choose another score",
            )

    @property
    def direction_sign(self) -> int:
        """1 to maximise, -1 to minimise."""
        return 1 if self.direction == "maximise" else -1

    @property
    def objective_and_limit_scores(self) -> tuple[Score, ...]:
        """All measured scores: the objective, then those of the limits."""
        return (self.score, *(limit.score for limit in self.limits))


@frozen_dataclass
class LabelledRecording:
    """Recording with known truth."""

    scenario: Scenario
    """Scenario with a recording instead of a scene."""
    truth: Scene = Scene()
    """True scene from the first frame of the file on; only positions and motion count."""
    empty_range_m: tuple[float, float] | None = None
    """Ranges between which there was no target: cells over threshold there are false alarms."""

    def __post_init__(self) -> None:
        if self.scenario.recording is None:
            raise InvalidSetting(
                "LabelledRecording.scenario",
                value="a scene",
                expected="a scenario of a recording",
                fix="name it under scenarios",
            )
        if (
            self.empty_range_m is not None
            and not 0 <= self.empty_range_m[0] < self.empty_range_m[1]
        ):
            raise InvalidSetting(
                "LabelledRecording.empty_range_m",
                value=f"{self.empty_range_m[0]} m to {self.empty_range_m[1]} m",
                expected="two ranges, the nearer one first",
                fix="give 20 m and 60 m where nothing is between them",
            )


@frozen_dataclass
class Tune:
    """Search for the settings with the best objective."""

    _file_reader: ClassVar[str] = "dechirp.load_tune"

    name: str = "tune"
    scenarios: tuple[Scenario, ...] = ()
    recordings: tuple[LabelledRecording, ...] = ()
    seed: int = 0
    search: tuple[SweptSetting, ...]
    """Settings and their candidate values."""
    objective: Objective
    trials: int = 200
    """Trials of each candidate, the same ones for all."""
    candidates: int = 60
    """Number of choices of settings to try, in addition to the unchanged settings."""
    confirmation_trials: int = 1000
    """New trials, unused by the search, for the best candidate and the unchanged settings."""
    confidence: float = 0.95
    """Confidence of all two-sided intervals."""

    def __post_init__(self) -> None:
        check_integer_fields(self, "seed", at_least=0, at_most=2**63 - 1)
        check_integer_fields(self, "trials", "confirmation_trials", at_least=2, at_most=10_000_000)
        check_integer_fields(self, "candidates", at_least=1, at_most=100_000)
        check_probability("Tune.confidence", self.confidence)
        if not (self.scenarios or self.recordings):
            raise InvalidSetting(
                "Tune.scenarios",
                value="missing, and recordings as well",
                expected="scenarios to try settings on, or recordings, or both",
                fix="add the name of a scenario",
            )
        if any(scenario.scene is None for scenario in self.scenarios):
            raise InvalidSetting(
                "Tune.scenarios",
                value="with one of a recording or of traffic",
                expected="scenarios with a scene, which is simulated again and again",
                fix="name a recording under recordings, as scenario: FILE, with its truth",
            )
        if not self.search:
            raise InvalidSetting(
                "Tune.search",
                value="empty",
                expected="at least one setting to search",
                fix="give chain.cfar.n_guard.range: {from: 1, to: 6, step: 1}, for instance",
            )

    @property
    def n_setting_combinations(self) -> int:
        """Number of combinations of values."""
        return math.prod(len(setting.texts) for setting in self.search)
