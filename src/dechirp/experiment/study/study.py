"""A study: a scenario, what is varied of it, how often it is tried, and what is made of it."""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from typing import Literal, get_args

from dechirp.config.nearest import did_you_mean
from dechirp.core.checks import count, instances, not_negative, positive, probability
from dechirp.core.displayed import Displayed, Table, several
from dechirp.core.errors import DechirpError, InvalidSetting
from dechirp.core.values import value
from dechirp.core.words import in_unit
from dechirp.evaluate.score.base import Score
from dechirp.experiment.scenario import Scenario

Kept = Literal["cubes", "maps", "detections"]


@value
class Listed:
    """A setting that takes values in turn: a list or a range of a study file."""

    path: str
    """As `--set` takes it."""
    texts: tuple[str, ...]
    """Values as settings files write them: `-10 dBsm`, `hann`."""
    numbers: tuple[float, ...] | None = None
    """The same as a figure's axis has them, in the written unit; none where they are words."""
    unit: str = ""
    """Written beside the axis: `dBsm`; empty without."""
    labels: tuple[str, ...] = ()
    """What a legend says of each: `ordered-statistic`; the texts where nothing is given."""

    def __post_init__(self) -> None:
        labels = self.labels or self.texts
        object.__setattr__(self, "labels", labels)
        if not self.texts:
            raise InvalidSetting(
                "Listed.texts", got="empty", need="at least one value", fix="Give the values."
            )
        for name, given in (("labels", labels), ("numbers", self.numbers)):
            if given is not None and len(given) != len(self.texts):
                raise InvalidSetting(
                    f"Listed.{name}",
                    got=f"{len(given)} of them",
                    need=f"one for each of the {len(self.texts)} values",
                    fix="Give as many, or none.",
                )
        for name in ("texts", "labels"):
            twice = Counter(getattr(self, name)).most_common(1)[0]
            if twice[1] > 1:
                raise InvalidSetting(
                    f"Listed.{name}",
                    got=f"{twice[0]} twice",
                    need="values that differ",
                    fix="Take one of them out.",
                )


@value
class Drawn:
    """A setting that is drawn: once a point with `Draw`, else anew in each trial."""

    path: str
    distribution: Literal["uniform", "normal"]
    first: float
    """Lower end, or mean, in the written unit."""
    second: float
    """Upper end, or standard deviation (of levels: in dB)."""
    unit: str = ""

    def __post_init__(self) -> None:
        if self.distribution == "normal":
            positive(self, "second")
        elif not self.first < self.second < math.inf:
            raise InvalidSetting(
                "Drawn.second",
                got=f"{self.second} {self.unit}".strip(),
                need=f"above the lower end, {self.first} {self.unit}".strip(),
                fix="Give the lower end first.",
            )


@value
class Draw:
    """Points that are drawn, of all `Drawn` settings together."""

    method: Literal["sobol", "independent"] = "sobol"
    n: int

    def __post_init__(self) -> None:
        count(self, "n", at_most=2**30)
        if self.method == "sobol" and self.n & (self.n - 1):
            above = 2 ** self.n.bit_length()
            raise InvalidSetting(
                "Draw.n",
                got=self.n,
                need="a power of two: only so many points of a Sobol sequence lie evenly",
                fix=f"Take {above // 2} or {above}, or method: independent.",
            )


@value
class Until:
    """When a point has had enough trials: once its interval is narrow enough."""

    score: str
    """Label of one of the study's scores."""
    target: str | None = None
    """None: all targets together."""
    width: float
    """High less low, SI."""

    def __post_init__(self) -> None:
        positive(self, "width")


@value
class Trials:
    """How many trials a point has. They run in numbered blocks."""

    at_most: int = 1000
    until: Until | None = None
    block: int = 50
    """Trials in a block: what is kept, or lost, at once. `docs/studies.md` has the rule."""

    def __post_init__(self) -> None:
        count(self, "at_most", "block")


@value
class Requirement:
    """What must hold, to be shown with a confidence."""

    score: str
    target: str | None = None
    at: tuple[tuple[str, str], ...] = ()
    """Path and text of the settings of the points that are meant; none: every point."""
    at_least: float | None = None
    at_most: float | None = None
    """SI; one of the two, or both."""
    confidence: float = 0.95
    """One-sided, for each limit."""

    def __post_init__(self) -> None:
        probability("Requirement.confidence", self.confidence)
        if self.confidence <= 0.5:
            raise InvalidSetting(
                "Requirement.confidence",
                got=self.confidence,
                need="above 0.5: less is shown by chance",
                fix="Take 0.95, or leave it out.",
            )
        if self.at_least is None and self.at_most is None:
            raise InvalidSetting(
                "Requirement.at_least",
                got="absent, and no at_most either",
                need="a limit: at_least, at_most or both",
                fix="Add at_least or at_most.",
            )
        if self.at_least is not None and self.at_most is not None and self.at_least > self.at_most:
            raise InvalidSetting(
                "Requirement.at_least",
                got=self.at_least,
                need=f"no more than at_most, {self.at_most}",
                fix="Swap them.",
            )


@value
class Study(Displayed):
    """Trials of a scenario over varied settings."""

    name: str = "study"
    scenario: Scenario
    seed: int = 0
    vary: tuple[Listed | Drawn, ...] = ()
    """Lists make a grid, the last one fastest; within it, points that `draw` asks for."""
    draw: Draw | None = None
    """None: what is drawn is drawn anew in each trial, the same at every point."""
    trials: Trials = Trials()
    scores: tuple[Score, ...]
    confidence: float = 0.95
    """Of the intervals of all scores."""
    stop_after_failures: float = 0.01
    """Share of trials that may raise; more stop the study."""
    require: tuple[Requirement, ...] = ()
    sensor: Literal["signal", "statistical"] = "signal"
    """Whether trials simulate and process samples, or draw detections from theory."""
    keep: tuple[Kept, ...] = ()
    """What of each trial becomes an item of a data set, with its truth; none: no data set."""
    at_most_points: int = 100_000
    """More are refused, so that a slip of the pen does not fill a disk; raise it for more."""
    at_most_trials: int = 100_000_000
    """The same of the trials of all points together."""
    at_most_bytes: int = 100_000_000_000
    """The same of a data set, before it is packed."""

    def __post_init__(self) -> None:
        fix = "Write (DetectionProbability(),), with both brackets, even for one alone."
        object.__setattr__(self, "scores", instances("Study.scores", self.scores, Score, fix=fix))
        object.__setattr__(self, "keep", tuple(self.keep))
        wrong = list(self._wrong())
        if wrong:
            # All at once, as mistakes of a file are told.
            DechirpError.__init__(wrong[0], *(one for error in wrong for one in error.mistakes))
            raise wrong[0]

    @property
    def n_points(self) -> int:
        """Points of the grid of all lists, and of what is drawn with `draw`."""
        sizes = (len(one.texts) for one in self.vary if isinstance(one, Listed))
        return math.prod(sizes) * (self.draw.n if self.draw is not None else 1)

    def _line(self) -> str:
        points = several(self.n_points, "point")
        parts = [f"{self.name}: {points} of at most {several(self.trials.at_most, 'trial')}"]
        parts.append(several(len(self.scores), "score"))
        parts += [several(len(self.require), "requirement")] if self.require else []
        return ", ".join(parts)

    def _tables(self) -> Iterable[Table]:
        yield Table("Varied", [(one.path, _values(one)) for one in self.vary])
        yield Table("Scores", [(score.label(),) for score in self.scores])
        yield Table("Requirements", [(text,) for one in self.require for text in self._asked(one)])

    def _asked(self, one: Requirement) -> Iterator[str]:
        """Each limit of a requirement, in the unit of its score."""
        units = {score.label(): score.unit for score in self.scores}
        owner = f" of {one.target}" if one.target else ""
        listed = [axis for axis in self.vary if isinstance(axis, Listed)]
        labels = {axis.path: dict(zip(axis.texts, axis.labels, strict=True)) for axis in listed}
        where = ", ".join(f"{path} {labels[path][text]}" for path, text in one.at)
        for sign, limit in (("≥", one.at_least), ("≤", one.at_most)):
            if limit is not None:
                said = in_unit(limit, units[one.score] or "probability")
                yield f"{one.score}{owner} {sign} {said}" + (f" at {where}" if where else "")

    def _wrong(self) -> Iterator[InvalidSetting]:
        checks: tuple[Callable[[], None], ...] = (
            lambda: count(self, "seed", at_least=0, at_most=2**63 - 1),
            lambda: count(self, "at_most_points", at_most=2**63 - 1),
            lambda: count(self, "at_most_trials", at_most=2**63 - 1),
            lambda: count(self, "at_most_bytes", at_most=2**63 - 1),
            lambda: probability("Study.confidence", self.confidence),
            lambda: not_negative(self, "stop_after_failures", at_most=1.0),
        )
        for check in checks:
            try:
                check()
            except InvalidSetting as error:
                yield error
        if self.scenario.scene is None:
            yield InvalidSetting(
                "Study.scenario",
                got="of a recording",
                need="of a scene that can be simulated again and again",
                fix="Give a scene; `dechirp tune` takes recordings.",
            )
        yield from self._wrong_scores()
        yield from self._wrong_points()
        yield from self._wrong_keep()
        labels = tuple(score.label() for score in self.scores)
        told: list[tuple[str, Requirement | Until]] = [
            (f"Study.require.{at}", one) for at, one in enumerate(self.require)
        ]
        if self.trials.until is not None:
            told.append(("Study.trials.until", self.trials.until))
        for where, one in told:
            yield from wrong_score(f"{where}.score", one.score, labels)
            names = self.scenario.scene.names if self.scenario.scene is not None else ()
            if one.target is not None:
                yield from wrong_target(f"{where}.target", one.target, names)
            yield from _wrong_limits(where, one)
        by_path = {one.path: one for one in self.vary}
        for at, requirement in enumerate(self.require):
            for path, text in requirement.at:
                axis = by_path.get(path)
                if not isinstance(axis, Listed) or text not in axis.texts:
                    yield wrong_at(f"Study.require.{at}.at", path, text, self.vary)

    def _wrong_scores(self) -> Iterator[InvalidSetting]:
        labels = [score.label() for score in self.scores]
        twice = [label for label in labels if labels.count(label) > 1]
        if twice or not labels:
            yield InvalidSetting(
                "Study.scores",
                got=f"{twice[0]} twice" if twice else "empty",
                need="at least one score, each once",
                fix="Take one of them out." if twice else "Write [detection_probability].",
            )

    def _wrong_points(self) -> Iterator[InvalidSetting]:
        paths = [one.path for one in self.vary]
        for path in dict.fromkeys(path for path in paths if paths.count(path) > 1):
            yield InvalidSetting(
                "Study.vary", got=f"{path} twice", need="given once", fix="Keep one of them."
            )
        if self.draw is not None and not any(isinstance(one, Drawn) for one in self.vary):
            yield InvalidSetting(
                "Study.draw",
                got="given, with nothing to draw",
                need="left out, or a setting that is drawn",
                fix="Write {uniform: [LOW, HIGH]} or {normal: [MEAN, STD]} in vary.",
            )
        n_points, n_trials = self.n_points, self.n_points * self.trials.at_most
        if n_points > self.at_most_points:
            yield InvalidSetting(
                "Study.vary",
                got=f"a grid of {n_points} points",
                need=f"at most at_most_points, {self.at_most_points}",
                fix=f"Take larger steps, or confirm it: at_most_points: {n_points}.",
            )
        elif n_trials > self.at_most_trials:
            yield InvalidSetting(
                "Study.trials.at_most",
                got=f"{self.trials.at_most}, which makes {n_trials} at {n_points} points",
                need=f"at most at_most_trials, {self.at_most_trials}, in all",
                fix=f"Take fewer, or confirm it: at_most_trials: {n_trials}.",
            )

    def _wrong_keep(self) -> Iterator[InvalidSetting]:
        known = get_args(Kept)
        wrong = [one for one in self.keep if one not in known or self.keep.count(one) > 1]
        if wrong:
            yield InvalidSetting(
                "Study.keep",
                got=f"{wrong[0]} twice" if wrong[0] in known else repr(wrong[0]),
                need=f"some of {', '.join(known)}, each once",
                fix=did_you_mean(str(wrong[0]), known),
            )
        drawn = [one for one in self.keep if one != "detections"]
        if drawn and self.sensor == "statistical":
            yield InvalidSetting(
                "Study.keep",
                got=f"{drawn[0]}, with sensor: statistical",
                need="detections alone: there are no samples that they could be of",
                fix="Set sensor: signal, or write keep: [detections].",
            )


def _values(axis: Listed | Drawn) -> str:
    if isinstance(axis, Drawn):
        return f"{axis.distribution}, {axis.first:g} and {axis.second:g} {axis.unit}".strip()
    labels = axis.labels
    if len(labels) <= 4:
        return ", ".join(labels)
    return f"{labels[0]} to {labels[-1]}, {len(labels)} values"


def _wrong_limits(where: str, one: Requirement | Until) -> Iterator[InvalidSetting]:
    """Say that a probability is asked to be what none can be."""
    if not one.score.endswith("probability"):
        return
    if isinstance(one, Until):
        if one.width >= 1:
            yield InvalidSetting(
                f"{where}.width",
                got=one.width,
                need="below 1: any interval of a probability is as narrow",
                fix="Take 0.1, or leave until out.",
            )
        return
    for name in ("at_least", "at_most"):
        limit = getattr(one, name)
        if limit is not None and not 0 <= limit <= 1:
            yield InvalidSetting(
                f"{where}.{name}",
                got=limit,
                need=f"from 0 to 1, as {one.score} is",
                fix="Write 0.9 for 90 %.",
            )


def wrong_score(where: str, label: str, labels: tuple[str, ...]) -> Iterator[InvalidSetting]:
    """Say that a score is asked about that the study does not have."""
    if label not in labels:
        yield InvalidSetting(
            where,
            got=label,
            need=f"one of the study's scores: {', '.join(labels)}",
            fix=f"{did_you_mean(label, labels).rstrip('.')}, or add it to scores.",
        )


def wrong_target(where: str, name: str, names: tuple[str, ...]) -> Iterator[InvalidSetting]:
    """Say that a target is asked about that the scenario does not have."""
    if name not in names:
        need = f"one of the scenario's targets: {', '.join(names)}" if names else "left out"
        yield InvalidSetting(where, got=name, need=need, fix=did_you_mean(name, names))


def wrong_at(where: str, path: str, text: str, vary: tuple[Listed | Drawn, ...]) -> InvalidSetting:
    """Say that points are asked about that the study does not have."""
    listed = {one.path: one for one in vary if isinstance(one, Listed)}
    if path not in listed:
        return InvalidSetting(
            where,
            got=f"{path}, which takes no values in turn",
            need=f"one of {', '.join(listed)}" if listed else "left out: no setting is listed",
            fix=did_you_mean(path, listed),
        )
    labels = listed[path].labels
    shown = labels if len(labels) <= 20 else (*labels[:10], "...", *labels[-3:])
    return InvalidSetting(
        where,
        got=f"{path}: {text}",
        need=f"one of the values of {path}: {', '.join(shown)}",
        fix=did_you_mean(text, labels),
    )
