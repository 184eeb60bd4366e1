"""Messages in an MCAP file, in the order of the file.

Chunks are decompressed one at a time, to at most their declared size and never more than 256 MiB.

References
----------
MCAP format specification, mcap.dev/spec.
"""

import mmap
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from dechirp.core.optional_imports import import_from_extra

MAGIC = b"\x89MCAP0\r\n"

_MAX_CHUNK_BYTES = 2**28  # bytes; writers close chunks at about 1 MiB
_SCHEMAS = ("ros2msg", "ros2idl", "omgidl")


class Message(NamedTuple):
    """One message, as sent."""

    topic: str
    type: str
    time_ns: int
    data: bytes | memoryview
    """Content in CDR, or in the encoding that the type names."""


def iter_mcap_messages(path: Path) -> Iterator[Message]:
    """Yield all messages; messages of other encodings than ROS 2 have the type `encoding/name`.

    Raises any error of the library for damaged bytes.
    """
    stream = import_from_extra("io", "mcap.stream_reader", setting="recording")
    records = import_from_extra("io", "mcap.records", setting="recording")
    schemas: dict[int, Any] = {}
    channels: dict[int, Any] = {}
    # A mapping never returns more bytes than the file has, whatever length is requested.
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        reader = stream.StreamReader(content, emit_chunks=True, validate_crcs=True)
        for outer in reader.records:
            inside = [outer]
            if isinstance(outer, records.Chunk):
                inside = stream.breakup_chunk(_decompress_chunk(outer), validate_crc=True)
            for record in inside:
                if isinstance(record, records.Schema):
                    schemas[record.id] = record
                elif isinstance(record, records.Channel):
                    channels[record.id] = record
                elif isinstance(record, records.Message):
                    channel = channels[record.channel_id]
                    kind = _message_type(channel, schemas.get(channel.schema_id))
                    yield Message(channel.topic, kind, record.log_time, record.data)


def _message_type(channel: Any, schema: Any | None) -> str:
    """Return the type of the messages of a channel."""
    if schema is None:
        return str(channel.message_encoding)
    if channel.message_encoding == "cdr" and schema.encoding in _SCHEMAS:
        return str(schema.name)
    return f"{channel.message_encoding}/{schema.name}"


def _decompress_chunk(chunk: Any) -> Any:
    """Return the chunk without compression."""
    if not chunk.compression:
        return chunk
    size = chunk.uncompressed_size
    if size > _MAX_CHUNK_BYTES:
        raise ValueError(f"a chunk of {size} bytes")
    if chunk.compression == "zstd":
        unpacker = import_from_extra("io", "zstandard", setting="recording").ZstdDecompressor()
        content = unpacker.stream_reader(chunk.data).read(size)
    elif chunk.compression == "lz4":
        unpacker = import_from_extra("io", "lz4.frame", setting="recording").LZ4FrameDecompressor()
        content = unpacker.decompress(chunk.data, max_length=size)
    else:
        raise ValueError(f"compression {chunk.compression!r}")
    if len(content) != size:
        raise ValueError(f"{len(content)} bytes in a chunk of {size}")
    return replace(chunk, compression="", data=content)
