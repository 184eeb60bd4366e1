"""Decompressed sizes, determined before a library decompresses into memory.

Libraries allocate whatever a stream decompresses to: 1 MB can become 2 GB.
"""

import bz2
import gzip
import io
import lzma
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from dechirp.core.compiled_kernels import AS_WRITTEN, kernel

HEADER_BYTES = 16
"""Bytes at the start of a chunk that `declared_decompressed_size` needs."""

LIMITED_CODECS = ("blosc", "gzip", "zlib", "zstd", "lz4", "bz2", "lzma")
"""Compressions whose decompressed size can be checked, by their names in Zarr."""

_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
_STEP_BYTES = 2**20


def declared_decompressed_size(codec: str, chunk_head: bytes) -> int | None:
    """Return the decompressed size that a chunk declares and no library exceeds; None without one.

    Raises
    ------
    ValueError
        If the chunk does not begin like one of its codec.
    """
    if codec == "blosc" and len(chunk_head) >= 16:
        return int.from_bytes(chunk_head[4:8], "little")
    if codec == "lz4" and len(chunk_head) >= 4:
        return int.from_bytes(chunk_head[:4], "little")
    if codec in ("blosc", "lz4"):
        raise ValueError(f"a chunk that does not begin like one of {codec}")
    return None


def exceeds_decompressed_size(
    codec: str, config: Mapping[str, Any], compressed: bytes, max_bytes: int
) -> bool:
    """Return whether a chunk decompresses to more than `max_bytes`, without holding many more.

    Raises
    ------
    Exception
        Any error of the codec's library for damaged bytes.
    """
    declared = declared_decompressed_size(codec, compressed[:HEADER_BYTES])
    if declared is not None:
        return declared > max_bytes
    if codec == "zlib":  # one stream only; libraries ignore what follows
        return len(zlib.decompressobj().decompress(compressed, max_bytes + 1)) > max_bytes
    if codec == "zstd":
        size = _declared_zstd_decompressed_size(compressed)
        return (
            not _zstd_decompresses_within(compressed, max_bytes)
            if size is None
            else size > max_bytes
        )
    n_bytes = 0
    with _decompressing_stream(codec, config, io.BytesIO(compressed)) as stream:
        while n_bytes <= max_bytes and (block := stream.read(_STEP_BYTES)):
            n_bytes += len(block)
    return n_bytes > max_bytes


def _decompressing_stream(
    codec: str, config: Mapping[str, Any], source: io.BytesIO
) -> io.BufferedIOBase:
    """Open a decompressing stream of a codec."""
    if codec == "gzip":
        return gzip.GzipFile(fileobj=source)
    if codec == "bz2":
        return bz2.BZ2File(source)
    if codec == "lzma":
        kind = config.get("format", lzma.FORMAT_AUTO)
        return lzma.LZMAFile(source, format=kind, filters=config.get("filters"))
    raise ValueError(f"no size limit is known for {codec}")


def _declared_zstd_decompressed_size(compressed: bytes) -> int | None:
    """Return the size that a Zstandard chunk declares; None without one, or for several frames.

    Frame and block headers: RFC 8878, section 3.1.1.
    """
    if len(compressed) < 6 or not compressed.startswith(_ZSTD_MAGIC):
        return None
    descriptor = compressed[4]
    is_single = descriptor >> 5 & 1
    n_bytes = (is_single, 2, 4, 8)[descriptor >> 6]
    offset = 5 + (1 - is_single) + (0, 1, 2, 4)[descriptor & 3]
    size = int.from_bytes(compressed[offset : offset + n_bytes], "little") + (
        256 if n_bytes == 2 else 0
    )
    offset += n_bytes
    is_last = False
    while not is_last and offset + 3 <= len(compressed):
        block = int.from_bytes(compressed[offset : offset + 3], "little")
        is_last = bool(block & 1)
        offset += 3 + (1 if block >> 1 & 3 == 1 else block >> 3)  # type 1: one repeated byte
    offset += 4 * (descriptor >> 2 & 1)  # checksum
    return size if n_bytes and is_last and offset == len(compressed) else None


def _zstd_decompresses_within(compressed: bytes, max_bytes: int) -> bool:
    """Return whether a Zstandard chunk decompresses to at most `max_bytes`."""
    from numcodecs import zstd  # type: ignore[import-untyped]  # comes with Zarr

    try:
        zstd.decompress(compressed, np.empty(max_bytes, np.uint8))
    except (RuntimeError, ValueError) as error:
        if "too small" in str(error):
            return False
        raise
    return True


@kernel(plain=AS_WRITTEN, nogil=False, error_model="python")
def lzf_decompressed_size(compressed: np.ndarray) -> int:
    """Return the decompressed size of LZF data (n,) uint8."""
    size, offset = 0, 0
    while offset < compressed.size:
        control = int(compressed[offset])
        if control < 32:  # a literal run of control + 1 bytes
            size += control + 1
            offset += control + 2
            continue
        length = control >> 5  # a back reference
        offset += 2
        if length == 7:
            if offset > compressed.size:
                break
            length += int(compressed[offset - 1])
            offset += 1
        size += length + 2
    return size
