"""Settings of a recording, from whatever file holds them."""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from dechirp.config import files
from dechirp.config.models import Readers
from dechirp.core.errors import DechirpError, RecordingError
from dechirp.formats.settings import (
    infineon_json,
    mmwave_json,
    mmwave_setup,
    studio_log,
    ti_cfg,
)
from dechirp.formats.settings.base import Settings
from dechirp.formats.settings.calibration import read_calibration
from dechirp.radar.calibration import Calibration
from dechirp.radar.devices.base import Device
from dechirp.radar.radar import Radar

_YAML = (".yaml", ".yml")
_SUFFIXES = (*_YAML, ".txt", ".log", ".json", ".cfg")
_LARGEST_BYTES = 16 * 2**20  # years of a log; its lines take 8 bytes more each


def read_radar(path: str | Path, device: Device | None = None) -> Radar:
    """Radar from a settings file: our YAML, or that of a vendor.

    Vendors' are TI's `.cfg`, `.mmwave.json`, `.setup.json` and mmWave Studio log, and
    Infineon's `config.json`. What a file holds decides, not its name.

    Parameters
    ----------
    path : path
        The file.
    device : Device, optional
        The device it is of, for the positions of its antennas; it comes before the one that
        the file names. A YAML file has an array of its own.

    Raises
    ------
    RecordingError
        If it is a vendor's file that cannot be read.
    InvalidFile
        If it is a YAML file or a `.cfg` with mistakes.
    """
    return read_settings(Path(path), device).radar


def read_settings(file: Path, device: Device | None = None) -> Settings:
    """Radar from a settings file, with what the file says of the recording's layout.

    `read_radar` says what is read, and what is raised.
    """
    text = _text(file)
    name = file.name.lower()
    if studio_log.looks_like(text):
        settings = studio_log.read(file, text, device)
    elif ti_cfg.looks_like(text) or name.endswith(".cfg"):
        settings = ti_cfg.read(file, text, device)
    elif mmwave_json.looks_like(text):
        settings = mmwave_json.read(file, text, device)
    elif mmwave_setup.looks_like(text):
        used, chip = mmwave_setup.named_by(file, text)
        settings = mmwave_json.read(used, _text(used), device, chip)
    elif infineon_json.looks_like(text) or name.endswith(".json"):
        settings = infineon_json.read(file, text, device)
    else:
        readers: Readers = {Calibration: read_calibration}
        settings = Settings(radar=files.read(file, Radar, readers=readers))
    return replace(settings.of_device(device), path=file)


def find_settings(recording: Path) -> Path:
    """Find the settings file beside a recording: of the same name, else the only one.

    A `.setup.json` and the `.mmwave.json` it names are one; of several of the recording's name
    that say the same, it is the first. Links that lead out of the folder are left alone.

    Raises
    ------
    RecordingError
        If there is none, or several could be meant; it names them.
    """
    candidates = sorted(
        file for file in recording.parent.iterdir() if file != recording and holds_settings(file)
    )
    pairs = {used: file for file in candidates if (used := _used_by(file)) is not None}
    candidates = [file for file in candidates if file not in pairs]
    # mmWave Studio calls the settings of adc_data_Raw_0.bin adc_data_LogFile.txt.
    stem = re.sub(r"_Raw_\d+$", "", recording.stem)
    stems = {file: [file.name] for file in candidates}
    for used, file in pairs.items():
        stems[file].append(used.name)
    named = [file for file in candidates if any(name.startswith(stem) for name in stems[file])]
    # adc_data_1 also begins the name of adc_data_10.
    exact = [
        file
        for file in named
        if any(
            name.startswith(stem) and not name[len(stem) :][:1].isalnum() for name in stems[file]
        )
    ]
    for choice in (exact, named, candidates):
        if len(choice) == 1 or (choice and choice is not candidates and _say_the_same(choice)):
            return choice[0]
        if choice:
            break
    raise RecordingError(
        recording,
        got="a recording without settings of its own"
        + (f", beside {', '.join(file.name for file in choice)}" if candidates else ""),
        need="one whose radar is known",
        fix="Give the radar: --radar FILE (radar=FILE in Python), a YAML file or the settings"
        " file of its vendor.",
    )


def _say_the_same(files: Sequence[Path]) -> bool:
    """Whether several files are settings of one radar, and of one layout."""
    try:
        said = [replace(read_settings(file), path=None, findings=()) for file in files]
    except DechirpError:
        return False
    return all(one == said[0] for one in said)


def holds_settings(file: Path) -> bool:
    """Whether a file holds settings of a recording, of ours or of a vendor's."""
    # A meta.json describes a collection of recordings, not the radar.
    if file.suffix.lower() not in _SUFFIXES or file.name == "meta.json":
        return False
    if not mmwave_setup.lies_in_its_folder(file):
        return False
    try:
        text = _text(file)
    except RecordingError:
        return False
    if file.suffix.lower() == ".json":
        known = infineon_json.looks_like(text) or mmwave_json.looks_like(text)
        return known or _used_by(file) is not None
    if file.suffix.lower() in _YAML:
        return any(line.startswith("frame:") for line in text.splitlines())
    return studio_log.looks_like(text) or ti_cfg.looks_like(text)


def _used_by(file: Path) -> Path | None:
    """Settings file that a setup file names; None if it is none, or names none of its folder."""
    try:
        text = _text(file) if file.suffix.lower() == ".json" else ""
        return mmwave_setup.named_by(file, text)[0] if mmwave_setup.looks_like(text) else None
    except RecordingError:
        return None


def _text(file: Path) -> str:
    try:
        if not file.is_file():
            raise FileNotFoundError(2, "no such file")
        with file.open("rb") as bytes_in:
            content = bytes_in.read(_LARGEST_BYTES + 1)
        if len(content) > _LARGEST_BYTES:
            got = f"longer than {_LARGEST_BYTES} bytes"
        elif b"\0" in content:
            got = "not text"
        else:
            # Logs come from Windows, with paths in any code page.
            return content.decode("utf-8-sig", errors="replace")
    except OSError as error:
        got = f"not readable ({error.strerror})"
    raise RecordingError(
        file,
        got=got,
        need="a settings file: YAML, a TI .cfg, .mmwave.json or .setup.json, a mmWave Studio log"
        " or an Infineon config.json",
        fix="Give the file that says what the radar sent.",
    ) from None
