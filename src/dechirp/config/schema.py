"""JSON Schema (2020-12) of settings files for editors, generated from the slots of the reader.

The schema checks names, kinds, units and types. Bounds of numbers and conditions on several
settings are checked when a file is read.
"""

import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import is_dataclass
from functools import partial
from typing import Any, Literal, TypeAlias, cast, get_args, get_origin

from dechirp.config.dumping import to_yaml_data
from dechirp.config.fields import Slot, field_docstrings, is_family, list_settings
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
    """Builder of schemas of slots, with one definition for each value class."""

    def __init__(self, *, read_from_path: Collection[type] = ()) -> None:
        self.read_from_path = read_from_path
        self.definitions: dict[str, Schema] = {}

    def build_document(self, title: str, root: Schema) -> Schema:
        """Build a schema document with all definitions."""
        return {
            "$schema": DIALECT,
            "title": title,
            **root,
            "$defs": dict(sorted(self.definitions.items())),
        }

    def slot_schema(self, slot: Slot) -> Schema:
        """Return the schema of a slot."""
        choices = [self._type_schema(choice, slot) for choice in slot.choices]
        return any_of_schema([*choices, {"type": "null"}] if slot.is_optional else choices)

    def mapping_schema(
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
                inner = self.slot_schema(setting.slot)
                if not setting.is_required:
                    inner = {**inner, "default": _default_data(setting.default, setting.slot.unit)}
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

    def value_reference(self, cls: type) -> Schema:
        """Return a reference to the schema of a value class."""
        return self._reference(cls.__name__, lambda: self.mapping_schema(cls))

    def quantity_reference(self, unit: str | None) -> Schema:
        """Return a reference to the schema of quantities with a unit suffix."""
        return self._reference(unit or "ratio", lambda: _quantity_schema(DIMENSIONS[unit]))

    def _type_schema(self, hint: Any, slot: Slot) -> Schema:
        if hint in _SIMPLE:
            return _SIMPLE[hint]
        if hint is float:
            return self.quantity_reference(slot.unit)
        if get_origin(hint) is Literal:
            return {"enum": list(get_args(hint))}
        if get_origin(hint) is tuple:
            return self._list_schema(get_args(hint), slot)
        if is_family(hint):
            return self._reference(
                hint.group.removeprefix("dechirp."), lambda: self._family_schema(hint)
            )
        if not is_dataclass(hint):
            raise TypeError(f"{slot.field}: a schema has no words for {hint}")
        reference = self.value_reference(cast(type, hint))
        return any_of_schema([TEXT, reference]) if hint in self.read_from_path else reference

    def _list_schema(self, hints: tuple[Any, ...], slot: Slot) -> Schema:
        inner, *others = (Slot(hint, slot.unit) for hint in hints if hint is not Ellipsis)
        if Ellipsis in hints:
            return {"type": "array", "items": self.slot_schema(inner)}
        size = {"minItems": 1 + len(others), "maxItems": 1 + len(others)}
        return {
            "type": "array",
            "items": self.slot_schema(inner),
            **size,
        }

    def _family_schema(self, base: type[Family]) -> Schema:
        members = base.members()
        group = base.group.removeprefix("dechirp.")
        return schema_by_kind(
            {
                kind: self._reference(
                    f"{group}.{kind}", partial(self.mapping_schema, member, kind={"const": kind})
                )
                for kind, member in members.items()
            }
        )

    def _reference(self, name: str, make: Callable[[], Schema]) -> Schema:
        if name not in self.definitions:
            self.definitions[name] = {}  # reserved, since a value may contain its own class
            self.definitions[name] = make()
        return {"$ref": f"#/$defs/{name}"}


def build_schema(cls: type, *, read_from_path: Collection[type] = ()) -> Schema:
    """Build the schema of files that describe a value of a class."""
    schemas = SchemaBuilder(read_from_path=read_from_path)
    return schemas.build_document(f"{cls.__name__} of dechirp", schemas.mapping_schema(cls))


def any_of_schema(choices: list[Schema]) -> Schema:
    """Return a schema that accepts any of the choices."""
    return {"anyOf": choices} if len(choices) > 1 else choices[0]


def schema_by_kind(members: Mapping[str, Schema]) -> Schema:
    """Return the schema of a mapping whose `kind` selects a schema, so errors refer to that one."""
    return {
        "type": "object",
        "properties": {"kind": {"enum": list(members)}},
        "required": ["kind"],
        "allOf": [
            {"if": {"properties": {"kind": {"const": kind}}, "required": ["kind"]}, "then": member}
            for kind, member in members.items()
        ],
    }


def list_schema(inner: Schema, *, at_least: int = 0) -> Schema:
    """Return the schema of a list."""
    return {"type": "array", "items": inner, "minItems": at_least}


def _default_data(default: Any, unit: str | None) -> Any:
    return (
        format_exact_quantity(default, unit)
        if isinstance(default, float)
        else to_yaml_data(default, unit)
    )


def _quantity_schema(kind: Dimension) -> Schema:
    """Return the schema of a number with a unit; 0 and ratios need none."""
    from dechirp.config.units import compatible_units  # pint takes 0.3 s

    unit_patterns = [re.escape(name) for name, _ in (*kind.db_units, *kind.offset_units)]
    if kind.si_unit:
        for places in compatible_units(kind.si_unit.replace("^", "")):
            unit_patterns.append(
                "/".join(f"({'|'.join(map(_spelling_pattern, names))})" for names in places)
            )
        unit_patterns.append(r"[A-Za-z]\S*/\S+/\S+")  # m/s/s is refused when the file is read
    unit = f"({'|'.join(unit_patterns)})" if unit_patterns else None
    bare_number = _ZERO if kind.si_unit else _NUMBER
    pattern = rf"^\s*({bare_number}|{_NUMBER}\s*{unit})\s*$" if unit else rf"^\s*{bare_number}\s*$"
    number: Schema = {"const": 0} if kind.si_unit else {"type": "number"}
    return {
        "description": kind.description,
        "anyOf": [number, {"type": "string", "pattern": pattern}],
    }


def _spelling_pattern(name: str) -> str:
    if name == "deg":
        return "deg|°"
    for plain, variants in _SPELLINGS.items():
        name = re.sub(plain, variants.replace("\\", "\\" * 2), name)
    return name
