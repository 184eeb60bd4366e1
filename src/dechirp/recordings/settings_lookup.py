"""Settings of a recording: those that the user gave, else those of a file next to it."""

import re
from pathlib import Path

from dechirp.core.errors import DechirpError, RecordingError
from dechirp.core.findings import Finding
from dechirp.radar.array import Array
from dechirp.recordings.readers.base import RecordingHints
from dechirp.recordings.settings.base import RecordingSettings
from dechirp.recordings.settings.radar_example import RadarExample
from dechirp.recordings.settings.read import (
    choose_settings_file,
    list_settings_files,
    read_settings,
)


def find_recording_settings(
    path: Path, hints: RecordingHints, example: RadarExample | None = None
) -> RecordingSettings:
    """Return the settings of a recording.

    The example, with what is known of the recording, is for the message if there are none.

    Raises
    ------
    RecordingError
        If none were given, and none or several are next to it.
    """
    if hints.settings is not None:
        return hints.settings
    file, findings = choose_settings_file(path, example)
    return read_settings(file, hints.device).with_findings(*findings)


def find_optional_settings(
    path: Path, hints: RecordingHints
) -> tuple[RecordingSettings | None, tuple[Finding, ...]]:
    """Return the settings of a recording that can be read without them, and findings.

    Unlike those that the user gave, settings beside the recording may be of no use.
    """
    if hints.settings is not None:
        return hints.settings, hints.settings.findings
    files = list_settings_files(path)
    if not files:
        return None, ()
    try:
        settings = find_recording_settings(path, hints)
    except DechirpError as error:
        names = ", ".join(file.name for file in files[:4])
        note = Finding(
            level="note",
            setting="radar",
            value=f"unknown: {names} not used ({error.mistakes[0].value})",
            expected="one settings file that can be read, for the times and limits of the radar",
            fix="no action needed for the points; else give the radar: --radar FILE",
        )
        return None, (note,)
    return settings, settings.findings


def find_sub_frame_settings(path: Path, hints: RecordingHints) -> RecordingSettings:
    """Return the settings of raw samples: those of the sub-frame that the user named, or the first.

    Raises
    ------
    RecordingError
        If there are no settings, or no sub-frame of that name; or if the samples of a capture have
        headers or other data among them.
    """
    settings = find_recording_settings(path, hints)
    if settings.foreign_stream:
        raise RecordingError(
            path,
            value=f"samples with headers or other data among them: {settings.foreign_stream}",
            expected="samples alone: lvdsStreamCfg -1 0 1 0",
            fix="record so; or correct the settings if the capture has none",
        )
    if hints.inner_name is None:
        return settings
    number = re.fullmatch(r"(?:sub-?frame[-_]?)?(\d{1,4})", hints.inner_name.lower())
    n_sub_frames = len(settings.sub_frames)
    if number is None or int(number[1]) >= n_sub_frames:
        raise RecordingError(
            path,
            value=f"sub-frame {hints.inner_name!r}, in frames of"
            f" {n_sub_frames or 'a single'} sub-frame{'s' if n_sub_frames else ''}",
            expected=f"a number from 0 to {n_sub_frames - 1}" if n_sub_frames else "no name",
            fix=f"give {path.name}/0" if n_sub_frames else f"give {path.name} itself",
        )
    return settings.with_sub_frame(int(number[1]))


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
