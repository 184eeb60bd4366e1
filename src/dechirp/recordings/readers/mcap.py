"""MCAP files with radar point clouds, without samples."""

from pathlib import Path
from typing import ClassVar

from dechirp.core.mcap_messages import MAGIC, iter_mcap_messages
from dechirp.core.optional_imports import import_from_extra
from dechirp.core.values import frozen_dataclass
from dechirp.recordings.messages.contents import messages_to_contents
from dechirp.recordings.readers.base import Contents, Format, MatchQuality, RecordingHints


@frozen_dataclass
class Mcap(Format):
    """Detections in an MCAP file: point clouds (`sensor_msgs/msg/PointCloud2`).

    Needs the extra `io`.
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
        import_from_extra("io", "mcap", setting="recording")
        return messages_to_contents(path, iter_mcap_messages(path), hints, "a complete MCAP file")
