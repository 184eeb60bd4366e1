"""ROS 1 bags with radar point clouds, without samples."""

from pathlib import Path
from typing import ClassVar

from dechirp.core.values import frozen_dataclass
from dechirp.recordings.messages.contents import messages_to_contents
from dechirp.recordings.messages.ros1_bag_messages import MAGIC, iter_ros1_messages
from dechirp.recordings.readers.base import Contents, Format, MatchQuality, RecordingHints


@frozen_dataclass
class Ros1Bag(Format):
    """Detections in a ROS 1 bag: point clouds (`sensor_msgs/PointCloud2`).

    Version 2.0, with chunks that are not compressed or with bz2 or lz4. Needs the extra `io`.
    """

    options: ClassVar[tuple[str, ...]] = ("inner_name",)

    def recognise(self, path: Path) -> MatchQuality:
        if not path.is_file():
            return MatchQuality.NO
        with path.open("rb") as file:
            return (
                MatchQuality.SELF_DESCRIBING if file.read(len(MAGIC)) == MAGIC else MatchQuality.NO
            )

    def read(self, path: Path, hints: RecordingHints) -> Contents:
        return messages_to_contents(
            path, iter_ros1_messages(path), hints, "a complete ROS 1 bag of version 2.0"
        )
