"""ROS 2 bags with radar point clouds, without samples.

A folder with `metadata.yaml`, which names the message files (`.db3` or `.mcap`) in it; or a `.db3`
file alone.

References
----------
ros2/rosbag2, rosbag2_storage_sqlite3: tables `topics` and `messages`.
"""

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path, PurePath
from typing import Any, ClassVar

from dechirp.config.yaml_tree import parse_yaml
from dechirp.core import mcap_messages
from dechirp.core.errors import InvalidFile, RecordingError
from dechirp.core.mcap_messages import Message
from dechirp.core.values import frozen_dataclass
from dechirp.recordings.arrays.lazy_array import convert_parser_errors
from dechirp.recordings.messages.contents import messages_to_contents
from dechirp.recordings.readers.base import (
    Contents,
    Format,
    MatchQuality,
    RecordingHints,
    check_stays_in_folder,
)

_MESSAGES = """
SELECT topics.name, topics.type, messages.timestamp, messages.data
FROM messages JOIN topics ON messages.topic_id = topics.id
ORDER BY messages.timestamp, messages.id
"""
_TABLES = """
SELECT count(*) FROM sqlite_master
WHERE type = 'table' AND name IN ('topics', 'messages') AND sql NOT LIKE '%virtual%'
"""


def iter_sqlite_messages(path: Path) -> Iterator[Message]:
    """Yield all messages; raises any error of SQLite for damaged bytes."""
    # Read-only and immutable: SQLite takes no lock and creates no files.
    address = f"{path.absolute().as_uri()}?mode=ro&immutable=1"
    with closing(sqlite3.connect(address, uri=True)) as file:
        # No value can be larger than the file, whatever its columns declare.
        file.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, max(path.stat().st_size, 2**20))
        file.execute("PRAGMA trusted_schema = OFF")
        if file.execute(_TABLES).fetchone() != (2,):
            raise ValueError("no tables topics and messages")
        for topic, kind, time_ns, data in file.execute(_MESSAGES):
            if not isinstance(data, bytes):
                raise ValueError("a message that is not bytes")
            yield Message(str(topic), str(kind), int(time_ns), data)


METADATA = "metadata.yaml"
_SQLITE = b"SQLite format 3\0"

_MARK = "rosbag2_bagfile_information"
_MAX_METADATA_BYTES = 2**20  # bytes of metadata; a topic takes a few hundred
_STORAGES = {
    "sqlite3": iter_sqlite_messages,
    "mcap": mcap_messages.iter_mcap_messages,
}
_EXPECTED = "a complete ROS 2 bag with storage sqlite3 or mcap, without bag compression"


@frozen_dataclass
class Ros2Bag(Format):
    """Detections in a ROS 2 bag: point clouds (`sensor_msgs/msg/PointCloud2`), or radar_msgs.

    The folder of the bag, with storage sqlite3 or mcap, or its `.db3` file. Needs the extra `io`.
    """

    options: ClassVar[tuple[str, ...]] = ("inner_name",)

    def recognise(self, path: Path) -> MatchQuality:
        if path.is_file():
            is_bag = _is_sqlite_bag(path)
            return MatchQuality.SELF_DESCRIBING if is_bag else MatchQuality.NO
        metadata = path / METADATA
        if not metadata.is_file():
            return MatchQuality.NO
        with metadata.open("rb") as file:
            return (
                MatchQuality.SELF_DESCRIBING
                if _MARK.encode() in file.read(_MAX_METADATA_BYTES)
                else MatchQuality.NO
            )

    def read(self, path: Path, hints: RecordingHints) -> Contents:
        if path.is_file():
            return messages_to_contents(path, iter_sqlite_messages(path), hints, _EXPECTED)
        with convert_parser_errors(path, _EXPECTED):
            metadata = _read_bag_metadata(path)
            storage, names = metadata["storage_identifier"], metadata["relative_file_paths"]
            compression = str(metadata.get("compression_mode") or "none").lower()
            if storage not in _STORAGES or compression != "none":
                raise RecordingError(
                    path,
                    value=f"a bag with storage {storage!r} and compression {compression!r}",
                    expected=_EXPECTED,
                    fix="convert it: ros2 bag convert",
                )
            # Before bag version 4, file names begin with the folder name.
            files = [path / PurePath(str(name)).name for name in names]
            for file in files:
                check_stays_in_folder(path, file)
                if not file.is_file():
                    raise FileNotFoundError(f"no {file.name}")

        def messages() -> Iterator[Message]:
            for file in files:
                yield from _STORAGES[storage](file)

        return messages_to_contents(path, messages(), hints, _EXPECTED)


def _is_sqlite_bag(path: Path) -> bool:
    """Return whether a file is an SQLite database with the tables of a bag, even if damaged."""
    with path.open("rb") as file:
        if file.read(len(_SQLITE)) != _SQLITE:
            return False
    address = f"{path.absolute().as_uri()}?mode=ro&immutable=1"
    try:
        with closing(sqlite3.connect(address, uri=True)) as database:
            return bool(database.execute(_TABLES).fetchone() == (2,))
    except (sqlite3.Error, OverflowError, MemoryError, UnicodeDecodeError):
        # `UnicodeDecodeError`: a damaged name in SQLite's own message.
        return path.suffix.lower() == ".db3"  # `read` reports the damage


def _read_bag_metadata(path: Path) -> dict[str, Any]:
    """Read the metadata of a bag; raise `ValueError` if they are damaged."""
    with (path / METADATA).open("rb") as file:
        text = file.read(_MAX_METADATA_BYTES).decode()
    try:
        document = parse_yaml(text, str(path / METADATA)).plain_data
    except InvalidFile as error:
        raise ValueError(str(error)) from None
    metadata = document[_MARK] if isinstance(document, dict) else None
    if not isinstance(metadata, dict):
        raise ValueError(f"no {_MARK}")
    return metadata
