"""A search for settings: over what, for which aim, and how often each is tried."""

import math
from typing import Literal

import numpy as np

from dechirp.core.checks import count, probability
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.evaluate.score.base import Estimate, Score
from dechirp.experiment.scenario import Scenario
from dechirp.experiment.study.study import Listed
from dechirp.scene.scene import Scene

Verdict = Literal["met", "not met", "undecided"]


@value
class Limit:
    """What a score must not exceed, or must reach; one of the two."""

    score: Score
    at_most: float | None = None
    """SI."""
    at_least: float | None = None

    def __post_init__(self) -> None:
        if (self.at_most is None) == (self.at_least is None):
            raise InvalidSetting(
                "Limit.at_most",
                got="absent" if self.at_most is None else "beside at_least",
                need="given, or else at_least given: one of the two",
                fix="Take one out, or give one.",
            )
        for name, limit in (("at_most", self.at_most), ("at_least", self.at_least)):
            if limit is not None and self.score.label().endswith("probability"):
                probability(f"Limit.{name}", limit)

    def verdict(self, estimate: Estimate) -> Verdict:
        """Whether the whole interval is within the limit, beyond it, or neither."""
        if self.at_most is not None:
            within, beyond = estimate.high <= self.at_most, estimate.low > self.at_most
        else:
            assert self.at_least is not None
            within, beyond = estimate.low >= self.at_least, estimate.high < self.at_least
        return "met" if within else "not met" if beyond else "undecided"

    def excess(self, estimate: Estimate) -> float:
        """How far beyond the limit the near end of the interval is, relative; 0 up to it.

        Infinite where there is no estimate.
        """
        if self.at_most is not None:
            bound, beyond = self.at_most, estimate.low - self.at_most
        else:
            assert self.at_least is not None
            bound, beyond = self.at_least, self.at_least - estimate.high
        if np.isnan(beyond):
            return math.inf
        return max(beyond, 0.0) / (abs(bound) or 1.0)


@value
class Aim:
    """The score that is to be as large, or as small, as limits allow."""

    towards: Literal["most", "least"]
    score: Score
    limits: tuple[Limit, ...] = ()

    def __post_init__(self) -> None:
        right = {"more": "most", "less": "least", None: None}[self.score.better]
        if self.towards != right:
            label = self.score.label()
            raise InvalidSetting(
                f"aim.{self.towards}",
                got=label,
                need="a score that should be large"
                if self.towards == "most"
                else "a score that should be small",
                fix=f"Write {right}: {label}."
                if right
                else "Set limits to it, and aim at another score.",
            )

    @property
    def sign(self) -> int:
        """1 where more is better, -1 where less is."""
        return 1 if self.towards == "most" else -1

    @property
    def scores(self) -> tuple[Score, ...]:
        """All that are measured: the aim's own, then those of the limits."""
        return (self.score, *(limit.score for limit in self.limits))


@value
class Recorded:
    """A recording, and what is known of what was there."""

    scenario: Scenario
    """With a recording instead of a scene."""
    truth: Scene = Scene()
    """What was there, from the first frame of the file on; only places and ways count."""
    empty_m: tuple[float, float] | None = None
    """Ranges between which nothing was: cells over threshold there are false alarms."""

    def __post_init__(self) -> None:
        if self.scenario.recording is None:
            raise InvalidSetting(
                "Recorded.scenario",
                got="a scene",
                need="a scenario of a recording",
                fix="Name it under scenarios.",
            )
        if self.empty_m is not None and not 0 <= self.empty_m[0] < self.empty_m[1]:
            raise InvalidSetting(
                "Recorded.empty_m",
                got=f"{self.empty_m[0]} m to {self.empty_m[1]} m",
                need="two ranges, the nearer one first",
                fix="Give 20 m and 60 m where nothing is between them.",
            )


@value
class Tune:
    """A search for the settings that serve an aim best."""

    name: str = "tune"
    scenarios: tuple[Scenario, ...] = ()
    recordings: tuple[Recorded, ...] = ()
    seed: int = 0
    search: tuple[Listed, ...]
    """Settings and the values that they may take."""
    aim: Aim
    looks: int = 200
    """Trials of each candidate, the same ones for all."""
    candidates: int = 60
    """Choices of settings that are tried, beside the settings as they are."""
    fresh_looks: int = 1000
    """Trials, of which the search saw none, that the best and the settings as they are get."""
    confidence: float = 0.95
    """Of all intervals, two-sided."""

    def __post_init__(self) -> None:
        count(self, "seed", at_least=0, at_most=2**63 - 1)
        count(self, "looks", "fresh_looks", at_least=2, at_most=10_000_000)
        count(self, "candidates", at_least=1, at_most=100_000)
        probability("Tune.confidence", self.confidence)
        if not (self.scenarios or self.recordings):
            raise InvalidSetting(
                "Tune.scenarios",
                got="absent, and no recordings either",
                need="scenarios to try settings on, or recordings, or both",
                fix="Name a scenario.",
            )
        if any(one.recording is not None for one in self.scenarios):
            raise InvalidSetting(
                "Tune.scenarios",
                got="with one of a recording",
                need="scenarios with a scene, which is simulated again and again",
                fix="Name it under recordings, as scenario: FILE, beside its truth.",
            )
        if not self.search:
            raise InvalidSetting(
                "Tune.search",
                got="empty",
                need="at least one setting to search",
                fix="Give chain.cfar.n_guard.range: {from: 1, to: 6, step: 1}, for instance.",
            )

    @property
    def n_choices(self) -> int:
        """How many combinations there are."""
        return math.prod(len(one.texts) for one in self.search)
