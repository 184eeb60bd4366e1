"""TI radars' serial output: packets of points that the chip detected itself, no samples.

A packet is a magic word, a header of 32-bit words (version, length of the packet, platform,
frame number, CPU cycles, number of objects, number of items, and except on xWR14xx the number
of the subframe), then items: type, length, content. It is padded to a multiple of 32 bytes.

Points are four floats, x y z and velocity (type 1); before SDK 3 a count and a Q format, and
16-bit numbers: range bin, Doppler bin, peak, x, y, z. Their signal-to-noise ratios are in an
item of their own (type 7). In TI's axes x points right and y forward.

Bytes get lost on serial lines. A packet counts where its items fill it, its counts agree, and
the next one begins where it ends or its points are not its last item; else the search goes on
inside it, and the loss is told.

TI, Understanding the Out of Box Demo Data Output (mmWave industrial toolbox).
"""

import mmap
import struct
from array import array
from collections import Counter
from pathlib import Path

import numpy as np
import xarray as xr

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.values import value
from dechirp.formats.base import Contents, Fit, Format, Told
from dechirp.radar.radar import Radar

_MAGIC = bytes([2, 1, 4, 3, 6, 5, 8, 7])
_HEAD_BYTES = 2**14
_LONGEST_PACKET = 2**20
_MOST_ITEMS = 32
_PADDING = 32
_FARTHEST_M = 1e4  # a float with a wrong bit is mostly far beyond
_LARGEST_SNR = 2000  # 200 dB, as above
_MOST_KINDS = 100
_LARGEST_STEP = 2**16  # of frame numbers: more is a number that was damaged

_POINTS, _SIDE_INFO = 1, 7
_ITEMS = {
    2: "range profile",
    3: "noise profile",
    4: "azimuth map",
    5: "range-Doppler map",
    6: "statistics",
    8: "azimuth-elevation map",
    9: "temperature",
}

_OLD_POINT = np.dtype(
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
class TiUart(Format):
    """Detections from the serial port of a TI demo (TLV).

    The bytes of the data port, as they came.
    """

    def recognise(self, path: Path) -> Fit:
        """Tell by a magic word near the start, and a header after it that can be one."""
        if not path.is_file():
            return Fit.NO
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
        at = head.find(_MAGIC)
        while at >= 0:
            if _header(head, at) is not None:
                return Fit.OWN
            at = head.find(_MAGIC, at + 1)
        return Fit.NO

    def read(self, path: Path, told: Told) -> Contents:
        """See `Format.read`."""
        if not path.stat().st_size:
            raise _nothing(path, 0, 0)
        with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as text:
            found = _search(text)
            if not len(found.packets):
                raise _nothing(path, found.n_damaged, found.n_bytes_lost)
            radar = None if told.settings is None else told.settings.radar
            xyzv, snr = _points(text, found.packets, radar)
        points = _detections(found.packets, xyzv, snr, radar)
        findings = () if told.settings is None else told.settings.findings
        if np.isnan(xyzv[:, 3]).any():
            findings = (*findings, _no_velocity())
        return Contents(
            radar=radar,
            n_frames=len(found.packets),
            points=points,
            findings=(*findings, *_lost(found), *_not_read(found)),
        )


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
class _Found:
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


def _header(text: bytes | mmap.mmap, at: int) -> _Header | None:
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


def _search(text: mmap.mmap) -> _Found:
    """Every whole packet, in the order of the file."""
    packets, kinds = array("q"), Counter[int]()
    n_bytes_lost = n_places = n_damaged = 0
    end = 0  # of the last whole packet
    at = text.find(_MAGIC)
    while at >= 0:
        header = _header(text, at)
        items = None if header is None else _whole(text, at, header)
        if header is None or items is None:
            n_damaged += 1
            at = text.find(_MAGIC, at + 1)
            continue
        n_bytes_lost, n_places = n_bytes_lost + at - end, n_places + (at > end)
        packets.extend((header.version, header.frame_number, *_places(header, items)))
        kinds.update(kind if kind in kinds or len(kinds) < _MOST_KINDS else -1 for kind in items)
        end = at + header.n_bytes
        at = text.find(_MAGIC, end)
    rest = len(text) - end
    return _Found(
        packets=np.frombuffer(packets, _PACKET),
        kinds=kinds,
        n_bytes_lost=n_bytes_lost + rest,
        n_places=n_places + (rest > 0),
        n_damaged=n_damaged,
    )


def _places(header: _Header, items: Items) -> tuple[int, int, int]:
    """Number of points, first byte of the points and of their side information."""
    if not header.n_objects or _POINTS not in items:
        return 0, -1, -1
    return header.n_objects, items[_POINTS][0], items.get(_SIDE_INFO, (-1, 0))[0]


def _whole(text: mmap.mmap, at: int, header: _Header) -> Items | None:
    """Items of a packet that begins here; None unless it is whole."""
    end = at + header.n_bytes
    # A packet that begins before this one ends says that bytes of this one were lost.
    if end > len(text) or text.find(_MAGIC, at + 1, end + len(_MAGIC) - 1) >= 0:
        return None
    without_subframe = header.platform & 0xFFFF == 0x1443
    items = _items(text, at + (36 if without_subframe else 40), end, header.n_items)
    if items is None or not _agrees(text, header, items):
        return None
    # Lost bytes leave the items in their places only if they were in the last of them.
    last = max(items, key=lambda kind: items[kind][0], default=_POINTS)
    followed = end == len(text) or text[end : end + len(_MAGIC)] == _MAGIC
    return items if followed or last not in (_POINTS, _SIDE_INFO) else None


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
    if _SIDE_INFO in items:
        at, n_bytes = items[_SIDE_INFO]
        side = np.frombuffer(text[at : at + n_bytes - n_bytes % 2], "<i2")
        if n_bytes != 4 * n or np.max(np.abs(side[::2].astype(int)), initial=0) > _LARGEST_SNR:
            return False
    if _POINTS not in items:
        return True
    at, n_bytes = items[_POINTS]
    if _is_old(header.version):
        if n_bytes < 4 or n_bytes != 4 + _OLD_POINT.itemsize * n:
            return False
        n_said, q_format = struct.unpack_from("<2H", text, at)
        return bool(n_said == n and q_format < 16)
    if n_bytes != 16 * n:
        return False
    farthest = np.max(np.abs(np.frombuffer(text[at : at + n_bytes], "<f4")), initial=0)
    return bool(farthest < _FARTHEST_M)  # NaN is not


def _is_old(version: int) -> bool:
    return version >> 24 < 3


_UNITS = {
    "frame": "1",
    "frame_number": "1",
    "time": "s",
    "range": "m",
    "velocity": "m/s",
    "azimuth": "rad",
    "elevation": "rad",
    "snr": "1",
}


def _points(
    text: mmap.mmap, packets: np.ndarray, radar: Radar | None
) -> tuple[np.ndarray, np.ndarray]:
    """Points of all packets, (point, x y z velocity) in TI's axes, and their ratios."""
    counts = packets["n_points"]
    xyzv = np.empty((int(counts.sum()), 4), np.float32)
    snr = np.full(len(xyzv), np.nan, np.float32)
    first = 0
    for version, _, n, points_at, side_at in packets[counts > 0].tolist():
        rows = slice(first, first + n)
        if _is_old(version):
            xyzv[rows] = _of_16_bits(text, version, n, points_at, radar)
        else:
            content = text[points_at : points_at + 16 * n]
            xyzv[rows] = np.frombuffer(content, "<f4").reshape(n, 4)
        if side_at >= 0:
            side = np.frombuffer(text[side_at : side_at + 4 * n], "<i2")
            snr[rows] = 10 ** (side[::2] / 100)  # in steps of 0.1 dB
        first += n
    return xyzv, snr


def _detections(
    packets: np.ndarray, xyzv: np.ndarray, snr: np.ndarray, radar: Radar | None
) -> xr.Dataset:
    """Points as detections, in single precision as they were sent; uses up `xyzv`."""
    left, forward, up, velocity = xyzv.T
    # In place: a stream of nothing but points would take many times its size.
    left *= -1  # np.negative, in place and with a stride, goes wrong in NumPy 2.4
    ground = np.hypot(left, forward)
    azimuth = np.arctan2(left, forward, out=left)
    distance = np.hypot(ground, up, out=forward)
    elevation = np.arctan2(up, ground, out=up)
    counts, numbers = packets["n_points"], packets["frame_number"]
    columns = {
        "frame": np.repeat(np.arange(len(packets), dtype=np.int32), counts),
        "frame_number": np.repeat(numbers.astype(np.uint32), counts),
        "range": distance,
        "velocity": velocity,
        "azimuth": azimuth,
        "elevation": elevation,
        "snr": snr,
    }
    if radar is not None:
        # Since the first packet; the radar's own number counts those that were lost.
        times_s = (numbers - numbers[0]) * radar.frame.start_s(1) + radar.frame.mid_frame_s
        columns["time"] = np.repeat(times_s, counts)
    return xr.Dataset(
        {
            name: ("detection", columns[name], {"units": units})
            for name, units in _UNITS.items()
            if name in columns
        }
    )


def _of_16_bits(text: mmap.mmap, version: int, n: int, at: int, radar: Radar | None) -> np.ndarray:
    """Points (point, x y z velocity) from before SDK 3, in m and m/s, TI's axes."""
    _, q_format = struct.unpack_from("<2H", text, at)
    old = np.frombuffer(text[at + 4 : at + 4 + n * _OLD_POINT.itemsize], _OLD_POINT)
    xyz = np.stack([old["x"], old["y"], old["z"]], axis=-1) / 2.0**q_format
    velocity = np.full(n, np.nan)
    if radar is not None:
        doppler = old["doppler"].astype(np.int64)
        n_bins = radar.frame.n_chirps
        if version >> 16 == 0x0100:  # SDK 1.0 counts them from 0, half of them negative
            doppler = np.where(doppler >= n_bins / 2, doppler - n_bins, doppler)
        velocity = doppler * radar.frame.velocity_resolution_m_per_s
    return np.column_stack([xyz, velocity])


def _lost(found: _Found) -> tuple[Finding, ...]:
    """What was lost on the way."""
    numbers = found.packets["frame_number"]
    steps = np.diff(numbers)
    onward = (steps >= 0) & (steps <= _LARGEST_STEP)  # the subframes of a frame have one number
    n_missing = int(np.maximum(steps[onward] - 1, 0).sum())
    n_jumps = int(np.count_nonzero(~onward))
    if not (found.n_bytes_lost or n_missing or n_jumps):
        return ()
    return (
        Finding(
            level="warning",
            setting="recording",
            got=f"{len(numbers)} whole packets; {found.n_damaged} damaged ones,"
            f" {found.n_bytes_lost} bytes in {found.n_places} places left out, {n_missing} frames"
            f" missing between frame {numbers[0]} and {numbers[-1]}, {n_jumps} jumps of the frame"
            " number",
            need="every packet that the radar sent",
            fix="Record with a faster serial port, or send fewer items (guiMonitor).",
        ),
    )


def _not_read(found: _Found) -> tuple[Finding, ...]:
    others = [
        f"{_ITEMS.get(kind, 'unknown')} ({kind}) in {count}"
        for kind, count in sorted(found.kinds.items())
        if kind not in (_POINTS, _SIDE_INFO, -1)
    ]
    if not others:
        return ()
    more = f" and {len(others) - 12} more" if len(others) > 12 else ""
    return (
        Finding(
            level="note",
            setting="points",
            got=f"other items in {len(found.packets)} packets, not read:"
            f" {', '.join(others[:12])}{more}",
            need=f"points ({_POINTS}) and their side information ({_SIDE_INFO})",
            fix="Nothing is to be done.",
        ),
    )


def _no_velocity() -> Finding:
    return Finding(
        level="warning",
        setting="points",
        got="velocities as numbers of Doppler bins, as before SDK 3: they are not given",
        need="the radar, which says how wide a bin is",
        fix="Give the radar: --radar FILE (radar=FILE in Python).",
    )


def _nothing(path: Path, n_damaged: int, n_bytes: int) -> RecordingError:
    return RecordingError(
        path,
        got=f"without a whole packet: {n_damaged} magic words in {n_bytes} bytes, with nothing"
        " after them that fits",
        need="the bytes of a TI radar's data port, with packets of points",
        fix="Record the data port, not the one of the commands, at its own baud rate.",
    )
