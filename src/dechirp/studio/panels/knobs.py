"""Knobs: settings with label, help, current text and choices."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, is_dataclass, replace
from functools import cache
from typing import Any, Literal, cast, get_args, get_origin

from dechirp.config.dumping import quote_yaml_if_needed, to_yaml_data
from dechirp.config.fields import (
    Setting,
    ValueType,
    describe_accepted_values,
    field_docstrings,
    is_family_type,
    list_settings,
)
from dechirp.config.setting_paths import SettingPath, find_setting
from dechirp.config.yaml_tree import join_setting_path, replace_repeated_labels_by_index
from dechirp.core.errors import InvalidSetting
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
    def is_on_off_switch(self) -> bool:
        """True for an on/off switch."""
        return [shown for _, shown in self.choices] == ["off", "on"]


def setting_knobs(root_value: Any, path: str) -> Iterator[Knob]:
    """Yield the knobs of a setting and of all nested ones; none below a missing value.

    Raises
    ------
    InvalidSetting
        If the path has no setting.
    """
    setting_path = find_setting(root_value, path)
    if setting_path.remaining_names:
        return
    owner, current = (
        _value_at_path(root_value, replace(setting_path, steps=setting_path.steps[:-1])),
        _value_at_path(root_value, setting_path),
    )
    help = ""
    if is_dataclass(owner):
        help = cached_field_docstrings(cast(type, type(owner))).get(str(setting_path.steps[-1]), "")
    name = path.rpartition(".")[2]
    yield from _knobs_of_value(
        Knob(path, label_from_setting_name(name), help, ""), setting_path.value_type, current
    )


def empty_knobs_of_required_settings(family: type[Family], kind: str, path: str) -> list[Knob]:
    """Return empty knobs of the required settings of a member.

    The list is empty for an unknown kind, which parsing reports.
    """
    cls = cached_family_members(family).get(kind)
    if cls is None:
        return []
    return [
        _knob_with_input_or_choices(
            _empty_knob(cls, key, setting, path, depth=1), setting.value_type, None
        )
        for key, setting in list_settings(cls).items()
        if setting.is_required
    ]


def setting_or_parent_value(root_value: Any, path: str) -> Any:
    """Return the value of a setting, or of its nearest existing parent."""
    return _value_at_path(root_value, find_setting(root_value, path))


def family_of_setting(root_value: Any, path: str) -> type[Family] | None:
    """Return the family that a setting, or a member of a list, is chosen from."""
    list_family = family_of_parent_list(root_value, path)
    if list_family is not None:
        return list_family
    return next(
        (
            option
            for option in find_setting(root_value, path).leaf_value_type.types_without_none
            if is_family_type(option)
        ),
        None,
    )


def family_of_parent_list(root_value: Any, path: str) -> type[Family] | None:
    """Return the family of a list if a path names a kind of its members, present or not."""
    parent_path, _, kind = path.rpartition(".")
    list_path = find_setting(root_value, parent_path) if parent_path else None
    if list_path is None or list_path.remaining_names:
        return None
    family = _family_of_list_members(list_path.value_type)
    return family if family is not None and kind in cached_family_members(family) else None


def overrides_for_knob_text(root_value: Any, path: str, text: str) -> tuple[str, ...]:
    """Return PATH=VALUE for the text of a knob; for a kind in a list, the whole list.

    Raises
    ------
    InvalidSetting
        If the text is empty and the setting needs a value.
    """
    if family_of_parent_list(root_value, path) is None:
        value_type = find_setting(root_value, path).leaf_value_type
        if not (text.strip() or value_type.is_optional):
            raise InvalidSetting(
                path,
                value="empty",
                expected=describe_accepted_values(value_type),
                fix="type one, or press Escape for the value before",
            )
        return (f"{path}={text}",)
    parent_path, _, kind = path.rpartition(".")
    other_members = [
        format_setting_inline(member)
        for member in _value_at_path(root_value, find_setting(root_value, parent_path))
        if member.kind() != kind
    ]
    return (
        f"{parent_path}=[{', '.join(other_members if text == NONE else [*other_members, text])}]",
    )


def list_member_name_in_path(members: Iterable[Any], index: int) -> str:
    """Return the name of a list member in a path."""
    names = []
    for position, member in enumerate(members):
        own_name = member.kind() if isinstance(member, Family) else getattr(member, "name", None)
        names.append(own_name or str(position))
    name = replace_repeated_labels_by_index(names)[index]
    return str(index) if "." in name else name


def label_from_setting_name(setting_name: str) -> str:
    """Return the label of a setting name."""
    parts = setting_name.removeprefix("n_").replace("-", "_").split("_")
    text = " ".join(part.upper() if part in _CAPITALS else part for part in parts)
    return text[:1].upper() + text[1:]


def format_setting_inline(value: Any, unit: str | None = None) -> str:
    """Format a value on one line, as settings files write it."""
    return _yaml_data_on_one_line(to_yaml_data(value, unit))


@cache
def cached_family_members(family: type[Family]) -> dict[str, type]:
    """Return the members of a family, cached: finding them takes 2 ms."""
    return family.members()


@cache
def cached_field_docstrings(cls: type) -> dict[str, str]:
    """Return the docstrings of the fields of a class, cached: they are parsed from its source."""
    return field_docstrings(cls)


def _value_at_path(root_value: Any, path: SettingPath) -> Any:
    for step in path.steps:
        root_value = root_value[step] if isinstance(step, int) else getattr(root_value, step)
    return root_value


def _family_of_list_members(value_type: ValueType) -> type[Family] | None:
    """Return the family of the list members in a slot."""
    return next(
        (
            option
            for option in value_type.list_member_type().types_without_none
            if is_family_type(option)
        ),
        None,
    )


def _knobs_of_value(knob: Knob, value_type: ValueType, current_value: Any) -> Iterator[Knob]:
    """Yield the knobs of the value in a slot."""
    family = next(
        (choice for choice in value_type.types_without_none if is_family_type(choice)), None
    )
    list_family = _family_of_list_members(value_type)
    if family is not None:
        empty_choice = ((NONE, "none"),) if value_type.is_optional else ()
        kinds = tuple((kind_as_yaml_mapping(kind), kind) for kind in cached_family_members(family))
        text = NONE if current_value is None else kind_as_yaml_mapping(current_value.kind())
        yield replace(knob, text=text, choices=(*empty_choice, *kinds))
        if current_value is not None:
            yield from _knobs_of_nested_settings(knob, current_value)
    elif list_family is not None:
        for kind, cls in cached_family_members(list_family).items():
            yield from _knobs_of_kind_in_list(knob, kind, cls, current_value)
    elif not any(is_dataclass(choice) for choice in value_type.types_without_none):
        yield _knob_with_input_or_choices(knob, value_type, current_value)
    elif value_type.is_optional:
        yield _on_off_knob(knob, "{}", on=current_value is not None)
        if current_value is not None:
            yield from _knobs_of_nested_settings(knob, current_value)
    else:
        for member_knob in _knobs_of_nested_settings(
            replace(knob, depth=knob.depth - 1), current_value
        ):
            yield replace(
                member_knob,
                label=f"{knob.label}: {member_knob.label[:1].lower()}{member_knob.label[1:]}",
            )


def _knobs_of_kind_in_list(
    list_knob: Knob, kind: str, cls: type, members: Sequence[Any]
) -> Iterator[Knob]:
    """Yield the knobs of one kind in a list, present or not."""
    positions = [position for position, member in enumerate(members) if member.kind() == kind]
    help = " ".join((cls.__doc__ or "").partition("\n\n")[0].split())
    kind_knob = replace(
        list_knob,
        path=join_setting_path(list_knob.path, kind),
        label=label_from_setting_name(kind),
        help=help,
    )
    yield _on_off_knob(kind_knob, kind_as_yaml_mapping(kind), on=bool(positions))
    for position in positions:
        path = join_setting_path(list_knob.path, list_member_name_in_path(members, position))
        yield from _knobs_of_nested_settings(replace(kind_knob, path=path), members[position])


def _on_off_knob(knob: Knob, on_text: str, *, on: bool) -> Knob:
    return replace(knob, text=on_text if on else NONE, choices=((NONE, "off"), (on_text, "on")))


def _knobs_of_nested_settings(parent_knob: Knob, parent_value: Any) -> Iterator[Knob]:
    cls = cast(type, type(parent_value))
    for key, setting in list_settings(cls).items():
        knob = _empty_knob(cls, key, setting, parent_knob.path, depth=parent_knob.depth + 1)
        yield from _knobs_of_value(knob, setting.value_type, getattr(parent_value, setting.field))


def _empty_knob(cls: type, key: str, setting: Setting, parent_path: str, *, depth: int) -> Knob:
    return Knob(
        path=join_setting_path(parent_path, key),
        label=label_from_setting_name(key),
        help=cached_field_docstrings(cls).get(setting.field, ""),
        text="",
        depth=depth,
    )


def _knob_with_input_or_choices(knob: Knob, value_type: ValueType, current_value: Any) -> Knob:
    expected = describe_accepted_values(value_type, with_null=False)
    help = (
        f"{knob.help} Needs {expected}{', or nothing' if value_type.is_optional else ''}.".strip()
    )
    text = "" if current_value is None else format_setting_inline(current_value, value_type.unit)
    choices: list[tuple[str, str]] = []
    for choice in value_type.types_without_none:
        if get_origin(choice) is Literal:
            choices += [(quote_yaml_if_needed(str(name)), str(name)) for name in get_args(choice)]
        elif choice is bool:
            choices += [("false", "off"), ("true", "on")]
        else:
            return replace(knob, text=text, help=help, placeholder=expected)
    if value_type.is_optional:
        choices = [(NONE, "none"), *choices]
    return replace(knob, text=text or NONE, help=help, choices=tuple(choices))


def kind_as_yaml_mapping(kind: str) -> str:
    """Return the text that selects a member with its defaults."""
    return f"{{kind: {kind}}}"


def _yaml_data_on_one_line(data: Any) -> str:
    if isinstance(data, dict):
        members = (f"{key}: {_yaml_data_on_one_line(value)}" for key, value in data.items())
        return f"{{{', '.join(members)}}}"
    if isinstance(data, list):
        return f"[{', '.join(map(_yaml_data_on_one_line, data))}]"
    if isinstance(data, str):
        return quote_yaml_if_needed(data)
    if data is None:
        return NONE
    return str(data).lower() if isinstance(data, bool) else repr(data)
