"""The settings of a recording: those that were told, else those of the file beside it."""

from pathlib import Path

from dechirp.formats.base import Told
from dechirp.formats.settings.base import Settings
from dechirp.formats.settings.read import find_settings, read_settings


def settings_for(path: Path, told: Told) -> Settings:
    """Settings that belong to a recording.

    Raises
    ------
    RecordingError
        If nobody gave any, and none or several lie beside it.
    """
    return told.settings or read_settings(find_settings(path), told.device)
