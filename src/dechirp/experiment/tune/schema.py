"""JSON Schema of the settings of a search: what `read` reads."""

from dechirp.config.fields import Slot
from dechirp.config.help import field_help
from dechirp.config.schema import Schema, Schemas, list_of
from dechirp.evaluate.score.base import Score
from dechirp.experiment.scenario import READERS
from dechirp.experiment.study.schema import label, limit, scenario, varied
from dechirp.experiment.tune.read import SEARCHED, PlainSettings
from dechirp.experiment.tune.tune import Tune
from dechirp.scene.scene import Scene


def tune_schema() -> Schema:
    """What the settings of a search may say."""
    schemas = Schemas(read_from_path=READERS)
    limits = {
        "type": "object",
        "properties": {
            kind.replace("-", "_"): limit(member, schemas)
            for kind, member in Score.members().items()
        },
        "additionalProperties": False,
    }
    aim = {
        "type": "object",
        "properties": {
            "most": label(),
            "least": label(),
            "at_most": limits,
            "at_least": limits,
        },
        "oneOf": [{"required": ["most"]}, {"required": ["least"]}],
        "additionalProperties": False,
    }
    recorded = {
        "type": "object",
        "properties": {
            "scenario": scenario(schemas),
            "truth": schemas.value(Scene),
            "empty": schemas.slot(Slot(tuple[float, float], "m")),
        },
        "required": ["scenario"],
        "additionalProperties": False,
    }
    parts = {
        "scenarios": list_of(scenario(schemas)),
        "recordings": list_of(recorded),
        "search": {
            "type": "object",
            "minProperties": 1,
            "propertyNames": {"pattern": rf"^({'|'.join(SEARCHED)})(\.|$)"},
            "additionalProperties": varied(drawn=False),
        },
        "aim": aim,
    }
    meanings = field_help(Tune)
    root = schemas.mapping(PlainSettings)
    root["description"] = (Tune.__doc__ or "").partition("\n")[0]
    for name, part in parts.items():
        told = {"description": meanings[name]} if meanings[name] else {}
        root["properties"][name] = {**told, **part}
    root["required"] = ["search", "aim"]
    root["anyOf"] = [{"required": ["scenarios"]}, {"required": ["recordings"]}]
    return schemas.document("Search of dechirp", root)
