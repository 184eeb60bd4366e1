"""Encoder and decoder of object lists as datagrams for Automotive Ethernet.

A list is one datagram or several, each with a header of 40 bytes and up to 25 objects of 56
bytes: 1440 bytes, within the 1472 that Ethernet carries in one piece. Numbers are big-endian,
(network order); floats are IEEE 754, NaN where unknown.

| byte | header | |
|---|---|---|
| 0 | `DCOL` | mark |
| 4 | uint16 | version of the layout, 1 |
| 6 | uint16 | datagrams of the list |
| 8 | uint16 | index of this one among them, from 0 |
| 10 | uint16 | objects in this one |
| 12 | uint32 | sequence: increases by 1 from datagram to datagram, modulo 2^32 |
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

ASAM OSI's `SensorData` (see `osi`) has no field for the SNR of a track or for the number, length
and width of a detection. It takes 2.2 to 2.7 times as many bytes, more than one datagram holds, and
OSI does not define how to divide a message.
"""

import struct
import zlib
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.results.object_lists.list_columns import (
    MEASURED,
    STATUSES,
    build_object_list,
    check_object_list,
    cycle_indices,
    status_codes,
    warn_clipped_values,
    warn_lost_messages,
)

_MARK, _VERSION = b"DCOL", 1
_HEADER = struct.Struct(">4sHHHHIqIIII")
_CRC_OFFSET = 36
_OBJECT = np.dtype(
    [("number", ">u4"), ("status", "u1"), ("zero", "u1", 3)] + [(name, ">f4") for name in MEASURED]
)
MAX_OBJECTS_PER_DATAGRAM = 25
_SEQUENCE_PERIOD = 2**32
_MAX_TIME_S = 9.2e9  # 291 years in ns are what an int64 holds


class _Header(NamedTuple):
    mark: bytes
    version: int
    n_datagrams: int
    part_index: int
    n_objects_here: int
    sequence: int
    time_ns: int
    frame: int
    n_objects: int
    zero: int
    crc: int


def encode_datagrams(objects: xr.Dataset, *, sequence: int = 0) -> list[bytes]:
    """Encode an object list as datagrams, one list for each cycle, in sending order.

    Parameters
    ----------
    objects : Dataset
        As `object_list` returns it.
    sequence : int
        Sequence number of the first datagram.

    Raises
    ------
    InvalidSetting
        If it is not an object list.

    Warns
    -----
    PhysicsWarning
        If numbers or frames are above 4294967295, or values beyond single precision.
    """
    objects = check_object_list(objects)
    rows = _objects_to_binary_records(objects)
    sent: list[bytes] = []
    bounds = np.searchsorted(cycle_indices(objects), np.arange(objects.sizes["cycle"] + 1))
    frames = np.minimum(objects["cycle_frame"].values, _SEQUENCE_PERIOD - 1).tolist()
    times_ns = np.round(_cycle_times_clipped_to_field_s(objects) * 1e9).astype(np.int64).tolist()
    for start, end, frame, time_ns in zip(bounds[:-1], bounds[1:], frames, times_ns, strict=True):
        list_rows = rows[start:end]
        n_datagrams = max(1, -(-len(list_rows) // MAX_OBJECTS_PER_DATAGRAM))
        for index in range(n_datagrams):
            part_rows = list_rows[index * MAX_OBJECTS_PER_DATAGRAM :][:MAX_OBJECTS_PER_DATAGRAM]
            header = _Header(
                mark=_MARK,
                version=_VERSION,
                n_datagrams=n_datagrams,
                part_index=index,
                n_objects_here=len(part_rows),
                sequence=(sequence + len(sent)) % _SEQUENCE_PERIOD,
                time_ns=time_ns,
                frame=frame,
                n_objects=len(list_rows),
                zero=0,
                crc=0,
            )
            sent.append(_insert_crc(_HEADER.pack(*header) + part_rows.tobytes()))
    return sent


def object_list_from_datagrams(received: Iterable[bytes]) -> xr.Dataset:
    """Assemble an object list from received datagrams.

    Raises
    ------
    InvalidSetting
        If time decreases from list to list.

    Warns
    -----
    PhysicsWarning
        If datagrams are damaged, missing, duplicate or out of order. Reordered datagrams are
        sorted; incomplete lists are omitted.
    """
    collector = _DatagramCollector()
    for datagram in received:
        collector.add_datagram(datagram)
    complete = [
        parts
        for (*_, n_datagrams), parts in collector.parts_by_list.items()
        if len(parts) == n_datagrams
    ]
    collector.warn_losses(len(complete))
    headers = [parts[0].header for parts in complete]
    rows = [np.concatenate([parts[index].rows for index in sorted(parts)]) for parts in complete]
    table = np.concatenate([np.empty(0, _OBJECT), *rows])
    frame = np.array([header.frame for header in headers], int)
    time_s = np.array([header.time_ns for header in headers], np.int64) * 1e-9
    n_rows = [len(parts) for parts in rows]
    columns = {name: table[name].astype(float) for name in MEASURED}
    columns["number"] = table["number"].astype(int)
    columns["status"] = np.array(STATUSES)[np.minimum(table["status"], len(STATUSES) - 1)]
    columns["frame"], columns["time"] = np.repeat(frame, n_rows), np.repeat(time_s, n_rows)
    order = np.argsort(time_s, kind="stable")
    return check_object_list(build_object_list(columns, frame[order], time_s[order]))


class _Datagram(NamedTuple):
    header: _Header
    rows: np.ndarray


@dataclass
class _DatagramCollector:
    """Datagrams by list, and counts of damaged, late and duplicate ones."""

    parts_by_list: dict[tuple[int, ...], dict[int, _Datagram]] = field(default_factory=dict)
    n_damaged: int = 0
    n_duplicates: int = 0
    n_late: int = 0
    last_sequence: int | None = None
    sequences: set[int] = field(default_factory=set)

    def add_datagram(self, datagram: bytes) -> None:
        """Add a datagram to its list, or count its defect."""
        parsed = _parse_datagram(datagram)
        if parsed is None:
            self.n_damaged += 1
            return
        header = parsed.header
        # The sequence of its first datagram identifies a list; frame, time and length distinguish
        # it from lists of another sender, or of one that restarted.
        start = (header.sequence - header.part_index) % _SEQUENCE_PERIOD
        key = (start, header.frame, header.time_ns, header.n_datagrams)
        parts = self.parts_by_list.setdefault(key, {})
        if header.part_index in parts:
            self.n_duplicates += 1
            return
        parts[header.part_index] = parsed
        ahead = (
            0
            if self.last_sequence is None
            else (header.sequence - self.last_sequence) % _SEQUENCE_PERIOD
        )
        if ahead >= _SEQUENCE_PERIOD // 2:
            self.n_late += 1
        else:
            self.last_sequence = header.sequence
        self.sequences.add(header.sequence)

    @property
    def n_missing_datagrams(self) -> int:
        """Number of datagrams missing between the first and the last known ones."""
        if not self.parts_by_list:
            return 0
        sequences = {
            (start + index) % _SEQUENCE_PERIOD
            for start, _, _, n_datagrams in self.parts_by_list
            for index in range(n_datagrams)
        }
        gaps = np.diff(sorted(sequences), append=min(sequences) + _SEQUENCE_PERIOD) - 1
        # The largest gap lies outside the received sequence, wherever that wraps.
        return int(gaps.sum() - gaps.max()) + len(sequences) - len(self.sequences)

    def warn_losses(self, n_complete: int) -> None:
        """Warn about damaged, missing, late and duplicate datagrams."""
        counts = {
            "damaged or foreign": self.n_damaged,
            "missing in the sequence": self.n_missing_datagrams,
            "late": self.n_late,
            "duplicate": self.n_duplicates,
        }
        warn_lost_messages(
            counts,
            remaining=f"{n_complete} of {len(self.parts_by_list)} lists are complete",
            expected="every datagram once, in order",
            fix="check the network load",
        )


def _cycle_times_clipped_to_field_s(objects: xr.Dataset) -> np.ndarray:
    return np.clip(objects["cycle_time"].values, -_MAX_TIME_S, _MAX_TIME_S)


def _objects_to_binary_records(objects: xr.Dataset) -> np.ndarray:
    rows = np.zeros(objects.sizes["object"], _OBJECT)
    number = objects["number"].values
    largest = float(np.finfo(np.float32).max)
    n_clipped = {
        "number (to 4294967295)": int((number >= _SEQUENCE_PERIOD).sum()),
        "frame (to 4294967295)": int((objects["cycle_frame"].values >= _SEQUENCE_PERIOD).sum()),
        "time (to 9.2e9 s)": int(
            (_cycle_times_clipped_to_field_s(objects) != objects["cycle_time"].values).sum()
        ),
    }
    rows["number"] = np.minimum(number, _SEQUENCE_PERIOD - 1)
    rows["status"] = status_codes(objects)
    for name in MEASURED:
        values = objects[name].values
        n_clipped[f"{name} (to {largest:.3g})"] = int((np.abs(values) > largest).sum())
        rows[name] = np.clip(values, -largest, largest)
    warn_clipped_values("a datagram", n_clipped)
    return rows


def _insert_crc(datagram: bytes) -> bytes:
    """Return the datagram with its CRC."""
    crc = zlib.crc32(datagram)
    return datagram[:_CRC_OFFSET] + struct.pack(">I", crc) + datagram[_CRC_OFFSET + 4 :]


def _parse_datagram(datagram: bytes) -> _Datagram | None:
    """Parse a datagram; return None if it is damaged or not of an object list."""
    if len(datagram) < _HEADER.size:
        return None
    header = _Header(*_HEADER.unpack_from(datagram))
    without_crc = datagram[:_CRC_OFFSET] + bytes(4) + datagram[_CRC_OFFSET + 4 :]
    is_valid = (
        header.mark == _MARK
        and header.version == _VERSION
        and header.crc == zlib.crc32(without_crc)
        and len(datagram) == _HEADER.size + header.n_objects_here * _OBJECT.itemsize
        and header.part_index < header.n_datagrams
    )
    if not is_valid:
        return None
    return _Datagram(header, np.frombuffer(datagram, _OBJECT, offset=_HEADER.size))
