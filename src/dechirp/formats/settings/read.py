"""Settings of a recording, from whatever file holds them."""

from pathlib import Path

from dechirp.config import files
from dechirp.core.errors import RecordingError
from dechirp.formats.settings import infineon_json, studio_log
from dechirp.formats.settings.base import Settings
from dechirp.radar.radar import Radar

_SUFFIXES = (".yaml", ".yml", ".txt", ".log", ".json")
_LARGEST_BYTES = 64 * 2**20


def read_radar(path: str | Path) -> Radar:
    """Radar from a settings file: our YAML, a mmWave Studio log, an Infineon `config.json`.

    Raises
    ------
    RecordingError
        If it is a vendor's file that cannot be read.
    InvalidFile
        If it is a YAML file with mistakes.
    """
    return read_settings(Path(path)).radar


def read_settings(file: Path) -> Settings:
    """Radar from a settings file, with what the file says of the recording's layout."""
    text = _text(file)
    if studio_log.looks_like(text):
        return studio_log.read(file, text)
    if file.suffix.lower() == ".json":
        return infineon_json.read(file, text)
    return Settings(radar=files.read(file, Radar))


def find_settings(recording: Path) -> Path:
    """Find the settings file beside a recording: of the same name, else the only one.

    Raises
    ------
    RecordingError
        If there is none, or several could be meant; it names them.
    """
    candidates = sorted(
        file
        for file in recording.parent.iterdir()
        if file != recording and file.suffix.lower() in _SUFFIXES and _holds_settings(file)
    )
    stem = recording.stem
    named = [file for file in candidates if file.stem.startswith(stem)]
    # adc_data_1 also begins the name of adc_data_10.
    exact = [file for file in named if not file.stem[len(stem) :][:1].isalnum()]
    for choice in (exact, named, candidates):
        if len(choice) == 1:
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


def _holds_settings(file: Path) -> bool:
    # A meta.json describes a collection of recordings, not the radar.
    if file.name == "meta.json" or not file.is_file():
        return False
    try:
        text = _text(file)
    except RecordingError:
        return False
    if file.suffix.lower() == ".json":
        return '"device_config"' in text
    if file.suffix.lower() in (".yaml", ".yml"):
        return any(line.startswith("frame:") for line in text.splitlines())
    return studio_log.looks_like(text)


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
        need="a settings file: YAML, a mmWave Studio log or an Infineon config.json",
        fix="Give the file that says what the radar sent.",
    ) from None
