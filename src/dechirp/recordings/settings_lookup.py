"""Settings of a recording: those that the user gave, else those of a file next to it."""

from pathlib import Path

from dechirp.core.findings import Finding
from dechirp.radar.array import Array
from dechirp.recordings.readers.base import RecordingHints
from dechirp.recordings.settings.base import RecordingSettings
from dechirp.recordings.settings.read import find_settings_file, read_settings


def find_recording_settings(path: Path, hints: RecordingHints) -> RecordingSettings:
    """Return the settings of a recording.

    Raises
    ------
    RecordingError
        If none were given, and none or several are next to it.
    """
    return hints.settings or read_settings(find_settings_file(path), hints.device)


def assumed_single_receiver_findings(settings: RecordingSettings) -> tuple[Finding, ...]:
    """Warn if raw samples are read as those of one receiver because no array was given.

    Samples of four receivers would be read as four times the frames, without any error.
    """
    if settings.radar.array != Array() or settings.receivers is not None:
        return ()
    return (
        Finding(
            level="warning",
            setting="radar.array.rx",
            value="missing, assumed to be one receiver",
            expected="the recorded receivers, since samples of more would be read as more frames",
            fix="give radar.array.rx, or the vendor's settings file",
        ),
    )
