"""Contents of a message file: a native recording, or point clouds of a foreign radar."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from dechirp.core.errors import RecordingError
from dechirp.core.mcap_messages import Message
from dechirp.recordings.arrays.lazy_array import convert_parser_errors
from dechirp.recordings.description import is_native_description
from dechirp.recordings.messages import foreign_point_clouds, native_tables
from dechirp.recordings.messages.message_arrays import collect_message_arrays
from dechirp.recordings.messages.ros import ros2_message_type_store
from dechirp.recordings.native import check_device_and_iq_hints
from dechirp.recordings.readers.base import Contents, RecordingHints


def messages_to_contents(
    path: Path, messages: Iterable[Message], hints: RecordingHints, expected: str
) -> Contents:
    """Read all messages of a file.

    Raises
    ------
    RecordingError
        If they are damaged, or none are points of a radar.
    InvalidSetting
        If the extra `io` is missing.
    """
    ros2_message_type_store()  # a missing extra is no damage
    settings = hints.settings
    radar = None if settings is None else settings.radar
    with convert_parser_errors(path, expected):
        arrays = collect_message_arrays(path, messages, hints.inner_name)
        text = arrays.description
        if text is None or not is_native_description(text):
            contents = foreign_point_clouds.read_foreign_detections(
                path, arrays, radar, hints.inner_name
            )
        elif hints.inner_name is None:
            contents = native_tables.read_native_message_contents(path, text, arrays, radar)
            check_device_and_iq_hints(path, hints, device=contents.device, iq=contents.iq)
        else:
            raise RecordingError(
                path,
                value=f"topic {hints.inner_name!r} of a recording written by dechirp",
                expected="the recording itself, whose detections and tables belong together",
                fix=f"open {path.name}",
            )
    setting_findings = () if settings is None else settings.findings
    return replace(contents, findings=(*setting_findings, *contents.findings))
