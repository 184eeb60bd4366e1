"""Settings of a recording from any supported settings file, and the search for that file."""

import os
import re
import shlex
from collections.abc import Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path

from dechirp.core.errors import DechirpError, RecordingError
from dechirp.core.findings import Finding
from dechirp.core.text import join_names
from dechirp.radar.devices.base import Device
from dechirp.radar.radar import Radar
from dechirp.recordings.foreign_files import stand_in_error
from dechirp.recordings.settings import (
    calterah_hxx,
    infineon_json,
    mmwave_json,
    mmwave_lua,
    mmwave_setup,
    mmwave_studio_log,
    mmwavelink_text,
    ti_cfg,
)
from dechirp.recordings.settings.base import RecordingSettings
from dechirp.recordings.settings.radar_example import RadarExample

_YAML = (".yaml", ".yml")
_SUFFIXES = (*_YAML, ".txt", ".log", ".json", ".cfg", ".lua")
# Files of the folder above that are read in search of settings: it may be a home folder.
_MAX_FILES_ABOVE = 64
_MAX_BYTES = 16 * 2**20  # a log of years; each line takes 8 more bytes of memory


def read_radar(path: str | Path, device: Device | None = None) -> Radar:
    """Read a radar from a settings file: native YAML, or a vendor's file.

    Vendor files are TI's `.cfg`, `.mmwave.json`, `.setup.json`, mmWave Studio log and `.lua`
    script, and `mmwaveconfig.txt` of mmWaveLink; Infineon's `config.json`, and Calterah's `.hxx`.
    The content determines the type, not the name.

    Parameters
    ----------
    path : path
        The file.
    device : Device, optional
        Device with the antenna positions; it has priority over the one named in the file. A YAML
        file has its own array.

    Raises
    ------
    RecordingError
        If it is a vendor's file that cannot be read.
    InvalidFile
        If it is a YAML file or a `.cfg` with mistakes.
    """
    return read_settings(Path(path), device).radar


def read_settings(file: Path, device: Device | None = None) -> RecordingSettings:
    """Read a radar and the layout of the recording from a settings file.

    See `read_radar` for supported files and errors.
    """
    text = _read_settings_text(file)
    name = file.name.lower()
    if mmwave_studio_log.is_mmwave_studio_log(text):
        settings = mmwave_studio_log.read_mmwave_studio_log(file, text, device)
    elif mmwave_lua.is_mmwave_lua(text) or name.endswith(".lua"):
        settings = mmwave_lua.read_mmwave_lua(file, text, device)
    elif ti_cfg.is_ti_cfg(text) or name.endswith(".cfg"):
        settings = ti_cfg.read_ti_cfg(file, text, device)
    elif mmwave_json.is_mmwave_json(text):
        settings = mmwave_json.read_mmwave_json(file, text, device)
    elif mmwave_setup.is_mmwave_setup(text):
        used, chip = mmwave_setup.find_named_settings_and_chip(file, text)
        settings = mmwave_json.read_mmwave_json(used, _read_settings_text(used), device, chip)
    elif mmwavelink_text.is_mmwavelink_text(text):
        settings = mmwavelink_text.read_mmwavelink_text(file, text, device)
    elif calterah_hxx.is_calterah_hxx(text):
        settings = calterah_hxx.read_calterah_hxx(file, text)
    elif infineon_json.is_infineon_json(text) or name.endswith(".json"):
        settings = infineon_json.read_infineon_json(file, text, device)
    else:
        # Only here, as it takes 0.07 s to import.
        from dechirp.recordings.settings.native import read_native_settings

        settings = read_native_settings(file, text, device)
    return replace(settings.completed_from_device(device), path=file)


def find_settings_file(recording: Path) -> Path:
    """Find the settings file beside a recording, see `choose_settings_file`."""
    return choose_settings_file(recording)[0]


def choose_settings_file(
    recording: Path, example: RadarExample | None = None
) -> tuple[Path, tuple[Finding, ...]]:
    """Choose the settings file beside a recording, with a finding where only words decide.

    The example, with what is known of the recording, is for the message if there is none.

    It is the one of the same name, else the only one, else the only one that shares a word of its
    name with this recording, else the only one without a word of the other recordings.

    A `.setup.json` and the `.mmwave.json` that it names count as one; of several equivalent files
    with the recording's name, the first is used. A script counts if there is nothing else, since
    a folder may contain scripts of other measurements. Links that lead out of the folder are
    ignored.

    Raises
    ------
    RecordingError
        If there is none, or several are possible; the message names them.
    """
    candidates, setup_files = _find_settings_candidates(recording)
    # mmWave Studio calls the settings of adc_data_Raw_0.bin adc_data_LogFile.txt.
    stem = re.sub(r"_Raw_\d+$", "", recording.stem)
    stems = {file: [file.name] for file in candidates}
    for named_file, file in setup_files.items():
        stems[file].append(named_file.name)
    named = [file for file in candidates if any(name.startswith(stem) for name in stems[file])]
    # adc_data_1 is also a prefix of adc_data_10.
    exact = [
        file
        for file in named
        if any(
            name.startswith(stem) and not name[len(stem) :][:1].isalnum() for name in stems[file]
        )
    ]
    # Split captures share the settings of adc_data_0.bin and adc_data_1.bin: adc_data.cfg.
    of_all_parts = re.sub(r"_\d+$", "", stem)
    common = [file for file in candidates if file.name.partition(".")[0] == of_all_parts]
    scripts = [file for file in candidates if file.suffix.lower() == ".lua"]
    others = [file for file in candidates if file not in scripts] or scripts
    for choices in (exact, named, common, others):
        if len(choices) == 1 or (
            choices and choices is not others and _have_equal_settings(choices)
        ):
            return choices[0], ()
        if choices:
            break
    if not candidates:
        pointer_error = _find_pointer_to_settings_error(recording)
        if pointer_error is not None:
            raise pointer_error
        above = _list_settings_in_folder_above(recording)
        if above:
            raise RecordingError(
                recording,
                value="no settings in the recording; in the folder above"
                f" {join_names(file.name for file in above)}",
                expected="the radar of the recording",
                fix="give those of this recording (radar=... in Python), or copy them beside it: "
                + join_names(f"--radar {shlex.quote(str(file))}" for file in above),
            )
        unused = [file.name for file in recording.parent.glob("*.cfg") if file.is_file()]
        raise RecordingError(
            recording,
            value="no settings in the recording"
            + (f"; not those of a radar: {join_names(sorted(unused))}" if unused else ""),
            expected="the radar of the recording",
            fix=(example or RadarExample()).advice(recording),
        )
    shared, foreign = _shared_and_foreign_words(choices, recording)
    matching = [file for file in choices if shared[file]]
    neutral = [file for file in choices if not foreign[file]]
    for chosen, why in (
        (matching, "it alone shares a word with the name of the recording: {}"),
        (neutral, "the others have words of other recordings in their names: {}"),
    ):
        if len(chosen) == 1:
            (file,) = chosen
            words = shared[file] if chosen is matching else set().union(*foreign.values())
            return file, (_settings_by_words_finding(file, choices, why.format(join_names(words))),)
    ordered = sorted(choices, key=lambda file: (-len(shared[file]), len(foreign[file])))
    raise RecordingError(
        recording,
        value="no settings in the recording; in the folder"
        f" {join_names(file.name for file in choices)}",
        expected="the radar of the recording",
        fix="give the one of this recording (radar=... in Python), or name it like the recording: "
        + join_names(f"--radar {shlex.quote(str(file))}" for file in ordered),
    )


def _shared_and_foreign_words(
    settings_files: list[Path], recording: Path
) -> tuple[dict[Path, set[str]], dict[Path, set[str]]]:
    """Return words of the names of settings files that distinguish recordings of the folder.

    Those that the name of this recording contains, but not the names of all settings files; and
    those that names of other recordings contain, but not that of this one.
    """

    def words(file: Path) -> set[str]:
        return {word for word in re.split(r"[\W_]+", file.stem.lower()) if word}

    similar = [file for file in recording.parent.glob(f"*{recording.suffix}") if file != recording]
    others = set().union(*map(words, similar)) - words(recording)
    of_all = set.intersection(*map(words, settings_files))
    shared = {file: (words(file) & words(recording)) - of_all for file in settings_files}
    return shared, {file: words(file) & others for file in settings_files}


def _settings_by_words_finding(file: Path, choices: list[Path], reason: str) -> Finding:
    """Return the note that a settings file was chosen by the words of its name."""
    others = [choice for choice in choices if choice != file]
    return Finding(
        level="note",
        setting="radar",
        value=f"chosen --radar {shlex.quote(str(file))} because {reason}",
        expected=f"the settings of this recording, out of {len(choices)} files of the folder",
        fix="no action needed if they are; else give --radar"
        f" {shlex.quote(str(others[0]))}, and name it like the recording",
    )


def _find_pointer_to_settings_error(recording: Path) -> RecordingError | None:
    """Return the error of a file beside a recording that stands in for settings, such as of LFS."""
    for file in sorted(recording.parent.iterdir()):
        suffix = file.suffix.lower()
        is_candidate = file != recording and suffix in _SUFFIXES and suffix != ".txt"
        if is_candidate and mmwave_setup.is_file_not_linked_outside_folder(file):
            error = stand_in_error(file) if os.access(file, os.R_OK) else None
            if error is not None:
                return error
    return None


def _list_settings_in_folder_above(recording: Path) -> list[Path]:
    """Return the settings files of the folder that contains that of the recording."""
    folder = recording.absolute().parent
    try:
        files = sorted(islice(folder.parent.iterdir(), _MAX_FILES_ABOVE))
    except OSError:
        return []
    # As the user gave the path, which may be relative to this folder.
    parent = recording.parent.parent if recording.parent.name else folder.parent
    return [parent / file.name for file in files if file.is_file() and holds_settings(file)]


def list_settings_files(recording: Path) -> list[Path]:
    """Return all files beside a recording that contain settings."""
    return _find_settings_candidates(recording)[0]


def _find_settings_candidates(recording: Path) -> tuple[list[Path], dict[Path, Path]]:
    """Return the settings files beside a recording, and the setup file of each file named in one.

    The setup file stands for both.
    """
    candidates = sorted(
        file for file in recording.parent.iterdir() if file != recording and holds_settings(file)
    )
    setup_files = {
        named_file: file
        for file in candidates
        if (named_file := _settings_file_named_in(file)) is not None
    }
    return [file for file in candidates if file not in setup_files], setup_files


def _have_equal_settings(files: Sequence[Path]) -> bool:
    """Return whether several files contain the same radar and layout."""
    try:
        settings = [replace(read_settings(file), path=None, findings=()) for file in files]
    except DechirpError:
        return False
    return all(file_settings == settings[0] for file_settings in settings)


def holds_settings(file: Path) -> bool:
    """Return whether a file contains settings of a recording, native or a vendor's."""
    # A meta.json describes a collection of recordings, not the radar.
    if file.suffix.lower() not in _SUFFIXES or file.name == "meta.json":
        return False
    if not mmwave_setup.is_file_not_linked_outside_folder(file):
        return False
    try:
        text = _read_settings_text(file)
    except RecordingError:
        return False
    if file.suffix.lower() == ".json":
        is_recognised = infineon_json.is_infineon_json(text) or mmwave_json.is_mmwave_json(text)
        return is_recognised or _settings_file_named_in(file) is not None
    if file.suffix.lower() in _YAML:
        return any(line.startswith("frame:") for line in text.splitlines())
    is_recognised = mmwave_lua.is_mmwave_lua(text) or mmwave_studio_log.is_mmwave_studio_log(text)
    is_recognised = is_recognised or mmwavelink_text.is_mmwavelink_text(text)
    return is_recognised or ti_cfg.is_ti_cfg(text)


def _settings_file_named_in(setup_file: Path) -> Path | None:
    """Return the settings file that a setup file names; None for other files."""
    try:
        text = _read_settings_text(setup_file) if setup_file.suffix.lower() == ".json" else ""
        return (
            mmwave_setup.find_named_settings_and_chip(setup_file, text)[0]
            if mmwave_setup.is_mmwave_setup(text)
            else None
        )
    except RecordingError:
        return None


def _read_settings_text(file: Path) -> str:
    """Read the text of a settings file; raise `RecordingError` if it cannot be read."""
    try:
        if not file.is_file():
            raise FileNotFoundError(2, "no such file")
        with file.open("rb") as bytes_in:
            content = bytes_in.read(_MAX_BYTES + 1)
        if content.startswith((b"\xff\xfe", b"\xfe\xff")):
            # Editors and shells of Windows write UTF-16.
            content = content.decode("utf-16", errors="replace").encode()
        if len(content) > _MAX_BYTES:
            problem = f"longer than {_MAX_BYTES} bytes"
        elif b"\0" in content:
            problem = "not text"
        else:
            error = stand_in_error(file)
            if error is not None:
                raise error
            # Logs come from Windows and contain paths in any code page.
            return content.decode("utf-8-sig", errors="replace")
    except OSError as error:
        problem = f"not readable ({error.strerror})"
    raise RecordingError(
        file,
        value=problem,
        expected="a settings file: YAML, a TI .cfg, .mmwave.json or .setup.json, a mmWave Studio"
        " log or .lua script, or an Infineon config.json",
        fix="give the settings file of the radar",
    ) from None
