"""Settings files to values: the page that calls the rest of this folder.

A key is the name of a field without its unit, nesting is attribute nesting, and every
mistake of a file is told at once.
"""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar, cast

from pydantic import ValidationError

from dechirp.config.fields import Slot, words
from dechirp.config.mistakes import Spot, mistakes
from dechirp.config.models import Context, Readers, checker
from dechirp.config.overrides import override
from dechirp.config.tree import Node, Place, read_tree, repeated
from dechirp.core.errors import InvalidFile, Mistake

T = TypeVar("T")

_LARGEST = 2**20  # bytes; takes some 4 s to read


def read(
    path: str | Path,
    kind: type[T],
    *,
    overrides: Iterable[str] = (),
    readers: Readers | None = None,
) -> T:
    """Value of a class from a settings file.

    Parameters
    ----------
    path : str or Path
        A YAML file; paths in it are relative to its folder.
    kind : type
        The value class.
    overrides : iterable of str
        PATH=VALUE, each put in the place of what the file says.
    readers : mapping of type to function of a Path, optional
        How to read a value of a type where the path of a file stands for it.

    Raises
    ------
    InvalidFile
        With every mistake of the file, and of files that it names.
    DechirpError
        What a reader raises.
    """
    path = Path(path)
    return parse(
        text_in(path),
        kind,
        file=str(path),
        base=path.absolute().parent,
        overrides=overrides,
        readers=readers,
    )


def parse(
    text: str,
    kind: type[T],
    *,
    file: str = "<text>",
    base: Path = Path(),
    overrides: Iterable[str] = (),
    readers: Readers | None = None,
) -> T:
    """Value of a class from the text of a settings file; `read` says what else it takes."""
    context = Context(base=base, readers=readers or {})
    return of_tree(read_tree(text, file), kind, context, overrides=overrides)


def of_tree(tree: Node, kind: type[T], context: Context, *, overrides: Iterable[str] = ()) -> T:
    """Value of a class from what a settings file, or a part of it, holds."""
    wrong: list[Mistake] = []
    if tree.content is None:
        overrides = tuple(overrides)
        if not overrides:
            raise InvalidFile(
                tree.place.mistake(
                    "the file", got="empty", need=words(Slot(kind)), fix="Write the settings."
                )
            )
        tree = replace(tree, content={})
    for option in overrides:
        try:
            tree = override(Spot("", tree, Slot(kind)), option, context)
        except InvalidFile as error:
            wrong += error.mistakes
    try:
        made = value_of(Spot("", tree, Slot(kind)), context)
    except InvalidFile as error:
        wrong += error.mistakes
    if wrong:
        raise InvalidFile(*in_order(wrong))
    return cast(T, made)


def value_of(spot: Spot, context: Context) -> Any:
    """Value of what is written at a spot.

    Raises
    ------
    InvalidFile
        With every mistake in it.
    """
    wrong = list(repeated(spot.node, spot.path))
    try:
        made = checker(spot.slot).validate_python(spot.node.plain, context=context)
    except ValidationError as error:
        wrong += mistakes(error, spot, read_from_path=context.readers)
    if wrong:
        raise InvalidFile(*in_order(wrong))
    return made


def in_order(wrong: Iterable[Mistake]) -> list[Mistake]:
    """Each mistake once, as they come in the file; those that are in none at the end."""
    return sorted(dict.fromkeys(wrong), key=_order)


def _order(mistake: Mistake) -> tuple[bool, int, int]:
    return mistake.line is None, mistake.line or 0, mistake.column or 0


def text_in(path: Path) -> str:
    """Text of a settings file.

    Raises
    ------
    InvalidFile
        If it is none: not there, not text, or larger than 1 MiB.
    """
    try:
        if not path.exists():
            got = "not there"
        elif not path.is_file():
            got = "a folder" if path.is_dir() else "not a file"
        elif path.stat().st_size > _LARGEST:
            got = f"{path.stat().st_size / 2**20:.3g} MiB"
        else:
            return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        got = f"not text: its byte {error.start} is no UTF-8"
    except OSError as error:
        got = f"not readable: {error.strerror}"
    raise InvalidFile(
        Place(str(path)).mistake(
            "the file",
            got=got,
            need="a settings file: YAML of at most 1 MiB",
            fix="Give the file that holds the settings.",
        )
    )
