"""Folder of small files, such as a page and its numbers, written atomically."""

from collections.abc import Collection, Mapping
from pathlib import Path

from dechirp.core.atomic_files import atomic_folder, check_replaceable


def check_output_folder(out: Path, names: Collection[str]) -> None:
    """Raise `DechirpError` if a folder cannot take files of these names.

    The folder must be absent, empty or hold only earlier files of these names, the first name among
    them. Call this before a long run.
    """
    check_replaceable(out, marker=next(iter(names)), own_names=names)


def write_files(out: Path, contents: Mapping[str, bytes]) -> None:
    """Write each content under its name into a folder that `check_output_folder` accepted.

    Raises
    ------
    DechirpError
        If the folder cannot be written. It is then unchanged.
    """
    with atomic_folder(out) as made:
        for name, content in contents.items():
            (made / name).write_bytes(content)
