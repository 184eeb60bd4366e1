"""`dechirp schema`: the JSON Schema of a settings file, by which editors check and complete it."""

from typing import Literal, TypeAlias

Kind: TypeAlias = Literal["scenario", "study", "tune", "radar", "requirements"]


def schema(kind: Kind = "scenario", /) -> int:
    """Print the JSON Schema of a kind of settings file.

    Editors take it to check a file while it is written, and to complete names and kinds.

    Parameters
    ----------
    kind
        Which file: scenario, study, tune, radar (as --radar takes it) or requirements (of design).
    """
    from dechirp.config.schema import Schema, document
    from dechirp.experiment.scenario import READERS, Scenario
    from dechirp.experiment.study.schema import study_schema
    from dechirp.experiment.tune.schema import tune_schema
    from dechirp.radar.calibration import Calibration
    from dechirp.radar.radar import Radar
    from dechirp.radar.requirements import Requirements
    from dechirp.store.tables import json_text

    made: Schema
    match kind:
        case "scenario":
            made = document(Scenario, read_from_path=READERS)
        case "study":
            made = study_schema()
        case "tune":
            made = tune_schema()
        case "radar":
            made = document(Radar, read_from_path=[Calibration])
        case "requirements":
            made = document(Requirements)
    print(json_text(made), end="")
    return 0
