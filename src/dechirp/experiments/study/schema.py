"""JSON Schema of study files, as `parsing` reads them."""

from collections.abc import Iterable, Mapping

from dechirp.config.fields import ValueType
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
from dechirp.evaluation.score.base import Score
from dechirp.experiments.scenario import READERS
from dechirp.experiments.study.dumping import score_limit_unit
from dechirp.experiments.study.study import Requirement, StopRule, Study
from dechirp.experiments.study.vary_values import DISTRIBUTIONS, RANGE_KEYS

_PAIR: Schema = {"type": "array", "minItems": 2, "maxItems": 2}
_NULL: Schema = {"type": "null"}
_LIMIT: Schema = {"type": ["string", "number", "null"]}
_END: Schema = {"type": ["string", "number"]}


def study_file_schema() -> Schema:
    """Build the schema of study files; varied settings and values are checked on reading."""
    names, definitions = build_definitions(
        [*map(ValueType, (Study, StopRule, Requirement)), *score_limit_types()], READERS
    )
    study = definitions.pop(names[0])
    stop_rule, requirement = definitions[names[1]], definitions[names[2]]
    limits = dict(zip(Score.members(), map(reference, names[3:]), strict=True))
    point = {"type": "object", "additionalProperties": True}
    replace_settings(stop_rule, {"score": score_name_schema(), "width": _END})
    replace_settings(
        requirement,
        {"score": score_name_schema(), "points": point, "at_least": _LIMIT, "at_most": _LIMIT},
    )
    _require_limit_unit_of_score(stop_rule, ("width",), limits)
    _require_limit_unit_of_score(requirement, ("at_least", "at_most"), limits)
    settings = study["properties"]
    score = any_of_schema([score_name_schema(), settings["scores"]["items"]])
    replace_settings(
        study,
        {
            "scenario": any_of_schema([TEXT, settings["scenario"]]),
            "vary": {"type": ["object", "null"], "additionalProperties": varied_values_schema()},
            "scores": list_schema(score, min_length=1),
            "require": any_of_schema([list_schema(reference(names[2])), _NULL]),
        },
    )
    return schema_document("Study of dechirp", study, definitions)


def score_name_schema() -> Schema:
    """Build the schema of the name of a score."""
    return {"enum": list(Score.members())}


def varied_values_schema(*, with_distributions: bool = True) -> Schema:
    """Build the schema of varied values: list, range, distribution, or mapping of labels."""
    ends = {"from": _END, "to": _END}
    by_step = {**ends, "step": _END}
    by_number = {**ends, "n": {"type": "integer"}, "spacing": {"enum": ["linear", "log"]}}
    ranges = [
        _closed_object_schema(by_step | {"spacing": by_number["spacing"]}, required=by_step),
        _closed_object_schema(by_number, required=("from", "to", "n")),
    ]
    distributions = [
        _closed_object_schema({name: _PAIR}, required=(name,)) for name in DISTRIBUTIONS
    ]
    labelled = {
        "type": "object",
        "minProperties": 1,
        "propertyNames": {"not": {"enum": [*RANGE_KEYS, *DISTRIBUTIONS]}},
    }
    lists = {"type": "array", "minItems": 1}
    return any_of_schema([lists, *ranges, *(distributions if with_distributions else []), labelled])


def score_limit_types() -> list[ValueType]:
    """Return the type of a limit of each score, in its unit."""
    return [ValueType(float, score_limit_unit(member)) for member in Score.members().values()]


def _closed_object_schema(properties: Schema, *, required: Iterable[str]) -> Schema:
    return {
        "type": "object",
        "properties": properties,
        "required": list(required),
        "additionalProperties": False,
    }


def _require_limit_unit_of_score(
    schema: Schema, limit_names: Iterable[str], limits: Mapping[str, Schema]
) -> None:
    """Require that limits have the unit of their score."""
    schema["allOf"] = [
        {
            "if": {"properties": {"score": {"const": kind}}, "required": ["score"]},
            "then": {"properties": dict.fromkeys(limit_names, any_of_schema([limit, _NULL]))},
        }
        for kind, limit in limits.items()
    ]
