"""Chunks of a Zarr array on disk, judged before they are unpacked."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.values import value
from dechirp.formats.arrays.stored import too_large
from dechirp.formats.arrays.unpacking import HEAD_BYTES, UNPACKED, size_in_head, unpacks_beyond

_SAME_SIZE = ("bytes", "transpose", "shuffle", "bitround")
_RETYPING = ("delta", "fixedscaleoffset", "quantize", "astype")
_TYPES = ("dtype", "astype", "encode_dtype", "decode_dtype")
_CHECKSUM, _CHECKSUM_BYTES = "crc32c", 4
_SHARDS = "sharding_indexed"
_EMPTY = 2**64 - 1


@value
class Packing:
    """How the chunks of an array are compressed."""

    codec: str | None
    """One of `UNPACKED`; None if they are not."""
    config: Mapping[str, Any]
    n_bytes: int
    """Bytes that a chunk unpacks to."""
    n_behind: int
    """Bytes of checksums behind what is compressed."""


@value
class Sharding:
    """How the chunks of an array lie several in a file."""

    inner: Packing
    n_inner: int
    n_behind: int
    """Bytes of checksums behind the table of their places."""
    table_first: bool


def packing_in(
    path: Path, said: Mapping[str, Any], chunk: tuple[int, ...], itemsize: int
) -> Packing | Sharding:
    """How chunks, of what shape in how large numbers, are packed.

    Parameters
    ----------
    path : Path
        The recording, for errors.
    said : mapping
        Metadata of the array, as Zarr has understood it.
    chunk : tuple of int
        Shape of what is in a file.
    itemsize : int
        Bytes of a number.

    Raises
    ------
    RecordingError
        If it cannot be told how much chunks would unpack to.
    """
    if said["zarr_format"] == 2:
        codecs = [*(said.get("filters") or ()), said.get("compressor")]
        return _packing(path, [(one["id"], one) for one in codecs if one], chunk, itemsize)
    codecs = _named(said["codecs"])
    if _SHARDS not in (name for name, _ in codecs):
        return _packing(path, codecs, chunk, itemsize)
    config = codecs[-1][1]
    names = [name for name, _ in codecs]
    index = _named(config.get("index_codecs", ()))
    if names not in ([_SHARDS], ["transpose", _SHARDS]):
        raise _refused(path, " and ".join(names))
    if index[0] != ("bytes", {"endian": "little"}) or index[1:] not in ([], [(_CHECKSUM, {})]):
        raise _refused(path, f"{_SHARDS} with a table of places in {index}")
    inner = tuple(int(size) for size in config["chunk_shape"])
    return Sharding(
        inner=_packing(path, _named(config["codecs"]), inner, itemsize),
        n_inner=math.prod(chunk) // math.prod(inner),
        n_behind=_CHECKSUM_BYTES * (len(index) - 1),
        table_first=str(config["index_location"]) == "start",
    )


def _named(codecs: Any) -> list[tuple[str, Mapping[str, Any]]]:
    return [
        (one["name"].removeprefix("numcodecs."), one.get("configuration") or {}) for one in codecs
    ]


def _packing(
    path: Path, codecs: list[tuple[str, Mapping[str, Any]]], chunk: tuple[int, ...], itemsize: int
) -> Packing:
    codec: str | None = None
    config: Mapping[str, Any] = {}
    n_bytes, n_behind = math.prod(chunk) * itemsize, 0
    for name, said in codecs:
        if name == _CHECKSUM and said.get("location", "end") == "end":
            n_behind += _CHECKSUM_BYTES
        elif codec is not None:
            raise _refused(path, f"{name} after {codec}")
        elif name in UNPACKED:
            codec, config = name, said
            n_bytes, n_behind = n_bytes + n_behind, 0
        elif name in _RETYPING:
            types = [np.dtype(said[key]) for key in _TYPES if said.get(key) is not None]
            if any(one.itemsize != itemsize for one in types):
                raise _refused(path, f"{name}, which changes the size of numbers")
        elif name not in _SAME_SIZE:
            raise _refused(path, name)
    return Packing(codec=codec, config=config, n_bytes=n_bytes, n_behind=n_behind)


def _refused(path: Path, what: str) -> RecordingError:
    return RecordingError(
        path,
        got=f"an array that needs the codec {what}",
        need=f"one compressed once, by {', '.join(UNPACKED)}, after filters that keep its size",
        fix="Save the samples again so, or without compression.",
    )


def must_unpack_to_size(path: Path, chunk: Path, packing: Packing | Sharding) -> None:
    """Raise `RecordingError` if a file holds a chunk that unpacks to more than it should."""
    if isinstance(packing, Packing) and packing.codec is None:
        return
    n_bytes = chunk.stat().st_size
    with chunk.open("rb") as file:
        if isinstance(packing, Packing):
            _must_fit(path, file, 0, n_bytes, packing)
            return
        table_bytes = 16 * packing.n_inner
        if packing.inner.codec is None or table_bytes + packing.n_behind > n_bytes:
            return  # a file that is too short is for Zarr to refuse
        file.seek(0 if packing.table_first else n_bytes - table_bytes - packing.n_behind)
        for place in np.frombuffer(file.read(table_bytes), "<u8").reshape(-1, 2):
            start, size = place.tolist()
            if start != _EMPTY:
                _must_fit(path, file, start, min(size, n_bytes), packing.inner)


def _must_fit(path: Path, file: BinaryIO, start: int, n_bytes: int, packing: Packing) -> None:
    """Raise `RecordingError` if a part of a file unpacks to more than a chunk."""
    assert packing.codec is not None
    file.seek(start)
    head = file.read(min(HEAD_BYTES, n_bytes))
    said = size_in_head(packing.codec, head)
    if said is not None:
        is_larger = said > packing.n_bytes
    else:
        packed = head + file.read(max(n_bytes - len(head), 0))
        packed = packed[: len(packed) - packing.n_behind]
        is_larger = unpacks_beyond(packing.codec, packing.config, packed, packing.n_bytes)
    if is_larger:
        what = f"a piece of {n_bytes} bytes that unpacks to more than {packing.n_bytes}"
        raise too_large(path, what, file_bytes=n_bytes)
