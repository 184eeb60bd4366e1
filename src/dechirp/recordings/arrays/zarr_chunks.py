"""Decompressed sizes of the chunks of a Zarr array, checked before decompression."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.values import frozen_dataclass
from dechirp.recordings.arrays.decompression_limits import (
    HEADER_BYTES,
    LIMITED_CODECS,
    declared_decompressed_size,
    exceeds_decompressed_size,
)
from dechirp.recordings.arrays.lazy_array import memory_exceeds_file_error

_SAME_SIZE = ("bytes", "transpose", "shuffle", "bitround")
_RETYPING = ("delta", "fixedscaleoffset", "quantize", "astype")
_TYPES = ("dtype", "astype", "encode_dtype", "decode_dtype")
_CHECKSUM, _CHECKSUM_BYTES = "crc32c", 4
_SHARDS = "sharding_indexed"
_ABSENT_CHUNK = 2**64 - 1


@frozen_dataclass
class ChunkCompression:
    """Compression of the chunks of an array."""

    codec: str | None
    """One of `LIMITED_CODECS`; None without compression."""
    config: Mapping[str, Any]
    n_bytes: int
    """Decompressed size of a chunk."""
    checksum_bytes: int
    """Bytes of checksums after the compressed data."""


@frozen_dataclass
class Sharding:
    """Layout of an array with several chunks in a file."""

    inner: ChunkCompression
    n_inner: int
    index_checksum_bytes: int
    """Bytes of checksums after the chunk index."""
    is_index_first: bool


def parse_chunk_compression(
    path: Path, metadata: Mapping[str, Any], chunk_shape: tuple[int, ...], itemsize: int
) -> ChunkCompression | Sharding:
    """Return the compression of chunks with this shape and number size.

    Parameters
    ----------
    path : Path
        The recording, for errors.
    metadata : mapping
        Metadata of the array, as parsed by Zarr.
    chunk_shape : tuple of int
        Shape of the array in one file.
    itemsize : int
        Bytes of a number.

    Raises
    ------
    RecordingError
        If the decompressed size of chunks cannot be determined.
    """
    if metadata["zarr_format"] == 2:
        codecs = [*(metadata.get("filters") or ()), metadata.get("compressor")]
        return _parse_codecs_as_compression(
            path, [(codec["id"], codec) for codec in codecs if codec], chunk_shape, itemsize
        )
    codecs = _codec_names_and_configs(metadata["codecs"])
    if _SHARDS not in (name for name, _ in codecs):
        return _parse_codecs_as_compression(path, codecs, chunk_shape, itemsize)
    config = codecs[-1][1]
    names = [name for name, _ in codecs]
    index = _codec_names_and_configs(config.get("index_codecs", ()))
    if names not in ([_SHARDS], ["transpose", _SHARDS]):
        raise _unsupported_codecs_error(path, " and ".join(names))
    if index[0] != ("bytes", {"endian": "little"}) or index[1:] not in ([], [(_CHECKSUM, {})]):
        raise _unsupported_codecs_error(path, f"{_SHARDS} with an index in {index}")
    inner = tuple(int(size) for size in config["chunk_shape"])
    return Sharding(
        inner=_parse_codecs_as_compression(
            path, _codec_names_and_configs(config["codecs"]), inner, itemsize
        ),
        n_inner=math.prod(chunk_shape) // math.prod(inner),
        index_checksum_bytes=_CHECKSUM_BYTES * (len(index) - 1),
        is_index_first=str(config["index_location"]) == "start",
    )


def _codec_names_and_configs(codecs: Any) -> list[tuple[str, Mapping[str, Any]]]:
    """Return the name and configuration of each codec."""
    return [
        (codec["name"].removeprefix("numcodecs."), codec.get("configuration") or {})
        for codec in codecs
    ]


def _parse_codecs_as_compression(
    path: Path,
    codecs: list[tuple[str, Mapping[str, Any]]],
    chunk_shape: tuple[int, ...],
    itemsize: int,
) -> ChunkCompression:
    """Return the compression of a sequence of codecs."""
    codec: str | None = None
    config: Mapping[str, Any] = {}
    n_bytes, checksum_bytes = math.prod(chunk_shape) * itemsize, 0
    for name, settings in codecs:
        if name == _CHECKSUM and settings.get("location", "end") == "end":
            checksum_bytes += _CHECKSUM_BYTES
        elif codec is not None:
            raise _unsupported_codecs_error(path, f"{name} after {codec}")
        elif name in LIMITED_CODECS:
            codec, config = name, settings
            n_bytes, checksum_bytes = n_bytes + checksum_bytes, 0
        elif name in _RETYPING:
            types = [np.dtype(settings[key]) for key in _TYPES if settings.get(key) is not None]
            if any(dtype.itemsize != itemsize for dtype in types):
                raise _unsupported_codecs_error(path, f"{name}, which changes the size of numbers")
        elif name not in _SAME_SIZE:
            raise _unsupported_codecs_error(path, name)
    return ChunkCompression(
        codec=codec, config=config, n_bytes=n_bytes, checksum_bytes=checksum_bytes
    )


def _unsupported_codecs_error(path: Path, codec: str) -> RecordingError:
    """Return the error of codecs whose decompressed size is unknown."""
    return RecordingError(
        path,
        value=f"an array that needs the codec {codec}",
        expected=f"one compression ({', '.join(LIMITED_CODECS)}) after filters that keep the size",
        fix="save the samples again with one of them, or without compression",
    )


def check_chunk_file_decompressed_size(
    path: Path, chunk_file: Path, compression: ChunkCompression | Sharding
) -> None:
    """Raise `RecordingError` if a file holds a chunk that decompresses to more than its size."""
    if isinstance(compression, ChunkCompression) and compression.codec is None:
        return
    n_bytes = chunk_file.stat().st_size
    with chunk_file.open("rb") as file:
        if isinstance(compression, ChunkCompression):
            _check_decompressed_chunk_size(path, file, 0, n_bytes, compression)
            return
        table_bytes = 16 * compression.n_inner
        if (
            compression.inner.codec is None
            or table_bytes + compression.index_checksum_bytes > n_bytes
        ):
            return  # Zarr itself refuses a file that is too short
        file.seek(
            0
            if compression.is_index_first
            else n_bytes - table_bytes - compression.index_checksum_bytes
        )
        for entry in np.frombuffer(file.read(table_bytes), "<u8").reshape(-1, 2):
            start, size = entry.tolist()
            if start != _ABSENT_CHUNK:
                _check_decompressed_chunk_size(
                    path, file, start, min(size, n_bytes), compression.inner
                )


def _check_decompressed_chunk_size(
    path: Path, file: BinaryIO, start: int, n_bytes: int, compression: ChunkCompression
) -> None:
    """Raise `RecordingError` if a part of a file decompresses to more than a chunk."""
    assert compression.codec is not None
    file.seek(start)
    head = file.read(min(HEADER_BYTES, n_bytes))
    declared = declared_decompressed_size(compression.codec, head)
    if declared is not None:
        is_larger = declared > compression.n_bytes
    else:
        compressed = head + file.read(max(n_bytes - len(head), 0))
        compressed = compressed[: len(compressed) - compression.checksum_bytes]
        is_larger = exceeds_decompressed_size(
            compression.codec, compression.config, compressed, compression.n_bytes
        )
    if is_larger:
        description = (
            f"a chunk of {n_bytes} bytes that decompresses to more than {compression.n_bytes}"
        )
        raise memory_exceeds_file_error(path, description, file_bytes=n_bytes)
