"""YAML text of a study, identical for equal studies."""

from collections.abc import Iterator
from textwrap import indent

from dechirp.config.dumping import dump_node_on_one_line, dump_yaml, quote_yaml_if_needed
from dechirp.config.quantities import format_exact_quantity
from dechirp.config.yaml_tree import parse_yaml
from dechirp.core.dimensions import DIMENSIONS
from dechirp.evaluation.score.base import Score
from dechirp.experiments.study.study import Requirement, Study, SweptSetting
from dechirp.experiments.study.vary_values import varied_setting_as_yaml


def dump_study_as_yaml(study: Study, *, with_scenario: bool = True) -> str:
    """Dump a study to YAML that `parsing.load_study` reads as an equal study with its scenario.

    Files that settings name have absolute paths.
    """
    return "".join(f"{text}\n" for text in _study_yaml_lines(study, with_scenario))


def score_limit_unit(score: Score | type[Score]) -> str | None:
    """Return the suffix of the unit in which limits of a score are written."""
    return "probability" if score.kind().endswith("probability") else score.unit


def _study_yaml_lines(study: Study, with_scenario: bool) -> Iterator[str]:
    yield f"name: {quote_yaml_if_needed(study.name)}"
    yield f"seed: {study.seed}"
    if with_scenario:
        yield f"scenario:\n{indent(dump_yaml(study.scenario), '  ').rstrip()}"
    if study.vary:
        yield "vary:"
    for axis in study.vary:
        yield f"  {quote_yaml_if_needed(axis.path)}: {varied_setting_as_yaml(axis)}"
    if study.draw is not None:
        yield f"draw: {{method: {study.draw.method}, n: {study.draw.n}}}"
    units = {score.kind(): score_limit_unit(score) for score in study.scores}
    trials = [f"at_most: {study.trials.at_most}", f"block: {study.trials.block}"]
    until = study.trials.until
    if until is not None:
        rule = [f"score: {quote_yaml_if_needed(until.score)}", *_target_yaml_entries(until.target)]
        rule.append(f"width: {_limit_as_yaml_quantity(until.width, units[until.score])}")
        trials.append(f"until: {{{', '.join(rule)}}}")
    yield f"trials: {{{', '.join(trials)}}}"
    yield f"scores: [{', '.join(_score_as_yaml(score) for score in study.scores)}]"
    yield f"confidence: {study.confidence!r}"
    yield f"stop_after_failures: {float(study.stop_after_failures)!r}"
    if study.require:
        yield "require:"
    for requirement in study.require:
        yield f"  - {{{', '.join(_requirement_yaml_entries(requirement, study, units))}}}"
    yield f"sensor: {study.sensor}"
    yield f"at_most_points: {study.at_most_points}"
    yield f"at_most_trials: {study.at_most_trials}"
    if study.keep:
        yield f"keep: [{', '.join(study.keep)}]"
    if study.at_most_bytes != Study.at_most_bytes:
        yield f"at_most_bytes: {study.at_most_bytes}"


def _requirement_yaml_entries(
    requirement: Requirement, study: Study, units_by_score: dict[str, str | None]
) -> Iterator[str]:
    yield f"score: {quote_yaml_if_needed(requirement.score)}"
    yield from _target_yaml_entries(requirement.target)
    axes = {axis.path: axis for axis in study.vary if isinstance(axis, SweptSetting)}
    points = [
        f"{quote_yaml_if_needed(path)}: {_swept_value_as_yaml_label(axes[path], text)}"
        for path, text in requirement.points
    ]
    if points:
        yield f"points: {{{', '.join(points)}}}"
    unit = units_by_score[requirement.score]
    for name in ("at_least", "at_most"):
        limit = getattr(requirement, name)
        if limit is not None:
            yield f"{name}: {_limit_as_yaml_quantity(limit, unit)}"
    yield f"confidence: {requirement.confidence!r}"


def _swept_value_as_yaml_label(axis: SweptSetting, value_text: str) -> str:
    label = axis.labels[axis.texts.index(value_text)]
    return value_text if label == value_text else quote_yaml_if_needed(label)


def _target_yaml_entries(target_name: str | None) -> list[str]:
    return [] if target_name is None else [f"target: {quote_yaml_if_needed(target_name)}"]


def _limit_as_yaml_quantity(limit: float, unit: str | None) -> str:
    return format_exact_quantity(limit, unit) if DIMENSIONS[unit].si_unit else repr(float(limit))


def _score_as_yaml(score: Score) -> str:
    """Format a score, by its name alone where it has no settings."""
    tree = parse_yaml(dump_yaml(score), "")
    has_no_settings = isinstance(tree.content, dict) and len(tree.content) == 1
    return quote_yaml_if_needed(score.kind()) if has_no_settings else dump_node_on_one_line(tree)
