"""Checksums (SHA-256) of the numbers of a certificate and of the source code.

Two runs with the same seed are compared by one line. The numbers are rounded to six digits, because
processors differ in the last of sixteen. Sentences and labels do not enter, so that a certificate
can be reworded; ids and units do.
"""

import hashlib
import json
import math
from collections.abc import Mapping
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import Any

PROVENANCE_KEYS = frozenset(
    ("checksum", "code", "date", "files", "machine", "timing_s", "version", "versions")
)
"""Keys that describe the date, the machine and the software of a run instead of its results."""
TEXT_KEYS = frozenset(("id", "unit"))
"""Keys whose text enters the checksum."""
_DIGITS = 6


def number_checksum(document: Mapping[str, Any]) -> str:
    """Return the SHA-256 of the numbers of a certificate, in hexadecimal.

    The digest is that of canonical JSON: sorted keys, no spaces, six digits, no text except ids and
    units.

    Parameters
    ----------
    document : mapping
        Result of `build_document`, or the content of `verify.json`.
    """
    results = {key: content for key, content in document.items() if key not in PROVENANCE_KEYS}
    return _json_digest(_without_text(results))


def _json_digest(content: object) -> str:
    """Return the SHA-256 of canonical JSON with rounded numbers."""
    text = json.dumps(
        _round_numbers(content),
        sort_keys=True,
        separators=(",", ":"),
        ensure_ascii=True,
        allow_nan=False,
    )
    return hashlib.sha256(text.encode()).hexdigest()


def _without_text(content: object) -> object:
    """Drop all texts but ids and units."""
    if isinstance(content, Mapping):
        return {
            key: _without_text(child)
            for key, child in content.items()
            if key in TEXT_KEYS or not isinstance(child, str)
        }
    if isinstance(content, list | tuple):
        return [_without_text(child) for child in content if not isinstance(child, str)]
    return content


def code_checksum() -> str:
    """Return the SHA-256 of all Python files of the package, in hexadecimal."""
    digest = hashlib.sha256()
    for name, content in sorted(_python_files(files("dechirp"), "dechirp")):
        digest.update(name.encode() + b"\0" + hashlib.sha256(content).digest())
    return digest.hexdigest()


def _python_files(folder: Traversable, name: str) -> list[tuple[str, bytes]]:
    files_with_content = []
    for entry in folder.iterdir():
        path = f"{name}/{entry.name}"
        if entry.is_dir():
            files_with_content += _python_files(entry, path)
        elif entry.name.endswith(".py"):
            # Git may have converted the line endings.
            files_with_content.append((path, entry.read_bytes().replace(b"\r\n", b"\n")))
    return files_with_content


def _round_numbers(content: object) -> object:
    if isinstance(content, Mapping):
        return {name: _round_numbers(inside) for name, inside in content.items()}
    if isinstance(content, list | tuple):
        return [_round_numbers(inside) for inside in content]
    if isinstance(content, bool | str) or content is None:
        return content
    if isinstance(content, int | float):  # 1 and 1.0 are one number
        return f"{content:.{_DIGITS}g}" if math.isfinite(content) else None
    raise TypeError(f"not a JSON value: {content!r}")
