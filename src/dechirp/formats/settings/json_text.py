"""JSON files of vendors, which may hold anything."""

import json
from pathlib import Path
from typing import Any

from dechirp.core.errors import RecordingError

# Real ones have some kilobytes. Lists in lists take 40 bytes of memory for each byte.
_LARGEST = 2**21


def parsed(file: Path, text: str) -> Any:
    """Parse the text of a JSON file.

    Raises
    ------
    RecordingError
        If it is not JSON, nested too deeply, or too long.
    """
    try:
        if len(text) <= _LARGEST:
            return json.loads(text)
        got = f"longer than {_LARGEST} characters"
    except RecursionError:
        got = "nested too deeply"
    except ValueError as error:
        got = f"not JSON ({error})"
    raise RecordingError(
        file, got=got, need="the JSON file of the recording", fix="Copy it again from its source."
    ) from None


def number(thing: Any) -> bool:
    """Whether it is a number that fits into a float, and no truth value."""
    return isinstance(thing, int | float) and not isinstance(thing, bool) and abs(thing) < 1e300


def count(thing: Any) -> bool:
    """Whether it is a whole number."""
    return isinstance(thing, int) and number(thing)


def shown(thing: Any) -> str:
    """What a JSON value is, in at most 40 characters."""
    if isinstance(thing, list | dict):
        return "a list" if isinstance(thing, list) else "an object"
    return json.dumps(thing)[:40]
