"""JSON Schema of tune files, as `parsing` reads them."""

from dechirp.config.fields import Slot, field_docstrings
from dechirp.config.schema import Schema, SchemaBuilder, list_schema
from dechirp.evaluation.score.base import Score
from dechirp.experiments.scenario import READERS
from dechirp.experiments.study.schema import (
    limit_schema,
    scenario_schema,
    score_label_schema,
    vary_schema,
)
from dechirp.experiments.tune.parsing import SEARCHABLE_SECTIONS, PlainSettings
from dechirp.experiments.tune.tune import Tune
from dechirp.scene.scene import Scene


def tune_schema() -> Schema:
    """Build the schema of the settings of a search."""
    schemas = SchemaBuilder(read_from_path=READERS)
    limits = {
        "type": "object",
        "properties": {
            kind.replace("-", "_"): limit_schema(member, schemas)
            for kind, member in Score.members().items()
        },
        "additionalProperties": False,
    }
    objective = {
        "type": "object",
        "properties": {
            "maximise": score_label_schema(),
            "minimise": score_label_schema(),
            "at_most": limits,
            "at_least": limits,
        },
        "oneOf": [{"required": ["maximise"]}, {"required": ["minimise"]}],
        "additionalProperties": False,
    }
    recorded = {
        "type": "object",
        "properties": {
            "scenario": scenario_schema(schemas),
            "truth": schemas.value_reference(Scene),
            "empty_range": schemas.slot_schema(Slot(tuple[float, float], "m")),
        },
        "required": ["scenario"],
        "additionalProperties": False,
    }
    parts = {
        "scenarios": list_schema(scenario_schema(schemas)),
        "recordings": list_schema(recorded),
        "search": {
            "type": "object",
            "minProperties": 1,
            "propertyNames": {"pattern": rf"^({'|'.join(SEARCHABLE_SECTIONS)})(\.|$)"},
            "additionalProperties": vary_schema(with_distributions=False),
        },
        "objective": objective,
    }
    meanings = field_docstrings(Tune)
    root = schemas.mapping_schema(PlainSettings)
    root["description"] = (Tune.__doc__ or "").partition("\n")[0]
    for name, part in parts.items():
        description = {"description": meanings[name]} if meanings[name] else {}
        root["properties"][name] = {**description, **part}
    root["required"] = ["search", "objective"]
    root["anyOf"] = [{"required": ["scenarios"]}, {"required": ["recordings"]}]
    return schemas.build_document("Search of dechirp", root)
