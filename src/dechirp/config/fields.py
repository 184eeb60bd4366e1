"""Settings of value classes: names in files, types, units, defaults and help texts."""

import ast
import inspect
import textwrap
import types
from collections.abc import Collection
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import cache
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from dechirp.config.yaml_tree import YamlNode
from dechirp.core.dimensions import DIMENSIONS, split_unit_suffix
from dechirp.core.families import Family

_SIMPLE_TYPES: dict[Any, str] = {
    int: "a whole number",
    str: "a text",
    bool: "true or false",
}


@dataclass(frozen=True)
class Slot:
    """Accepted content of one place in a file: a type, and the unit of its numbers."""

    hint: Any
    unit: str | None = None
    field: str = ""
    """Name of the field; the suffix `_path` marks texts that are file paths."""

    @property
    def choices(self) -> tuple[Any, ...]:
        """Types of a union without None, or the single type."""
        if get_origin(self.hint) in (Union, types.UnionType):
            return tuple(choice for choice in get_args(self.hint) if choice is not type(None))
        return (self.hint,)

    @property
    def is_optional(self) -> bool:
        """True if null is accepted."""
        return type(None) in get_args(self.hint)

    def value_class(self, node: YamlNode) -> type | None:
        """Return the class that a mapping here describes; in a family `kind` selects it."""
        for choice in self.choices:
            if is_family(choice):
                kind = node.content.get("kind") if isinstance(node.content, dict) else None
                members: dict[str, type] = choice.members()
                return members.get(kind.text) if kind else None
            if is_dataclass(choice):
                return choice if isinstance(choice, type) else None
        return None

    def member_slot(self) -> "Slot":
        """Return the slot of the members of a list."""
        for choice in self.choices:
            if get_origin(choice) is tuple:
                return Slot(get_args(choice)[0], self.unit, self.field)
        return Slot(object)

    @property
    def is_path(self) -> bool:
        """True if a text here is a file path."""
        return str in self.choices and is_path_field(self.field)


@dataclass(frozen=True)
class Setting:
    """Field of a value class under its name in files."""

    field: str
    slot: Slot
    is_required: bool
    default: Any
    """Value without an entry in the file; None for a required setting."""


@cache
def list_settings(cls: type) -> dict[str, Setting]:
    """Return the settings of a value class by their names in files, without units."""
    hints = get_type_hints(cls)
    settings = {}
    for field in fields(cls):
        key, unit = _split_setting_unit(field.name, hints[field.name])
        default = field.default
        if field.default_factory is not MISSING:
            default = field.default_factory()
        settings[key] = Setting(
            field=field.name,
            slot=Slot(hints[field.name], unit, field.name),
            is_required=default is MISSING,
            default=None if default is MISSING else default,
        )
    return settings


def field_docstrings(cls: type[Any]) -> dict[str, str]:
    """Return the docstring of each field of a value class on one line; empty if it has none."""
    body = ast.parse(textwrap.dedent(inspect.getsource(cls))).body[0]
    assert isinstance(body, ast.ClassDef)
    docstrings = {}
    for statement, next_statement in zip(body.body, [*body.body[1:], ast.Pass()], strict=True):
        if isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name):
            match next_statement:
                case ast.Expr(value=ast.Constant(value=str(text))):
                    docstrings[statement.target.id] = " ".join(text.split())
    return {field.name: docstrings.get(field.name, "") for field in fields(cls)}


def setting_name(cls: type, field: str) -> str:
    """Return the name of a field in files, or the same name if the class lacks the field."""
    return next(
        (key for key, setting in list_settings(cls).items() if setting.field == field), field
    )


def is_path_field(field: str) -> bool:
    """Check whether a field of this name holds a file path."""
    return field == "path" or field.endswith("_path")


def is_family(hint: Any) -> bool:
    """Check whether a type is a family, whose members `kind` selects."""
    if not (inspect.isclass(hint) and issubclass(hint, Family)):
        return False
    return not is_dataclass(hint) or inspect.isabstract(hint)  # a base class may have settings


def describe_slot(slot: Slot, *, read_from_path: Collection[type] = ()) -> str:
    """Describe the accepted content of a slot for an error message."""
    texts = [_describe_type(choice, slot.unit, read_from_path) for choice in slot.choices]
    return " or ".join([*texts, "null"] if slot.is_optional else texts)


def _describe_type(hint: Any, unit: str | None, read_from_path: Collection[type]) -> str:
    if hint in _SIMPLE_TYPES:
        text = _SIMPLE_TYPES[hint]
    elif hint is float:
        text = DIMENSIONS[unit].description
    elif get_origin(hint) is Literal:
        text = f"one of {', '.join(str(choice) for choice in get_args(hint))}"
    elif get_origin(hint) is tuple:
        member, *others = get_args(hint)
        size = "" if Ellipsis in others else f" of {1 + len(others)}"
        member_text = describe_slot(Slot(member, unit), read_from_path=read_from_path)
        text = f"a list{size}, each {member_text}"
    elif is_family(hint):
        text = f"a mapping with kind: {', '.join(hint.members())}"
    else:
        text = f"a mapping of {', '.join(list_settings(hint)) or 'nothing'}"
        text += ", or the path of a file" if hint in read_from_path else ""
    return text


def _split_setting_unit(field: str, hint: Any) -> tuple[str, str | None]:
    return split_unit_suffix(field) if _contains_type(float, hint) else (field, None)


def _contains_type(kind: type, hint: Any) -> bool:
    return hint is kind or any(_contains_type(kind, part) for part in get_args(hint))
