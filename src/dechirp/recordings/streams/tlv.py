"""Packets of TI's demos in the bytes of a serial line, some of which may be lost.

A packet is a magic word, a header of 32-bit words (version, length of the packet, platform, frame
number, CPU cycles, number of objects, number of items, and except on xWR14xx the number of the
subframe), then items: type, length, content. It is padded to a multiple of 32 bytes.

A packet is complete if its items fill it, its counts agree, and either the next one begins where it
ends or its points are not its last item; otherwise the search continues inside it.
"""

import mmap
import struct
from array import array
from collections import Counter

import numpy as np

from dechirp.core.values import frozen_dataclass

MAGIC = bytes([2, 1, 4, 3, 6, 5, 8, 7])
_MAX_PACKET_BYTES = 2**20
_MAX_ITEMS = 32
_PADDING = 32
_MAX_COORDINATE_M = 1e4  # a float with a wrong bit is mostly far larger
_MAX_SNR = 2000  # 200 dB, as above
_MAX_ITEM_TYPES = 100

POINTS, SIDE_INFO = 1, 7

FIXED_POINT = np.dtype(
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
"""Items of a packet, by type: first byte and number of bytes of the content."""


@frozen_dataclass
class _Header:
    """Header of a packet."""

    version: int
    n_bytes: int
    platform: int
    frame_number: int
    n_objects: int
    n_items: int


# Positions and version of the points of a complete packet. Packets may be only 36 bytes long,
# so Python objects would take many times the size of the file.
_PACKET = np.dtype(
    [
        ("version", np.int64),
        ("frame_number", np.int64),
        ("n_points", np.int64),
        ("points_at", np.int64),
        ("side_at", np.int64),  # -1 without side information
    ]
)


@frozen_dataclass
class TlvPackets:
    """Complete packets of a stream, and its losses."""

    packets: np.ndarray
    """(packet,) of `_PACKET`."""
    packets_per_item_type: Counter[int]
    """Number of packets with an item of each type."""
    n_bytes_lost: int
    """Bytes outside of complete packets."""
    n_gaps: int
    n_damaged: int
    """Packets that begin, but are incomplete."""


def parse_packet_header(serial_bytes: bytes | mmap.mmap, offset: int) -> _Header | None:
    """Return the header after a magic word; None if it is invalid."""
    if offset + 36 > len(serial_bytes):
        return None
    version, n_bytes, platform, number, _, n_objects, n_items = struct.unpack_from(
        "<7I", serial_bytes, offset + 8
    )
    if not 36 <= n_bytes <= _MAX_PACKET_BYTES or n_items > _MAX_ITEMS or n_objects > n_bytes:
        return None
    return _Header(
        version=version,
        n_bytes=n_bytes,
        platform=platform,
        frame_number=number,
        n_objects=n_objects,
        n_items=n_items,
    )


def find_complete_packets(serial_bytes: mmap.mmap) -> TlvPackets:
    """Find all complete packets, in the order of the file."""
    packets, packets_per_item_type = array("q"), Counter[int]()
    n_bytes_lost = n_gaps = n_damaged = 0
    end = 0  # end of the last complete packet
    offset = serial_bytes.find(MAGIC)
    while offset >= 0:
        header = parse_packet_header(serial_bytes, offset)
        items = None if header is None else _parse_packet_items(serial_bytes, offset, header)
        if header is None or items is None:
            n_damaged += 1
            offset = serial_bytes.find(MAGIC, offset + 1)
            continue
        n_bytes_lost, n_gaps = n_bytes_lost + offset - end, n_gaps + (offset > end)
        packets.extend(
            (header.version, header.frame_number, *_point_count_and_item_offsets(header, items))
        )
        packets_per_item_type.update(
            kind
            if kind in packets_per_item_type or len(packets_per_item_type) < _MAX_ITEM_TYPES
            else -1
            for kind in items
        )
        end = offset + header.n_bytes
        offset = serial_bytes.find(MAGIC, end)
    rest = len(serial_bytes) - end
    return TlvPackets(
        packets=np.frombuffer(packets, _PACKET),
        packets_per_item_type=packets_per_item_type,
        n_bytes_lost=n_bytes_lost + rest,
        n_gaps=n_gaps + (rest > 0),
        n_damaged=n_damaged,
    )


def _point_count_and_item_offsets(header: _Header, items: Items) -> tuple[int, int, int]:
    """Return the number of points, and the first bytes of points and side information."""
    if not header.n_objects or POINTS not in items:
        return 0, -1, -1
    return header.n_objects, items[POINTS][0], items.get(SIDE_INFO, (-1, 0))[0]


def _parse_packet_items(serial_bytes: mmap.mmap, offset: int, header: _Header) -> Items | None:
    """Return the items of the packet at an offset; None unless it is complete."""
    end = offset + header.n_bytes
    # A packet that begins before this one ends shows that bytes of this one were lost.
    if end > len(serial_bytes) or serial_bytes.find(MAGIC, offset + 1, end + len(MAGIC) - 1) >= 0:
        return None
    without_subframe = header.platform & 0xFFFF == 0x1443
    items = _locate_items(
        serial_bytes, offset + (36 if without_subframe else 40), end, header.n_items
    )
    if items is None or not _are_items_consistent(serial_bytes, header, items):
        return None
    # Lost bytes leave the items in place only if they were in the last of them.
    last_item = max(items, key=lambda kind: items[kind][0], default=POINTS)
    is_followed = end == len(serial_bytes) or serial_bytes[end : end + len(MAGIC)] == MAGIC
    return items if is_followed or last_item not in (POINTS, SIDE_INFO) else None


def _locate_items(serial_bytes: mmap.mmap, offset: int, end: int, n_items: int) -> Items | None:
    """Return the contents of the items, which must fill the packet except for its padding."""
    items: Items = {}
    for _ in range(n_items):
        if offset + 8 > end:
            return None
        kind, n_bytes = struct.unpack_from("<2I", serial_bytes, offset)
        offset += 8
        if kind in items or offset + n_bytes > end:
            return None
        items[kind] = offset, n_bytes
        offset += n_bytes
    return items if 0 <= end - offset < _PADDING else None


def _are_items_consistent(serial_bytes: mmap.mmap, header: _Header, items: Items) -> bool:
    """Return whether the counts of objects agree, and the points are plausible."""
    n = header.n_objects
    if SIDE_INFO in items:
        offset, n_bytes = items[SIDE_INFO]
        side = np.frombuffer(serial_bytes[offset : offset + n_bytes - n_bytes % 2], "<i2")
        if n_bytes != 4 * n or np.max(np.abs(side[::2].astype(int)), initial=0) > _MAX_SNR:
            return False
    if POINTS not in items:
        return True
    offset, n_bytes = items[POINTS]
    if has_fixed_point_coordinates(header.version):
        if n_bytes < 4 or n_bytes != 4 + FIXED_POINT.itemsize * n:
            return False
        n_said, q_format = struct.unpack_from("<2H", serial_bytes, offset)
        return bool(n_said == n and q_format < 16)
    if n_bytes != 16 * n:
        return False
    farthest = np.max(
        np.abs(np.frombuffer(serial_bytes[offset : offset + n_bytes], "<f4")), initial=0
    )
    return bool(farthest < _MAX_COORDINATE_M)  # False for NaN


def has_fixed_point_coordinates(sdk_version: int) -> bool:
    """Return whether points are 16-bit numbers, as before SDK 3."""
    return sdk_version >> 24 < 3
