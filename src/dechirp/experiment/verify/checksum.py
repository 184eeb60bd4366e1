"""SHA-256 of the numbers of a certificate and of the code that made them.

Whoever runs the same seed again compares one line. The numbers are rounded to six digits first:
another processor rounds the last of sixteen otherwise, and the certificate is the same.
"""

import hashlib
import json
import math
from collections.abc import Mapping
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import Any

NOT_NUMBERS = frozenset(
    ("checksum", "code", "date", "files", "machine", "timing_s", "version", "versions")
)
"""What tells when, where and with what they were found."""
_DIGITS = 6


def of_numbers(document: Mapping[str, Any]) -> str:
    """SHA-256, in hexadecimal, of canonical JSON: names in order, no spaces, six digits.

    Parameters
    ----------
    document : mapping
        What `document` gives, or what is read back from `verify.json`.
    """
    numbers = {name: inside for name, inside in document.items() if name not in NOT_NUMBERS}
    text = json.dumps(
        _rounded(numbers), sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False
    )
    return hashlib.sha256(text.encode()).hexdigest()


def of_code() -> str:
    """SHA-256, in hexadecimal, of all files of Python in the package, by name."""
    found = hashlib.sha256()
    for name, content in sorted(_sources(files("dechirp"), "dechirp")):
        found.update(name.encode() + b"\0" + hashlib.sha256(content).digest())
    return found.hexdigest()


def _sources(folder: Traversable, name: str) -> list[tuple[str, bytes]]:
    made = []
    for entry in folder.iterdir():
        within = f"{name}/{entry.name}"
        if entry.is_dir():
            made += _sources(entry, within)
        elif entry.name.endswith(".py"):
            # As on every system: git may have turned the ends of lines.
            made.append((within, entry.read_bytes().replace(b"\r\n", b"\n")))
    return made


def _rounded(content: object) -> object:
    if isinstance(content, Mapping):
        return {name: _rounded(inside) for name, inside in content.items()}
    if isinstance(content, list | tuple):
        return [_rounded(inside) for inside in content]
    if isinstance(content, bool | str) or content is None:
        return content
    if isinstance(content, int | float):  # 1 and 1.0 are one number
        return f"{content:.{_DIGITS}g}" if math.isfinite(content) else None
    raise TypeError(f"no value of JSON: {content!r}")
