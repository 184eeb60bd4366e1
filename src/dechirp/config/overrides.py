"""Overrides `--set PATH=VALUE` of the command line, applied to the tree of a settings file."""

from dataclasses import replace

from dechirp.config.dumping import dump_yaml
from dechirp.config.error_messages import SettingNode
from dechirp.config.validation import ValidationContext
from dechirp.config.yaml_tree import Location, YamlNode, join_setting_path, parse_yaml
from dechirp.core.errors import InvalidFile, quote_for_message
from dechirp.core.suggestions import did_you_mean_fix

_OPTION_LOCATION = Location("--set")


def apply_override(root: SettingNode, override: str, context: ValidationContext) -> YamlNode:
    """Change one setting of a tree; `override` is PATH=VALUE, VALUE as in a file.

    A missing mapping along the path starts as its default; a value given as a file path is read
    first. A new kind starts from its own defaults: the settings of the previous kind are dropped.

    Raises
    ------
    InvalidFile
        If the text has another form, or the path does not exist.
    """
    path, node = parse_override(override)
    return replace_node(root, path.split("."), node, context)


def parse_override(override: str) -> tuple[str, YamlNode]:
    """Split PATH=VALUE into the path and the node of the value.

    Raises
    ------
    InvalidFile
        If the text has another form.
    """
    path, equals, value = override.partition("=")
    if not (path.strip() and equals):
        raise InvalidFile(
            _OPTION_LOCATION.create_mistake(
                "--set",
                value=quote_for_message(override) if override else "empty",
                expected="PATH=VALUE",
                fix="write --set PATH=VALUE, such as --set radar.frame.n_chirps=64",
            )
        )
    path = path.strip()
    try:
        return path, _relocate_tree(parse_yaml(value, "--set"), _OPTION_LOCATION)
    except InvalidFile as error:
        mistakes = (replace(m, setting=path, line=None, column=None) for m in error.mistakes)
        raise InvalidFile(*mistakes) from None


def replace_node(
    setting: SettingNode, names: list[str], replacement: YamlNode, context: ValidationContext
) -> YamlNode:
    """Replace the node at the names below a setting; return the new node of the setting.

    Raises
    ------
    InvalidFile
        If the names lead to no setting.
    """
    if not names:
        return replacement
    name, *rest = names
    node = _node_or_tree_of_referenced_file(setting, context)
    setting = replace(setting, node=node)
    if isinstance(node.content, list):
        index = _index_of_list_member(setting, name)
        child = SettingNode(
            join_setting_path(setting.path, name),
            node.content[index],
            setting.value_type.list_member_type(),
        )
        members = list(node.content)
        members[index] = replace_node(child, rest, replacement, context)
        return replace(node, content=members)
    if not isinstance(node.content, dict):
        raise InvalidFile(
            _OPTION_LOCATION.create_mistake(
                join_setting_path(setting.path, name),
                value=f"inside {setting.name_in_messages}, which is {node.content_description}",
                expected="inside a mapping or a list",
                fix=f"set {setting.name_in_messages} itself",
            )
        )
    known_setting = setting.accepted_settings().get(name)
    if known_setting and rest:
        start = node.content.get(name)
        if start is None or start.content is None:
            start = _node_from_default(known_setting.default)
        child = SettingNode(join_setting_path(setting.path, name), start, known_setting.value_type)
        replacement = replace_node(child, rest, replacement, context)
    current = node.content.get(name)
    if name == "kind" and current is not None and current.content != replacement.content:
        return replace(node, content={name: replacement})
    # Unknown names are kept and refused later, together with those of the file.
    return replace(node, content={**node.content, name: replacement})


def _node_or_tree_of_referenced_file(setting: SettingNode, context: ValidationContext) -> YamlNode:
    """Return the node, or the tree of the file whose path it holds."""
    path = setting.node.content
    for cls in setting.value_type.types_without_none if isinstance(path, str) else ():
        if cls in context.readers:
            file = context.folder / str(path)
            return _relocate_tree(
                parse_yaml(dump_yaml(context.readers[cls](file)), ""), Location(str(file))
            )
    return setting.node


def _node_from_default(default: object) -> YamlNode:
    if default is None:
        return YamlNode({}, _OPTION_LOCATION, _OPTION_LOCATION)
    return _relocate_tree(parse_yaml(dump_yaml(default), ""), _OPTION_LOCATION)


def _relocate_tree(node: YamlNode, location: Location) -> YamlNode:
    """Copy a tree with all nodes at one location."""
    content = node.content
    if isinstance(content, dict):
        content = {name: _relocate_tree(child, location) for name, child in content.items()}
    elif isinstance(content, list):
        content = [_relocate_tree(child, location) for child in content]
    duplicate_keys = tuple((name, location) for name, _ in node.duplicate_keys)
    return replace(
        node,
        content=content,
        location=location,
        name_location=location,
        duplicate_keys=duplicate_keys,
    )


def _index_of_list_member(setting: SettingNode, name: str) -> int:
    """Return the index of a list member given by label or index."""
    labels = setting.node.list_member_labels
    if name in labels:
        return labels.index(name)
    if name.isdecimal() and len(name) < 10 and int(name) < len(labels):
        return int(name)
    raise InvalidFile(
        _OPTION_LOCATION.create_mistake(
            join_setting_path(setting.path, name),
            value="not in the list",
            expected=f"one of {', '.join(labels)}" if labels else "no member: the list is empty",
            fix=did_you_mean_fix(name, labels),
        )
    )
