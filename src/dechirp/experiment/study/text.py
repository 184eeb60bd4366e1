"""A study as the text of a study file, the same for studies that are equal."""

from collections.abc import Iterator
from textwrap import indent

from dechirp.config.quantities import text_of
from dechirp.config.texts import dump, line, quoted
from dechirp.config.tree import read_tree
from dechirp.core.kinds import KINDS
from dechirp.evaluate.score.base import Score
from dechirp.experiment.study.study import Listed, Requirement, Study
from dechirp.experiment.study.vary import written_axis


def study_text(study: Study, *, with_scenario: bool = True) -> str:
    """YAML that `read.load_study` reads back to an equal study, its scenario inside.

    Files that settings name have absolute paths.
    """
    return "".join(f"{one}\n" for one in _lines(study, with_scenario))


def unit_of(score: Score | type[Score]) -> str | None:
    """Suffix of the unit in which limits of a score are written."""
    return "probability" if score.label().endswith("probability") else score.unit


def _lines(study: Study, with_scenario: bool) -> Iterator[str]:
    yield f"name: {quoted(study.name)}"
    yield f"seed: {study.seed}"
    if with_scenario:
        yield f"scenario:\n{indent(dump(study.scenario), '  ').rstrip()}"
    if study.vary:
        yield "vary:"
    for axis in study.vary:
        yield f"  {quoted(axis.path)}: {written_axis(axis)}"
    if study.draw is not None:
        yield f"draw: {{method: {study.draw.method}, n: {study.draw.n}}}"
    units = {score.label(): unit_of(score) for score in study.scores}
    trials = [f"at_most: {study.trials.at_most}", f"block: {study.trials.block}"]
    until = study.trials.until
    if until is not None:
        told = [f"score: {quoted(until.score)}", *_target(until.target)]
        told.append(f"width: {_number(until.width, units[until.score])}")
        trials.append(f"until: {{{', '.join(told)}}}")
    yield f"trials: {{{', '.join(trials)}}}"
    yield f"scores: [{', '.join(_score(score) for score in study.scores)}]"
    yield f"confidence: {study.confidence!r}"
    yield f"stop_after_failures: {float(study.stop_after_failures)!r}"
    if study.require:
        yield "require:"
    for requirement in study.require:
        yield f"  - {{{', '.join(_requirement(requirement, study, units))}}}"
    yield f"sensor: {study.sensor}"
    yield f"at_most_points: {study.at_most_points}"
    yield f"at_most_trials: {study.at_most_trials}"
    if study.keep:
        yield f"keep: [{', '.join(study.keep)}]"
    if study.at_most_bytes != Study.at_most_bytes:
        yield f"at_most_bytes: {study.at_most_bytes}"


def _requirement(
    requirement: Requirement, study: Study, units: dict[str, str | None]
) -> Iterator[str]:
    yield f"score: {quoted(requirement.score)}"
    yield from _target(requirement.target)
    axes = {axis.path: axis for axis in study.vary if isinstance(axis, Listed)}
    at = [f"{quoted(path)}: {_value(axes[path], text)}" for path, text in requirement.at]
    if at:
        yield f"at: {{{', '.join(at)}}}"
    unit = units[requirement.score]
    for name in ("at_least", "at_most"):
        limit = getattr(requirement, name)
        if limit is not None:
            yield f"{name}: {_number(limit, unit)}"
    yield f"confidence: {requirement.confidence!r}"


def _value(axis: Listed, text: str) -> str:
    label = axis.labels[axis.texts.index(text)]
    return text if label == text else quoted(label)


def _target(name: str | None) -> list[str]:
    return [] if name is None else [f"target: {quoted(name)}"]


def _number(number: float, unit: str | None) -> str:
    return text_of(number, unit) if KINDS[unit].base else repr(float(number))


def _score(score: Score) -> str:
    """Its name alone where it has no settings."""
    written = read_tree(dump(score), "")
    alone = isinstance(written.content, dict) and len(written.content) == 1
    return quoted(score.label()) if alone else line(written)
