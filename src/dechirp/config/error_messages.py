"""Error messages of settings files: location, value, accepted values and fix of each mistake."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Literal, get_args, get_origin

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from dechirp.config.fields import (
    Setting,
    ValueType,
    describe_accepted_values,
    is_family_type,
    list_settings,
    setting_name_of_field,
)
from dechirp.config.validation import ReferencedFileError
from dechirp.config.yaml_tree import Location, YamlNode, join_setting_path
from dechirp.core.errors import InvalidSetting, Mistake, quote_for_message
from dechirp.core.suggestions import CHOOSE_OR_OMIT, did_you_mean_fix, nearest_name


@dataclass(frozen=True)
class SettingNode:
    """Setting of a file: its path, the YAML node, and the type that it must have."""

    path: str
    node: YamlNode
    value_type: ValueType

    @property
    def location(self) -> Location:
        """Location that messages point to: the name, if the value takes several lines."""
        wide = isinstance(self.node.content, dict | list)
        return self.node.name_location if wide else self.node.location

    @property
    def name_in_messages(self) -> str:
        """Name of the setting in messages."""
        return self.path or "the file"

    def accepted_settings(self) -> dict[str, Setting]:
        """Return the settings that a mapping here accepts."""
        cls = self.value_type.class_of_mapping(self.node)
        return list_settings(cls) if cls else {}

    def child(self, key: str | int) -> "SettingNode | None":
        """Return the inner setting of a name or index, if the file contains it."""
        content = self.node.content
        if isinstance(content, dict) and key in content:
            setting = self.accepted_settings().get(str(key))
            value_type = setting.value_type if setting else ValueType(object)
            return SettingNode(
                join_setting_path(self.path, str(key)), content[str(key)], value_type
            )
        if isinstance(content, list) and isinstance(key, int) and key < len(content):
            path = join_setting_path(self.path, self.node.list_member_labels[key])
            return SettingNode(path, content[key], self.value_type.list_member_type())
        return None


def mistakes_of_validation_error(
    error: ValidationError, root: SettingNode, *, path_readable_types: Collection[type]
) -> list[Mistake]:
    """Return the mistakes of a tree that failed validation against a value class.

    Parameters
    ----------
    error : ValidationError
        Error of pydantic, whose own texts are not shown.
    root : SettingNode
        Root of the tree.
    path_readable_types : collection of types
        Types that a file path may replace.
    """
    mistakes: dict[Mistake, None] = {}  # a list that is too short by two is one mistake
    for detail in error.errors(include_url=False):
        setting, parent = root, root
        for key in detail["loc"]:
            # A missing setting belongs to its parent, as do pydantic's names of union members.
            setting, parent = setting.child(key) or setting, setting
        mistakes.update(
            dict.fromkeys(_mistakes_of_error_detail(detail, setting, parent, path_readable_types))
        )
    return list(mistakes)


def _mistakes_of_error_detail(
    detail: ErrorDetails,
    setting: SettingNode,
    parent: SettingNode,
    path_readable_types: Collection[type],
) -> Iterator[Mistake]:
    last = detail["loc"][-1] if detail["loc"] else None
    if detail["type"] == "value_error":
        yield from locate_mistakes_in_file(detail["ctx"]["error"], setting)
    elif detail["type"] == "extra_forbidden":
        yield _unknown_setting_mistake(setting, parent)
    elif detail["type"] == "missing" and isinstance(last, str):
        yield from _missing_setting_mistakes_unless_misspelt(last, setting, path_readable_types)
    elif detail["type"] == "kind" and isinstance(setting.node.content, dict):
        yield _unknown_kind_mistake(setting)
    else:
        yield setting.location.create_mistake(
            setting.name_in_messages,
            value=setting.node.content_description,
            expected=describe_accepted_values(
                setting.value_type, path_readable_types=path_readable_types
            ),
            fix=_suggest_fix(setting),
        )


def locate_mistakes_in_file(error: Exception, setting: SettingNode) -> Iterator[Mistake]:
    """Translate the refusal of a value or a quantity to mistakes located in the file."""
    if not isinstance(error, InvalidSetting | ReferencedFileError):
        raise error  # a defect of the package
    for mistake in error.mistakes:
        if mistake.file is not None:
            yield mistake
            continue
        target, path = setting, setting.path
        cls = setting.value_type.class_of_mapping(setting.node)
        owner, *names = mistake.setting.split(".")
        if cls is not None and owner in list_settings(cls):
            names = [owner, *names]  # the path of a setting instead of Class.field
        elif cls is None or owner != cls.__name__:
            names = []
        for name in names:
            cls = target.value_type.class_of_mapping(target.node)
            key = setting_name_of_field(cls, name) if cls else name
            labels = target.node.list_member_labels
            child = target.child(labels.index(key) if key in labels else key)
            target, path = child or target, join_setting_path(path, key)
        is_scalar_in_file = target.path == path and not isinstance(target.node.content, dict | list)
        # Quote -1 MHz as written in the file, not as -1000000.0.
        is_number = mistake.setting == "quantity" or (names and _is_float_text(mistake.value))
        yield target.location.create_mistake(
            path or "the file",
            value=target.node.content_description
            if is_scalar_in_file and is_number
            else mistake.value,
            expected=mistake.expected,
            fix=mistake.fix,
        )


def _unknown_setting_mistake(setting: SettingNode, parent: SettingNode) -> Mistake:
    names = list(parent.accepted_settings())
    if any(is_family_type(choice) for choice in parent.value_type.types_without_none):
        names.insert(0, "kind")
    return setting.node.name_location.create_mistake(
        setting.name_in_messages,
        value="unknown setting",
        expected=f"one of {', '.join(names)}" if names else "no settings here",
        fix=did_you_mean_fix(setting.path.rpartition(".")[2], names, CHOOSE_OR_OMIT),
    )


def _missing_setting_mistakes_unless_misspelt(
    key: str, parent: SettingNode, path_readable_types: Collection[type]
) -> Iterator[Mistake]:
    known_settings = parent.accepted_settings()
    assert isinstance(parent.node.content, dict)
    misspelt = (name for name in parent.node.content if name not in known_settings)
    if key in (nearest_name(name, known_settings) for name in misspelt):
        return  # the misspelt name is reported instead
    yield parent.location.create_mistake(
        join_setting_path(parent.path, key),
        value="missing",
        expected=describe_accepted_values(
            known_settings[key].value_type, path_readable_types=path_readable_types
        ),
        fix=f"add {key}",
    )


def _unknown_kind_mistake(setting: SettingNode) -> Mistake:
    families = [
        choice for choice in setting.value_type.types_without_none if is_family_type(choice)
    ]
    kinds = [kind for family in families for kind in family.members()]
    kind = setting.child("kind")
    location, kind_text = (
        (kind.location, kind.node.content_description) if kind else (setting.location, "missing")
    )
    failed_plugins = {
        name: reason for family in families for name, reason in family.failed_plugins().items()
    }
    if kind and kind.node.text in failed_plugins:
        return location.create_mistake(
            join_setting_path(setting.path, "kind"),
            value=f"{kind_text}, which cannot be loaded ({failed_plugins[kind.node.text]})",
            expected=f"one of {', '.join(kinds)}, or a package that can be loaded",
            fix="repair or remove the package that defines it",
        )
    return location.create_mistake(
        join_setting_path(setting.path, "kind"),
        value=kind_text,
        expected=f"one of {', '.join(kinds)}",
        fix=did_you_mean_fix(kind_text, kinds),
    )


def _suggest_fix(setting: SettingNode) -> str:
    hint = setting.value_type.types_without_none[0]
    if get_origin(hint) is Literal:
        return did_you_mean_fix(setting.node.text, map(str, get_args(hint)))
    if get_origin(hint) is tuple:
        return "write all values in brackets, separated by commas"
    if is_family_type(hint):
        kind = nearest_name(setting.node.text, hint.members()) or "NAME"
        return f"write {{kind: {kind}}} and its settings"
    if hint is str and not isinstance(setting.node.content, dict | list | None):
        return f"write it in quotes: '{quote_for_message(setting.node.text)}'"
    fixes = {
        int: "write digits only, such as 128, without quotes, point or unit",
        float: "write one number",
        bool: "write true or false, without quotes",
        str: "write text",
    }
    return fixes.get(hint, "write its settings below it, indented, as NAME: VALUE")


def _is_float_text(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
