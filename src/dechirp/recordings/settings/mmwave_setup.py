"""TI mmWave Studio: the file that names the settings of a capture (`.setup.json`).

It names them with the folder of the computer that recorded. Of that path only the file name
counts: captures are copied with their settings, and other folders are never read. If the settings
were renamed, they are the only `.mmwave.json` of the folder.
"""

import re
from pathlib import Path

from dechirp.core.errors import RecordingError
from dechirp.recordings.settings.json_text import format_json_excerpt, parse_json


def is_mmwave_setup(text: str) -> bool:
    """Return whether a text is such a file, provided that it is JSON."""
    return '"configUsed"' in text


def find_named_settings_and_chip(file: Path, text: str) -> tuple[Path, str]:
    """Return the `.mmwave.json` named by such a file, and the name of the chip, or empty text.

    Raises
    ------
    RecordingError
        If it names no file of its own folder.
    """
    document = parse_json(file, text)
    document = document if isinstance(document, dict) else {}
    name, chip = document.get("configUsed"), document.get("mmWaveDevice")
    base_name = re.split(r"[/\\]", name)[-1] if isinstance(name, str) else ""
    if _is_file_name(base_name) and base_name != file.name:
        named_files = [file.parent / base_name]
        if not named_files[0].exists():
            named_files = [*file.parent.glob("*.mmwave.json")]
        if len(named_files) == 1 and is_file_not_linked_outside_folder(named_files[0]):
            return named_files[0], chip if isinstance(chip, str) else ""
    raise RecordingError(
        file,
        value=f"configUsed {format_json_excerpt(name)}",
        expected="the name of a .mmwave.json file in the folder of this file",
        fix="put that file next to it, or give the .mmwave.json file itself",
    )


def is_file_not_linked_outside_folder(file: Path) -> bool:
    """Return whether a path is a file, and not a link that leads out of its folder."""
    try:
        return file.is_file() and file.resolve().is_relative_to(file.parent.resolve())
    except (OSError, RuntimeError):  # a name too long, or a symlink loop
        return False


def _is_file_name(name: str) -> bool:
    """Return whether a name without slashes is that of a file."""
    return 0 < len(name) < 256 and not set(name) & set(":\0") and name not in (".", "..")
