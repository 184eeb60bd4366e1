"""`dechirp list`: families of members that settings select by `kind`."""

import re
import sys
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from dechirp.cli.options import Json

if TYPE_CHECKING:
    from dechirp.core.families import Family

# Written out, so that a shell completes them without the package behind them.
FamilyName: TypeAlias = Literal[
    "angle",
    "body",
    "cfar",
    "device",
    "format",
    "generator",
    "impairment",
    "mitigation",
    "modulation",
    "multiplexing",
    "pattern",
    "score",
    "traffic",
    "witness",
    "writer",
]


def list_members(
    family: FamilyName | None = None,
    /,
    *,
    as_json: Json = False,
) -> int:
    """List the members that settings select by kind: detectors, impairments, formats.

    Parameters
    ----------
    family
        Family to list; all by default.
    """
    from dechirp.results.text_files import to_json_text

    bases = family_base_classes()
    wanted = {name: bases[name] for name in bases if family in (None, name)}
    members = {name: help_and_settings_by_kind(base) for name, base in wanted.items()}
    if as_json:
        print(to_json_text({"families": members}), end="")
    else:
        _print_members(members)
    for name, base in wanted.items():
        for kind, reason in base.failed_plugins().items():
            print(f"{name}: plugin {kind} cannot be loaded: {reason}", file=sys.stderr)
    return 0


def family_base_classes() -> dict[str, "type[Family]"]:
    """Return the base class of each family, from every `base.py` outside the studio."""
    import importlib
    from pathlib import Path

    import dechirp
    from dechirp.core.families import Family

    root = Path(dechirp.__path__[0])
    for file in sorted(root.rglob("base.py")):
        *packages, name = file.relative_to(root).with_suffix("").parts
        if packages[0] != "studio":  # needs the extra `web` and takes seconds to import
            importlib.import_module(".".join(["dechirp", *packages, name]))
    return {
        base.group.removeprefix("dechirp."): base
        for base in sorted(Family.__subclasses__(), key=lambda base: base.group)
    }


def help_and_settings_by_kind(base: "type[Family]") -> dict[str, Any]:
    """Return the help and settings of each member by kind, as a settings file writes them."""
    from dataclasses import is_dataclass

    from dechirp.core.families import Family

    settings_by_kind = {}
    for kind, member in base.members().items():
        assert issubclass(member, Family)
        settings_by_kind[kind] = {
            "help": (member.__doc__ or "").partition("\n")[0],
            "experimental": member.experimental,
            # Formats of traffic and witnesses have none, and are no value classes.
            "settings": _describe_settings(member) if is_dataclass(member) else {},
        }
    return settings_by_kind


def _describe_settings(value_class: type, default_values: Any = None) -> dict[str, Any]:
    """Describe the settings of a class by name; those of a mapping follow as `mapping.name`."""
    from dataclasses import is_dataclass

    from dechirp.config.fields import (
        describe_accepted_values,
        field_docstrings,
        is_family_type,
        list_settings,
    )

    help_by_field = field_docstrings(value_class)
    settings = {}
    for name, setting in list_settings(value_class).items():
        default = getattr(default_values, setting.field, setting.default)
        settings[name] = {
            # The default is the better example: 77 GHz beside a default of 2 MHz misleads.
            "expected": describe_accepted_values(setting.value_type, with_examples=default is None),
            "required": setting.is_required,
            "default": _format_default(default, setting.value_type.unit),
            "help": help_by_field[setting.field],
        }
        for choice in setting.value_type.types_without_none:
            if isinstance(choice, type) and is_dataclass(choice) and not is_family_type(choice):
                members = _describe_settings(choice, default)
                settings |= {f"{name}.{member}": text for member, text in members.items()}
    return settings


def _format_default(default: Any, unit: str | None) -> Any:
    from dechirp.config.dumping import to_yaml_data
    from dechirp.config.quantities import format_exact_quantity

    return (
        format_exact_quantity(default, unit)
        if isinstance(default, float)
        else to_yaml_data(default, unit)
    )


def _print_members(families: dict[str, Any]) -> None:
    from rich.padding import Padding
    from rich.text import Text

    from dechirp.cli.console import open_stdout_console

    screen = open_stdout_console()
    for family, members in families.items():
        screen.print(Text(family, "bold underline"))
        for kind, member in members.items():
            mark = " (experimental)" if member["experimental"] else ""
            screen.print(
                Padding(Text.assemble((kind, "bold"), f"{mark}  {member['help']}"), (0, 2))
            )
            for name, setting in member["settings"].items():
                default = f" (default {_format_default_for_reader(setting['default'])})"
                if setting["required"]:
                    default = " (required)"
                elif isinstance(setting["default"], dict) and "kind" not in setting["default"]:
                    default = ""  # the settings of the mapping follow
                line = f"{name}: {setting['expected']}{default}. {setting['help']}"
                screen.print(Padding(line, (0, 6)))


def _format_default_for_reader(value: Any) -> str:
    """Write a default on one line: mappings as `share: 0.6667`, numbers with four digits."""
    if isinstance(value, dict):
        return ", ".join(
            f"{name}: {_format_default_for_reader(item)}" for name, item in value.items()
        )
    if isinstance(value, list):
        return f"[{', '.join(map(_format_default_for_reader, value))}]"
    if value is None:
        return "null"
    if isinstance(value, str) and re.fullmatch(r"-?\d+\.\d+", value):
        value = float(value)  # without a unit
    if isinstance(value, float):
        # 1e-5 in place of 1e-05.
        return re.sub(r"e([+-])0*", lambda match: "e" + match[1].strip("+"), f"{value:.4g}")
    return str(value).lower() if isinstance(value, bool) else str(value)
