"""Parser of study files, which reports all mistakes at once.

`scenario` is the path of a scenario file, relative to the study file, or the scenario itself;
`vary_values.py` describes the values of varied settings. `--set PATH=VALUE` applies to the scenario
unless the path begins with a setting of the study. For a varied path, the study keeps that one
value: a label of the axis, or any value.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from dechirp.config import loading
from dechirp.config.dumping import dump_node_on_one_line
from dechirp.config.error_messages import SettingNode, locate_mistakes_in_file
from dechirp.config.fields import ValueType, list_settings
from dechirp.config.loading import (
    build_value_from_tree,
    read_settings_text,
    sort_and_deduplicate_mistakes,
    validate_and_build_value,
)
from dechirp.config.overrides import apply_override, parse_override
from dechirp.config.setting_paths import SettingPath
from dechirp.config.validation import ValidationContext
from dechirp.config.yaml_tree import (
    Location,
    YamlNode,
    duplicate_key_mistakes,
    join_setting_path,
    parse_yaml,
)
from dechirp.core.argument_types import check_argument_types
from dechirp.core.errors import (
    DechirpError,
    InvalidFile,
    InvalidSetting,
    Mistake,
    quote_for_message,
)
from dechirp.core.suggestions import CHOOSE_OR_OMIT, did_you_mean_fix
from dechirp.evaluation.score.base import Score
from dechirp.experiments.scenario import READERS, Scenario
from dechirp.experiments.study.dumping import score_limit_unit
from dechirp.experiments.study.study import (
    RandomSetting,
    Requirement,
    Study,
    SweptSetting,
    TrialBudget,
    unknown_point_mistake,
)
from dechirp.experiments.study.variants import (
    ABSOLUTE_CONTEXT,
    ScenarioVariants,
    check_settings_do_not_overlap,
)
from dechirp.experiments.study.vary_values import parse_varied_setting

_PLAIN_SETTINGS = (
    "name",
    "seed",
    "draw",
    "confidence",
    "stop_after_failures",
    "sensor",
    "at_most_points",
    "at_most_trials",
    "keep",
    "at_most_bytes",
)
_MAX_MISTAKES = 10  # invalid values of one setting before the rest is skipped


@check_argument_types
def load_study(path: str | Path, overrides: Iterable[str] = (), seed: int | None = None) -> Study:
    """Load a study from a YAML file.

    Parameters
    ----------
    path : str or Path
        The file; paths in it are relative to its folder, those in a scenario file to that one's.
    overrides : iterable of str
        PATH=VALUE, as after `--set`: of the scenario, except for paths that begin with a setting of
        the study other than `name` and `seed`; `vary.PATH=VALUE` varies another setting, or
        replaces its values. A varied path takes this one value or label, and requirements at other
        values are dropped.
    seed : int, optional
        Replaces the seed of the study.

    Raises
    ------
    InvalidFile
        With every mistake of the file, of the scenario and of the options at once. Each value of
        a list is tried on the scenario alone, some of a long range, and the ends of distributions.
    """
    path = Path(path)
    file = _StudyParser(
        str(path), ValidationContext(folder=path.absolute().parent, readers=READERS)
    )
    file.parse_text_and_apply_overrides(read_settings_text(path), overrides)
    file.read_independent_settings()
    file.read_scenario_with_overrides()
    file.read_and_try_varied_settings()
    file.read_scores()
    return file.build_study(seed)


@dataclass
class _StudyParser:
    """Values and mistakes of a study file, read part by part."""

    name: str
    context: ValidationContext
    tree: YamlNode = field(init=False)
    mistakes: list[Mistake] = field(default_factory=list)
    values: dict[str, Any] = field(default_factory=dict)
    scenario_options: list[str] = field(default_factory=list)
    axis_options: dict[str, YamlNode] = field(default_factory=dict)
    resolved_paths: dict[str, SettingPath] = field(default_factory=dict)

    @property
    def top_level_nodes(self) -> Mapping[str, YamlNode]:
        assert isinstance(self.tree.content, dict)
        return self.tree.content

    def parse_text_and_apply_overrides(self, text: str, overrides: Iterable[str]) -> None:
        """Parse the text, and apply the options."""
        self.tree = parse_yaml(text, self.name)
        names = list_settings(Study)
        if not isinstance(self.tree.content, dict):
            raise InvalidFile(
                self.tree.location.create_mistake(
                    "the file",
                    value=self.tree.content_description
                    if self.tree.content is not None
                    else "empty",
                    expected=f"a mapping of {', '.join(names)}",
                    fix="write scenario, vary and scores, each on a line of its own",
                )
            )
        self.mistakes += duplicate_key_mistakes(self.tree)
        for option in overrides:
            with self.record_mistakes_raised_within():
                self._apply_override_to_study_or_scenario(option)
        for name, node in self.top_level_nodes.items():
            if name not in names:
                self.mistakes.append(
                    node.name_location.create_mistake(
                        join_setting_path("", name),
                        value="unknown setting",
                        expected=f"one of {', '.join(names)}",
                        fix=did_you_mean_fix(name, names, CHOOSE_OR_OMIT),
                    )
                )
        for name, what in (
            ("scenario", "the path of a scenario file, or the scenario itself"),
            ("scores", "a list of scores"),
        ):
            if name not in self.top_level_nodes:
                self.mistakes.append(
                    self.tree.location.create_mistake(
                        name, value="missing", expected=what, fix=f"add {name}"
                    )
                )

    def _apply_override_to_study_or_scenario(self, override: str) -> None:
        path, node = parse_override(override)
        first, _, rest = path.partition(".")
        vary = self.top_level_nodes.get("vary")
        varied = vary.content if vary is not None and isinstance(vary.content, dict) else {}
        if path in varied:
            self.axis_options[path] = node
        elif first == "vary" and rest:
            place = vary.location if vary is not None else node.location
            whole = YamlNode({**varied, rest: node}, place, place)
            self.tree = replace(self.tree, content={**self.top_level_nodes, "vary": whole})
        elif first == "scenario" and rest:
            self.scenario_options.append(override.partition(".")[2])
        elif first in list_settings(Study) and first not in ("name", "seed"):
            spot = SettingNode("", self.tree, ValueType(Study))
            self.tree = apply_override(spot, override, self.context)
        else:
            self.scenario_options.append(override)

    def read_independent_settings(self) -> None:
        """Read the settings that need no other."""
        for name in _PLAIN_SETTINGS:
            if name in self.top_level_nodes:
                spot = SettingNode(
                    name, self.top_level_nodes[name], list_settings(Study)[name].value_type
                )
                with self.record_mistakes_raised_within():
                    self.values[name] = validate_and_build_value(spot, self.context)

    def read_scenario_with_overrides(self) -> None:
        """Read the scenario, with the options that apply to it."""
        node = self.top_level_nodes.get("scenario")
        if node is None:
            return
        expected = "the path of a scenario file, or the scenario itself"
        with self.record_mistakes_raised_within():
            if isinstance(node.content, str):
                path = self.context.folder / node.content
                if not path.is_file():
                    raise _invalid_file_error(
                        node.location,
                        "scenario",
                        f"{node.content_description}, which is no file",
                        expected,
                        f"Paths start from {self.context.folder}.",
                    )
                scenario = loading.read_settings(
                    path, Scenario, overrides=self.scenario_options, readers=READERS
                )
            elif isinstance(node.content, dict):
                scenario = build_value_from_tree(
                    node, Scenario, self.context, overrides=self.scenario_options
                )
            else:
                raise _invalid_file_error(
                    node.location,
                    "scenario",
                    node.content_description,
                    expected,
                    "Write scenario: scenario.yaml.",
                )
            if scenario.scene is None:
                raise _invalid_file_error(
                    node.name_location,
                    "scenario",
                    "of a recording",
                    "of a scene that can be simulated again and again",
                    "Give a scene; dechirp tune takes recordings.",
                )
            self.values["scenario"] = scenario

    def read_and_try_varied_settings(self) -> None:
        """Read the varied settings, and try them on the scenario."""
        node = self.top_level_nodes.get("vary")
        if node is None or node.content is None:
            self.values["vary"] = ()
            return
        if "scenario" not in self.values:
            return
        if not isinstance(node.content, dict):
            self.mistakes.append(
                node.location.create_mistake(
                    "vary",
                    value=node.content_description,
                    expected="a mapping of paths, such as scene.targets.car.rcs, to values",
                    fix="write PATH: [VALUE, VALUE]",
                )
            )
            return
        variants = ScenarioVariants(self.values["scenario"])
        at_most = self.values.get("at_most_points", Study.at_most_points)
        axes: list[SweptSetting | RandomSetting] = []
        for path, child in node.content.items():
            with self.record_mistakes_raised_within():
                axes.append(self._parse_and_try_varied_setting(path, child, variants, at_most))
        for option in self.scenario_options:
            self._check_override_apart_from_varied_settings(option, variants)
        if len(axes) == len(node.content):
            self.values["vary"] = tuple(axes)

    def _parse_and_try_varied_setting(
        self, path: str, node: YamlNode, variants: ScenarioVariants, max_values: int
    ) -> SweptSetting | RandomSetting:
        if path == "seed":
            raise _invalid_file_error(
                node.name_location,
                "vary.seed",
                "varied",
                "other settings: random numbers follow from the study's seed and the trial",
                "Set more trials, or the seed of the study.",
            )
        try:
            way = variants.locate_setting(path)
            check_settings_do_not_overlap([*self.resolved_paths.values(), way])
        except InvalidSetting as error:
            (mistake,) = error.mistakes
            setting = f"vary.{mistake.setting.removeprefix('vary.')}"
            raise _invalid_file_error(
                node.name_location, setting, mistake.value, mistake.expected, mistake.fix
            ) from None
        self.resolved_paths[path] = way
        axis, probes = parse_varied_setting(
            path, node, way.leaf_value_type, self.context, max_values=max_values
        )
        if path in self.axis_options:
            override_node = self._replace_label_by_value_node(axis, self.axis_options[path])
            listed = YamlNode([override_node], override_node.location, override_node.location)
            axis, probes = parse_varied_setting(
                path, listed, way.leaf_value_type, self.context, max_values=max_values
            )
        wrong: list[Mistake] = []
        for value in probes:
            if len(wrong) < _MAX_MISTAKES:
                wrong += _mistakes_of_value_in_scenario(variants, path, value)
        if wrong:
            raise InvalidFile(*wrong)
        return axis

    def _replace_label_by_value_node(
        self, axis: SweptSetting | RandomSetting, node: YamlNode
    ) -> YamlNode:
        """Return the value of an option: the one that its label stands for, or itself."""
        if isinstance(axis, SweptSetting) and node.text in axis.labels:
            text = axis.texts[axis.labels.index(node.text)]
            return replace(
                parse_yaml(text, "--set"), location=node.location, name_location=node.location
            )
        return node

    def _check_override_apart_from_varied_settings(
        self, override: str, variants: ScenarioVariants
    ) -> None:
        """Record a mistake for an option that a varied setting would override."""
        path, _ = parse_override(override)
        try:
            way = variants.locate_setting(path)
        except InvalidSetting:
            return
        for other in self.resolved_paths.values():
            if way.overlaps(other):
                self.mistakes.append(
                    Location("--set").create_mistake(
                        path,
                        value=f"cannot be combined with {other.path}, which is varied",
                        expected=f"{other.path}, or a setting that it does not contain",
                        fix=f"set {other.path} itself, or vary.{other.path}",
                    )
                )

    def read_scores(self) -> None:
        """Read the scores, by their names in study files."""
        node = self.top_level_nodes.get("scores")
        if node is None:
            return
        kinds = Score.members()
        if not isinstance(node.content, list) or not node.content:
            self.mistakes.append(
                node.location.create_mistake(
                    "scores",
                    value=node.content_description,
                    expected=f"a list of scores: {', '.join(kinds)}",
                    fix="write [detection_probability]",
                )
            )
            return
        scores: list[Score] = []
        for index, member in enumerate(node.content):
            named = member
            if isinstance(member.content, dict):
                named = member.content.get("kind", member)
            kind = named.text
            if kind not in kinds or not isinstance(named.content, str):
                self.mistakes.append(
                    named.location.create_mistake(
                        f"scores.{index}",
                        value=named.content_description,
                        expected=f"one of {', '.join(kinds)}",
                        fix=did_you_mean_fix(kind, kinds),
                    )
                )
                continue
            inner = dict(member.content) if isinstance(member.content, dict) else {}
            inner["kind"] = replace(named, content=kind, text=kind)
            spot = SettingNode(f"scores.{index}", replace(member, content=inner), ValueType(Score))
            with self.record_mistakes_raised_within():
                scores.append(validate_and_build_value(spot, self.context))
        if len(scores) == len(node.content):
            self.values["scores"] = tuple(scores)

    def build_study(self, seed: int | None) -> Study:
        """Read trials and requirements, which refer to scores and points, and build the study."""
        self._read_trial_budget()
        self._read_requirements()
        fields = {**self.values, **({} if seed is None else {"seed": seed})}
        study = None
        if all(name in fields for name in ("scenario", "vary", "scores")):
            try:
                study = Study(**fields)
            except InvalidSetting as error:
                self.mistakes += locate_mistakes_in_file(
                    error, SettingNode("", self.tree, ValueType(Study))
                )
        if self.mistakes or study is None:
            raise InvalidFile(
                *sort_and_deduplicate_mistakes(_drop_duplicate_mistakes(self.mistakes))
            )
        return study

    @property
    def _limit_unit_by_score_kind(self) -> dict[str, str | None]:
        return {score.kind(): score_limit_unit(score) for score in self.values.get("scores", ())}

    def _read_trial_budget(self) -> None:
        node = self.top_level_nodes.get("trials")
        if node is None:
            return
        if isinstance(node.content, dict):
            until = node.content.get("until")
            if until is not None and isinstance(until.content, dict):
                inner = self._convert_score_limits_to_si(
                    until.content, "trials.until", ("width",), fallback=1.0
                )
                until = replace(until, content=inner)
                node = replace(node, content={**node.content, "until": until})
        with self.record_mistakes_raised_within():
            self.values["trials"] = validate_and_build_value(
                SettingNode("trials", node, ValueType(TrialBudget)), self.context
            )

    def _read_requirements(self) -> None:
        node = self.top_level_nodes.get("require")
        if node is None or node.content is None:
            return
        members: list[YamlNode] = []
        for index, member in enumerate(node.content if isinstance(node.content, list) else ()):
            inner = member.content
            if isinstance(inner, dict):
                where = f"require.{index}"
                inner = self._convert_score_limits_to_si(
                    inner, where, ("at_least", "at_most"), fallback=0.0
                )
                points = inner.get("points")
                if points is not None and isinstance(points.content, dict):
                    pairs = self._parse_points_of_requirement(points, f"{where}.points")
                    if pairs is None:
                        continue
                    inner = {**inner, "points": pairs}
                elif points is not None and points.content is not None:
                    self.mistakes.append(
                        points.location.create_mistake(
                            f"{where}.points",
                            value=points.content_description,
                            expected="a mapping of paths that are varied, and their values",
                            fix="write points: {PATH: VALUE}",
                        )
                    )
                    inner = {key: child for key, child in inner.items() if key != "points"}
            members.append(replace(member, content=inner))
        if isinstance(node.content, list):
            node = replace(node, content=members)
        slot = ValueType(tuple[Requirement, ...])
        with self.record_mistakes_raised_within():
            self.values["require"] = validate_and_build_value(
                SettingNode("require", node, slot), self.context
            )

    def _convert_score_limits_to_si(
        self,
        content: dict[str, YamlNode],
        where: str,
        limit_names: Sequence[str],
        *,
        fallback: float,
    ) -> dict[str, YamlNode]:
        """Convert limits of a score to SI; invalid ones are recorded and replaced by `fallback`."""
        score = content.get("score")
        kind = "" if score is None else score.text
        units = self._limit_unit_by_score_kind
        converted = dict(content)
        for name in limit_names:
            node = content.get(name)
            if node is None or node.content is None:
                continue
            number = fallback
            if kind in units:
                spot = SettingNode(f"{where}.{name}", node, ValueType(float, units[kind]))
                with self.record_mistakes_raised_within():
                    number = validate_and_build_value(spot, self.context)
            converted[name] = replace(node, content=number)
        return converted

    def _parse_points_of_requirement(self, points: YamlNode, where: str) -> YamlNode | None:
        """Return pairs of path and text of the points that a requirement selects.

        None where an option has removed those points.
        """
        assert isinstance(points.content, dict)
        vary: tuple[SweptSetting | RandomSetting, ...] = self.values.get("vary", ())
        pairs: list[YamlNode] = []
        for path, node in points.content.items():
            axis = next((axis for axis in vary if axis.path == path), None)
            text = (
                self._text_of_matching_swept_value(axis, node)
                if isinstance(axis, SweptSetting)
                else None
            )
            if text is not None:
                parts = [replace(node, content=part, text=part) for part in (path, text)]
                pairs.append(replace(node, content=parts))
            elif path in self.axis_options:
                return None
            elif "vary" in self.values:
                (mistake,) = unknown_point_mistake(
                    f"{where}.{path}", path, node.text or node.content_description, vary
                ).mistakes
                place = node.location if isinstance(axis, SweptSetting) else node.name_location
                self.mistakes.append(
                    place.create_mistake(
                        mistake.setting,
                        value=mistake.value,
                        expected=mistake.expected,
                        fix=mistake.fix,
                    )
                )
        return replace(points, content=pairs)

    def _text_of_matching_swept_value(self, axis: SweptSetting, node: YamlNode) -> str | None:
        """Return the text of the axis value that a node means, by its label or by equality."""
        if node.text and node.text in axis.labels:
            return axis.texts[axis.labels.index(node.text)]
        slot = self.resolved_paths[axis.path].leaf_value_type
        try:
            meant = validate_and_build_value(SettingNode(axis.path, node, slot), self.context)
        except InvalidFile:
            return None
        for text in axis.texts:
            if _is_equal_within_rounding(
                meant,
                validate_and_build_value(
                    SettingNode(axis.path, parse_yaml(text, ""), slot), ABSOLUTE_CONTEXT
                ),
            ):
                return text
        return None

    @contextmanager
    def record_mistakes_raised_within(self) -> Iterator[None]:
        """Record the mistakes of the block, and continue."""
        try:
            yield
        except DechirpError as error:
            self.mistakes += error.mistakes


def _mistakes_of_value_in_scenario(
    variants: ScenarioVariants, path: str, node: YamlNode
) -> Iterator[Mistake]:
    """Yield the mistakes of a value in the scenario."""
    try:
        variant = variants.scenario_with_settings({path: dump_node_on_one_line(node)})
    except DechirpError as error:
        value = quote_for_message(dump_node_on_one_line(node))
        for mistake in error.mistakes:
            inside = mistake.setting == path or mistake.setting.startswith(f"{path}.")
            reported_value = value if mistake.setting == path else mistake.value
            relocated = replace(
                mistake,
                setting=f"vary.{mistake.setting if inside else path}",
                value=reported_value
                if inside
                else f"{value}, which makes {mistake.setting} {mistake.value}",
                expected=mistake.expected
                if inside
                else f"values for which {mistake.setting} is {mistake.expected}",
            )
            place = node.location
            yield replace(relocated, file=place.file, line=place.line, column=place.column)
        return
    assert variant.scene is not None and variants.scenario.scene is not None
    if variant.scene.names != variants.scenario.scene.names:
        yield node.location.create_mistake(
            f"vary.{path}",
            value=f"{quote_for_message(dump_node_on_one_line(node))}, with targets"
            f" {', '.join(variant.scene.names) or 'none'}",
            expected=f"the scenario's targets: {', '.join(variants.scenario.scene.names)}",
            fix="keep the names at every point; scores are identified by target",
        )


def _is_equal_within_rounding(first: Any, second: Any) -> bool:
    if isinstance(first, float) and isinstance(second, float):
        return math.isclose(first, second, rel_tol=1e-9)
    return bool(first == second)


def _drop_duplicate_mistakes(mistakes: Iterable[Mistake]) -> list[Mistake]:
    """Drop repeated mistakes of the same position with a longer path."""
    first: dict[tuple[object, ...], Mistake] = {}
    for mistake in mistakes:
        first.setdefault(
            (mistake.file, mistake.line, mistake.column, mistake.value, mistake.expected), mistake
        )
    return list(first.values())


def _invalid_file_error(
    place: Location, setting: str, value: str, expected: str, fix: str
) -> InvalidFile:
    return InvalidFile(place.create_mistake(setting, value=value, expected=expected, fix=fix))
