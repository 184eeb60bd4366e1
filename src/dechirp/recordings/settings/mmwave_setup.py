"""TI mmWave Studio: the file that names the settings of a capture (`.setup.json`)."""

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
    if isinstance(name, str) and _is_file_name_without_folder(name) and name != file.name:
        named_file = file.parent / name
        if is_file_not_linked_outside_folder(named_file):
            return named_file, chip if isinstance(chip, str) else ""
    raise RecordingError(
        file,
        value=f"configUsed {format_json_excerpt(name)}",
        expected="the bare name of a .mmwave.json file in the same folder",
        fix="put that file next to it and write its name without a folder, or give the"
        " .mmwave.json file itself",
    )


def is_file_not_linked_outside_folder(file: Path) -> bool:
    """Return whether a path is a file, and not a link that leads out of its folder."""
    try:
        return file.is_file() and file.resolve().is_relative_to(file.parent.resolve())
    except (OSError, RuntimeError):  # a name too long, or a symlink loop
        return False


def _is_file_name_without_folder(name: str) -> bool:
    """Return whether a name is a file name without folder."""
    return 0 < len(name) < 256 and not set(name) & set("/\\:\0") and name not in (".", "..")
