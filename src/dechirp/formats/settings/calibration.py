"""Calibrations as JSON files: the names of the fields, SI units and all."""

import json
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

from dechirp.config.nearest import OR_NONE, did_you_mean
from dechirp.config.shown import shown
from dechirp.config.texts import plain
from dechirp.core.errors import InvalidFile, InvalidSetting, Mistake
from dechirp.radar.calibration import Calibration

_LARGEST_BYTES = 2**20  # 192 elements take 40 kB


def calibration_text(calibration: Calibration) -> str:
    """JSON that `read_calibration` reads back to an equal value, an element a line."""
    lines = []
    for name, content in plain(calibration).items():
        text = json.dumps(content, allow_nan=False)
        if isinstance(content, list):
            text = "[\n    " + ",\n    ".join(json.dumps(one) for one in content) + "\n  ]"
        lines.append(f'  "{name}": {text}')
    return "{\n" + ",\n".join(lines) + "\n}\n"


def read_calibration(path: str | Path) -> Calibration:
    """Calibration from a JSON file.

    Raises
    ------
    InvalidFile
        If it cannot be read, is not JSON, lacks a key, has one that is none, or holds values that
        no calibration has. What the file names last counts where it names a key twice.
    """
    file = Path(path)
    content = _content(file)
    known = {field.name: field for field in fields(Calibration)}
    mistakes = [
        _mistake(file, key, got="not a key", need=f"one of {', '.join(known)}",
                 fix=did_you_mean(key, list(known), OR_NONE))
        for key in content
        if key not in known
    ]  # fmt: skip
    mistakes += [
        _mistake(file, name, got="absent", need="given, for each element", fix=_REMAKE)
        for name, field in known.items()
        if field.default is MISSING and name not in content
    ]
    if mistakes:
        raise InvalidFile(*mistakes)
    try:
        return Calibration(**content)
    except InvalidSetting as error:
        raise InvalidFile(
            *(
                _mistake(
                    file,
                    wrong.setting.removeprefix("Calibration."),
                    got=shown(wrong.got),
                    need=wrong.need,
                    fix=wrong.fix,
                )
                for wrong in error.mistakes
            )
        ) from None


_REMAKE = "dechirp calibrate writes such a file."


def _content(file: Path) -> dict[str, Any]:
    try:
        if not file.is_file():
            got = "a folder" if file.is_dir() else "not there"
        elif file.stat().st_size > _LARGEST_BYTES:
            got = f"{file.stat().st_size / 2**20:.3g} MiB"
        else:
            content = json.loads(file.read_text(encoding="utf-8-sig"))
            if isinstance(content, dict):
                return content
            got = f"JSON of a {'list' if isinstance(content, list) else 'single value'}"
    except OSError as error:
        got = f"not readable ({error.strerror})"
    except json.JSONDecodeError as error:
        got = f"not JSON from line {error.lineno}, column {error.colno} on: {shown(error.msg)}"
    except (ValueError, RecursionError):  # bytes that are no text, or brackets without end
        got = "not JSON"
    raise InvalidFile(
        _mistake(
            file, "the file", got=got, need="a calibration, JSON of at most 1 MiB", fix=_REMAKE
        )
    )


def _mistake(file: Path, setting: str, *, got: str, need: str, fix: str) -> Mistake:
    return Mistake(setting=shown(setting), got=got, need=need, fix=fix, file=str(file))
