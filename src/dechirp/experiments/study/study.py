"""Study: a scenario, its varied settings, its number of trials, its scores and requirements."""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from typing import ClassVar, Literal, get_args

from dechirp.core.checks import (
    check_field_classes,
    check_instances,
    check_integer_fields,
    check_non_negative_fields,
    check_positive_fields,
    check_probability,
)
from dechirp.core.display import Displayable, Table, format_count_with_noun
from dechirp.core.errors import DechirpError, InvalidSetting
from dechirp.core.suggestions import did_you_mean_fix
from dechirp.core.text import format_quantity
from dechirp.core.values import frozen_dataclass
from dechirp.evaluation.score.base import Score
from dechirp.experiments.scenario import Scenario

__all__ = ["RandomSetting", "Requirement", "Sampling", "StopRule", "SweptSetting", "TrialBudget"]


def __dir__() -> list[str]:
    return __all__


KeptData = Literal["cubes", "maps", "detections"]


@frozen_dataclass
class SweptSetting:
    """Setting that takes given values in turn: a list or a range of a study file."""

    path: str
    """Path of the setting, as `--set` accepts it."""
    texts: tuple[str, ...]
    """Values as settings files write them: `-10 dBsm`, `hann`."""
    numbers: tuple[float, ...] | None = None
    """Values as numbers for a figure's axis, in the written unit; None for texts."""
    unit: str = ""
    """Unit for axis labels, such as `dBsm`; empty without."""
    labels: tuple[str, ...] = ()
    """Legend label of each value, such as `ordered-statistic`; by default the texts."""

    def __post_init__(self) -> None:
        labels = self.labels or self.texts
        object.__setattr__(self, "labels", labels)
        if not self.texts:
            raise InvalidSetting(
                "SweptSetting.texts",
                value="empty",
                expected="at least one value",
                fix="give the values",
            )
        for name, entries in (("labels", labels), ("numbers", self.numbers)):
            if entries is not None and len(entries) != len(self.texts):
                raise InvalidSetting(
                    f"SweptSetting.{name}",
                    value=f"{len(entries)} of them",
                    expected=f"one for each of the {len(self.texts)} values",
                    fix="give as many, or none",
                )
        for name in ("texts", "labels"):
            most_common = Counter(getattr(self, name)).most_common(1)[0]
            if most_common[1] > 1:
                raise InvalidSetting(
                    f"SweptSetting.{name}",
                    value=f"{most_common[0]} twice",
                    expected="values that differ",
                    fix="take one of them out",
                )


@frozen_dataclass
class RandomSetting:
    """Setting drawn from a distribution: once a point with `Sampling`, else anew in each trial."""

    path: str
    distribution: Literal["uniform", "normal"]
    first: float
    """Lower end, or mean, in the written unit."""
    second: float
    """Upper end, or standard deviation (of levels: in dB)."""
    unit: str = ""

    def __post_init__(self) -> None:
        if self.distribution == "normal":
            check_positive_fields(self, "second")
        elif not self.first < self.second < math.inf:
            raise InvalidSetting(
                "RandomSetting.second",
                value=f"{self.second} {self.unit}".strip(),
                expected=f"above the lower end, {self.first} {self.unit}".strip(),
                fix="give the lower end first",
            )


@frozen_dataclass
class Sampling:
    """Sampling of points, over all random settings together."""

    method: Literal["sobol", "independent"] = "sobol"
    n: int

    def __post_init__(self) -> None:
        check_integer_fields(self, "n", at_most=2**30)
        if self.method == "sobol" and self.n & (self.n - 1):
            above = 2 ** self.n.bit_length()
            raise InvalidSetting(
                "Sampling.n",
                value=self.n,
                expected="a power of two: only then the points of a Sobol sequence lie evenly",
                fix=f"take {above // 2} or {above}, or method: independent",
            )


@frozen_dataclass
class StopRule:
    """Stop rule of a point: its trials end once an interval is narrow enough."""

    score: str
    """Label of one of the study's scores."""
    target: str | None = None
    """None: all targets together."""
    width: float
    """Upper less lower end, SI."""

    def __post_init__(self) -> None:
        check_positive_fields(self, "width")


@frozen_dataclass
class TrialBudget:
    """Number of trials of a point, which run in numbered blocks."""

    at_most: int = 1000
    until: StopRule | None = None
    block: int = 50
    """Trials in a block, which is saved, or lost, as a whole. `docs/studies.md` has the rule."""

    def __post_init__(self) -> None:
        check_integer_fields(self, "at_most", "block")


@frozen_dataclass
class Requirement:
    """Limit of a score, to be shown with a confidence."""

    score: str
    target: str | None = None
    points: tuple[tuple[str, str], ...] = ()
    """Path and text of settings that select points; empty: every point."""
    at_least: float | None = None
    at_most: float | None = None
    """SI; one of the two limits, or both."""
    confidence: float = 0.95
    """One-sided, for each limit."""

    def __post_init__(self) -> None:
        check_probability("Requirement.confidence", self.confidence)
        if self.confidence <= 0.5:
            raise InvalidSetting(
                "Requirement.confidence",
                value=self.confidence,
                expected="above 0.5: less is shown by chance",
                fix="take 0.95, or leave it out",
            )
        if self.at_least is None and self.at_most is None:
            raise InvalidSetting(
                "Requirement.at_least",
                value="missing, and at_most as well",
                expected="a limit: at_least, at_most or both",
                fix="add at_least or at_most",
            )
        if self.at_least is not None and self.at_most is not None and self.at_least > self.at_most:
            raise InvalidSetting(
                "Requirement.at_least",
                value=self.at_least,
                expected=f"no more than at_most, {self.at_most}",
                fix="swap them",
            )


@frozen_dataclass
class Study(Displayable):
    """Monte Carlo study: trials of a scenario over varied settings."""

    _file_reader: ClassVar[str] = "dechirp.load_study"

    name: str = "study"
    scenario: Scenario
    seed: int = 0
    vary: tuple[SweptSetting | RandomSetting, ...] = ()
    """Swept settings make a grid, the last one fastest; within it, the points of `draw`."""
    draw: Sampling | None = None
    """None: random settings are drawn anew in each trial, equal at every point."""
    trials: TrialBudget = TrialBudget()
    scores: tuple[Score, ...]
    confidence: float = 0.95
    """Confidence of the intervals of all scores."""
    stop_after_failures: float = 0.01
    """Share of trials that may fail; more stop the study."""
    require: tuple[Requirement, ...] = ()
    sensor: Literal["signal", "statistical"] = "signal"
    """`signal` simulates and processes samples, `statistical` draws detections from theory."""
    keep: tuple[KeptData, ...] = ()
    """Data of each trial that become an item of a data set, with its truth; empty: no data set."""
    at_most_points: int = 100_000
    """Safeguard against mistyped ranges that would fill a disk; raise it for more points."""
    at_most_trials: int = 100_000_000
    """The same safeguard for the trials of all points together."""
    at_most_bytes: int = 100_000_000_000
    """The same safeguard for a data set, before compression."""

    def __post_init__(self) -> None:
        check_field_classes(self, scenario=Scenario, trials=TrialBudget)
        fix = "Write (DetectionProbability(),), with both brackets, even for one alone."
        object.__setattr__(
            self, "scores", check_instances("Study.scores", self.scores, Score, fix=fix)
        )
        object.__setattr__(self, "keep", tuple(self.keep))
        errors = list(self._find_invalid_settings())
        if errors:
            # Reported all at once, like the mistakes of a file.
            DechirpError.__init__(
                errors[0], *(mistake for error in errors for mistake in error.mistakes)
            )
            raise errors[0]

    @property
    def n_points(self) -> int:
        """Number of points: of the grid of all swept settings, times those of `draw`."""
        sizes = (len(setting.texts) for setting in self.vary if isinstance(setting, SweptSetting))
        return math.prod(sizes) * (self.draw.n if self.draw is not None else 1)

    def _display_line(self) -> str:
        points = format_count_with_noun(self.n_points, "point")
        trials = format_count_with_noun(self.trials.at_most, "trial")
        parts = [f"{self.name}: {points} of at most {trials}"]
        parts.append(format_count_with_noun(len(self.scores), "score"))
        parts += [format_count_with_noun(len(self.require), "requirement")] if self.require else []
        return ", ".join(parts)

    def _display_tables(self) -> Iterable[Table]:
        yield Table("Varied", [(entry.path, _varied_values_as_text(entry)) for entry in self.vary])
        yield Table("Scores", [(score.kind(),) for score in self.scores])
        yield Table(
            "Requirements",
            [(text,) for entry in self.require for text in self._requirement_limits_as_text(entry)],
        )

    def _requirement_limits_as_text(self, requirement: Requirement) -> Iterator[str]:
        """Yield each limit of a requirement as text, in the unit of its score."""
        units = {score.kind(): score.unit for score in self.scores}
        owner = f" of {requirement.target}" if requirement.target else ""
        swept_settings = [axis for axis in self.vary if isinstance(axis, SweptSetting)]
        labels = {
            axis.path: dict(zip(axis.texts, axis.labels, strict=True)) for axis in swept_settings
        }
        where = ", ".join(f"{path} {labels[path][text]}" for path, text in requirement.points)
        for sign, limit in (("≥", requirement.at_least), ("≤", requirement.at_most)):
            if limit is not None:
                limit_text = format_quantity(limit, units[requirement.score] or "probability")
                yield f"{requirement.score}{owner} {sign} {limit_text}" + (
                    f" at {where}" if where else ""
                )

    def _find_invalid_settings(self) -> Iterator[InvalidSetting]:
        checks: tuple[Callable[[], None], ...] = (
            lambda: check_integer_fields(self, "seed", at_least=0, at_most=2**63 - 1),
            lambda: check_integer_fields(self, "at_most_points", at_most=2**63 - 1),
            lambda: check_integer_fields(self, "at_most_trials", at_most=2**63 - 1),
            lambda: check_integer_fields(self, "at_most_bytes", at_most=2**63 - 1),
            lambda: check_probability("Study.confidence", self.confidence),
            lambda: check_non_negative_fields(self, "stop_after_failures", at_most=1.0),
        )
        for check in checks:
            try:
                check()
            except InvalidSetting as error:
                yield error
        if self.scenario.scene is None:
            yield InvalidSetting(
                "Study.scenario",
                value="a scenario with a recording",
                expected="a scenario with a scene, which is simulated in every trial",
                fix="give a scene; `dechirp tune` takes recordings",
            )
        yield from self._missing_or_repeated_score_mistakes()
        yield from self._varied_setting_and_size_mistakes()
        yield from self._kept_data_mistakes()
        labels = tuple(score.kind() for score in self.scores)
        conditions: list[tuple[str, Requirement | StopRule]] = [
            (f"Study.require.{index}", requirement)
            for index, requirement in enumerate(self.require)
        ]
        if self.trials.until is not None:
            conditions.append(("Study.trials.until", self.trials.until))
        for setting, condition in conditions:
            yield from unknown_score_mistakes(f"{setting}.score", condition.score, labels)
            names = self.scenario.scene.names if self.scenario.scene is not None else ()
            if condition.target is not None:
                yield from unknown_target_mistakes(f"{setting}.target", condition.target, names)
            yield from _probability_limit_mistakes(setting, condition)
        by_path = {axis.path: axis for axis in self.vary}
        for index, requirement in enumerate(self.require):
            for path, text in requirement.points:
                axis = by_path.get(path)
                if not isinstance(axis, SweptSetting) or text not in axis.texts:
                    yield unknown_point_mistake(
                        f"Study.require.{index}.points", path, text, self.vary
                    )

    def _missing_or_repeated_score_mistakes(self) -> Iterator[InvalidSetting]:
        labels = [score.kind() for score in self.scores]
        twice = [label for label in labels if labels.count(label) > 1]
        if twice or not labels:
            yield InvalidSetting(
                "Study.scores",
                value=f"{twice[0]} twice" if twice else "empty",
                expected="at least one score, each once",
                fix="take one of them out" if twice else "write [detection_probability]",
            )

    def _varied_setting_and_size_mistakes(self) -> Iterator[InvalidSetting]:
        paths = [setting.path for setting in self.vary]
        for path in dict.fromkeys(path for path in paths if paths.count(path) > 1):
            yield InvalidSetting(
                "Study.vary",
                value=f"{path} twice",
                expected="each setting once",
                fix="keep one of them",
            )
        if self.draw is not None and not any(
            isinstance(setting, RandomSetting) for setting in self.vary
        ):
            yield InvalidSetting(
                "Study.draw",
                value=f"{self.draw.n} points, without a random setting",
                expected="a random setting in vary",
                fix="write {uniform: [LOW, HIGH]} or {normal: [MEAN, STD]} in vary, or remove draw",
            )
        n_points, n_trials = self.n_points, self.n_points * self.trials.at_most
        if n_points > self.at_most_points:
            yield InvalidSetting(
                "Study.vary",
                value=f"a grid of {n_points} points",
                expected=f"at most at_most_points, {self.at_most_points}",
                fix=f"take larger steps, or confirm it: at_most_points: {n_points}",
            )
        elif n_trials > self.at_most_trials:
            yield InvalidSetting(
                "Study.trials.at_most",
                value=f"{self.trials.at_most}, which makes {n_trials} at {n_points} points",
                expected=f"at most at_most_trials, {self.at_most_trials}, in all",
                fix=f"take fewer, or confirm it: at_most_trials: {n_trials}",
            )

    def _kept_data_mistakes(self) -> Iterator[InvalidSetting]:
        kinds = get_args(KeptData)
        invalid = [kind for kind in self.keep if kind not in kinds or self.keep.count(kind) > 1]
        if invalid:
            yield InvalidSetting(
                "Study.keep",
                value=f"{invalid[0]} twice" if invalid[0] in kinds else repr(invalid[0]),
                expected=f"some of {', '.join(kinds)}, each once",
                fix=did_you_mean_fix(str(invalid[0]), kinds),
            )
        sample_kinds = [kind for kind in self.keep if kind != "detections"]
        if sample_kinds and self.sensor == "statistical":
            yield InvalidSetting(
                "Study.keep",
                value=f"{sample_kinds[0]}, with sensor: statistical",
                expected="only detections, since no samples are simulated",
                fix="set sensor: signal, or write keep: [detections]",
            )


def _varied_values_as_text(axis: SweptSetting | RandomSetting) -> str:
    if isinstance(axis, RandomSetting):
        return f"{axis.distribution}, {axis.first:g} and {axis.second:g} {axis.unit}".strip()
    labels = axis.labels
    if len(labels) <= 4:
        return ", ".join(labels)
    return f"{labels[0]} to {labels[-1]}, {len(labels)} values"


def _probability_limit_mistakes(
    where: str, condition: Requirement | StopRule
) -> Iterator[InvalidSetting]:
    """Yield mistakes for limits that no probability can have."""
    if not condition.score.endswith("probability"):
        return
    if isinstance(condition, StopRule):
        if condition.width >= 1:
            yield InvalidSetting(
                f"{where}.width",
                value=condition.width,
                expected="below 1: any interval of a probability is as narrow",
                fix="take 0.1, or leave until out",
            )
        return
    for name in ("at_least", "at_most"):
        limit = getattr(condition, name)
        if limit is not None and not 0 <= limit <= 1:
            yield InvalidSetting(
                f"{where}.{name}",
                value=limit,
                expected=f"from 0 to 1, as {condition.score} is",
                fix="write 0.9 for 90 %",
            )


def unknown_score_mistakes(
    where: str, label: str, known_labels: tuple[str, ...]
) -> Iterator[InvalidSetting]:
    """Yield a mistake if the study does not have a score."""
    if label not in known_labels:
        yield InvalidSetting(
            where,
            value=label,
            expected=f"one of the study's scores: {', '.join(known_labels)}",
            fix=f"{did_you_mean_fix(label, known_labels).rstrip('.')}, or add it to scores",
        )


def unknown_target_mistakes(
    where: str, name: str, known_names: tuple[str, ...]
) -> Iterator[InvalidSetting]:
    """Yield a mistake if the scenario does not have a target."""
    if name not in known_names:
        need = (
            f"one of the scenario's targets: {', '.join(known_names)}"
            if known_names
            else "no target, since the scenario has none"
        )
        yield InvalidSetting(
            where, value=name, expected=need, fix=did_you_mean_fix(name, known_names)
        )


def unknown_point_mistake(
    where: str, path: str, value_text: str, vary: tuple[SweptSetting | RandomSetting, ...]
) -> InvalidSetting:
    """Return the mistake for selected points that the study does not have."""
    swept_settings = {
        setting.path: setting for setting in vary if isinstance(setting, SweptSetting)
    }
    if path not in swept_settings:
        return InvalidSetting(
            where,
            value=f"{path}, which is not a swept setting",
            expected=f"one of {', '.join(swept_settings)}"
            if swept_settings
            else "no points, since no setting is swept",
            fix=did_you_mean_fix(path, swept_settings),
        )
    labels = swept_settings[path].labels
    values = labels if len(labels) <= 20 else (*labels[:10], "...", *labels[-3:])
    return InvalidSetting(
        where,
        value=f"{path}: {value_text}",
        expected=f"one of the values of {path}: {', '.join(values)}",
        fix=did_you_mean_fix(value_text, labels),
    )
