"""The settings of a recording: those that were told, else those of the file beside it."""

from pathlib import Path

from dechirp.core.findings import Finding
from dechirp.formats.base import Told
from dechirp.formats.settings.base import Settings
from dechirp.formats.settings.read import find_settings, read_settings
from dechirp.radar.array import Array


def settings_for(path: Path, told: Told) -> Settings:
    """Settings that belong to a recording.

    Raises
    ------
    RecordingError
        If nobody gave any, and none or several lie beside it.
    """
    return told.settings or read_settings(find_settings(path), told.device)


def untold_receivers(settings: Settings) -> tuple[Finding, ...]:
    """Warn where bare numbers are read as those of one receiver because nobody gave any other.

    Those of four would come out as four times the frames, and nothing in them speaks against it.
    """
    if settings.radar.array != Array() or settings.receivers is not None:
        return ()
    return (
        Finding(
            level="warning",
            setting="radar.array.rx",
            got="not given, taken as one receiver",
            need="as many as were recorded: samples of more would be taken for more frames",
            fix="Give radar.array.rx, or the settings file of the vendor.",
        ),
    )
