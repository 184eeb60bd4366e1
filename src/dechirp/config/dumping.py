"""Values as text of a settings file, and as JSON data."""

import io
import json
import re
from collections.abc import Collection
from dataclasses import fields, is_dataclass
from typing import Any, cast

import numpy as np
from ruamel.yaml import YAML

from dechirp.config.fields import list_settings
from dechirp.config.quantities import format_exact_quantity
from dechirp.config.yaml_tree import YamlNode, parse_unquoted_scalar
from dechirp.core.families import Family

_PLAIN = re.compile(r"([A-Za-z0-9.+]|-(?=[^\s-]))([\w.+\-/^ %²°µ]*[\w.+\-/^%²°µ])?")


def dump_yaml(value: Any, *, omitted_settings: Collection[str] = ()) -> str:
    """Write YAML with units, which `loading.parse_settings` reads back to an equal value.

    Fields that equal their default of None are omitted, as are the settings in `omitted_settings`.
    """
    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = None  # braces and brackets around what fits on a line
    yaml.representer.sort_base_mapping_type_on_output = False
    yaml.width = 1000  # wrapped lines would end in a space
    stream = io.StringIO()
    data = to_yaml_data(value, None)
    for name in omitted_settings:
        del data[name]
    yaml.dump(data, stream)
    return stream.getvalue()


def dump_node_on_one_line(node: YamlNode) -> str:
    """Write a tree as YAML on one line, with scalars as in the file."""
    if isinstance(node.content, dict):
        members = (
            f"{quote_yaml_if_needed(name)}: {dump_node_on_one_line(child)}"
            for name, child in node.content.items()
        )
        return f"{{{', '.join(members)}}}"
    if isinstance(node.content, list):
        return f"[{', '.join(dump_node_on_one_line(child) for child in node.content)}]"
    return (
        quote_yaml_if_needed(node.content) if isinstance(node.content, str) else node.text or "null"
    )


def quote_yaml_if_needed(text: str) -> str:
    """Quote a text for YAML if it would otherwise not be read as that text."""
    is_plain = _PLAIN.fullmatch(text) and isinstance(parse_unquoted_scalar(text), str)
    return text if is_plain else json.dumps(text, ensure_ascii=not text.isprintable())


def to_json_data(value: Any) -> dict[str, Any]:
    """Return nested numbers in SI units under the full names of the fields, for JSON."""
    data: dict[str, Any] = _to_json_data(value)
    return data


def to_yaml_data(value: Any, unit: str | None) -> Any:
    """Convert a value to YAML data, with numbers as text in the unit of their field."""
    if is_dataclass(value):
        entries = _kind_mapping_of_family_member(value)
        for key, setting in list_settings(cast(type, type(value))).items():
            member = getattr(value, setting.field)
            if member is not None or setting.is_required or setting.default is not None:
                entries[key] = to_yaml_data(member, setting.value_type.unit)
        return entries
    if isinstance(value, tuple | list):
        return [to_yaml_data(member, unit) for member in value]
    number = value.item() if isinstance(value, np.generic) else value
    if isinstance(number, bool | str | None) or (isinstance(number, int) and unit is None):
        return number
    text = format_exact_quantity(number, unit)
    return text if " " in text else float(text)


def _to_json_data(value: Any) -> Any:
    if is_dataclass(value):
        members = {field.name: _to_json_data(getattr(value, field.name)) for field in fields(value)}
        return {**_kind_mapping_of_family_member(value), **members}
    if isinstance(value, tuple | list):
        return [_to_json_data(member) for member in value]
    return value.item() if isinstance(value, np.generic) else value


def _kind_mapping_of_family_member(value: Any) -> dict[str, Any]:
    return {"kind": value.kind()} if isinstance(value, Family) else {}
