"""JSON Schema (2020-12) of settings files, for editors: made of the slots that files are read by.

It refuses only what reading refuses as well: names, kinds, units and types that are wrong. What
depends on several settings, and the bounds of numbers, is checked when a file is read.
"""

import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import is_dataclass
from functools import partial
from typing import Any, Literal, TypeAlias, cast, get_args, get_origin

from dechirp.config.fields import Slot, is_family, settings
from dechirp.config.help import field_help
from dechirp.config.quantities import text_of
from dechirp.config.texts import as_text
from dechirp.core.families import Family
from dechirp.core.kinds import KINDS, Kind

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
# What `quantity` reads as well.
_SPELLINGS = {r"\bu(?=m\b|s\b|W\b)": "[uµμ]", r"2\b": r"(\^?2|²)", r"3\b": r"\^?3"}


class Schemas:
    """Schemas of slots, and of the values in them by name, each once."""

    def __init__(self, *, read_from_path: Collection[type] = ()) -> None:
        self.read_from_path = read_from_path
        self.definitions: dict[str, Schema] = {}

    def document(self, title: str, root: Schema) -> Schema:
        """Put all of it into one document."""
        return {
            "$schema": DIALECT,
            "title": title,
            **root,
            "$defs": dict(sorted(self.definitions.items())),
        }

    def slot(self, slot: Slot) -> Schema:
        """What may stand in a slot."""
        choices = [self._choice(choice, slot) for choice in slot.choices]
        return any_of([*choices, {"type": "null"}] if slot.optional else choices)

    def mapping(
        self, cls: type, *, instead: Mapping[str, Schema] | None = None, kind: Schema | None = None
    ) -> Schema:
        """Settings of a value class; `instead` has those that a file writes otherwise."""
        meanings = field_help(cls)
        properties: dict[str, Schema] = {} if kind is None else {"kind": kind}
        required = [] if kind is None else ["kind"]
        for name, setting in settings(cls).items():
            inner = (instead or {}).get(name)
            if inner is None:
                inner = self.slot(setting.slot)
                if not setting.required:
                    inner = {**inner, "default": _default(setting.default, setting.slot.unit)}
            help_text = meanings[setting.field]
            properties[name] = {"description": help_text, **inner} if help_text else inner
            required += [name] if setting.required else []
        return {
            "description": (cls.__doc__ or "").partition("\n")[0],
            "type": "object",
            "properties": properties,
            "required": required,
            "additionalProperties": False,
        }

    def value(self, cls: type) -> Schema:
        """Refer to the settings of a value class."""
        return self._named(cls.__name__, lambda: self.mapping(cls))

    def quantity(self, unit: str | None) -> Schema:
        """Refer to numbers with a unit of the kind of a field's suffix."""
        return self._named(unit or "ratio", lambda: _quantity(KINDS[unit]))

    def _choice(self, hint: Any, slot: Slot) -> Schema:
        if hint in _SIMPLE:
            return _SIMPLE[hint]
        if hint is float:
            return self.quantity(slot.unit)
        if get_origin(hint) is Literal:
            return {"enum": list(get_args(hint))}
        if get_origin(hint) is tuple:
            return self._list(get_args(hint), slot)
        if is_family(hint):
            return self._named(hint.group.removeprefix("dechirp."), lambda: self._family(hint))
        if not is_dataclass(hint):
            raise TypeError(f"{slot.field}: a schema has no words for {hint}")
        made = self.value(cast(type, hint))
        return any_of([TEXT, made]) if hint in self.read_from_path else made

    def _list(self, hints: tuple[Any, ...], slot: Slot) -> Schema:
        inner, *others = (Slot(hint, slot.unit) for hint in hints if hint is not Ellipsis)
        if Ellipsis in hints:
            return {"type": "array", "items": self.slot(inner)}
        size = {"minItems": 1 + len(others), "maxItems": 1 + len(others)}
        return {"type": "array", "items": self.slot(inner), **size}  # `words` takes them as alike

    def _family(self, base: type[Family]) -> Schema:
        members = base.members()
        group = base.group.removeprefix("dechirp.")
        return by_kind(
            {
                kind: self._named(
                    f"{group}.{kind}", partial(self.mapping, member, kind={"const": kind})
                )
                for kind, member in members.items()
            }
        )

    def _named(self, name: str, make: Callable[[], Schema]) -> Schema:
        if name not in self.definitions:
            self.definitions[name] = {}  # a value may hold others of its own kind
            self.definitions[name] = make()
        return {"$ref": f"#/$defs/{name}"}


def document(cls: type, *, read_from_path: Collection[type] = ()) -> Schema:
    """Schema of files that hold a value of a class; `Schemas` says what else it takes."""
    schemas = Schemas(read_from_path=read_from_path)
    return schemas.document(f"{cls.__name__} of dechirp", schemas.mapping(cls))


def any_of(choices: list[Schema]) -> Schema:
    """One of several; the one alone."""
    return {"anyOf": choices} if len(choices) > 1 else choices[0]


def by_kind(members: Mapping[str, Schema]) -> Schema:
    """A mapping whose `kind` says which of the schemas it has, so that mistakes are told of it."""
    return {
        "type": "object",
        "properties": {"kind": {"enum": list(members)}},
        "required": ["kind"],
        "allOf": [
            {"if": {"properties": {"kind": {"const": kind}}, "required": ["kind"]}, "then": member}
            for kind, member in members.items()
        ],
    }


def list_of(inner: Schema, *, at_least: int = 0) -> Schema:
    """A list of what has a schema."""
    return {"type": "array", "items": inner, "minItems": at_least}


def _default(default: Any, unit: str | None) -> Any:
    return text_of(default, unit) if isinstance(default, float) else as_text(default, unit)


def _quantity(kind: Kind) -> Schema:
    """A number with a unit; 0 needs none, and what has no base unit may be bare."""
    from dechirp.config.units import alike  # pint takes 0.3 s

    named = [re.escape(name) for name, _ in (*kind.levels, *kind.zeros)]
    if kind.base:
        for places in alike(kind.base.replace("^", "")):
            named.append("/".join(f"({'|'.join(map(_spelled, names))})" for names in places))
        named.append(r"[A-Za-z]\S*/\S+/\S+")  # of m/s/s is said when it is read
    unit = f"({'|'.join(named)})" if named else None
    bare = _ZERO if kind.base else _NUMBER
    pattern = rf"^\s*({bare}|{_NUMBER}\s*{unit})\s*$" if unit else rf"^\s*{bare}\s*$"
    number: Schema = {"const": 0} if kind.base else {"type": "number"}
    return {
        "description": kind.words,
        "anyOf": [number, {"type": "string", "pattern": pattern}],
    }


def _spelled(name: str) -> str:
    if name == "deg":
        return "deg|°"
    for plain, also in _SPELLINGS.items():
        name = re.sub(plain, also.replace("\\", "\\" * 2), name)
    return name
