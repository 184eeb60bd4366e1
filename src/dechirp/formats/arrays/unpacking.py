"""How much a compressed piece unpacks to, found before a library unpacks it into memory.

Those make room for whatever comes out: 1 MB can become 2 GB.
"""

import bz2
import gzip
import io
import lzma
import zlib
from collections.abc import Mapping
from typing import Any

import numba
import numpy as np

HEAD_BYTES = 16
"""Bytes at the start of a piece that `size_in_head` needs."""

UNPACKED = ("blosc", "gzip", "zlib", "zstd", "lz4", "bz2", "lzma")
"""Compressions whose pieces can be judged, by their names in Zarr."""

_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
_STEP_BYTES = 2**20


def size_in_head(codec: str, head: bytes) -> int | None:
    """Bytes that a piece says it unpacks to, and that no more room is made for; None: unsaid.

    Raises
    ------
    ValueError
        If it does not begin as one of its kind does.
    """
    if codec == "blosc" and len(head) >= 16:
        return int.from_bytes(head[4:8], "little")
    if codec == "lz4" and len(head) >= 4:
        return int.from_bytes(head[:4], "little")
    if codec in ("blosc", "lz4"):
        raise ValueError(f"a piece that does not begin as one of {codec}")
    return None


def unpacks_beyond(codec: str, config: Mapping[str, Any], packed: bytes, most: int) -> bool:
    """Whether a piece unpacks to more bytes than `most`, found without holding many more.

    Raises
    ------
    Exception
        Whatever its library does of damaged bytes.
    """
    said = size_in_head(codec, packed[:HEAD_BYTES])
    if said is not None:
        return said > most
    if codec == "zlib":  # its one stream: what follows is not unpacked
        return len(zlib.decompressobj().decompress(packed, most + 1)) > most
    if codec == "zstd":
        size = _size_of_frame(packed)
        return not _fits(packed, most) if size is None else size > most
    n_bytes = 0
    with _stream(codec, config, io.BytesIO(packed)) as stream:
        while n_bytes <= most and (block := stream.read(_STEP_BYTES)):
            n_bytes += len(block)
    return n_bytes > most


def _stream(codec: str, config: Mapping[str, Any], source: io.BytesIO) -> io.BufferedIOBase:
    if codec == "gzip":
        return gzip.GzipFile(fileobj=source)
    if codec == "bz2":
        return bz2.BZ2File(source)
    if codec == "lzma":
        kind = config.get("format", lzma.FORMAT_AUTO)
        return lzma.LZMAFile(source, format=kind, filters=config.get("filters"))
    raise ValueError(f"no size is known of what {codec} made")


def _size_of_frame(packed: bytes) -> int | None:
    """Bytes that Zstandard says a piece unpacks to; None if unsaid, or of several frames.

    Its frame and block headers: RFC 8878, section 3.1.1.
    """
    if len(packed) < 6 or not packed.startswith(_ZSTD_MAGIC):
        return None
    said = packed[4]
    is_single = said >> 5 & 1
    n_bytes = (is_single, 2, 4, 8)[said >> 6]
    at = 5 + (1 - is_single) + (0, 1, 2, 4)[said & 3]
    size = int.from_bytes(packed[at : at + n_bytes], "little") + (256 if n_bytes == 2 else 0)
    at += n_bytes
    is_last = False
    while not is_last and at + 3 <= len(packed):
        block = int.from_bytes(packed[at : at + 3], "little")
        is_last = bool(block & 1)
        at += 3 + (1 if block >> 1 & 3 == 1 else block >> 3)  # 1: a byte, repeated
    at += 4 * (said >> 2 & 1)  # a checksum
    return size if n_bytes and is_last and at == len(packed) else None


def _fits(packed: bytes, most: int) -> bool:
    """Whether a piece of Zstandard unpacks into so many bytes."""
    from numcodecs import zstd  # type: ignore[import-untyped]  # comes with Zarr

    try:
        zstd.decompress(packed, np.empty(most, np.uint8))
    except (RuntimeError, ValueError) as error:
        if "too small" in str(error):
            return False
        raise
    return True


@numba.njit(cache=True)
def size_of_lzf(packed: np.ndarray) -> int:
    """Bytes that a piece (n,) uint8, compressed by LZF, unpacks to."""
    made, at = 0, 0
    while at < packed.size:
        control = int(packed[at])
        if control < 32:  # so many bytes and one more, as they are
            made += control + 1
            at += control + 2
            continue
        length = control >> 5  # bytes that came before, to be repeated
        at += 2
        if length == 7:
            if at > packed.size:
                break
            length += int(packed[at - 1])
            at += 1
        made += length + 2
    return made
