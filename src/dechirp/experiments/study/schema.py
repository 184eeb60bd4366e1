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
from dechirp.experiments.study.dumping import score_unit
from dechirp.experiments.study.study import Requirement, StopRule, Study, TrialBudget
from dechirp.experiments.study.vary_values import DISTRIBUTIONS, RANGE_KEYS

_PAIR: Schema = {"type": "array", "minItems": 2, "maxItems": 2}
_NULL: Schema = {"type": "null"}
_LIMIT: Schema = {"type": ["string", "number", "null"]}
_END: Schema = {"type": ["string", "number"]}


def study_schema() -> Schema:
    """Build the schema of study files; varied settings and values are checked on reading."""
    schemas = SchemaBuilder(path_readable_types=READERS)
    stop_rule = schemas.schema_of_class(
        StopRule, replacements={"score": score_label_schema(), "width": _END}
    )
    point = {"type": "object", "additionalProperties": True}
    requirement_fields = {
        "score": score_label_schema(),
        "points": point,
        "at_least": _LIMIT,
        "at_most": _LIMIT,
    }
    root = schemas.schema_of_class(
        Study,
        replacements={
            "scenario": scenario_schema(schemas),
            "vary": {"type": ["object", "null"], "additionalProperties": vary_schema()},
            "scores": list_schema(
                any_of_schema([score_label_schema(), _configured_score_schema(schemas)]),
                min_length=1,
            ),
            "trials": schemas.schema_of_class(
                TrialBudget,
                replacements={
                    "until": any_of_schema(
                        [_with_unit_rules(stop_rule, ("width",), schemas), _NULL]
                    )
                },
            ),
            "require": any_of_schema(
                [
                    list_schema(
                        _with_unit_rules(
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


def score_label_schema() -> Schema:
    """Build the schema of the name of a score."""
    return {"enum": [kind.replace("-", "_") for kind in Score.members()]}


def vary_schema(*, with_distributions: bool = True) -> Schema:
    """Build the schema of varied values: list, range, distribution, or mapping of labels."""
    ends = {"from": _END, "to": _END}
    by_step = {**ends, "step": _END}
    by_number = {**ends, "n": {"type": "integer"}, "spacing": {"enum": ["linear", "log"]}}
    ranges = [
        _object_schema(by_step | {"spacing": by_number["spacing"]}, required=by_step),
        _object_schema(by_number, required=("from", "to", "n")),
    ]
    distributions = [_object_schema({name: _PAIR}, required=(name,)) for name in DISTRIBUTIONS]
    labelled = {
        "type": "object",
        "minProperties": 1,
        "propertyNames": {"not": {"enum": [*RANGE_KEYS, *DISTRIBUTIONS]}},
    }
    lists = {"type": "array", "minItems": 1}
    return any_of_schema([lists, *ranges, *(distributions if with_distributions else []), labelled])


def limit_schema(member: type[Score], schemas: SchemaBuilder) -> Schema:
    """Build the schema of a limit of a score, in its unit."""
    return schemas.reference_to_quantity_schema(score_unit(member))


def _object_schema(properties: Schema, *, required: Iterable[str]) -> Schema:
    return {
        "type": "object",
        "properties": properties,
        "required": list(required),
        "additionalProperties": False,
    }


def _configured_score_schema(schemas: SchemaBuilder) -> Schema:
    """Build the schema of a score with settings, whose kind may be written as its label."""
    return schema_by_kind(
        {
            name: schemas.schema_of_class(member, kind={"const": name})
            for kind, member in Score.members().items()
            for name in sorted({kind, kind.replace("-", "_")})
        }
    )


def _with_unit_rules(mapping: Schema, names: Iterable[str], schemas: SchemaBuilder) -> Schema:
    """Require that limits have the unit of the score beside them."""
    rules = [
        {
            "if": {
                "properties": {"score": {"const": kind.replace("-", "_")}},
                "required": ["score"],
            },
            "then": {
                "properties": {
                    name: any_of_schema([limit_schema(member, schemas), _NULL]) for name in names
                }
            },
        }
        for kind, member in Score.members().items()
    ]
    return {**mapping, "allOf": rules}
