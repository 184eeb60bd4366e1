"""A folder of small files, such as a page and the numbers on it: all of them or none."""

from collections.abc import Collection, Mapping
from pathlib import Path

from dechirp.store.whole import must_be_replaceable, whole_folder


def check_out(out: Path, names: Collection[str]) -> None:
    """Raise `DechirpError` if a folder cannot take files of these names.

    It must be absent, empty or hold nothing but earlier ones, the first name among them. To be
    asked before a long run.
    """
    must_be_replaceable(out, mark=next(iter(names)), ours=names)


def write_files(out: Path, contents: Mapping[str, bytes]) -> None:
    """Write each content under its name into a folder that `check_out` has seen.

    Raises
    ------
    DechirpError
        If the folder cannot be written. It is left as it was then.
    """
    with whole_folder(out) as made:
        for name, content in contents.items():
            (made / name).write_bytes(content)
