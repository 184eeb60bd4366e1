"""Object lists as datagrams for Automotive Ethernet, and back.

A list is one datagram or several, each with a header of 40 bytes and up to 25 objects of 56
bytes: 1440 bytes, within the 1472 that Ethernet carries in one piece. Numbers are big-endian,
as network order is; floats are IEEE 754, NaN where not told.

| byte | header | |
|---|---|---|
| 0 | `DCOL` | mark |
| 4 | uint16 | version of the layout, 1 |
| 6 | uint16 | datagrams of the list |
| 8 | uint16 | place of this one among them, from 0 |
| 10 | uint16 | objects in this one |
| 12 | uint32 | sequence: grows by 1 from datagram to datagram, round and round |
| 16 | int64 | time of the list, ns |
| 24 | uint32 | frame |
| 28 | uint32 | objects in the list |
| 32 | uint32 | 0 |
| 36 | uint32 | CRC-32 of the whole datagram, with this as 0 |

| byte | object | |
|---|---|---|
| 0 | uint32 | number |
| 4 | uint8, three 0 | status: 0 detection, 1 tentative, 2 confirmed |
| 8 | 12 of float32 | x y z vx vy x_std y_std vx_std vy_std snr length width |
"""

import struct
import zlib
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.objects.lost import say_lost
from dechirp.objects.rows import (
    MEASURED,
    STATUSES,
    cycle_of,
    made,
    must_be_objects,
    status_codes,
)
from dechirp.objects.saturation import say_beyond

_MARK, _VERSION = b"DCOL", 1
_HEADER = struct.Struct(">4sHHHHIqIIII")
_CRC_AT = 36
_OBJECT = np.dtype(
    [("number", ">u4"), ("status", "u1"), ("zero", "u1", 3)] + [(name, ">f4") for name in MEASURED]
)
MOST_OBJECTS = 25
_ROUND = 2**32
_LATEST_S = 9.2e9  # 291 years in ns are what an int64 holds


class _Header(NamedTuple):
    mark: bytes
    version: int
    n_datagrams: int
    place: int
    n_here: int
    sequence: int
    time_ns: int
    frame: int
    n_objects: int
    zero: int
    crc: int


def datagrams(objects: xr.Dataset, *, sequence: int = 0) -> list[bytes]:
    """Datagrams of an object list, one list for each cycle, in the order of sending.

    Parameters
    ----------
    objects : Dataset
        As `object_list` makes it.
    sequence : int
        Of the first datagram.

    Raises
    ------
    InvalidSetting
        If it is no object list.

    Warns
    -----
    PhysicsWarning
        If numbers or frames are above 4294967295, or values beyond single precision.
    """
    objects = must_be_objects(objects)
    rows = _packed(objects)
    sent: list[bytes] = []
    ends = np.searchsorted(cycle_of(objects), np.arange(objects.sizes["cycle"] + 1))
    frames = np.minimum(objects["cycle_frame"].values, _ROUND - 1).tolist()
    times_ns = np.round(_times_s(objects) * 1e9).astype(np.int64).tolist()
    for start, end, frame, time_ns in zip(ends[:-1], ends[1:], frames, times_ns, strict=True):
        own = rows[start:end]
        n_datagrams = max(1, -(-len(own) // MOST_OBJECTS))
        for place in range(n_datagrams):
            here = own[place * MOST_OBJECTS :][:MOST_OBJECTS]
            header = _Header(
                mark=_MARK,
                version=_VERSION,
                n_datagrams=n_datagrams,
                place=place,
                n_here=len(here),
                sequence=(sequence + len(sent)) % _ROUND,
                time_ns=time_ns,
                frame=frame,
                n_objects=len(own),
                zero=0,
                crc=0,
            )
            sent.append(_checked(_HEADER.pack(*header) + here.tobytes()))
    return sent


def gathered(received: Iterable[bytes]) -> xr.Dataset:
    """Object list of datagrams as they were received.

    Raises
    ------
    InvalidSetting
        If time goes backwards from list to list.

    Warns
    -----
    PhysicsWarning
        If datagrams are damaged, missing, came twice or in another order. What came in another
        order is put right; lists that are not whole are left out.
    """
    heard = _Heard()
    for datagram in received:
        heard.take(datagram)
    whole = [one for (*_, n_datagrams), one in heard.lists.items() if len(one) == n_datagrams]
    heard.say(len(whole))
    first = [one[0].header for one in whole]
    rows = [np.concatenate([one[at].rows for at in sorted(one)]) for one in whole]
    table = np.concatenate([np.empty(0, _OBJECT), *rows])
    frame = np.array([header.frame for header in first], int)
    time_s = np.array([header.time_ns for header in first], np.int64) * 1e-9
    n_rows = [len(one) for one in rows]
    columns = {name: table[name].astype(float) for name in MEASURED}
    columns["number"] = table["number"].astype(int)
    columns["status"] = np.array(STATUSES)[np.minimum(table["status"], len(STATUSES) - 1)]
    columns["frame"], columns["time"] = np.repeat(frame, n_rows), np.repeat(time_s, n_rows)
    order = np.argsort(time_s, kind="stable")
    return must_be_objects(made(columns, frame[order], time_s[order]))


class _Datagram(NamedTuple):
    header: _Header
    rows: np.ndarray


@dataclass
class _Heard:
    """Datagrams by list, and what was wrong with others."""

    lists: dict[tuple[int, ...], dict[int, _Datagram]] = field(default_factory=dict)
    damaged: int = 0
    twice: int = 0
    late: int = 0
    last: int | None = None
    sequences: set[int] = field(default_factory=set)

    def take(self, datagram: bytes) -> None:
        """Sort a datagram into its list, or count what is wrong with it."""
        found = _opened(datagram)
        if found is None:
            self.damaged += 1
            return
        header = found.header
        # A list is known by the sequence of its first datagram; its frame, time and length tell it
        # from one of another sender, or of one that began again.
        start = (header.sequence - header.place) % _ROUND
        key = (start, header.frame, header.time_ns, header.n_datagrams)
        own = self.lists.setdefault(key, {})
        if header.place in own:
            self.twice += 1
            return
        own[header.place] = found
        ahead = 0 if self.last is None else (header.sequence - self.last) % _ROUND
        if ahead >= _ROUND // 2:
            self.late += 1
        else:
            self.last = header.sequence
        self.sequences.add(header.sequence)

    @property
    def missing(self) -> int:
        """Datagrams that did not come, between the first and the last that are known of."""
        if not self.lists:
            return 0
        known = {
            (start + place) % _ROUND
            for start, _, _, n_datagrams in self.lists
            for place in range(n_datagrams)
        }
        gaps = np.diff(sorted(known), append=min(known) + _ROUND) - 1
        # The largest gap lies outside the run, wherever in the round that is.
        return int(gaps.sum() - gaps.max()) + len(known) - len(self.sequences)

    def say(self, n_whole: int) -> None:
        """Warn of what was wrong."""
        counts = {
            "damaged or foreign": self.damaged,
            "missing by their sequence": self.missing,
            "late": self.late,
            "twice": self.twice,
        }
        say_lost(
            counts,
            left=f"{n_whole} of {len(self.lists)} lists are whole",
            need="every datagram once, in order",
            fix="Look at the network's load.",
        )


def _times_s(objects: xr.Dataset) -> np.ndarray:
    return np.clip(objects["cycle_time"].values, -_LATEST_S, _LATEST_S)


def _packed(objects: xr.Dataset) -> np.ndarray:
    rows = np.zeros(objects.sizes["object"], _OBJECT)
    number = objects["number"].values
    largest = float(np.finfo(np.float32).max)
    beyond = {
        "number (to 4294967295)": int((number >= _ROUND).sum()),
        "frame (to 4294967295)": int((objects["cycle_frame"].values >= _ROUND).sum()),
        "time (to 9.2e9 s)": int((_times_s(objects) != objects["cycle_time"].values).sum()),
    }
    rows["number"] = np.minimum(number, _ROUND - 1)
    rows["status"] = status_codes(objects)
    for name in MEASURED:
        values = objects[name].values
        beyond[f"{name} (to {largest:.3g})"] = int((np.abs(values) > largest).sum())
        rows[name] = np.clip(values, -largest, largest)
    say_beyond("a datagram", beyond)
    return rows


def _checked(datagram: bytes) -> bytes:
    """The same with its CRC."""
    crc = zlib.crc32(datagram)
    return datagram[:_CRC_AT] + struct.pack(">I", crc) + datagram[_CRC_AT + 4 :]


def _opened(datagram: bytes) -> _Datagram | None:
    """What a datagram says; none if it is damaged or not of an object list."""
    if len(datagram) < _HEADER.size:
        return None
    header = _Header(*_HEADER.unpack_from(datagram))
    empty = datagram[:_CRC_AT] + bytes(4) + datagram[_CRC_AT + 4 :]
    right = (
        header.mark == _MARK
        and header.version == _VERSION
        and header.crc == zlib.crc32(empty)
        and len(datagram) == _HEADER.size + header.n_here * _OBJECT.itemsize
        and header.place < header.n_datagrams
    )
    if not right:
        return None
    return _Datagram(header, np.frombuffer(datagram, _OBJECT, offset=_HEADER.size))
