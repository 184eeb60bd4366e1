"""`dechirp schema`: JSON Schema of a settings file, for editors."""

from typing import Literal, TypeAlias

SettingsKind: TypeAlias = Literal["scenario", "study", "tune", "radar", "requirements"]


def schema(kind: SettingsKind = "scenario", /) -> int:
    """Print the JSON Schema of a settings file, for editors.

    Editors use it to check a file during editing and to complete names and kinds.

    Parameters
    ----------
    kind
        Kind of file: scenario, study, tune, radar (for --radar) or requirements (for design).
    """
    from dechirp.config.schema import Schema
    from dechirp.config.validation import build_file_schema
    from dechirp.experiments.scenario import READERS, Scenario
    from dechirp.experiments.study.schema import study_file_schema
    from dechirp.experiments.tune.document import tune_file_schema
    from dechirp.radar.calibration import Calibration
    from dechirp.radar.design.requirements import Requirements
    from dechirp.radar.radar import Radar
    from dechirp.results.text_files import to_json_text

    document_schema: Schema
    match kind:
        case "scenario":
            document_schema = build_file_schema(Scenario, path_readable_types=READERS)
        case "study":
            document_schema = study_file_schema()
        case "tune":
            document_schema = tune_file_schema()
        case "radar":
            document_schema = build_file_schema(Radar, path_readable_types=[Calibration])
        case "requirements":
            document_schema = build_file_schema(Requirements)
    print(to_json_text(document_schema), end="")
    return 0
