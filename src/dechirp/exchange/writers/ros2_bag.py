"""Bags of ROS 2 (`.ros2`): a folder with detections as clouds of points, in SQLite."""

import sqlite3
from collections.abc import Iterable
from pathlib import Path
from typing import Any, ClassVar

from dechirp.core.extra import library
from dechirp.core.values import value
from dechirp.exchange.point_clouds import KEEPS, messages, must_have_detections
from dechirp.exchange.ros_messages import keeps_for_late_listeners
from dechirp.exchange.writers.base import Progress, Writer
from dechirp.formats.messages.ros import CLOUD, Message, types
from dechirp.formats.recording import Recording
from dechirp.formats.ros2_bag import METADATA
from dechirp.store.whole import must_be_replaceable, whole_folder

_VERSION = 8  # of bags: ROS 2 Iron and later; 9 writes qualities of service as words


@value
class Ros2Bag(Writer):
    """Detections and tables as messages in a bag of ROS 2, storage sqlite3."""

    endings: ClassVar[tuple[str, ...]] = (".ros2",)
    keeps: ClassVar[str] = KEEPS
    of_detections: ClassVar[bool] = True

    def check(self, recording: Recording) -> None:
        """See `Writer.check`."""
        types()
        must_have_detections(recording)

    def write(
        self, recording: Recording, out: Path, progress: Progress | None = None
    ) -> tuple[Path, ...]:
        """See `Writer.write`."""
        name = f"{out.stem}.db3"
        must_be_replaceable(out, mark=METADATA, ours=(METADATA, name))
        with whole_folder(out) as made:
            inner = made / out.stem  # the library wants a new folder, and names its file after it
            try:
                _write(inner, messages(recording, progress))
            except sqlite3.Error as error:  # a full disk, in its words
                raise OSError(str(error)) from None
            for file in (METADATA, name):
                (inner / file).rename(made / file)
            inner.rmdir()
        return (out,)


def _write(folder: Path, sent: Iterable[Message]) -> None:
    topics: dict[str, Any] = {}
    with library("rosbags.rosbag2", of="recording").Writer(folder, version=_VERSION) as bag:
        for topic, kind, time_ns, data in sent:
            if topic not in topics:
                quality = [] if kind == CLOUD else [keeps_for_late_listeners()]
                topics[topic] = bag.add_connection(
                    topic, kind, typestore=types(), offered_qos_profiles=quality
                )
            bag.write(topics[topic], time_ns, data)
