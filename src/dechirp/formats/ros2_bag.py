"""Bags of ROS 2 with clouds of points that radars detected, no samples.

A folder with `metadata.yaml`, which names the files of messages in it (`.db3` or `.mcap`).
"""

from collections.abc import Iterator
from pathlib import Path, PurePath
from typing import Any, ClassVar

from dechirp.config.tree import read_tree
from dechirp.core.errors import InvalidFile, RecordingError
from dechirp.core.values import value
from dechirp.formats.arrays.stored import parsing
from dechirp.formats.base import Contents, Fit, Format, Told, must_stay_in
from dechirp.formats.messages import in_mcap, in_sqlite
from dechirp.formats.messages.contents import contents_of
from dechirp.formats.messages.ros import Message

METADATA = "metadata.yaml"

_MARK = "rosbag2_bagfile_information"
_LONGEST = 2**20  # bytes of metadata: a topic takes a few hundred
_STORAGES = {"sqlite3": in_sqlite.messages, "mcap": in_mcap.messages}
_NEED = "a bag of ROS 2, whole, in sqlite3 or mcap and without compression of its own"


@value
class Ros2Bag(Format):
    """Detections in a bag of ROS 2: clouds of points (`sensor_msgs/msg/PointCloud2`).

    Its folder, of storage sqlite3 or mcap. Needs the extra `io`.
    """

    options: ClassVar[tuple[str, ...]] = ("inside",)

    def recognise(self, path: Path) -> Fit:
        """Tell by what its metadata begin with."""
        metadata = path / METADATA
        if not metadata.is_file():
            return Fit.NO
        with metadata.open("rb") as file:
            return Fit.OWN if _MARK.encode() in file.read(_LONGEST) else Fit.NO

    def read(self, path: Path, told: Told) -> Contents:
        """See `Format.read`."""
        with parsing(path, _NEED):
            about = _metadata(path)
            storage, names = about["storage_identifier"], about["relative_file_paths"]
            packed = str(about.get("compression_mode") or "none").lower()
            if storage not in _STORAGES or packed != "none":
                raise RecordingError(
                    path,
                    got=f"a bag of storage {storage!r} and compression {packed!r}",
                    need=_NEED,
                    fix="Convert it: ros2 bag convert.",
                )
            # Before version 4 of bags, names begin with that of the folder.
            files = [path / PurePath(str(name)).name for name in names]
            for file in files:
                must_stay_in(path, file)
                if not file.is_file():
                    raise FileNotFoundError(f"no {file.name}")

        def messages() -> Iterator[Message]:
            for file in files:
                yield from _STORAGES[storage](file)

        return contents_of(path, messages(), told, _NEED)


def _metadata(path: Path) -> dict[str, Any]:
    with (path / METADATA).open("rb") as file:
        text = file.read(_LONGEST).decode()
    try:
        said = read_tree(text, str(path / METADATA)).plain
    except InvalidFile as error:
        raise ValueError(str(error)) from None
    about = said[_MARK] if isinstance(said, dict) else None
    if not isinstance(about, dict):
        raise ValueError(f"no {_MARK}")
    return about
