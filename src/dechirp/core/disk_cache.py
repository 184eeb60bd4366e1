"""Cache on disk: numbers that take long to compute, shared by all processes of a user.

Each entry is a file whose name is the hash of its key. It is written under another name and
renamed, so that processes that read or write at the same time see complete entries only, and it
contains its key and a checksum: a damaged entry is computed again. A cache that cannot be read or
written is not used.
"""

import hashlib
import json
import os
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import platformdirs

FOLDER_VARIABLE = "DECHIRP_CACHE_DIR"


def cache_folder() -> Path | None:
    """Return the folder of the environment variable DECHIRP_CACHE_DIR, or that of the system.

    None if the variable is set to nothing, or the user has no home folder: then nothing is kept.
    """
    folder = os.environ.get(FOLDER_VARIABLE)
    if folder is None:
        with suppress(RuntimeError):  # of platformdirs, without a home folder
            return platformdirs.user_cache_path("dechirp", appauthor=False)
    return Path(folder) if folder else None


def key_hash(key: Mapping[str, object]) -> str:
    """Return the name of an entry: the hash of its key, which JSON must be able to hold."""
    return hashlib.sha256(json.dumps(key, sort_keys=True).encode()).hexdigest()[:32]


def source_hash(*files: Path) -> str | None:
    """Return the hash of the code that computes an entry, a part of its key; None if unreadable."""
    try:
        sources = [file.read_bytes() for file in sorted(set(files))]
    except OSError:
        return None
    return hashlib.sha256(b"\0".join(sources)).hexdigest()[:16]


def read_cached_numbers(kind: str, key: Mapping[str, object]) -> list[float] | None:
    """Return the numbers kept for a key; None if there are none, or they are damaged."""
    folder = cache_folder()
    if folder is None:
        return None
    with suppress(OSError, ValueError, TypeError, KeyError):
        entry = json.loads((folder / kind / f"{key_hash(key)}.json").read_bytes())
        numbers = [float(number) for number in entry["numbers"]]
        if entry["key"] == key and entry["checksum"] == _checksum(numbers):
            return numbers
    return None


def write_cached_numbers(kind: str, key: Mapping[str, object], numbers: Sequence[float]) -> None:
    """Keep numbers for a key, if the folder can be written."""
    folder = cache_folder()
    if folder is None:
        return
    entry = {"key": key, "numbers": list(numbers), "checksum": _checksum(numbers)}
    with suppress(OSError):
        (folder / kind).mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile("w", dir=folder / kind, delete=False) as file:
            file.write(json.dumps(entry))
        try:
            Path(file.name).replace(folder / kind / f"{key_hash(key)}.json")
        finally:
            Path(file.name).unlink(missing_ok=True)


def _checksum(numbers: Sequence[float]) -> str:
    return hashlib.sha256(json.dumps(list(numbers)).encode()).hexdigest()
