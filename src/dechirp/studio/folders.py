"""What lies in the folders of the studio: a path counts as where it ends, all links followed."""

import os
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path

DEEPEST = 4
"""Folders below one, that are looked into."""
MOST_NAMES = 10_000
"""Of one folder, that are looked at."""


def is_inside(path: Path, folders: Iterable[Path]) -> bool:
    """Whether a path ends, with all links followed, in one of the folders."""
    try:
        end = path.resolve()
        # Of links that lead round in a circle, one is left from Python 3.13 on.
        return not end.is_symlink() and any(
            end.is_relative_to(folder.resolve()) for folder in folders
        )
    except (OSError, RuntimeError, ValueError):  # links in a circle, names that no system has
        return False


def is_plain(path: Path, folders: Iterable[Path]) -> bool:
    """Whether a path is a file or folder in the folders, and all below it is.

    Nothing is opened: a pipe would wait for ever, and a link may lead anywhere.
    """
    folders = tuple(folders)
    if not is_inside(path, folders):
        return False
    try:
        if not path.is_dir():
            return path.is_file()
        below = list(islice(_below(path, DEEPEST), MOST_NAMES))
        return len(below) < MOST_NAMES and all(stays(entry, folders) for entry in below)
    except OSError:
        return False


def stays(entry: os.DirEntry[str], folders: Iterable[Path]) -> bool:
    """Whether what lies in one of the folders is a file or folder there, links followed."""
    if entry.is_symlink() and not is_inside(Path(entry.path), folders):
        return False
    return entry.is_file() or entry.is_dir()


def _below(folder: Path, deeper: int) -> Iterator[os.DirEntry[str]]:
    with os.scandir(folder) as entries:
        for entry in entries:
            yield entry
            if deeper and entry.is_dir(follow_symlinks=False):
                yield from _below(Path(entry.path), deeper - 1)
