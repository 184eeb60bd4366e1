"""ROS 2 bags (`.ros2`): a folder with detections as point clouds, in SQLite."""

import sqlite3
from collections.abc import Iterable
from pathlib import Path
from typing import Any, ClassVar

from dechirp.core.atomic_files import atomic_folder, check_output_folder_replaceable
from dechirp.core.mcap_messages import Message
from dechirp.core.optional_imports import import_from_extra
from dechirp.core.values import frozen_dataclass
from dechirp.recordings.messages.ros import POINT_TYPES, ros2_message_type_store
from dechirp.recordings.readers.ros2_bag import METADATA
from dechirp.recordings.recording import Recording
from dechirp.recordings.writers.base import Progress, Writer
from dechirp.recordings.writers.point_clouds import (
    SUMMARY,
    check_has_detections,
    iter_ros2_messages,
)
from dechirp.recordings.writers.ros_messages import transient_local_qos

_VERSION = 8  # bag version of ROS 2 Iron and later; 9 writes qualities of service as words


@frozen_dataclass
class Ros2Bag(Writer):
    """Detections and tables as messages in a bag of ROS 2, storage sqlite3."""

    suffixes: ClassVar[tuple[str, ...]] = (".ros2",)
    summary: ClassVar[str] = SUMMARY
    holds_detections: ClassVar[bool] = True

    def check_recording(self, recording: Recording) -> None:
        ros2_message_type_store()
        check_has_detections(recording)

    def write(
        self, recording: Recording, out: Path, progress: Progress | None = None
    ) -> tuple[Path, ...]:
        name = f"{out.stem}.db3"
        check_output_folder_replaceable(out, marker_file=METADATA, own_names=(METADATA, name))
        with atomic_folder(out) as temporary:
            # The library creates the folder and names its file after it.
            inner = temporary / out.stem
            try:
                _write_bag(inner, iter_ros2_messages(recording, progress))
            except sqlite3.Error as error:  # such as a full disk
                raise OSError(str(error)) from None
            for file in (METADATA, name):
                (inner / file).rename(temporary / file)
            inner.rmdir()
        return (out,)


def _write_bag(folder: Path, messages: Iterable[Message]) -> None:
    topics: dict[str, Any] = {}
    with import_from_extra("io", "rosbags.rosbag2", setting="recording").Writer(
        folder, version=_VERSION
    ) as bag:
        for topic, kind, time_ns, data in messages:
            if topic not in topics:
                quality = [] if kind in POINT_TYPES else [transient_local_qos()]
                topics[topic] = bag.add_connection(
                    topic, kind, typestore=ros2_message_type_store(), offered_qos_profiles=quality
                )
            bag.write(topics[topic], time_ns, data)
