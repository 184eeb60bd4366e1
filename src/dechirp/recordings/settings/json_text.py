"""Parsing of JSON files of vendors, which may contain any value."""

import json
from pathlib import Path
from typing import Any

from dechirp.core.errors import RecordingError

# Real files have some kilobytes. Nested lists take 40 bytes of memory for each byte.
_MAX_CHARACTERS = 2**21


def parse_json(file: Path, text: str) -> Any:
    """Parse the text of a JSON file.

    Raises
    ------
    RecordingError
        If it is not JSON, nested too deeply, or too long.
    """
    try:
        if len(text) <= _MAX_CHARACTERS:
            return json.loads(text)
        problem = f"longer than {_MAX_CHARACTERS} characters"
    except RecursionError:
        problem = "nested too deeply"
    except ValueError as error:
        problem = f"not JSON ({error})"
    raise RecordingError(
        file,
        value=problem,
        expected="the JSON file of the recording",
        fix="copy it again from its source",
    ) from None


def is_float_sized_number(value: Any) -> bool:
    """Return whether a value is a number that fits into a float, and not a boolean."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300


def is_integer(value: Any) -> bool:
    """Return whether a value is an integer."""
    return isinstance(value, int) and is_float_sized_number(value)


def format_json_excerpt(value: Any) -> str:
    """Format a JSON value for a message, in at most 40 characters."""
    if isinstance(value, list | dict):
        return "a list" if isinstance(value, list) else "an object"
    return json.dumps(value)[:40]
