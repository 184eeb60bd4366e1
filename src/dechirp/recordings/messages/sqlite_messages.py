"""Messages in an SQLite file of a ROS 2 bag (`.db3`), in the order of their times.

References
----------
ros2/rosbag2, rosbag2_storage_sqlite3: tables `topics` and `messages`.
"""

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

from dechirp.recordings.messages.ros import Message

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
