"""TI mmWave Studio: the file that names the settings of a capture (`.setup.json`)."""

from pathlib import Path

from dechirp.core.errors import RecordingError
from dechirp.formats.settings.json_text import parsed, shown


def looks_like(text: str) -> bool:
    """Whether a text is such a file, if it is JSON at all."""
    return '"configUsed"' in text


def named_by(file: Path, text: str) -> tuple[Path, str]:
    """Give the `.mmwave.json` that such a file names, and the chip; empty where it names none.

    Raises
    ------
    RecordingError
        If it names no file of its own folder.
    """
    document = parsed(file, text)
    document = document if isinstance(document, dict) else {}
    name, chip = document.get("configUsed"), document.get("mmWaveDevice")
    if isinstance(name, str) and _bare(name) and name != file.name:
        used = file.parent / name
        if lies_in_its_folder(used):
            return used, chip if isinstance(chip, str) else ""
    raise RecordingError(
        file,
        got=f"with configUsed {shown(name)}",
        need="with the bare name of a .mmwave.json file that lies beside it",
        fix="Put that file beside it and write its name without a folder, or give the"
        " .mmwave.json file itself.",
    )


def lies_in_its_folder(file: Path) -> bool:
    """Whether it is a file, and one that no link leads to from outside its folder."""
    try:
        return file.is_file() and file.resolve().is_relative_to(file.parent.resolve())
    except (OSError, RuntimeError):  # a name too long, links in a circle
        return False


def _bare(name: str) -> bool:
    return 0 < len(name) < 256 and not set(name) & set("/\\:\0") and name not in (".", "..")
