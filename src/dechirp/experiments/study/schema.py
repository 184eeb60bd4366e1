"""JSON Schema of study files, as `parsing` reads them."""

from collections.abc import Iterable

from dechirp.config.schema import (
    TEXT,
    Schema,
    SchemaBuilder,
    any_of_schema,
    list_schema,
    schema_by_kind,
)
from dechirp.evaluation.score.base import Score
from dechirp.experiments.scenario import READERS, Scenario
from dechirp.experiments.study.dumping import score_limit_unit
from dechirp.experiments.study.study import Requirement, StopRule, Study, TrialBudget
from dechirp.experiments.study.vary_values import DISTRIBUTIONS, RANGE_KEYS

_PAIR: Schema = {"type": "array", "minItems": 2, "maxItems": 2}
_NULL: Schema = {"type": "null"}
_LIMIT: Schema = {"type": ["string", "number", "null"]}
_END: Schema = {"type": ["string", "number"]}


def study_file_schema() -> Schema:
    """Build the schema of study files; varied settings and values are checked on reading."""
    schemas = SchemaBuilder(path_readable_types=READERS)
    stop_rule = schemas.schema_of_class(
        StopRule, replacements={"score": score_name_schema(), "width": _END}
    )
    point = {"type": "object", "additionalProperties": True}
    requirement_fields = {
        "score": score_name_schema(),
        "points": point,
        "at_least": _LIMIT,
        "at_most": _LIMIT,
    }
    root = schemas.schema_of_class(
        Study,
        replacements={
            "scenario": scenario_schema(schemas),
            "vary": {"type": ["object", "null"], "additionalProperties": varied_values_schema()},
            "scores": list_schema(
                any_of_schema([score_name_schema(), _score_with_settings_schema(schemas)]),
                min_length=1,
            ),
            "trials": schemas.schema_of_class(
                TrialBudget,
                replacements={
                    "until": any_of_schema(
                        [_require_limit_unit_of_score(stop_rule, ("width",), schemas), _NULL]
                    )
                },
            ),
            "require": any_of_schema(
                [
                    list_schema(
                        _require_limit_unit_of_score(
                            schemas.schema_of_class(Requirement, replacements=requirement_fields),
                            ("at_least", "at_most"),
                            schemas,
                        )
                    ),
                    _NULL,
                ]
            ),
        },
    )
    return schemas.build_schema_document("Study of dechirp", root)


def scenario_schema(schemas: SchemaBuilder) -> Schema:
    """Build the schema of the path of a scenario file, or of the scenario itself."""
    return any_of_schema([TEXT, schemas.reference_to_class_schema(Scenario)])


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


def score_limit_schema(score_class: type[Score], schemas: SchemaBuilder) -> Schema:
    """Build the schema of a limit of a score, in its unit."""
    return schemas.reference_to_quantity_schema(score_limit_unit(score_class))


def _closed_object_schema(properties: Schema, *, required: Iterable[str]) -> Schema:
    return {
        "type": "object",
        "properties": properties,
        "required": list(required),
        "additionalProperties": False,
    }


def _score_with_settings_schema(schemas: SchemaBuilder) -> Schema:
    """Build the schema of a score with settings."""
    return schema_by_kind(
        {
            kind: schemas.schema_of_class(member, kind={"const": kind})
            for kind, member in Score.members().items()
        }
    )


def _require_limit_unit_of_score(
    mapping_schema: Schema, limit_names: Iterable[str], schemas: SchemaBuilder
) -> Schema:
    """Require that limits have the unit of their score."""
    rules = [
        {
            "if": {
                "properties": {"score": {"const": kind}},
                "required": ["score"],
            },
            "then": {
                "properties": {
                    name: any_of_schema([score_limit_schema(member, schemas), _NULL])
                    for name in limit_names
                }
            },
        }
        for kind, member in Score.members().items()
    ]
    return {**mapping_schema, "allOf": rules}
