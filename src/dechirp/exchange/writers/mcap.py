"""MCAP files (`.mcap`): detections as clouds of points, for Foxglove, ROS 2 and others."""

from pathlib import Path
from typing import ClassVar

from dechirp.core.extra import library
from dechirp.core.values import value
from dechirp.exchange.point_clouds import KEEPS, messages, must_have_detections
from dechirp.exchange.ros_messages import keeps_for_late_listeners
from dechirp.exchange.writers.base import Progress, Writer
from dechirp.formats.messages.ros import CLOUD, types
from dechirp.formats.recording import Recording
from dechirp.store.whole import whole_file


@value
class Mcap(Writer):
    """Detections and tables as messages of ROS 2 (profile `ros2`), compressed with zstd."""

    endings: ClassVar[tuple[str, ...]] = (".mcap",)
    keeps: ClassVar[str] = KEEPS
    of_detections: ClassVar[bool] = True

    def check(self, recording: Recording) -> None:
        """See `Writer.check`."""
        library("mcap", of="recording")
        types()
        must_have_detections(recording)

    def write(
        self, recording: Recording, out: Path, progress: Progress | None = None
    ) -> tuple[Path, ...]:
        """See `Writer.write`."""
        channels: dict[str, int] = {}
        with whole_file(out) as made, made.open("wb") as file:
            bag = library("mcap.writer", of="recording").Writer(file, enable_data_crcs=True)
            bag.start(profile="ros2", library="dechirp")
            for topic, kind, time_ns, data in messages(recording, progress):
                if topic not in channels:
                    text, _ = types().generate_msgdef(kind, ros_version=2)
                    schema = bag.register_schema(kind, "ros2msg", text.encode())
                    channels[topic] = bag.register_channel(topic, "cdr", schema, _quality(kind))
                bag.add_message(channels[topic], time_ns, data, time_ns)
            bag.finish()
        return (out,)


def _quality(kind: str) -> dict[str, str]:
    """Words of rosbag2 about a channel, by the type of its messages."""
    if kind == CLOUD:
        return {}
    metadata = library("rosbags.rosbag2.metadata", of="recording")
    return {"offered_qos_profiles": metadata.dump_qos_v8([keeps_for_late_listeners()])}
