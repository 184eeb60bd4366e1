"""Loading of settings files into values.

A key is the name of a field without its unit, nesting follows the attributes, and all mistakes
of a file are reported together.
"""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar, cast

from pydantic import ValidationError

from dechirp.config.error_messages import SettingNode, mistakes_of_validation_error
from dechirp.config.fields import ValueType, describe_accepted_values
from dechirp.config.overrides import apply_override
from dechirp.config.validation import Readers, ValidationContext, build_validator
from dechirp.config.yaml_tree import Location, YamlNode, duplicate_key_mistakes, parse_yaml
from dechirp.core.errors import InvalidFile, Mistake

T = TypeVar("T")

_MAX_BYTES = 2**20  # bytes; takes some 4 s to read


def read_settings(
    path: str | Path,
    value_class: type[T],
    *,
    overrides: Iterable[str] = (),
    readers: Readers | None = None,
) -> T:
    """Read a value of a class from a settings file.

    Parameters
    ----------
    path : str or Path
        A YAML file; paths in it are relative to its folder.
    value_class : type
        The value class.
    overrides : iterable of str
        PATH=VALUE, each of which replaces a setting of the file.
    readers : mapping of type to function of a Path, optional
        Functions that read a value of a type from a file named in its place.

    Raises
    ------
    InvalidFile
        With every mistake of the file and of the files that it names.
    DechirpError
        If a reader raises it.
    """
    path = Path(path)
    return parse_settings(
        read_settings_text(path),
        value_class,
        file=str(path),
        base_folder=path.absolute().parent,
        overrides=overrides,
        readers=readers,
    )


def parse_settings(
    text: str,
    value_class: type[T],
    *,
    file: str = "<text>",
    base_folder: Path = Path(),
    overrides: Iterable[str] = (),
    readers: Readers | None = None,
) -> T:
    """Parse the text of a settings file to a value; for the parameters see `read_settings`."""
    context = ValidationContext(folder=base_folder, readers=readers or {})
    return build_value_from_tree(parse_yaml(text, file), value_class, context, overrides=overrides)


def build_value_from_tree(
    tree: YamlNode,
    value_class: type[T],
    context: ValidationContext,
    *,
    overrides: Iterable[str] = (),
) -> T:
    """Build a value of a class from the tree of a settings file, or of a part of it."""
    mistakes: list[Mistake] = []
    if tree.content is None:
        overrides = tuple(overrides)
        if not overrides:
            raise InvalidFile(
                tree.location.create_mistake(
                    "the file",
                    value="empty",
                    expected=describe_accepted_values(ValueType(value_class)),
                    fix="write the settings",
                )
            )
        tree = replace(tree, content={})
    for option in overrides:
        try:
            tree = apply_override(SettingNode("", tree, ValueType(value_class)), option, context)
        except InvalidFile as error:
            mistakes += error.mistakes
    try:
        value = validate_and_build_value(SettingNode("", tree, ValueType(value_class)), context)
    except InvalidFile as error:
        mistakes += error.mistakes
    if mistakes:
        raise InvalidFile(*sort_and_deduplicate_mistakes(mistakes))
    return cast(T, value)


def validate_and_build_value(setting: SettingNode, context: ValidationContext) -> Any:
    """Validate a setting and return its value.

    Raises
    ------
    InvalidFile
        With every mistake in it.
    """
    mistakes = list(duplicate_key_mistakes(setting.node, setting.path))
    try:
        value = build_validator(setting.value_type).validate_python(
            setting.node.plain_data, context=context
        )
    except ValidationError as error:
        mistakes += mistakes_of_validation_error(
            error, setting, path_readable_types=context.readers
        )
    if mistakes:
        raise InvalidFile(*sort_and_deduplicate_mistakes(mistakes))
    return value


def sort_and_deduplicate_mistakes(mistakes: Iterable[Mistake]) -> list[Mistake]:
    """Sort mistakes by location, without duplicates; those without a location come last."""
    return sorted(dict.fromkeys(mistakes), key=_location_sort_key)


def _location_sort_key(mistake: Mistake) -> tuple[bool, int, int]:
    return mistake.line is None, mistake.line or 0, mistake.column or 0


def read_settings_text(path: Path) -> str:
    """Read the text of a settings file.

    Raises
    ------
    InvalidFile
        If it is missing, not text, or larger than 1 MiB.
    """
    try:
        if not path.exists():
            problem = "not found"
        elif not path.is_file():
            problem = "a folder" if path.is_dir() else "not a file"
        elif path.stat().st_size > _MAX_BYTES:
            problem = f"{path.stat().st_size / 2**20:.3g} MiB"
        else:
            return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        problem = f"not text: byte {error.start} is not UTF-8"
    except OSError as error:
        problem = f"not readable: {error.strerror}"
    raise InvalidFile(
        Location(str(path)).create_mistake(
            "the file",
            value=problem,
            expected="a settings file: YAML of at most 1 MiB",
            fix="name the file with the settings",
        )
    )
