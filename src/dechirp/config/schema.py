"""Parts of the JSON Schema (2020-12) of settings files that pydantic leaves to the package.

The schema checks names, kinds, units and types. Bounds of numbers and conditions on several
settings are checked when a file is read.
"""

import re
from collections.abc import Mapping
from typing import Any, TypeAlias

from dechirp.config.fields import field_docstrings, list_settings
from dechirp.config.quantities import format_exact_quantity
from dechirp.core.dimensions import Dimension
from dechirp.core.families import Family

Schema: TypeAlias = dict[str, Any]

DIALECT = "https://json-schema.org/draft/2020-12/schema"
REFERENCE = "#/$defs/"
TEXT: Schema = {"type": "string"}

_NUMBER = r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?"
_ZERO = r"[+-]?(0+\.?0*|\.0+)([eE][+-]?\d+)?"
# Further spellings that `parse_quantity` accepts.
_SPELLINGS = {r"\bu(?=m\b|s\b|W\b)": "[uµμ]", r"2\b": r"(\^?2|²)", r"3\b": r"\^?3"}


def add_kind_and_meanings(cls: type, schema: Schema) -> None:
    """Add kind, meanings and defaults of settings to the schema of a value class by pydantic."""
    meanings = field_docstrings(cls)
    properties = schema["properties"]
    for name, setting in list_settings(cls).items():
        properties[name].pop("title", None)
        if meanings[setting.field]:
            properties[name]["description"] = meanings[setting.field]
        if not setting.is_required:
            unit = setting.value_type.unit
            properties[name]["default"] = _default_as_yaml_data(setting.default, unit)
    schema["description"] = (cls.__doc__ or "").partition("\n")[0]
    if issubclass(cls, Family):
        schema["properties"] = {"kind": {"const": cls.kind()}, **properties}
        schema["required"] = ["kind", *schema.get("required", ())]


def replace_settings(schema: Schema, replacements: Mapping[str, Schema]) -> None:
    """Replace the schemas of settings that a file writes otherwise; their meanings remain."""
    for name, replacement in replacements.items():
        meaning = schema["properties"][name].get("description")
        description = {"description": meaning} if meaning else {}
        schema["properties"][name] = {**description, **replacement}


def schema_document(title: str, root_schema: Schema, definitions: Schema) -> Schema:
    """Return a schema with its dialect, title and definitions."""
    return {"$schema": DIALECT, **root_schema, "title": title, "$defs": definitions}


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


def reference(name: str) -> Schema:
    """Return a reference to a definition."""
    return {"$ref": f"{REFERENCE}{name}"}


def list_schema(member_schema: Schema, *, min_length: int = 0) -> Schema:
    """Return the schema of a list."""
    return {"type": "array", "items": member_schema, "minItems": min_length}


def _default_as_yaml_data(default: Any, unit_suffix: str | None) -> Any:
    from dechirp.config.dumping import to_yaml_data  # the reader of files has no use for it

    return (
        format_exact_quantity(default, unit_suffix)
        if isinstance(default, float)
        else to_yaml_data(default, unit_suffix)
    )


def quantity_schema(dimension: Dimension) -> Schema:
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
