"""Setting paths: find and replace settings of a value without going through text.

Dumping a scenario, changing and parsing it takes 20 ms; replacing the values along the path of a
setting takes only as long as their checks.
"""

import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, is_dataclass, replace
from typing import Any, Literal, TypeAlias, TypeVar, cast

from dechirp.config.dumping import dump_yaml
from dechirp.config.error_messages import SettingNode
from dechirp.config.fields import Setting, ValueType, is_family_type, list_settings
from dechirp.config.loading import validate_and_build_value
from dechirp.config.overrides import replace_node
from dechirp.config.validation import ValidationContext
from dechirp.config.yaml_tree import (
    Location,
    YamlNode,
    join_setting_path,
    parse_yaml,
    replace_repeated_labels_by_index,
)
from dechirp.core.errors import InvalidSetting
from dechirp.core.families import Family
from dechirp.core.findings import PhysicsWarning
from dechirp.core.suggestions import CHOOSE_OR_OMIT, did_you_mean_fix

T = TypeVar("T")
Steps: TypeAlias = tuple[str | int, ...]


@dataclass(frozen=True)
class SettingPath:
    """Position of a setting in a value."""

    path: str
    """Path in the form of `--set`."""
    steps: Steps
    """Fields and indices from the root to the last existing value."""
    value_type: ValueType
    """Type of the last existing value."""
    remaining_names: tuple[str, ...]
    """Names below it: settings of a value that is still None, or the kind of a family member."""
    leaf_value_type: ValueType
    """Type of the setting itself."""

    def overlaps(self, other: "SettingPath") -> bool:
        """Check whether a change at one path affects the other."""
        n_shared = min(len(self.steps), len(other.steps))
        if self.steps[:n_shared] != other.steps[:n_shared]:
            return False
        if self.steps != other.steps or not (self.remaining_names and other.remaining_names):
            return True
        n_shared = min(len(self.remaining_names), len(other.remaining_names))
        return self.remaining_names[:n_shared] == other.remaining_names[:n_shared] or "kind" in (
            self.remaining_names[-1],
            other.remaining_names[-1],
        )


def find_setting(root_value: Any, path: str) -> SettingPath:
    """Find a setting in a value.

    Raises
    ------
    InvalidSetting
        If the path does not exist; the error suggests the nearest name.
    """
    value_type = ValueType(type(root_value))
    value: Any = root_value
    steps: Steps = ()
    names = path.split(".")
    for depth, name in enumerate(names):
        parent_path = ".".join(names[:depth])
        if (is_dataclass(value) and name == "kind" and isinstance(value, Family)) or value is None:
            return SettingPath(
                path,
                steps,
                value_type,
                tuple(names[depth:]),
                _value_type_of_nested_setting(value_type, names[depth:], parent_path),
            )
        if is_dataclass(value):
            setting = _lookup_setting(list_settings(cast(type, type(value))), name, parent_path)
            value, value_type, steps = (
                getattr(value, setting.field),
                setting.value_type,
                (*steps, setting.field),
            )
        elif isinstance(value, tuple):
            index = _index_of_list_member(value, name, parent_path)
            value, value_type, steps = value[index], value_type.list_member_type(), (*steps, index)
        else:
            raise InvalidSetting(
                join_setting_path(parent_path, name),
                value=f"inside {parent_path}, which is one value",
                expected="inside a mapping or a list",
                fix=f"set {parent_path} itself",
            )
    return SettingPath(path, steps, value_type, (), value_type)


def build_value_with_replaced_setting(
    root_value: Any, path: SettingPath, node: YamlNode, context: ValidationContext
) -> Any:
    """Return the value at the steps of a path after a setting is replaced by a node."""
    if not path.remaining_names:
        return validate_and_build_value(SettingNode(path.path, node, path.value_type), context)
    value = root_value
    for step in path.steps:
        value = value[step] if isinstance(step, int) else getattr(value, step)
    location = Location("")
    start = YamlNode({}, location, location) if value is None else parse_yaml(dump_yaml(value), "")
    parent_path = ".".join(path.path.split(".")[: -len(path.remaining_names)])
    spot = SettingNode(parent_path, start, path.value_type)
    return validate_and_build_value(
        replace(spot, node=replace_node(spot, list(path.remaining_names), node, context)), context
    )


def replace_settings(root_value: T, new_values: Mapping[Steps, Any]) -> T:
    """Return a copy of a value with replacements at separate positions.

    Raises
    ------
    InvalidSetting
        If a new value fails its checks.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PhysicsWarning)  # findings of the run report them
        return cast(T, _replace_nested_values(root_value, new_values))


def iter_referenced_files(
    setting: SettingNode, context: ValidationContext
) -> Iterator[tuple[Steps, str]]:
    """Yield the position and the absolute path of each file that settings name."""
    for steps, node in _iter_file_path_nodes(setting, context, ()):
        yield steps, str((context.folder / str(node.content)).absolute())


def with_absolute_file_paths(setting: SettingNode, context: ValidationContext) -> YamlNode:
    """Return the tree with absolute file paths, which are valid from any folder."""
    node = setting.node
    for steps, path in iter_referenced_files(setting, context):
        node = _replace_scalar_text(node, steps, path)
    return node


def _replace_nested_values(value: Any, new_values: Mapping[Steps, Any]) -> Any:
    if () in new_values:
        return new_values[()]
    inner_changes: dict[str | int, dict[Steps, Any]] = {}
    for steps, replacement in new_values.items():
        inner_changes.setdefault(steps[0], {})[steps[1:]] = replacement
    if is_dataclass(value):
        fields = {
            str(name): _replace_nested_values(getattr(value, str(name)), change)
            for name, change in inner_changes.items()
        }
        return replace(cast(Any, value), **fields)
    members = list(value)
    for index, change in inner_changes.items():
        members[int(index)] = _replace_nested_values(members[int(index)], change)
    return tuple(members)


def _lookup_setting(known_settings: Mapping[str, Setting], name: str, parent_path: str) -> Setting:
    if name not in known_settings:
        raise InvalidSetting(
            join_setting_path(parent_path, name),
            value="unknown setting",
            expected=f"one of {', '.join(known_settings)}"
            if known_settings
            else "no settings here",
            fix=did_you_mean_fix(name, known_settings, CHOOSE_OR_OMIT),
        )
    return known_settings[name]


def _index_of_list_member(members: Sequence[Any], name: str, parent_path: str) -> int:
    """Return the index of a list member given by label or index."""
    labels = replace_repeated_labels_by_index(
        _label_of_list_member(member, str(position)) for position, member in enumerate(members)
    )
    if name in labels:
        return labels.index(name)
    if name.isdecimal() and len(name) < 10 and int(name) < len(labels):
        return int(name)
    raise InvalidSetting(
        join_setting_path(parent_path, name),
        value="not in the list",
        expected=f"one of {', '.join(labels)}" if labels else "no member: the list is empty",
        fix=did_you_mean_fix(name, labels),
    )


def _label_of_list_member(member: Any, index: str) -> str:
    """Return the label that `YamlNode.list_member_labels` gives to the dumped value."""
    name = getattr(member, "name", None) if is_dataclass(member) else None
    if isinstance(name, str):
        return name
    return member.kind() if isinstance(member, Family) else index


def _value_type_of_nested_setting(
    value_type: ValueType, names: Sequence[str], parent_path: str
) -> ValueType:
    """Return the type of a setting below a value that is still None, or of a kind."""
    for depth, name in enumerate(names):
        path = join_setting_path(parent_path, ".".join(names[:depth])) if depth else parent_path
        families = [choice for choice in value_type.types_without_none if is_family_type(choice)]
        classes = [choice for choice in value_type.types_without_none if is_dataclass(choice)]
        if families and name == "kind" and depth == len(names) - 1:
            return ValueType(Literal.__getitem__(tuple(families[0].members())))
        known_settings = list_settings(cast(type, classes[0])) if classes and not families else {}
        if not known_settings:
            raise InvalidSetting(
                join_setting_path(path, name),
                value=f"inside {path}, which is null",
                expected="inside a mapping or a list",
                fix=f"set {path} itself, with all its settings",
            )
        value_type = _lookup_setting(known_settings, name, path).value_type
    return value_type


def _iter_file_path_nodes(
    setting: SettingNode, context: ValidationContext, steps: Steps
) -> Iterator[tuple[Steps, YamlNode]]:
    content = setting.node.content
    if isinstance(content, str):
        if setting.value_type.is_file_path or any(
            choice in context.readers for choice in setting.value_type.types_without_none
        ):
            yield steps, setting.node
        return
    keys: Iterable[str | int] = ()
    if isinstance(content, dict | list):
        keys = content if isinstance(content, dict) else range(len(content))
    for key in keys:
        child = setting.child(key)
        assert child is not None  # `key` comes from the node
        yield from _iter_file_path_nodes(child, context, (*steps, key))


def _replace_scalar_text(node: YamlNode, steps: Steps, text: str) -> YamlNode:
    if not steps:
        return replace(node, content=text, text=text)
    first, *rest = steps
    if isinstance(node.content, dict):
        child = _replace_scalar_text(node.content[str(first)], tuple(rest), text)
        return replace(node, content={**node.content, str(first): child})
    assert isinstance(node.content, list)
    members = list(node.content)
    members[int(first)] = _replace_scalar_text(members[int(first)], tuple(rest), text)
    return replace(node, content=members)
