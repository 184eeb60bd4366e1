"""`dechirp list`: the families that settings choose from by `kind`, and their members."""

import sys
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from dechirp.cli.options import Json

if TYPE_CHECKING:
    from dechirp.core.families import Family

# Written out, so that a shell completes them without the package behind them.
Name: TypeAlias = Literal[
    "angle",
    "body",
    "cfar",
    "device",
    "format",
    "impairment",
    "mitigation",
    "modulation",
    "multiplexing",
    "pattern",
    "score",
    "writer",
]


def list_members(
    family: Name | None = None,
    /,
    *,
    as_json: Json = False,
) -> int:
    """List what settings choose by kind: detectors, impairments, formats.

    Parameters
    ----------
    family
        One family; all of them without it.
    """
    from dechirp.store.tables import json_text

    known = families()
    wanted = {name: known[name] for name in known if family in (None, name)}
    found = {name: members(base) for name, base in wanted.items()}
    if as_json:
        print(json_text({"families": found}), end="")
    else:
        _show(found)
    for name, base in wanted.items():
        for kind, why in base.missing_guests().items():
            print(f"{name}: {kind} of another package cannot be loaded: {why}", file=sys.stderr)
    return 0


def families() -> dict[str, "type[Family]"]:
    """Base classes by name, from every `base.py` of the package but those of the studio's parts."""
    import importlib
    from pathlib import Path

    import dechirp
    from dechirp.core.families import Family

    root = Path(dechirp.__path__[0])
    for file in sorted(root.rglob("base.py")):
        *packages, name = file.relative_to(root).with_suffix("").parts
        if packages[0] != "studio":  # they need the extra `web`, and seconds
            importlib.import_module(".".join(["dechirp", *packages, name]))
    return {
        base.group.removeprefix("dechirp."): base
        for base in sorted(Family.__subclasses__(), key=lambda base: base.group)
    }


def members(base: "type[Family]") -> dict[str, Any]:
    """Settings of each member by its kind, as a settings file writes them."""
    from dechirp.config.fields import settings, words
    from dechirp.config.help import field_help

    found = {}
    for kind, member in base.members().items():
        meanings = field_help(member)
        found[kind] = {
            "help": (member.__doc__ or "").partition("\n")[0],
            "settings": {
                name: {
                    "need": words(setting.slot),
                    "required": setting.required,
                    "default": _written(setting.default, setting.slot.unit),
                    "help": meanings[setting.field],
                }
                for name, setting in settings(member).items()
            },
        }
    return found


def _written(default: Any, unit: str | None) -> Any:
    from dechirp.config.quantities import text_of
    from dechirp.config.texts import as_text

    return text_of(default, unit) if isinstance(default, float) else as_text(default, unit)


def _show(found: dict[str, Any]) -> None:
    from rich.padding import Padding
    from rich.text import Text

    from dechirp.cli.show import console

    screen = console()
    for family, of_family in found.items():
        screen.print(Text(family, "bold underline"))
        for kind, member in of_family.items():
            screen.print(Padding(Text.assemble((kind, "bold"), f"  {member['help']}"), (0, 2)))
            for name, setting in member["settings"].items():
                default = "null" if setting["default"] is None else setting["default"]
                given = "required" if setting["required"] else f"default {default}"
                line = f"{name}: {setting['need']} ({given}). {setting['help']}"
                screen.print(Padding(line, (0, 6)))
