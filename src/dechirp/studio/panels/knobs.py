"""Knobs: settings with label, help, current text and choices."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, is_dataclass, replace
from functools import cache
from typing import Any, Literal, cast, get_args, get_origin

from dechirp.config.dumping import quote_yaml, to_yaml_data
from dechirp.config.fields import (
    Setting,
    Slot,
    describe_slot,
    field_docstrings,
    is_family,
    list_settings,
)
from dechirp.config.setting_paths import SettingPath, find_setting
from dechirp.config.yaml_tree import join_path, unique_labels
from dechirp.core.families import Family

NONE = "null"
_CAPITALS = {"adc", "dc", "if", "iq", "pll", "rcs", "rms", "rx", "snr", "tx"}


@dataclass(frozen=True)
class Knob:
    """Label, help, current text and choices of one setting."""

    path: str
    """Path of the setting, as for `--set`."""
    label: str
    help: str
    """Meaning and accepted values."""
    text: str
    """Current value as settings files write it; empty for none."""
    choices: tuple[tuple[str, str], ...] = ()
    """Possible texts with their labels; empty for typed input."""
    placeholder: str = ""
    """Placeholder of an empty field."""
    depth: int = 0
    """Nesting depth below the requested setting."""

    @property
    def is_switch(self) -> bool:
        """True for an on/off switch."""
        return [shown for _, shown in self.choices] == ["off", "on"]


def setting_knobs(whole: Any, path: str) -> Iterator[Knob]:
    """Yield the knobs of a setting and of all nested ones; none below a missing value.

    Raises
    ------
    InvalidSetting
        If the path has no setting.
    """
    setting_path = find_setting(whole, path)
    if setting_path.remaining_names:
        return
    owner, current = (
        _value_at_path(whole, replace(setting_path, steps=setting_path.steps[:-1])),
        _value_at_path(whole, setting_path),
    )
    help = ""
    if is_dataclass(owner):
        help = field_meanings(cast(type, type(owner))).get(str(setting_path.steps[-1]), "")
    name = path.rpartition(".")[2]
    yield from _slot_knobs(Knob(path, setting_label(name), help, ""), setting_path.slot, current)


def required_member_knobs(family: type[Family], kind: str, path: str) -> list[Knob]:
    """Return empty knobs of the required settings of a member.

    The list is empty for an unknown kind, which parsing reports.
    """
    cls = family_members(family).get(kind)
    if cls is None:
        return []
    return [
        _value_knob(_empty_knob(cls, key, setting, path, depth=1), setting.slot, None)
        for key, setting in list_settings(cls).items()
        if setting.is_required
    ]


def setting_value(whole: Any, path: str) -> Any:
    """Return the value of a setting, or of its nearest existing parent."""
    return _value_at_path(whole, find_setting(whole, path))


def setting_family(whole: Any, path: str) -> type[Family] | None:
    """Return the family that a setting, or a member of a list, is chosen from."""
    list_family = parent_list_family(whole, path)
    if list_family is not None:
        return list_family
    return next(
        (one for one in find_setting(whole, path).leaf_slot.choices if is_family(one)), None
    )


def parent_list_family(whole: Any, path: str) -> type[Family] | None:
    """Return the family of a list if a path names a kind of its members, present or not."""
    parent_path, _, kind = path.rpartition(".")
    list_path = find_setting(whole, parent_path) if parent_path else None
    if list_path is None or list_path.remaining_names:
        return None
    family = _list_family(list_path.slot)
    return family if family is not None and kind in family_members(family) else None


def override_options(whole: Any, path: str, text: str) -> tuple[str, ...]:
    """Return PATH=VALUE for the text of a knob; for a kind in a list, the whole list."""
    if parent_list_family(whole, path) is None:
        return (f"{path}={text}",)
    parent_path, _, kind = path.rpartition(".")
    other_members = [
        format_setting(member)
        for member in _value_at_path(whole, find_setting(whole, parent_path))
        if member.kind() != kind
    ]
    return (
        f"{parent_path}=[{', '.join(other_members if text == NONE else [*other_members, text])}]",
    )


def member_label(members: Iterable[Any], index: int) -> str:
    """Return the name of a list member in a path."""
    names = []
    for position, member in enumerate(members):
        own_name = member.kind() if isinstance(member, Family) else getattr(member, "name", None)
        names.append(own_name or str(position))
    name = unique_labels(names)[index]
    return str(index) if "." in name else name


def setting_label(name: str) -> str:
    """Return the label of a setting name."""
    parts = name.removeprefix("n_").replace("-", "_").split("_")
    text = " ".join(part.upper() if part in _CAPITALS else part for part in parts)
    return text[:1].upper() + text[1:]


def format_setting(value: Any, unit: str | None = None) -> str:
    """Format a value on one line, as settings files write it."""
    return _inline_yaml(to_yaml_data(value, unit))


@cache
def family_members(family: type[Family]) -> dict[str, type]:
    """Return the members of a family, cached: finding them takes 2 ms."""
    return family.members()


@cache
def field_meanings(cls: type) -> dict[str, str]:
    """Return the docstrings of the fields of a class, cached: they are parsed from its source."""
    return field_docstrings(cls)


def _value_at_path(whole: Any, path: SettingPath) -> Any:
    for step in path.steps:
        whole = whole[step] if isinstance(step, int) else getattr(whole, step)
    return whole


def _list_family(slot: Slot) -> type[Family] | None:
    """Return the family of the list members in a slot."""
    return next((one for one in slot.member_slot().choices if is_family(one)), None)


def _slot_knobs(entry: Knob, slot: Slot, current: Any) -> Iterator[Knob]:
    """Yield the knobs of the value in a slot."""
    family = next((choice for choice in slot.choices if is_family(choice)), None)
    list_family = _list_family(slot)
    if family is not None:
        empty_choice = ((NONE, "none"),) if slot.is_optional else ()
        kinds = tuple((kind_text(kind), kind) for kind in family_members(family))
        text = NONE if current is None else kind_text(current.kind())
        yield replace(entry, text=text, choices=(*empty_choice, *kinds))
        if current is not None:
            yield from _member_knobs(entry, current)
    elif list_family is not None:
        for kind, cls in family_members(list_family).items():
            yield from _list_kind_knobs(entry, kind, cls, current)
    elif not any(is_dataclass(choice) for choice in slot.choices):
        yield _value_knob(entry, slot, current)
    elif slot.is_optional:
        yield _switch_knob(entry, "{}", on=current is not None)
        if current is not None:
            yield from _member_knobs(entry, current)
    else:
        for member_knob in _member_knobs(replace(entry, depth=entry.depth - 1), current):
            yield replace(
                member_knob,
                label=f"{entry.label}: {member_knob.label[:1].lower()}{member_knob.label[1:]}",
            )


def _list_kind_knobs(entry: Knob, kind: str, cls: type, members: Sequence[Any]) -> Iterator[Knob]:
    """Yield the knobs of one kind in a list, present or not."""
    positions = [position for position, member in enumerate(members) if member.kind() == kind]
    help = " ".join((cls.__doc__ or "").partition("\n\n")[0].split())
    kind_knob = replace(
        entry, path=join_path(entry.path, kind), label=setting_label(kind), help=help
    )
    yield _switch_knob(kind_knob, kind_text(kind), on=bool(positions))
    for position in positions:
        path = join_path(entry.path, member_label(members, position))
        yield from _member_knobs(replace(kind_knob, path=path), members[position])


def _switch_knob(entry: Knob, on_text: str, *, on: bool) -> Knob:
    return replace(entry, text=on_text if on else NONE, choices=((NONE, "off"), (on_text, "on")))


def _member_knobs(entry: Knob, member: Any) -> Iterator[Knob]:
    cls = cast(type, type(member))
    for key, setting in list_settings(cls).items():
        knob = _empty_knob(cls, key, setting, entry.path, depth=entry.depth + 1)
        yield from _slot_knobs(knob, setting.slot, getattr(member, setting.field))


def _empty_knob(cls: type, key: str, setting: Setting, path: str, *, depth: int) -> Knob:
    return Knob(
        path=join_path(path, key),
        label=setting_label(key),
        help=field_meanings(cls).get(setting.field, ""),
        text="",
        depth=depth,
    )


def _value_knob(entry: Knob, slot: Slot, current: Any) -> Knob:
    expected = describe_slot(slot).removesuffix(" or null")
    help = f"{entry.help} Needs {expected}{', or nothing' if slot.is_optional else ''}.".strip()
    text = "" if current is None else format_setting(current, slot.unit)
    choices: list[tuple[str, str]] = []
    for choice in slot.choices:
        if get_origin(choice) is Literal:
            choices += [(quote_yaml(str(name)), str(name)) for name in get_args(choice)]
        elif choice is bool:
            choices += [("false", "off"), ("true", "on")]
        else:
            return replace(entry, text=text, help=help, placeholder=expected)
    if slot.is_optional:
        choices = [(NONE, "none"), *choices]
    return replace(entry, text=text or NONE, help=help, choices=tuple(choices))


def kind_text(kind: str) -> str:
    """Return the text that selects a member with its defaults."""
    return f"{{kind: {kind}}}"


def _inline_yaml(raw: Any) -> str:
    if isinstance(raw, dict):
        return f"{{{', '.join(f'{key}: {_inline_yaml(value)}' for key, value in raw.items())}}}"
    if isinstance(raw, list):
        return f"[{', '.join(map(_inline_yaml, raw))}]"
    if isinstance(raw, str):
        return quote_yaml(raw)
    if raw is None:
        return NONE
    return str(raw).lower() if isinstance(raw, bool) else repr(raw)
