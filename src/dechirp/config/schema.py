"""JSON Schema (2020-12) of settings files for editors, generated from the types of the settings.

The schema checks names, kinds, units and types. Bounds of numbers and conditions on several
settings are checked when a file is read. pydantic's own generator needs as many lines and ten times
the processor time, because quantities, members of families and meanings must be described to it
(`docs/decisions.md`).
"""

import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import is_dataclass
from functools import partial
from typing import Any, Literal, TypeAlias, cast, get_args, get_origin

from dechirp.config.dumping import to_yaml_data
from dechirp.config.fields import ValueType, field_docstrings, is_family_type, list_settings
from dechirp.config.quantities import format_exact_quantity
from dechirp.core.dimensions import DIMENSIONS, Dimension
from dechirp.core.families import Family

Schema: TypeAlias = dict[str, Any]

DIALECT = "https://json-schema.org/draft/2020-12/schema"
TEXT: Schema = {"type": "string"}

_SIMPLE: dict[Any, Schema] = {
    int: {"type": "integer"},
    str: TEXT,
    bool: {"type": "boolean"},
    object: {},
}
_NUMBER = r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?"
_ZERO = r"[+-]?(0+\.?0*|\.0+)([eE][+-]?\d+)?"
# Further spellings that `parse_quantity` accepts.
_SPELLINGS = {r"\bu(?=m\b|s\b|W\b)": "[uµμ]", r"2\b": r"(\^?2|²)", r"3\b": r"\^?3"}


class SchemaBuilder:
    """Builder of schemas of value types, with one definition for each value class."""

    def __init__(self, *, path_readable_types: Collection[type] = ()) -> None:
        self.path_readable_types = path_readable_types
        self.definitions: dict[str, Schema] = {}

    def build_schema_document(self, title: str, root_schema: Schema) -> Schema:
        """Build a schema document with all definitions."""
        return {
            "$schema": DIALECT,
            "title": title,
            **root_schema,
            "$defs": dict(sorted(self.definitions.items())),
        }

    def schema_of_value_type(self, value_type: ValueType) -> Schema:
        """Return the schema of a value type."""
        choices = [
            self._schema_of_type_hint(choice, value_type)
            for choice in value_type.types_without_none
        ]
        return any_of_schema([*choices, {"type": "null"}] if value_type.is_optional else choices)

    def schema_of_class(
        self,
        cls: type,
        *,
        replacements: Mapping[str, Schema] | None = None,
        kind: Schema | None = None,
    ) -> Schema:
        """Settings of a value class; `replacements` has those that a file writes otherwise."""
        meanings = field_docstrings(cls)
        properties: dict[str, Schema] = {} if kind is None else {"kind": kind}
        required = [] if kind is None else ["kind"]
        for name, setting in list_settings(cls).items():
            inner = (replacements or {}).get(name)
            if inner is None:
                inner = self.schema_of_value_type(setting.value_type)
                if not setting.is_required:
                    inner = {
                        **inner,
                        "default": _default_as_yaml_data(setting.default, setting.value_type.unit),
                    }
            help_text = meanings[setting.field]
            properties[name] = {"description": help_text, **inner} if help_text else inner
            required += [name] if setting.is_required else []
        return {
            "description": (cls.__doc__ or "").partition("\n")[0],
            "type": "object",
            "properties": properties,
            "required": required,
            "additionalProperties": False,
        }

    def reference_to_class_schema(self, cls: type) -> Schema:
        """Return a reference to the schema of a value class."""
        return self._define_once_and_reference(cls.__name__, lambda: self.schema_of_class(cls))

    def reference_to_quantity_schema(self, unit_suffix: str | None) -> Schema:
        """Return a reference to the schema of quantities with a unit suffix."""
        return self._define_once_and_reference(
            unit_suffix or "ratio", lambda: _quantity_schema(DIMENSIONS[unit_suffix])
        )

    def _schema_of_type_hint(self, type_hint: Any, value_type: ValueType) -> Schema:
        if type_hint in _SIMPLE:
            return _SIMPLE[type_hint]
        if type_hint is float:
            return self.reference_to_quantity_schema(value_type.unit)
        if get_origin(type_hint) is Literal:
            return {"enum": list(get_args(type_hint))}
        if get_origin(type_hint) is tuple:
            return self._list_schema(get_args(type_hint), value_type)
        if is_family_type(type_hint):
            return self._define_once_and_reference(
                type_hint.group.removeprefix("dechirp."), lambda: self._family_schema(type_hint)
            )
        if not is_dataclass(type_hint):
            raise TypeError(f"{value_type.field}: a schema has no words for {type_hint}")
        reference = self.reference_to_class_schema(cast(type, type_hint))
        return (
            any_of_schema([TEXT, reference]) if type_hint in self.path_readable_types else reference
        )

    def _list_schema(self, member_hints: tuple[Any, ...], value_type: ValueType) -> Schema:
        inner, *others = (
            ValueType(hint, value_type.unit) for hint in member_hints if hint is not Ellipsis
        )
        if Ellipsis in member_hints:
            return {"type": "array", "items": self.schema_of_value_type(inner)}
        size = {"minItems": 1 + len(others), "maxItems": 1 + len(others)}
        return {
            "type": "array",
            "items": self.schema_of_value_type(inner),
            **size,
        }

    def _family_schema(self, family: type[Family]) -> Schema:
        members = family.members()
        group = family.group.removeprefix("dechirp.")
        return schema_by_kind(
            {
                kind: self._define_once_and_reference(
                    f"{group}.{kind}", partial(self.schema_of_class, member, kind={"const": kind})
                )
                for kind, member in members.items()
            }
        )

    def _define_once_and_reference(
        self, name: str, build_definition: Callable[[], Schema]
    ) -> Schema:
        if name not in self.definitions:
            self.definitions[name] = {}  # reserved, since a value may contain its own class
            self.definitions[name] = build_definition()
        return {"$ref": f"#/$defs/{name}"}


def build_file_schema(cls: type, *, path_readable_types: Collection[type] = ()) -> Schema:
    """Build the schema of files that describe a value of a class."""
    schemas = SchemaBuilder(path_readable_types=path_readable_types)
    return schemas.build_schema_document(f"{cls.__name__} of dechirp", schemas.schema_of_class(cls))


def any_of_schema(choices: list[Schema]) -> Schema:
    """Return a schema that accepts any of the choices."""
    return {"anyOf": choices} if len(choices) > 1 else choices[0]


def schema_by_kind(schemas: Mapping[str, Schema]) -> Schema:
    """Return the schema of a mapping whose `kind` selects a schema, so errors refer to that one."""
    return {
        "type": "object",
        "properties": {"kind": {"enum": list(schemas)}},
        "required": ["kind"],
        "allOf": [
            {"if": {"properties": {"kind": {"const": kind}}, "required": ["kind"]}, "then": member}
            for kind, member in schemas.items()
        ],
    }


def list_schema(member_schema: Schema, *, min_length: int = 0) -> Schema:
    """Return the schema of a list."""
    return {"type": "array", "items": member_schema, "minItems": min_length}


def _default_as_yaml_data(default: Any, unit_suffix: str | None) -> Any:
    return (
        format_exact_quantity(default, unit_suffix)
        if isinstance(default, float)
        else to_yaml_data(default, unit_suffix)
    )


def _quantity_schema(dimension: Dimension) -> Schema:
    """Return the schema of a number with a unit; 0 and ratios need none."""
    from dechirp.config.units import units_of_same_dimension  # pint takes 0.3 s

    named_units = (*dimension.db_units, *dimension.offset_units, *dimension.fraction_units)
    unit_patterns = [re.escape(name) for name, _ in named_units]
    if dimension.si_unit:
        for places in units_of_same_dimension(dimension.si_unit.replace("^", "")):
            unit_patterns.append(
                "/".join(f"({'|'.join(map(_unit_spelling_pattern, names))})" for names in places)
            )
        unit_patterns.append(r"[A-Za-z]\S*/\S+/\S+")  # m/s/s is refused when the file is read
    unit = f"({'|'.join(unit_patterns)})" if unit_patterns else None
    bare_number = _ZERO if dimension.si_unit else _NUMBER
    pattern = rf"^\s*({bare_number}|{_NUMBER}\s*{unit})\s*$" if unit else rf"^\s*{bare_number}\s*$"
    number: Schema = {"const": 0} if dimension.si_unit else {"type": "number"}
    return {
        "description": dimension.description,
        "anyOf": [number, {"type": "string", "pattern": pattern}],
    }


def _unit_spelling_pattern(unit: str) -> str:
    if unit == "deg":
        return "deg|°"
    for plain, variants in _SPELLINGS.items():
        unit = re.sub(plain, variants.replace("\\", "\\" * 2), unit)
    return unit
