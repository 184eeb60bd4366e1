"""What a settings file may say of a value class: its fields under their names in files."""

import inspect
import types
from collections.abc import Collection
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import cache
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from dechirp.config.tree import Node
from dechirp.core.families import Family
from dechirp.core.kinds import KINDS, split

_SIMPLE: dict[Any, str] = {
    int: "a whole number",
    str: "a text",
    bool: "true or false",
}


@dataclass(frozen=True)
class Slot:
    """What may stand at one place of a file: a type, and the unit of the numbers in it."""

    hint: Any
    unit: str | None = None
    field: str = ""
    """Name of the field, which says whether a text is the path of a file."""

    @property
    def choices(self) -> tuple[Any, ...]:
        """The types of a union, without None; else the one type."""
        if get_origin(self.hint) in (Union, types.UnionType):
            return tuple(choice for choice in get_args(self.hint) if choice is not type(None))
        return (self.hint,)

    @property
    def optional(self) -> bool:
        """Whether null may stand here."""
        return type(None) in get_args(self.hint)

    def value_class(self, node: Node) -> type | None:
        """Class of the value that a mapping here stands for: of a family, as `kind` says."""
        for choice in self.choices:
            if is_family(choice):
                kind = node.content.get("kind") if isinstance(node.content, dict) else None
                members: dict[str, type] = choice.members()
                return members.get(kind.text) if kind else None
            if is_dataclass(choice):
                return choice if isinstance(choice, type) else None
        return None

    def member(self) -> "Slot":
        """Slot of the members of a list here."""
        for choice in self.choices:
            if get_origin(choice) is tuple:
                return Slot(get_args(choice)[0], self.unit, self.field)
        return Slot(object)

    @property
    def is_path(self) -> bool:
        """Whether a text here is the path of a file."""
        return str in self.choices and is_path(self.field)


@dataclass(frozen=True)
class Setting:
    """A field under its name in files."""

    field: str
    slot: Slot
    required: bool
    default: Any
    """What holds where nothing is written; None where it is required."""


@cache
def settings(cls: type) -> dict[str, Setting]:
    """List the settings of a value class by their name in files, the field's without its unit."""
    hints = get_type_hints(cls)
    found = {}
    for field in fields(cls):
        key, unit = _split(field.name, hints[field.name])
        default = field.default
        if field.default_factory is not MISSING:
            default = field.default_factory()
        found[key] = Setting(
            field=field.name,
            slot=Slot(hints[field.name], unit, field.name),
            required=default is MISSING,
            default=None if default is MISSING else default,
        )
    return found


def key_of(cls: type, field: str) -> str:
    """Name in files of a field, or the same name where the class has no such field."""
    return next((key for key, setting in settings(cls).items() if setting.field == field), field)


def is_path(field: str) -> bool:
    """Whether a field of that name holds the path of a file."""
    return field == "path" or field.endswith("_path")


def is_family(hint: Any) -> bool:
    """Whether a type is chosen by `kind`."""
    if not (inspect.isclass(hint) and issubclass(hint, Family)):
        return False
    return not is_dataclass(hint) or inspect.isabstract(hint)  # a base may have settings, too


def words(slot: Slot, *, read_from_path: Collection[type] = ()) -> str:
    """Say what may stand in a slot, to follow `must be`."""
    texts = [_words(choice, slot.unit, read_from_path) for choice in slot.choices]
    return " or ".join([*texts, "null"] if slot.optional else texts)


def _words(hint: Any, unit: str | None, read_from_path: Collection[type]) -> str:
    if hint in _SIMPLE:
        text = _SIMPLE[hint]
    elif hint is float:
        text = KINDS[unit].words
    elif get_origin(hint) is Literal:
        text = f"one of {', '.join(str(choice) for choice in get_args(hint))}"
    elif get_origin(hint) is tuple:
        inner, *others = get_args(hint)
        size = "" if Ellipsis in others else f" of {1 + len(others)}"
        each = words(Slot(inner, unit), read_from_path=read_from_path)
        text = f"a list{size}, each {each}"
    elif is_family(hint):
        text = f"a mapping with kind: {', '.join(hint.members())}"
    else:
        text = f"a mapping of {', '.join(settings(hint)) or 'nothing'}"
        text += ", or the path of a file" if hint in read_from_path else ""
    return text


def _split(field: str, hint: Any) -> tuple[str, str | None]:
    return split(field) if _holds(float, hint) else (field, None)


def _holds(kind: type, hint: Any) -> bool:
    return hint is kind or any(_holds(kind, part) for part in get_args(hint))
