"""MCAP files with clouds of points that radars detected, no samples."""

from pathlib import Path
from typing import ClassVar

from dechirp.core.extra import library
from dechirp.core.values import value
from dechirp.formats.base import Contents, Fit, Format, Told
from dechirp.formats.messages.contents import contents_of
from dechirp.formats.messages.in_mcap import MAGIC, messages


@value
class Mcap(Format):
    """Detections in an MCAP file: clouds of points (`sensor_msgs/msg/PointCloud2`).

    Needs the extra `io`.
    """

    options: ClassVar[tuple[str, ...]] = ("inside",)

    def recognise(self, path: Path) -> Fit:
        """Tell by its first bytes."""
        if not path.is_file():
            return Fit.NO
        with path.open("rb") as file:
            return Fit.OWN if file.read(len(MAGIC)) == MAGIC else Fit.NO

    def read(self, path: Path, told: Told) -> Contents:
        """See `Format.read`."""
        library("mcap", of="recording")
        return contents_of(path, messages(path), told, "an MCAP file, whole")
