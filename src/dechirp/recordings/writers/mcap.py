"""MCAP files (`.mcap`): detections as point clouds for Foxglove, ROS 2 and others."""

from pathlib import Path
from typing import ClassVar

from dechirp.core.atomic_files import atomic_file
from dechirp.core.optional_imports import import_from_extra
from dechirp.core.values import frozen_dataclass
from dechirp.recordings.messages.ros import POINT_TYPES, ros2_message_type_store
from dechirp.recordings.recording import Recording
from dechirp.recordings.writers.base import Progress, Writer
from dechirp.recordings.writers.point_clouds import (
    SUMMARY,
    check_has_detections,
    iter_ros2_messages,
)
from dechirp.recordings.writers.ros_messages import transient_local_qos


@frozen_dataclass
class Mcap(Writer):
    """Detections and tables as messages of ROS 2 (profile `ros2`), compressed with zstd."""

    suffixes: ClassVar[tuple[str, ...]] = (".mcap",)
    summary: ClassVar[str] = SUMMARY
    holds_detections: ClassVar[bool] = True

    def check_recording(self, recording: Recording) -> None:
        import_from_extra("io", "mcap", setting="recording")
        ros2_message_type_store()
        check_has_detections(recording)

    def write(
        self, recording: Recording, out: Path, progress: Progress | None = None
    ) -> tuple[Path, ...]:
        channels: dict[str, int] = {}
        with atomic_file(out) as temporary, temporary.open("wb") as file:
            bag = import_from_extra("io", "mcap.writer", setting="recording").Writer(
                file, enable_data_crcs=True
            )
            bag.start(profile="ros2", library="dechirp")
            for topic, kind, time_ns, data in iter_ros2_messages(recording, progress):
                if topic not in channels:
                    text, _ = ros2_message_type_store().generate_msgdef(kind, ros_version=2)
                    schema = bag.register_schema(kind, "ros2msg", text.encode())
                    channels[topic] = bag.register_channel(
                        topic, "cdr", schema, _rosbag_qos_metadata(kind)
                    )
                bag.add_message(channels[topic], time_ns, data, time_ns)
            bag.finish()
        return (out,)


def _rosbag_qos_metadata(kind: str) -> dict[str, str]:
    """Return the rosbag2 metadata of a channel for its message type."""
    if kind in POINT_TYPES:
        return {}
    metadata = import_from_extra("io", "rosbags.rosbag2.metadata", setting="recording")
    return {"offered_qos_profiles": metadata.dump_qos_v8([transient_local_qos()])}
