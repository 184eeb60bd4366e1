"""Files that are there whole or not at all: written beside their place, then renamed."""

import os
import uuid
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path

from dechirp.core.errors import InvalidSetting


def named(path: object, suffixes: Collection[str]) -> Path:
    """Keep a path that ends in one of the suffixes, or raise `InvalidSetting`."""
    if not isinstance(path, str | Path):
        raise InvalidSetting("path", got=repr(path), need="a path", fix="Give it as a text.")
    if "\0" in str(path) or Path(path).suffix.lower() not in suffixes:
        raise InvalidSetting(
            "path",
            got=f"{str(path)!r}, with the suffix {Path(path).suffix or 'of none'}",
            need=f"one that ends in {', '.join(suffixes)}",
            fix="Name it after the format that you want.",
        )
    return Path(path)


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Give a path to write to, which takes the place of `path` at the end.

    Whatever goes wrong, what was at `path` stays as it was.

    Raises
    ------
    InvalidSetting
        If it is a folder, cannot be written, or the disk is full.
    """
    place = Path(os.path.realpath(path))
    made = place.with_name(f".{uuid.uuid4().hex[:12]}{place.suffix}")
    try:
        try:
            if place.is_dir():
                raise IsADirectoryError(None, "a folder")
            yield made
            made.replace(place)
        finally:
            made.unlink(missing_ok=True)
    except OSError as error:
        raise _unwritable(path, error) from None


def must_be_writable(path: Path) -> None:
    """Raise `InvalidSetting` unless a file can be made there; to be asked before a long run."""
    place = Path(os.path.realpath(path))
    trial = place.with_name(f".{uuid.uuid4().hex[:12]}{place.suffix}")
    try:
        if place.is_dir():
            raise IsADirectoryError(None, "a folder")
        trial.touch(exist_ok=False)
        trial.unlink()
    except OSError as error:
        raise _unwritable(path, error) from None


def _unwritable(path: Path, error: OSError) -> InvalidSetting:
    return InvalidSetting(
        "path",
        got=f"{path}, not writable ({error.strerror or error})",
        need="a file in a folder that is there",
        fix="Name a place that can be written and has room.",
    )
