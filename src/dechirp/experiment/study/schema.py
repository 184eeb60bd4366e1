"""JSON Schema of study files: what `read` reads."""

from collections.abc import Iterable

from dechirp.config.schema import TEXT, Schema, Schemas, any_of, by_kind, list_of
from dechirp.evaluate.score.base import Score
from dechirp.experiment.scenario import READERS, Scenario
from dechirp.experiment.study.study import Requirement, Study, Trials, Until
from dechirp.experiment.study.text import unit_of
from dechirp.experiment.study.vary import DISTRIBUTIONS, RANGE

_PAIR: Schema = {"type": "array", "minItems": 2, "maxItems": 2}
_NULL: Schema = {"type": "null"}
_LIMIT: Schema = {"type": ["string", "number", "null"]}
_END: Schema = {"type": ["string", "number"]}


def study_schema() -> Schema:
    """What a study file may say; what may be varied, and its values, is known when it is read."""
    schemas = Schemas(read_from_path=READERS)
    until = schemas.mapping(Until, instead={"score": label(), "width": _END})
    point = {"type": "object", "additionalProperties": True}
    asked = {"score": label(), "at": point, "at_least": _LIMIT, "at_most": _LIMIT}
    root = schemas.mapping(
        Study,
        instead={
            "scenario": scenario(schemas),
            "vary": {"type": ["object", "null"], "additionalProperties": varied()},
            "scores": list_of(any_of([label(), _with_settings(schemas)]), at_least=1),
            "trials": schemas.mapping(
                Trials, instead={"until": any_of([_in_unit(until, ("width",), schemas), _NULL])}
            ),
            "require": any_of(
                [
                    list_of(
                        _in_unit(
                            schemas.mapping(Requirement, instead=asked),
                            ("at_least", "at_most"),
                            schemas,
                        )
                    ),
                    _NULL,
                ]
            ),
        },
    )
    return schemas.document("Study of dechirp", root)


def scenario(schemas: Schemas) -> Schema:
    """The path of a scenario file, or the scenario itself."""
    return any_of([TEXT, schemas.value(Scenario)])


def label() -> Schema:
    """Name of a score."""
    return {"enum": [kind.replace("-", "_") for kind in Score.members()]}


def varied(*, drawn: bool = True) -> Schema:
    """Values that a setting takes: a list, a range, a distribution, or a mapping of labels."""
    ends = {"from": _END, "to": _END}
    by_step = {**ends, "step": _END}
    by_number = {**ends, "n": {"type": "integer"}, "spacing": {"enum": ["linear", "log"]}}
    ranges = [
        _mapping(by_step | {"spacing": by_number["spacing"]}, required=by_step),
        _mapping(by_number, required=("from", "to", "n")),
    ]
    distributions = [_mapping({name: _PAIR}, required=(name,)) for name in DISTRIBUTIONS]
    labelled = {
        "type": "object",
        "minProperties": 1,
        "propertyNames": {"not": {"enum": [*RANGE, *DISTRIBUTIONS]}},
    }
    lists = {"type": "array", "minItems": 1}
    return any_of([lists, *ranges, *(distributions if drawn else []), labelled])


def limit(member: type[Score], schemas: Schemas) -> Schema:
    """A limit of a score, in its unit."""
    return schemas.quantity(unit_of(member))


def _mapping(properties: Schema, *, required: Iterable[str]) -> Schema:
    return {
        "type": "object",
        "properties": properties,
        "required": list(required),
        "additionalProperties": False,
    }


def _with_settings(schemas: Schemas) -> Schema:
    """A score with settings of its own, whose kind may be written as its label."""
    return by_kind(
        {
            name: schemas.mapping(member, kind={"const": name})
            for kind, member in Score.members().items()
            for name in sorted({kind, kind.replace("-", "_")})
        }
    )


def _in_unit(mapping: Schema, names: Iterable[str], schemas: Schemas) -> Schema:
    """Require that limits have the unit of the score beside them."""
    rules = [
        {
            "if": {
                "properties": {"score": {"const": kind.replace("-", "_")}},
                "required": ["score"],
            },
            "then": {
                "properties": {name: any_of([limit(member, schemas), _NULL]) for name in names}
            },
        }
        for kind, member in Score.members().items()
    ]
    return {**mapping, "allOf": rules}
