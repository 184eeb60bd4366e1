"""Messages in a ROS 1 bag of version 2.0, in the order of the file.

Records are read one after the other, so that bags without their index are read as well. Chunks are
decompressed one at a time, to exactly their declared size and never more than 256 MiB.

References
----------
ROS wiki, "Bags/Format/2.0": a record is a header of fields `name=value` and its data, each preceded
by its length.
"""

import bz2
import mmap
import struct
from collections.abc import Iterator
from pathlib import Path

from dechirp.core.mcap_messages import Message
from dechirp.core.optional_imports import import_from_extra
from dechirp.recordings.messages.ros import NANO, POINT_TYPES, ros2_message_type_store

MAGIC = b"#ROSBAG V2.0\n"

_MAX_CHUNK_BYTES = 2**28  # bytes; recorders close chunks at about 1 MiB
_MESSAGE, _CHUNK, _CONNECTION = 2, 5, 7


def iter_ros1_messages(path: Path) -> Iterator[Message]:
    """Yield all messages, named as in ROS 2; point clouds, scans and tracks are transcoded to CDR.

    Raises any error of the libraries for damaged bytes.
    """
    connections: dict[int, tuple[str, str]] = {}
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        if content[: len(MAGIC)] != MAGIC:
            raise ValueError("no ROS 1 bag of version 2.0")
        if len(content) == len(MAGIC):
            raise ValueError("a file without messages, cut after its first line")
        for fields, data in _iter_records(content, len(MAGIC)):
            if fields.get(b"op") != bytes([_CHUNK]):
                yield from _messages_of_record(fields, data, connections)
                continue
            chunk = _decompress_chunk(fields, data)
            for inner_fields, inner_data in _iter_records(chunk, 0):
                yield from _messages_of_record(inner_fields, inner_data, connections)


def _iter_records(
    content: bytes | mmap.mmap, position: int
) -> Iterator[tuple[dict[bytes, bytes], bytes]]:
    """Yield header and data of each record."""
    while position < len(content):
        header, position = _read_sized_part(content, position)
        data, position = _read_sized_part(content, position)
        yield _parse_fields(header), data


def _read_sized_part(content: bytes | mmap.mmap, position: int) -> tuple[bytes, int]:
    """Return a part that follows its length, and the position after it."""
    (size,) = struct.unpack("<I", content[position : position + 4])
    start, end = position + 4, position + 4 + size
    if end > len(content):
        raise ValueError(f"a record that ends {end - len(content)} bytes after the file")
    return content[start:end], end


def _parse_fields(header: bytes) -> dict[bytes, bytes]:
    """Parse the fields `name=value` of a header."""
    fields, position = {}, 0
    while position < len(header):
        field, position = _read_sized_part(header, position)
        name, equals, value = field.partition(b"=")
        if not equals:
            raise ValueError("a field without a value")
        fields[name] = value
    return fields


def _messages_of_record(
    fields: dict[bytes, bytes], data: bytes, connections: dict[int, tuple[str, str]]
) -> Iterator[Message]:
    """Yield the message of a record, or note the topic and type of its connection."""
    operation = fields[b"op"][0]
    if operation == _CONNECTION:
        kind = _parse_fields(data)[b"type"].decode()
        package, _, name = kind.partition("/")
        topic = "/" + fields[b"topic"].decode().strip("/")
        connections[_number(fields[b"conn"])] = topic, f"{package}/msg/{name}"
    elif operation == _MESSAGE:
        topic, kind = connections[_number(fields[b"conn"])]
        seconds, nanoseconds = struct.unpack("<II", fields[b"time"])
        if kind in POINT_TYPES:
            data = bytes(ros2_message_type_store().ros1_to_cdr(data, kind))
        yield Message(topic, kind, seconds * NANO + nanoseconds, data)


def _number(value: bytes) -> int:
    return int(struct.unpack("<I", value)[0])


def _decompress_chunk(fields: dict[bytes, bytes], data: bytes) -> bytes:
    """Return the records of a chunk."""
    size, compression = _number(fields[b"size"]), fields[b"compression"]
    if size > _MAX_CHUNK_BYTES:
        raise ValueError(f"a chunk of {size} bytes")
    if compression == b"none":
        chunk = data
    elif compression == b"bz2":
        chunk = bz2.BZ2Decompressor().decompress(data, size)
    elif compression == b"lz4":
        unpacker = import_from_extra("io", "lz4.frame", setting="recording").LZ4FrameDecompressor()
        chunk = unpacker.decompress(data, max_length=size)
    else:
        raise ValueError(f"compression {compression[:20]!r}")
    if len(chunk) != size:
        raise ValueError(f"{len(chunk)} bytes in a chunk of {size}")
    return chunk
