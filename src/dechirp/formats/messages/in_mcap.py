"""Messages in an MCAP file, in the order in which they lie there.

Chunks are unpacked one at a time, to no more than they say and never to more than 256 MiB.

References
----------
MCAP format specification, mcap.dev/spec.
"""

import mmap
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from dechirp.core.extra import library
from dechirp.formats.messages.ros import Message

MAGIC = b"\x89MCAP0\r\n"

_LARGEST_CHUNK = 2**28  # bytes; writers close one at about 1 MiB
_SCHEMAS = ("ros2msg", "ros2idl", "omgidl")


def messages(path: Path) -> Iterator[Message]:
    """All messages; of those that are not of ROS 2 the type is `encoding/name`.

    Raises whatever the library does of damaged bytes.
    """
    stream = library("mcap.stream_reader", of="recording")
    records = library("mcap.records", of="recording")
    schemas: dict[int, Any] = {}
    channels: dict[int, Any] = {}
    # A map never gives more than the file has, whatever length is asked of it.
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        reader = stream.StreamReader(content, emit_chunks=True, validate_crcs=True)
        for outer in reader.records:
            inside = [outer]
            if isinstance(outer, records.Chunk):
                inside = stream.breakup_chunk(_unpacked(outer), validate_crc=True)
            for record in inside:
                if isinstance(record, records.Schema):
                    schemas[record.id] = record
                elif isinstance(record, records.Channel):
                    channels[record.id] = record
                elif isinstance(record, records.Message):
                    channel = channels[record.channel_id]
                    kind = _type(channel, schemas.get(channel.schema_id))
                    yield Message(channel.topic, kind, record.log_time, record.data)


def _type(channel: Any, schema: Any | None) -> str:
    if schema is None:
        return str(channel.message_encoding)
    if channel.message_encoding == "cdr" and schema.encoding in _SCHEMAS:
        return str(schema.name)
    return f"{channel.message_encoding}/{schema.name}"


def _unpacked(chunk: Any) -> Any:
    """The same chunk without compression."""
    if not chunk.compression:
        return chunk
    size = chunk.uncompressed_size
    if size > _LARGEST_CHUNK:
        raise ValueError(f"a chunk of {size} bytes")
    if chunk.compression == "zstd":
        unpacker = library("zstandard", of="recording").ZstdDecompressor()
        content = unpacker.stream_reader(chunk.data).read(size)
    elif chunk.compression == "lz4":
        unpacker = library("lz4.frame", of="recording").LZ4FrameDecompressor()
        content = unpacker.decompress(chunk.data, max_length=size)
    else:
        raise ValueError(f"compression {chunk.compression!r}")
    if len(content) != size:
        raise ValueError(f"{len(content)} bytes in a chunk of {size}")
    return replace(chunk, compression="", data=content)
