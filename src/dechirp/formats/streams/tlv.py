"""Packets of TI's demos in the bytes of a serial line, some of which may be lost.

A packet is a magic word, a header of 32-bit words (version, length of the packet, platform,
frame number, CPU cycles, number of objects, number of items, and except on xWR14xx the number
of the subframe), then items: type, length, content. It is padded to a multiple of 32 bytes.

A packet counts where its items fill it, its counts agree, and the next one begins where it
ends or its points are not its last item; else the search goes on inside it.
"""

import mmap
import struct
from array import array
from collections import Counter

import numpy as np

from dechirp.core.values import value

MAGIC = bytes([2, 1, 4, 3, 6, 5, 8, 7])
_LONGEST_PACKET = 2**20
_MOST_ITEMS = 32
_PADDING = 32
_FARTHEST_M = 1e4  # a float with a wrong bit is mostly far beyond
_LARGEST_SNR = 2000  # 200 dB, as above
_MOST_KINDS = 100

POINTS, SIDE_INFO = 1, 7

OLD_POINT = np.dtype(
    [
        ("range", "<u2"),
        ("doppler", "<i2"),
        ("peak", "<u2"),
        ("x", "<i2"),
        ("y", "<i2"),
        ("z", "<i2"),
    ]
)

Items = dict[int, tuple[int, int]]
"""Of a packet, by type: first byte and number of bytes of the content."""


@value
class _Header:
    version: int
    n_bytes: int
    platform: int
    frame_number: int
    n_objects: int
    n_items: int


# Where the points of a whole packet are, and what decodes them; a packet may be 36 bytes
# long, so that Python objects for each would take many times the file.
_PACKET = np.dtype(
    [
        ("version", np.int64),
        ("frame_number", np.int64),
        ("n_points", np.int64),
        ("points_at", np.int64),
        ("side_at", np.int64),  # -1 without side information
    ]
)


@value
class Found:
    """What a stream of bytes holds."""

    packets: np.ndarray
    """(packet,) of `_PACKET`."""
    kinds: Counter[int]
    """How many packets have an item of each type."""
    n_bytes_lost: int
    """Outside of whole packets."""
    n_places: int
    n_damaged: int
    """Packets that begin, but are not whole."""


def header_at(text: bytes | mmap.mmap, at: int) -> _Header | None:
    """Header behind a magic word; None if it cannot be one."""
    if at + 36 > len(text):
        return None
    version, n_bytes, platform, number, _, n_objects, n_items = struct.unpack_from(
        "<7I", text, at + 8
    )
    if not 36 <= n_bytes <= _LONGEST_PACKET or n_items > _MOST_ITEMS or n_objects > n_bytes:
        return None
    return _Header(
        version=version,
        n_bytes=n_bytes,
        platform=platform,
        frame_number=number,
        n_objects=n_objects,
        n_items=n_items,
    )


def search(text: mmap.mmap) -> Found:
    """Every whole packet, in the order of the file."""
    packets, kinds = array("q"), Counter[int]()
    n_bytes_lost = n_places = n_damaged = 0
    end = 0  # of the last whole packet
    at = text.find(MAGIC)
    while at >= 0:
        header = header_at(text, at)
        items = None if header is None else _whole(text, at, header)
        if header is None or items is None:
            n_damaged += 1
            at = text.find(MAGIC, at + 1)
            continue
        n_bytes_lost, n_places = n_bytes_lost + at - end, n_places + (at > end)
        packets.extend((header.version, header.frame_number, *_places(header, items)))
        kinds.update(kind if kind in kinds or len(kinds) < _MOST_KINDS else -1 for kind in items)
        end = at + header.n_bytes
        at = text.find(MAGIC, end)
    rest = len(text) - end
    return Found(
        packets=np.frombuffer(packets, _PACKET),
        kinds=kinds,
        n_bytes_lost=n_bytes_lost + rest,
        n_places=n_places + (rest > 0),
        n_damaged=n_damaged,
    )


def _places(header: _Header, items: Items) -> tuple[int, int, int]:
    """Number of points, first byte of the points and of their side information."""
    if not header.n_objects or POINTS not in items:
        return 0, -1, -1
    return header.n_objects, items[POINTS][0], items.get(SIDE_INFO, (-1, 0))[0]


def _whole(text: mmap.mmap, at: int, header: _Header) -> Items | None:
    """Items of a packet that begins here; None unless it is whole."""
    end = at + header.n_bytes
    # A packet that begins before this one ends says that bytes of this one were lost.
    if end > len(text) or text.find(MAGIC, at + 1, end + len(MAGIC) - 1) >= 0:
        return None
    without_subframe = header.platform & 0xFFFF == 0x1443
    items = _items(text, at + (36 if without_subframe else 40), end, header.n_items)
    if items is None or not _agrees(text, header, items):
        return None
    # Lost bytes leave the items in their places only if they were in the last of them.
    last = max(items, key=lambda kind: items[kind][0], default=POINTS)
    followed = end == len(text) or text[end : end + len(MAGIC)] == MAGIC
    return items if followed or last not in (POINTS, SIDE_INFO) else None


def _items(text: mmap.mmap, at: int, end: int, n_items: int) -> Items | None:
    """Contents of the items, which must fill the packet but for its padding."""
    items: Items = {}
    for _ in range(n_items):
        if at + 8 > end:
            return None
        kind, n_bytes = struct.unpack_from("<2I", text, at)
        at += 8
        if kind in items or at + n_bytes > end:
            return None
        items[kind] = at, n_bytes
        at += n_bytes
    return items if 0 <= end - at < _PADDING else None


def _agrees(text: mmap.mmap, header: _Header, items: Items) -> bool:
    """Whether the counts of objects agree, and the points can be true."""
    n = header.n_objects
    if SIDE_INFO in items:
        at, n_bytes = items[SIDE_INFO]
        side = np.frombuffer(text[at : at + n_bytes - n_bytes % 2], "<i2")
        if n_bytes != 4 * n or np.max(np.abs(side[::2].astype(int)), initial=0) > _LARGEST_SNR:
            return False
    if POINTS not in items:
        return True
    at, n_bytes = items[POINTS]
    if is_old(header.version):
        if n_bytes < 4 or n_bytes != 4 + OLD_POINT.itemsize * n:
            return False
        n_said, q_format = struct.unpack_from("<2H", text, at)
        return bool(n_said == n and q_format < 16)
    if n_bytes != 16 * n:
        return False
    farthest = np.max(np.abs(np.frombuffer(text[at : at + n_bytes], "<f4")), initial=0)
    return bool(farthest < _FARTHEST_M)  # NaN is not


def is_old(version: int) -> bool:
    """Whether points are 16-bit numbers, as before SDK 3."""
    return version >> 24 < 3
