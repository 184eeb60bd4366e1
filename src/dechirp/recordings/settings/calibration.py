"""Calibrations as JSON files, with the field names of `Calibration` and SI units."""

import json
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

from dechirp.config.dumping import to_json_data
from dechirp.core.errors import InvalidFile, InvalidSetting, Mistake, quote_for_message
from dechirp.core.suggestions import CHOOSE_OR_OMIT, did_you_mean_fix
from dechirp.radar.calibration import Calibration

_MAX_BYTES = 2**20  # 192 elements take 40 kB


def format_calibration_json(calibration: Calibration) -> str:
    """Return the JSON from which `read_calibration` restores an equal value, an element a line."""
    lines = []
    for name, content in to_json_data(calibration).items():
        text = json.dumps(content, allow_nan=False)
        if isinstance(content, list):
            text = "[\n    " + ",\n    ".join(json.dumps(item) for item in content) + "\n  ]"
        lines.append(f'  "{name}": {text}')
    return "{\n" + ",\n".join(lines) + "\n}\n"


def read_calibration(path: str | Path) -> Calibration:
    """Read a calibration from a JSON file.

    Raises
    ------
    InvalidFile
        If it cannot be read, is not JSON, lacks a key, has an unknown key, or holds invalid values.
        The last of repeated keys counts.
    """
    file = Path(path)
    content = _read_json_object(file)
    known_fields = {field.name: field for field in fields(Calibration)}
    mistakes = [
        _calibration_mistake(file, key, value="an unknown key",
                 expected=f"one of {', '.join(known_fields)}",
                 fix=did_you_mean_fix(key, list(known_fields), CHOOSE_OR_OMIT))
        for key in content
        if key not in known_fields
    ]  # fmt: skip
    mistakes += [
        _calibration_mistake(
            file, name, value="missing", expected="one value for each element", fix=_RECALIBRATE_FIX
        )
        for name, field in known_fields.items()
        if field.default is MISSING and name not in content
    ]
    if mistakes:
        raise InvalidFile(*mistakes)
    try:
        return Calibration(**content)
    except InvalidSetting as error:
        raise InvalidFile(
            *(
                _calibration_mistake(
                    file,
                    mistake.setting.removeprefix("Calibration."),
                    value=quote_for_message(mistake.value),
                    expected=mistake.expected,
                    fix=mistake.fix,
                )
                for mistake in error.mistakes
            )
        ) from None


_RECALIBRATE_FIX = "create it with dechirp calibrate"


def _read_json_object(file: Path) -> dict[str, Any]:
    """Read the JSON object of a file; raise `InvalidFile` for anything else."""
    try:
        if not file.is_file():
            problem = "a folder" if file.is_dir() else "missing"
        elif file.stat().st_size > _MAX_BYTES:
            problem = f"{file.stat().st_size / 2**20:.3g} MiB"
        else:
            content = json.loads(file.read_text(encoding="utf-8-sig"))
            if isinstance(content, dict):
                return content
            problem = f"JSON of a {'list' if isinstance(content, list) else 'single value'}"
    except OSError as error:
        problem = f"not readable ({error.strerror})"
    except json.JSONDecodeError as error:
        reason = quote_for_message(error.msg)
        problem = f"not JSON from line {error.lineno}, column {error.colno} on: {reason}"
    except (ValueError, RecursionError):  # bytes that are not text, or nesting too deep
        problem = "not JSON"
    raise InvalidFile(
        _calibration_mistake(
            file,
            "the file",
            value=problem,
            expected="a calibration, JSON of at most 1 MiB",
            fix=_RECALIBRATE_FIX,
        )
    )


def _calibration_mistake(
    file: Path, setting: str, *, value: str, expected: str, fix: str
) -> Mistake:
    """Return a mistake in a calibration file."""
    return Mistake(
        setting=quote_for_message(setting), value=value, expected=expected, fix=fix, file=str(file)
    )
