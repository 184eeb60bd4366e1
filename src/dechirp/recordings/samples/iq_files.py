"""Recordings in two files, one of I and one of Q, whose names differ in that letter."""

import re
from pathlib import Path

_LETTER = re.compile(r"(?<![A-Za-z0-9])([IQiq])(?![A-Za-z0-9])|(?<=[a-z0-9])([IQ])(?![A-Za-z0-9])")


def iq_file_names(name: str) -> dict[str, str]:
    """Return the names of the I and of the Q file of a pair; empty for other names."""
    stem, dot, _ = name.rpartition(".")
    letter = _LETTER.search(stem if dot else name)
    if letter is None:
        return {}

    def name_with(replacement: str) -> str:
        if letter[0].isupper():
            replacement = replacement.upper()
        return f"{name[: letter.start()]}{replacement}{name[letter.end() :]}"

    return {"i": name_with("i"), "q": name_with("q")}


def other_iq_file(path: Path) -> Path | None:
    """Return the other file of an I/Q pair; None if there is none."""
    others = (path.with_name(name) for name in iq_file_names(path.name).values())
    folder = path.resolve().parent
    return next(
        (
            other
            for other in others
            if other != path and other.is_file() and other.resolve().parent == folder
        ),
        None,
    )


def leading_iq_file(path: Path) -> Path:
    """Return the I file of an I/Q pair; the path itself if it belongs to none."""
    return path if other_iq_file(path) is None else path.with_name(iq_file_names(path.name)["i"])
