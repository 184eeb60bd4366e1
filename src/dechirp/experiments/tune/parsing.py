"""Parser of tune files.

::

    scenarios: [reference.yaml]     # files, or scenarios themselves; or, or beside them,
    recordings:
      - scenario: recorded.yaml     # a scenario with `recording:`
        truth: {targets: [{name: reflector, position: [5 m, 0 m, 0 m], velocity: [0, 0, 0]}]}
        empty_range: [20 m, 60 m]   # ranges without targets: alarms there are false
    seed: 7
    search:                         # paths as --set takes them; values as in a study's vary
      chain.cfar.estimator: [{kind: cell-averaging}, {kind: greatest-of}]
      chain.cfar.n_training.range: {from: 4, to: 24, step: 1}
      chain.cfar.false_alarm_probability: {from: 1e-8, to: 1e-5, n: 13, spacing: log}
    objective:
      maximise: detection_probability   # or minimise: range_rmse
      at_most: {false_alarm_probability: 1e-6}      # at_least as well; any scores
    trials: 200                     # trials of each candidate, the same for all
    candidates: 60
    confirmation_trials: 1000       # trials in which the best must confirm its gain
    confidence: 0.95
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypeVar

from dechirp.config.dumping import dump_node_on_one_line
from dechirp.config.error_messages import SettingNode
from dechirp.config.fields import ValueType
from dechirp.config.loading import (
    build_value_from_tree,
    read_settings_text,
    sort_and_deduplicate_mistakes,
    validate_and_build_value,
)
from dechirp.config.quantities import parse_quantity
from dechirp.config.validation import ValidationContext
from dechirp.config.yaml_tree import YamlNode, duplicate_key_mistakes, join_setting_path, parse_yaml
from dechirp.core.argument_types import check_argument_types
from dechirp.core.errors import DechirpError, InvalidFile, InvalidSetting, Mistake
from dechirp.core.suggestions import CHOOSE_OR_OMIT, did_you_mean_fix
from dechirp.core.values import frozen_dataclass
from dechirp.evaluation.score.base import Score
from dechirp.experiments.scenario import READERS, Scenario, keep_given_chain_settings, load
from dechirp.experiments.study.dumping import score_limit_unit
from dechirp.experiments.study.study import RandomSetting, SweptSetting
from dechirp.experiments.study.variants import ScenarioVariants, check_settings_do_not_overlap
from dechirp.experiments.study.vary_values import parse_varied_setting
from dechirp.experiments.tune.tune import LabelledRecording, Limit, Objective, Tune
from dechirp.scene.scene import Scene

T = TypeVar("T")

_MAX_VALUES = 10_000
_MAX_MISTAKES = 10  # reported invalid values of one setting
SEARCHABLE_SECTIONS = ("chain", "ego_motion", "tracker", "group_tracker")
_PARSED_KEYS = ("scenarios", "recordings", "search", "objective")


@frozen_dataclass
class PlainSettings:
    """Scalar settings of the file."""

    name: str = "tune"
    seed: int = 0
    trials: int = 200
    candidates: int = 60
    confirmation_trials: int = 1000
    confidence: float = 0.95


@check_argument_types
def load_tune(path: str | Path, overrides: Sequence[str] = (), *, seed: int | None = None) -> Tune:
    """Load a search from a settings file.

    Parameters
    ----------
    path : path
        The settings file, YAML.
    overrides : sequence of str
        `PATH=VALUE` texts that replace settings of its scenarios.
    seed : int, optional
        Seed of the search in place of that of the file.

    Raises
    ------
    InvalidFile
        With every mistake of the file, each with its line and column.
    """
    path = Path(path)
    return _TuneParser(path, tuple(overrides), seed).parse_file()


class _TuneParser:
    """Parser of one file, which collects its mistakes."""

    def __init__(self, path: Path, overrides: Sequence[str], seed: int | None) -> None:
        self.path, self.overrides, self.seed = path, overrides, seed
        self.context = ValidationContext(folder=path.absolute().parent, readers=READERS)
        self.mistakes: list[Mistake] = []

    def parse_file(self) -> Tune:
        tree = parse_yaml(read_settings_text(self.path), str(self.path))
        self.mistakes += duplicate_key_mistakes(tree)
        if not isinstance(tree.content, dict):
            raise InvalidFile(
                tree.location.create_mistake(
                    "the file",
                    value="empty" if tree.content is None else tree.content_description,
                    expected="the settings of a search",
                    fix="write scenarios, search and objective",
                )
            )
        content = dict(tree.content)
        parts = {name: content.pop(name, None) for name in _PARSED_KEYS}
        plain = self._parse_scalar_settings(content, tree)
        scenarios = self._parse_list_members(parts["scenarios"], "scenarios", self._parse_scenario)
        recordings = self._parse_list_members(
            parts["recordings"], "recordings", self._parse_labelled_recording
        )
        all_scenarios = [*scenarios, *(recording.scenario for recording in recordings)]
        search = (
            self._parse_searched_settings(parts["search"], tree, all_scenarios)
            if all_scenarios
            else ()
        )
        objective = self._parse_objective(parts["objective"], tree)
        if self.mistakes or objective is None or plain is None:
            raise InvalidFile(*sort_and_deduplicate_mistakes(self.mistakes))
        fields = {name: getattr(plain, name) for name in plain.__dataclass_fields__}
        if self.seed is not None:
            fields["seed"] = self.seed
        try:
            return Tune(
                scenarios=tuple(scenarios),
                recordings=tuple(recordings),
                search=search,
                objective=objective,
                **fields,
            )
        except InvalidSetting as error:
            raise InvalidFile(*self._mistakes_with_file_positions(error, tree)) from None

    def _parse_scalar_settings(
        self, content: dict[str, YamlNode], tree: YamlNode
    ) -> PlainSettings | None:
        keys = (*PlainSettings.__dataclass_fields__, *_PARSED_KEYS)
        for name in [name for name in content if name not in PlainSettings.__dataclass_fields__]:
            self.mistakes.append(
                content.pop(name).name_location.create_mistake(
                    join_setting_path("", name),
                    value="unknown setting",
                    expected=f"one of {', '.join(keys)}",
                    fix=did_you_mean_fix(name, keys, CHOOSE_OR_OMIT),
                )
            )
        spot = SettingNode(
            "", replace(tree, content=content, duplicate_keys=()), ValueType(PlainSettings)
        )
        return self._value_or_none_recording_mistakes(
            lambda: validate_and_build_value(spot, self.context)
        )

    def _parse_list_members(
        self, node: YamlNode | None, name: str, parse_member: Callable[[str, YamlNode], T | None]
    ) -> list[T]:
        if node is None:
            return []
        if not isinstance(node.content, list):
            self._record_mistake(
                node, name, expected="a list", fix="write it in brackets, even one alone"
            )
            return []
        members = (
            parse_member(f"{name}.{index}", member) for index, member in enumerate(node.content)
        )
        return [member for member in members if member is not None]

    def _parse_scenario(self, path: str, node: YamlNode) -> Scenario | None:
        if isinstance(node.content, str):
            file = self.context.folder / node.content
            return self._value_or_none_recording_mistakes(lambda: load(file, self.overrides))
        if not isinstance(node.content, dict):
            self._record_mistake(
                node, path, expected="a scenario, or the name of its file", fix="name the file"
            )
            return None
        return self._value_or_none_recording_mistakes(
            lambda: keep_given_chain_settings(
                build_value_from_tree(node, Scenario, self.context, overrides=self.overrides),
                self.overrides,
                node,
            )
        )

    def _parse_labelled_recording(self, path: str, node: YamlNode) -> LabelledRecording | None:
        if not isinstance(node.content, dict) or "scenario" not in node.content:
            self._record_mistake(
                node,
                path,
                expected="a mapping of scenario, and truth or empty_range or both",
                fix="write scenario: FILE, a scenario that has a recording",
            )
            return None
        content = dict(node.content)
        scenario = self._parse_scenario(f"{path}.scenario", content.pop("scenario"))
        truth, empty_range = content.pop("truth", None), content.pop("empty_range", None)
        for name, child in content.items():
            self.mistakes.append(
                child.name_location.create_mistake(
                    join_setting_path(path, name),
                    value="unknown setting",
                    expected="one of scenario, truth, empty_range",
                    fix=did_you_mean_fix(
                        name, ("scenario", "truth", "empty_range"), CHOOSE_OR_OMIT
                    ),
                )
            )
        scene = Scene()
        if truth is not None:
            spot = SettingNode(f"{path}.truth", truth, ValueType(Scene))
            scene = (
                self._value_or_none_recording_mistakes(
                    lambda: validate_and_build_value(spot, self.context)
                )
                or scene
            )
        empty_range_m = None
        if empty_range is not None:
            slot = ValueType(tuple[float, float], "m", "empty_range")
            empty_range_m = self._value_or_none_recording_mistakes(
                lambda: validate_and_build_value(
                    SettingNode(f"{path}.empty_range", empty_range, slot), self.context
                )
            )
        if scenario is None:
            return None
        try:
            return LabelledRecording(scenario=scenario, truth=scene, empty_range_m=empty_range_m)
        except InvalidSetting as error:
            self.mistakes += self._mistakes_with_file_positions(error, node)
            return None

    def _parse_searched_settings(
        self, node: YamlNode | None, tree: YamlNode, scenarios: Sequence[Scenario]
    ) -> tuple[SweptSetting, ...]:
        if node is None or not isinstance(node.content, dict) or not node.content:
            self.mistakes.append(
                (node or tree).name_location.create_mistake(
                    "search",
                    value="missing" if node is None else node.content_description,
                    expected="settings to search, with their values",
                    fix="write chain.cfar.n_guard.range: {from: 1, to: 6, step: 1}, for instance",
                )
            )
            return ()
        settings: list[SweptSetting] = []
        variants = [ScenarioVariants(item) for item in scenarios]
        for path, values in node.content.items():
            listed = self._value_or_none_recording_mistakes(
                partial(self._parse_values_of_searched_setting, path, values, variants)
            )
            if listed is not None:
                settings.append(listed)
        try:
            check_settings_do_not_overlap(
                [variants[0].locate_setting(item.path) for item in settings]
            )
        except InvalidSetting as error:
            self.mistakes += [
                _mistake_at_position(item, node.name_location, "search") for item in error.mistakes
            ]
        return tuple(settings)

    def _parse_values_of_searched_setting(
        self, path: str, node: YamlNode, all_variants: Sequence[ScenarioVariants]
    ) -> SweptSetting:
        """Parse the values of one setting; each is tried alone on each scenario."""
        name = f"search.{path}"
        try:
            leaf = all_variants[0].locate_setting(path).leaf_value_type
        except InvalidSetting as error:
            raise InvalidFile(
                *(_mistake_at_position(item, node.name_location, name) for item in error.mistakes)
            ) from None
        if path.partition(".")[0] not in SEARCHABLE_SECTIONS:
            raise InvalidFile(
                node.name_location.create_mistake(
                    name,
                    value="no setting of what is made of samples",
                    expected=f"a setting in one of {', '.join(SEARCHABLE_SECTIONS)}",
                    fix="vary it in a study: it changes what there is to find",
                )
            )
        try:
            axis, probes = parse_varied_setting(
                path, node, leaf, self.context, max_values=_MAX_VALUES
            )
        except InvalidFile as error:
            mistakes = (
                replace(item, setting=item.setting.replace(f"vary.{path}", name, 1))
                for item in error.mistakes
            )
            raise InvalidFile(*mistakes) from None
        if isinstance(axis, RandomSetting):
            raise InvalidFile(
                node.location.create_mistake(
                    name,
                    value="a distribution",
                    expected="a list or a range: a search takes values, it does not draw them",
                    fix="write {from: ..., to: ..., step: ...}",
                )
            )
        wrong = [
            _mistake_at_position(mistake, item.location, name, dump_node_on_one_line(item))
            for item in probes
            for variants in all_variants
            for mistake in _mistakes_of_setting_value(variants, path, dump_node_on_one_line(item))
        ]
        if wrong:
            raise InvalidFile(*list(dict.fromkeys(wrong))[:_MAX_MISTAKES])
        return axis

    def _parse_objective(self, node: YamlNode | None, tree: YamlNode) -> Objective | None:
        if node is None or not isinstance(node.content, dict):
            self.mistakes.append(
                (node or tree).name_location.create_mistake(
                    "objective",
                    value="missing" if node is None else node.content_description,
                    expected="a score to maximise or minimise, and limits of others",
                    fix="write {maximise: detection_probability,"
                    " at_most: {false_alarm_probability: 1e-6}}",
                )
            )
            return None
        content = node.content
        keys = ("maximise", "minimise", "at_most", "at_least")
        for name in content:
            if name not in keys:
                self.mistakes.append(
                    content[name].name_location.create_mistake(
                        join_setting_path("objective", name),
                        value="unknown setting",
                        expected=f"one of {', '.join(keys)}",
                        fix=did_you_mean_fix(name, keys, CHOOSE_OR_OMIT),
                    )
                )
        directions = [name for name in ("maximise", "minimise") if name in content]
        if len(directions) != 1:
            self.mistakes.append(
                node.name_location.create_mistake(
                    "objective",
                    value="without maximise or minimise"
                    if not directions
                    else "both maximise and minimise",
                    expected="one of them, with the name of a score",
                    fix="write maximise: detection_probability",
                )
            )
            return None
        score_node = content[directions[0]]
        score = self._parse_score(f"objective.{directions[0]}", score_node, score_node.text)
        limits = [
            limit
            for side in ("at_most", "at_least")
            if side in content
            for limit in self._parse_limits_of_objective(side, content[side])
        ]
        if score is None:
            return None
        direction: Literal["maximise", "minimise"] = (
            "maximise" if directions[0] == "maximise" else "minimise"
        )
        try:
            return Objective(direction=direction, score=score, limits=tuple(limits))
        except InvalidSetting as error:
            self.mistakes += [
                score_node.location.create_mistake(
                    mistake.setting, value=mistake.value, expected=mistake.expected, fix=mistake.fix
                )
                for mistake in error.mistakes
            ]
            return None

    def _parse_limits_of_objective(self, side: str, node: YamlNode) -> Iterator[Limit]:
        if not isinstance(node.content, dict):
            self._record_mistake(
                node,
                f"objective.{side}",
                expected="a mapping of scores and their limits",
                fix="write {false_alarm_probability: 1e-6}",
            )
            return
        for label, child in node.content.items():
            path = f"objective.{side}.{label}"
            score = self._parse_score(path, child, label)
            if score is None:
                continue
            try:
                bound = parse_quantity(child.text, score_limit_unit(score), setting=path)
                limit = Limit(score=score, **{side: bound})
            except InvalidSetting as error:
                self.mistakes += [
                    _mistake_at_position(mistake, child.location, path)
                    for mistake in error.mistakes
                ]
                continue
            yield limit

    def _parse_score(self, path: str, node: YamlNode, kind: str) -> Score | None:
        classes: Mapping[str, type] = Score.members()
        if kind not in classes:
            self.mistakes.append(
                node.name_location.create_mistake(
                    path,
                    value=kind or node.content_description,
                    expected=f"a score: one of {', '.join(classes)}",
                    fix=did_you_mean_fix(kind, classes),
                )
            )
            return None
        score: Score = classes[kind]()
        if not score.is_repeatable:
            self._record_mistake(
                node,
                path,
                expected="a score that is the same when the same trial is done again",
                fix="measure it in a study of what is found",
            )
            return None
        return score

    def _record_mistake(self, node: YamlNode, path: str, *, expected: str, fix: str) -> None:
        self.mistakes.append(
            node.location.create_mistake(
                path, value=node.content_description, expected=expected, fix=fix
            )
        )

    def _value_or_none_recording_mistakes(self, make_value: Callable[[], T]) -> T | None:
        """Return the value of `make_value`; record the mistakes and return None if it raises."""
        try:
            return make_value()
        except InvalidFile as error:
            self.mistakes += error.mistakes
        return None

    def _mistakes_with_file_positions(
        self, error: DechirpError, node: YamlNode
    ) -> Iterator[Mistake]:
        """Yield the mistakes of a value with their positions in the file."""
        for mistake in error.mistakes:
            _, _, rest = mistake.setting.partition(".")
            name = rest.removesuffix("_m")
            child = node.content.get(name) if isinstance(node.content, dict) else None
            place = (child or node).name_location
            yield place.create_mistake(
                name, value=mistake.value, expected=mistake.expected, fix=mistake.fix
            )


def _mistake_at_position(mistake: Mistake, place: Any, name: str, text: str = "") -> Mistake:
    """Return a mistake with its position in the file of the search."""
    reported_value = mistake.value
    if text:
        reported_value = (
            text
            if name.endswith(mistake.setting)
            else f"{text}, with {mistake.setting} {reported_value}"
        )
    relocated: Mistake = place.create_mistake(
        name, value=reported_value, expected=mistake.expected, fix=mistake.fix
    )
    return relocated


def _mistakes_of_setting_value(
    variants: ScenarioVariants, path: str, value_text: str
) -> tuple[Mistake, ...]:
    try:
        variants.scenario_with_settings({path: value_text})
    except DechirpError as error:
        return error.mistakes
    return ()
