"""Settings of value classes: names in files, types, units, defaults and help texts."""

import ast
import inspect
import linecache
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
    str: "text",
    bool: "true or false",
}


@dataclass(frozen=True)
class ValueType:
    """Accepted content of one place in a file: a type, and the unit of its numbers."""

    hint: Any
    unit: str | None = None
    field: str = ""
    """Name of the field; the suffix `_path` marks texts that are file paths."""

    @property
    def types_without_none(self) -> tuple[Any, ...]:
        """Types of a union without None, or the single type."""
        if get_origin(self.hint) in (Union, types.UnionType):
            return tuple(choice for choice in get_args(self.hint) if choice is not type(None))
        return (self.hint,)

    @property
    def is_optional(self) -> bool:
        """True if null is accepted."""
        return type(None) in get_args(self.hint)

    def class_of_mapping(self, node: YamlNode) -> type | None:
        """Return the class that a mapping here describes; in a family `kind` selects it."""
        for choice in self.types_without_none:
            if is_family_type(choice):
                kind = node.content.get("kind") if isinstance(node.content, dict) else None
                members: dict[str, type] = choice.members()
                return members.get(kind.text) if kind else None
            if is_dataclass(choice):
                return choice if isinstance(choice, type) else None
        return None

    def list_member_type(self) -> "ValueType":
        """Return the type of the members of a list."""
        for choice in self.types_without_none:
            if get_origin(choice) is tuple:
                return ValueType(get_args(choice)[0], self.unit, self.field)
        return ValueType(object)

    @property
    def is_file_path(self) -> bool:
        """True if a text here is a file path."""
        return str in self.types_without_none and is_path_field(self.field)


@dataclass(frozen=True)
class Setting:
    """Field of a value class under its name in files."""

    field: str
    value_type: ValueType
    is_required: bool
    default: Any
    """Value without an entry in the file; None for a required setting."""


@cache
def list_settings(cls: type) -> dict[str, Setting]:
    """Return the settings of a value class by their names in files, without units."""
    hints = get_type_hints(cls)
    settings = {}
    for field in fields(cls):
        key, unit = _split_field_name_and_unit(field.name, hints[field.name])
        default = field.default
        if field.default_factory is not MISSING:
            default = field.default_factory()
        settings[key] = Setting(
            field=field.name,
            value_type=ValueType(hints[field.name], unit, field.name),
            is_required=default is MISSING,
            default=None if default is MISSING else default,
        )
    return settings


def field_docstrings(cls: type[Any]) -> dict[str, str]:
    """Return the docstring of each field of a value class on one line; empty if it has none.

    A field that a class defines again without a docstring has that of the base class.
    """
    docstrings: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        if is_dataclass(base) and inspect.get_annotations(base):
            docstrings |= _own_field_docstrings(base)
    return {field.name: docstrings.get(field.name, "") for field in fields(cls)}


def _own_field_docstrings(cls: type[Any]) -> dict[str, str]:
    classes = _parse_top_level_classes(str(inspect.getsourcefile(cls)))
    definition: ast.stmt | None = classes.get(cls.__qualname__)
    if definition is None:
        definition = ast.parse(textwrap.dedent(inspect.getsource(cls))).body[0]
    assert isinstance(definition, ast.ClassDef)
    docstrings = {}
    body = definition.body
    for statement, next_statement in zip(body, [*body[1:], ast.Pass()], strict=True):
        if isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name):
            match next_statement:
                case ast.Expr(value=ast.Constant(value=str(text))):
                    docstrings[statement.target.id] = " ".join(text.split())
    return docstrings


@cache
def _parse_top_level_classes(file: str) -> dict[str, ast.ClassDef]:
    """Return the classes of a source file by name: `inspect.getsource` takes ten times as long."""
    nodes = ast.parse("".join(linecache.getlines(file))).body
    return {node.name: node for node in nodes if isinstance(node, ast.ClassDef)}


def setting_name_of_field(cls: type, field: str) -> str:
    """Return the name of a field in files, or the same name if the class lacks the field."""
    return next(
        (key for key, setting in list_settings(cls).items() if setting.field == field), field
    )


def is_path_field(field: str) -> bool:
    """Check whether a field of this name holds a file path."""
    return field == "path" or field.endswith("_path")


def is_family_type(type_hint: Any) -> bool:
    """Check whether a type is a family, whose members `kind` selects."""
    if not (inspect.isclass(type_hint) and issubclass(type_hint, Family)):
        return False
    # A base class may have settings.
    return not is_dataclass(type_hint) or inspect.isabstract(type_hint)


def describe_accepted_values(
    value_type: ValueType,
    *,
    path_readable_types: Collection[type] = (),
    with_examples: bool = True,
    with_null: bool = True,
) -> str:
    """Describe the accepted values of a type, for an error message or a list."""
    texts = [
        _describe_accepted_type(choice, value_type.unit, path_readable_types, with_examples)
        for choice in value_type.types_without_none
    ]
    null = ", or null" if value_type.is_optional and with_null else ""
    return " or ".join(texts) + null


def _describe_accepted_type(
    type_hint: Any,
    unit: str | None,
    path_readable_types: Collection[type],
    with_examples: bool,
) -> str:
    if type_hint in _SIMPLE_TYPES:
        text = _SIMPLE_TYPES[type_hint]
    elif type_hint is float:
        text = DIMENSIONS[unit].description if with_examples else DIMENSIONS[unit].noun
    elif get_origin(type_hint) is Literal:
        text = f"one of {', '.join(str(choice) for choice in get_args(type_hint))}"
    elif get_origin(type_hint) is tuple:
        member, *others = get_args(type_hint)
        size = "" if Ellipsis in others else f" of {1 + len(others)}"
        member_text = describe_accepted_values(
            ValueType(member, unit),
            path_readable_types=path_readable_types,
            with_examples=with_examples,
        )
        text = f"a list{size}, each {member_text}"
    elif is_family_type(type_hint):
        text = f"a mapping with kind: {', '.join(type_hint.members())}"
    else:
        text = f"a mapping of {', '.join(list_settings(type_hint)) or 'nothing'}"
        text += ", or the path of a file" if type_hint in path_readable_types else ""
    return text


def _split_field_name_and_unit(field: str, type_hint: Any) -> tuple[str, str | None]:
    return split_unit_suffix(field) if _contains_type(float, type_hint) else (field, None)


def _contains_type(searched_type: type, type_hint: Any) -> bool:
    return type_hint is searched_type or any(
        _contains_type(searched_type, part) for part in get_args(type_hint)
    )
