"""Checks that paths are inside the folders of the studio, with links resolved."""

import os
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path

MAX_DEPTH = 4
"""Largest depth of scanned subfolders."""
MAX_NAMES = 10_000
"""Largest number of scanned names in one folder."""


def resolves_inside(path: Path, folders: Iterable[Path]) -> bool:
    """Return True if a path, with links resolved, is inside one of the folders."""
    try:
        end = path.resolve()
        # From Python 3.13 on, a loop of links resolves to one of them instead of failing.
        return not end.is_symlink() and any(
            end.is_relative_to(folder.resolve()) for folder in folders
        )
    except (OSError, RuntimeError, ValueError):  # links in a circle, names that no system has
        return False


def is_tree_inside(path: Path, folders: Iterable[Path]) -> bool:
    """Return True if a path and all entries below it are files or folders inside the folders.

    Nothing is opened: opening a pipe could block for ever, and a link may point anywhere.
    """
    folders = tuple(folders)
    if not resolves_inside(path, folders):
        return False
    try:
        if not path.is_dir():
            return path.is_file()
        entries = list(islice(_iter_entries_to_depth(path, MAX_DEPTH), MAX_NAMES))
        return len(entries) < MAX_NAMES and all(
            is_file_or_folder_inside(entry, folders) for entry in entries
        )
    except OSError:
        return False


def is_file_or_folder_inside(entry: os.DirEntry[str], folders: Iterable[Path]) -> bool:
    """Return True if an entry, links resolved, is a file or folder inside the folders."""
    if entry.is_symlink() and not resolves_inside(Path(entry.path), folders):
        return False
    return entry.is_file() or entry.is_dir()


def _iter_entries_to_depth(folder: Path, depth: int) -> Iterator[os.DirEntry[str]]:
    with os.scandir(folder) as entries:
        for entry in entries:
            yield entry
            if depth and entry.is_dir(follow_symlinks=False):
                yield from _iter_entries_to_depth(Path(entry.path), depth - 1)
