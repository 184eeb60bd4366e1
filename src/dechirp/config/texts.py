"""Values as the text of a settings file, and as plain numbers."""

import io
import json
import re
from collections.abc import Collection
from dataclasses import fields, is_dataclass
from typing import Any, cast

import numpy as np
from ruamel.yaml import YAML

from dechirp.config.fields import settings
from dechirp.config.quantities import text_of
from dechirp.config.tree import Node, resolved
from dechirp.core.families import Family

_PLAIN = re.compile(r"([A-Za-z0-9.+]|-(?=[^\s-]))([\w.+\-/^ %²°µ]*[\w.+\-/^%²°µ])?")


def dump(value: Any, *, without: Collection[str] = ()) -> str:
    """YAML with units that `files.parse` reads back to an equal value.

    Fields that are None are left out where None is what holds without them, and the settings
    of `value` that `without` names.
    """
    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = None  # braces and brackets around what fits on a line
    yaml.representer.sort_base_mapping_type_on_output = False
    yaml.width = 1000  # lines that it breaks end in a space
    stream = io.StringIO()
    written = as_text(value, None)
    for name in without:
        del written[name]
    yaml.dump(written, stream)
    return stream.getvalue()


def line(node: Node) -> str:
    """YAML of a tree on one line, as it was written where that is short and safe."""
    if isinstance(node.content, dict):
        members = (f"{quoted(name)}: {line(child)}" for name, child in node.content.items())
        return f"{{{', '.join(members)}}}"
    if isinstance(node.content, list):
        return f"[{', '.join(line(child) for child in node.content)}]"
    return quoted(node.content) if isinstance(node.content, str) else node.text or "null"


def quoted(text: str) -> str:
    """Write a text as YAML has it: in quotes only where it would be read as something else."""
    is_plain = _PLAIN.fullmatch(text) and isinstance(resolved(text), str)
    return text if is_plain else json.dumps(text, ensure_ascii=not text.isprintable())


def plain(value: Any) -> dict[str, Any]:
    """Nested plain numbers under the names of the fields, SI units and all, for JSON."""
    made: dict[str, Any] = _plain(value)
    return made


def as_text(value: Any, unit: str | None) -> Any:
    """As a settings file writes a value, with units of numbers whose fields have this one."""
    if is_dataclass(value):
        written = _kind(value)
        for key, setting in settings(cast(type, type(value))).items():
            member = getattr(value, setting.field)
            if member is not None or setting.required or setting.default is not None:
                written[key] = as_text(member, setting.slot.unit)
        return written
    if isinstance(value, tuple | list):
        return [as_text(member, unit) for member in value]
    number = value.item() if isinstance(value, np.generic) else value
    if isinstance(number, bool | str | None) or (isinstance(number, int) and unit is None):
        return number
    text = text_of(number, unit)
    return text if " " in text else float(text)


def _plain(value: Any) -> Any:
    if is_dataclass(value):
        members = {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
        return {**_kind(value), **members}
    if isinstance(value, tuple | list):
        return [_plain(member) for member in value]
    return value.item() if isinstance(value, np.generic) else value


def _kind(value: Any) -> dict[str, Any]:
    return {"kind": value.kind()} if isinstance(value, Family) else {}
