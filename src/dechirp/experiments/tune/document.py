"""Result of a search as plain values, and the schema of tune files."""

from collections.abc import Mapping
from typing import Any

from dechirp.config.dumping import to_json_data
from dechirp.config.fields import ValueType, field_docstrings
from dechirp.config.quantities import format_exact_quantity
from dechirp.config.schema import (
    TEXT,
    Schema,
    any_of_schema,
    list_schema,
    reference,
    replace_settings,
    schema_document,
)
from dechirp.config.validation import build_definitions
from dechirp.core.dimensions import DIMENSIONS
from dechirp.evaluation.score.base import Estimate, Score
from dechirp.experiments.scenario import READERS
from dechirp.experiments.study.dumping import score_limit_unit
from dechirp.experiments.study.schema import (
    score_limit_types,
    score_name_schema,
    varied_values_schema,
)
from dechirp.experiments.tune.parsing import SEARCHABLE_SECTIONS, PlainSettings
from dechirp.experiments.tune.run import Candidate, ConfirmedCandidate, TuneResult
from dechirp.experiments.tune.tune import LabelledRecording, Tune


def tune_file_schema() -> Schema:
    """Build the schema of the settings of a search."""
    names, definitions = build_definitions(
        [*map(ValueType, (PlainSettings, LabelledRecording)), *score_limit_types()], READERS
    )
    root, recorded = (definitions.pop(names[0]), definitions[names[1]])
    scenario = any_of_schema([TEXT, recorded["properties"]["scenario"]])
    replace_settings(recorded, {"scenario": scenario})
    limits = {
        "type": "object",
        "properties": dict(zip(Score.members(), map(reference, names[2:]), strict=True)),
        "additionalProperties": False,
    }
    objective = {
        "type": "object",
        "properties": {
            "maximise": score_name_schema(),
            "minimise": score_name_schema(),
            "at_most": limits,
            "at_least": limits,
        },
        "oneOf": [{"required": ["maximise"]}, {"required": ["minimise"]}],
        "additionalProperties": False,
    }
    parts = {
        "scenarios": list_schema(scenario),
        "recordings": list_schema(reference(names[1])),
        "search": {
            "type": "object",
            "minProperties": 1,
            "propertyNames": {"pattern": rf"^({'|'.join(SEARCHABLE_SECTIONS)})(\.|$)"},
            "additionalProperties": varied_values_schema(with_distributions=False),
        },
        "objective": objective,
    }
    meanings = field_docstrings(Tune)
    root["description"] = (Tune.__doc__ or "").partition("\n")[0]
    for name, part in parts.items():
        description = {"description": meanings[name]} if meanings[name] else {}
        root["properties"][name] = {**description, **part}
    root["required"] = ["search", "objective"]
    root["anyOf"] = [{"required": ["scenarios"]}, {"required": ["recordings"]}]
    return schema_document("Search of dechirp", root, definitions)


def tune_result_as_dict(tuned: TuneResult) -> dict[str, Any]:
    """Convert the numbers of a search to SI: settings as files write them, scores with intervals.

    `best` is null if every candidate was shown to exceed a limit; `default` are the unchanged
    settings, candidate 0. Both are of confirmation trials; `candidates` are of the search.
    """
    tune = tuned.tune
    return {
        "name": tune.name,
        "seed": tune.seed,
        "confidence": tune.confidence,
        "n_trials": {"search": tuned.n_trials[0], "confirmation": tuned.n_trials[1]},
        "objective": {
            "direction": tune.objective.direction,
            "score": tune.objective.score.kind(),
            "unit": tune.objective.score.unit,
            "limits": [
                {
                    "score": limit.score.kind(),
                    "unit": limit.score.unit,
                    "at_most": limit.at_most,
                    "at_least": limit.at_least,
                    "text": objective_limit_as_text(tuned, number),
                }
                for number, limit in enumerate(tune.objective.limits)
            ],
        },
        "search": {item.path: list(item.texts) for item in tune.search},
        "best": None if tuned.best is None else _confirmed_candidate_as_dict(tuned, tuned.best),
        "default": _confirmed_candidate_as_dict(tuned, tuned.default),
        "gain": None if tuned.gain is None else tuned.gain._asdict(),
        "refuted": [_confirmed_candidate_as_dict(tuned, item) for item in tuned.refuted],
        "importances": dict(tuned.importances),
        "candidates": [_searched_candidate_as_dict(item) for item in tuned.candidates],
        "findings": [to_json_data(item) for item in tuned.findings],
    }


def objective_limit_as_text(tuned: TuneResult, limit_index: int) -> str:
    """Format a limit: `at most 1e-06`, `at most 10 cm`."""
    limit = tuned.tune.objective.limits[limit_index]
    bound = limit.at_most if limit.at_most is not None else limit.at_least
    assert bound is not None
    words = "at most" if limit.at_most is not None else "at least"
    unit = score_limit_unit(limit.score)
    has_unit = unit in DIMENSIONS and DIMENSIONS[unit].si_unit
    number = format_exact_quantity(bound, unit) if has_unit else _number_as_short_text(bound)
    return f"{words} {number}"


def _number_as_short_text(number: float) -> str:
    return f"{number:g}".replace("e-0", "e-")


def _confirmed_candidate_as_dict(
    tuned: TuneResult, candidate: ConfirmedCandidate
) -> dict[str, Any]:
    return {
        "number": candidate.number,
        "settings": dict(tuned.candidates[candidate.number].settings),
        "scores": _estimates_as_dicts(candidate.scores),
        "sources": {
            name: _estimates_as_dicts(scores) for name, scores in candidate.by_source.items()
        },
        "limits": list(candidate.decisions),
    }


def _searched_candidate_as_dict(candidate: Candidate) -> dict[str, Any]:
    return {
        "number": candidate.number,
        "settings": dict(candidate.settings),
        "scores": _estimates_as_dicts(candidate.scores),
        "admitted": candidate.is_admitted,
        "failure": candidate.failure,
    }


def _estimates_as_dicts(scores: Mapping[str, Estimate]) -> dict[str, dict[str, float]]:
    return {label: estimate._asdict() for label, estimate in scores.items()}
