"""Object lists in the CAN messages of a vendor's radar, through its DBC and a mapping."""

import warnings
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr

from dechirp.core.findings import Finding, PhysicsWarning
from dechirp.core.text import format_si
from dechirp.results.object_lists.can_bus import CanFd
from dechirp.results.object_lists.can_frames import CanFrame, encode_dbc_message
from dechirp.results.object_lists.can_mapping import VendorLayout, message_identifier
from dechirp.results.object_lists.list_columns import (
    COLUMNS,
    MEASURED,
    build_object_list,
    check_object_list,
    warn_clipped_values,
    warn_lost_messages,
)
from dechirp.results.object_lists.priority import keep_most_important

_MAX_TIME_S = 2.0**32
_MAX_CLASSIC_BYTES = 8


@dataclass
class _VendorList:
    """Time of one list, and the signal codes of its objects by number."""

    time_s: float
    counter: int | None
    codes: dict[int, dict[str, int]] = field(default_factory=dict)
    identifiers: set[tuple[int, bool, int]] = field(default_factory=set)


def assemble_vendor_list(received_frames: Iterable[CanFrame], layout: VendorLayout) -> xr.Dataset:
    """Assemble an object list from received frames; other messages are ignored.

    A list begins at the message `start` of the mapping, where the counter changes, and before
    a second message of the same object. Its time is that of its first message.

    Raises
    ------
    InvalidSetting
        If time decreases from list to list.

    Warns
    -----
    PhysicsWarning
        If messages are shorter than their signals; they are omitted. If the last list ends before
        messages that the list before it has, or within an object of several messages.
    """
    lists: list[_VendorList] = []
    n_short = 0
    start = None if layout.start is None else message_identifier(layout.start)
    number_signal, counter_signal = str(layout.mapping.number), str(layout.mapping.counter)
    for frame in received_frames:
        identifier = (frame.identifier, frame.extended)
        if identifier == start:
            lists.append(_VendorList(frame.time_s, None))
            continue
        decoder = layout.decoders.get(identifier)
        if decoder is None:
            continue
        if len(frame.data) < decoder.length:
            n_short += 1
            continue
        codes = decoder.decode_codes(frame.data)
        slot = layout.slots[identifier]
        number = codes.get(number_signal, 0) if slot is None else slot
        counter = codes.get(counter_signal)
        sent = (*identifier, number)
        if (
            not lists
            or sent in lists[-1].identifiers
            or (None not in (counter, lists[-1].counter) and counter != lists[-1].counter)
        ):
            lists.append(_VendorList(frame.time_s, counter))
        current = lists[-1]
        current.counter = counter if current.counter is None else current.counter
        current.identifiers.add(sent)
        current.codes.setdefault(number, {}).update(codes)
    warn_lost_messages(
        {"messages shorter than their signals": n_short},
        remaining=f"{len(lists)} lists remain",
        expected="messages with the length of the DBC",
        fix="look for the DBC of this radar",
    )
    if n_missing := _count_missing_messages(lists, layout):
        finding = Finding(
            level="warning",
            setting="objects",
            value=f"list {len(lists) - 1}, the last, lacks {n_missing} messages at its end",
            expected="a log that ends between two lists",
            fix=f"select lists before frame {len(lists) - 1} if its missing objects matter",
        )
        warnings.warn(PhysicsWarning(finding), stacklevel=4)
    return _vendor_lists_to_object_list(lists, layout)


def _count_missing_messages(lists: list[_VendorList], layout: VendorLayout) -> int:
    """Count the messages that the last list lacks, as in a log cut off between two messages.

    The list before gives the messages with fixed places, and the kinds of those of numbered
    objects, each of which has one of each kind.
    """
    if len(lists) < 2:
        return 0
    previous, last = lists[-2].identifiers, lists[-1].identifiers
    expected = set()
    for identifier, extended, number in previous:
        is_fixed = layout.slots[identifier, extended] is not None
        numbers = [number] if is_fixed else [item[2] for item in last]
        expected |= {(identifier, extended, expected_number) for expected_number in numbers}
    return len(expected - last)


def _vendor_lists_to_object_list(lists: list[_VendorList], layout: VendorLayout) -> xr.Dataset:
    status = layout.mapping.status
    status_of_code = (
        {}
        if status is None
        else {code: name for name, codes in status.codes.items() for code in codes}
    )
    rows = [
        (cycle, number, codes, name)
        for cycle, received in enumerate(lists)
        for number, codes in received.codes.items()
        if (
            name := "confirmed"
            if status is None
            else status_of_code.get(codes.get(status.signal, status.empty))
        )
        and not any(codes.get(signal) == code for signal, code in layout.empty_codes.items())
    ]

    def quantity(name: str) -> np.ndarray:
        mapped = layout.mapping.signals.get(name)
        if mapped is None:
            return np.full(len(rows), np.nan)
        codes = [row[2].get(mapped.signal) for row in rows]
        is_known = np.array([code is not None for code in codes], bool)
        numbers = np.array([code or 0 for code in codes], np.int64)
        physical = layout.codes[mapped.signal].decode_codes(numbers)
        return np.where(is_known, mapped.quantity_from_physical(physical), np.nan)

    cycle_time_s = np.array([received.time_s for received in lists], float)
    frame = np.array([row[0] for row in rows], int)
    columns = {name: quantity(name) for name in MEASURED if name in COLUMNS}
    columns |= _positions_and_velocities({name: quantity(name) for name in _POLAR}, columns)
    columns["frame"], columns["time"] = frame, cycle_time_s[frame]
    columns["number"] = np.array([row[1] for row in rows], int)
    columns["status"] = np.array([row[3] for row in rows], "U9")
    return check_object_list(build_object_list(columns, np.arange(len(lists)), cycle_time_s))


_POLAR = ("range", "azimuth", "elevation", "range_rate")


def _positions_and_velocities(
    polar: dict[str, np.ndarray], columns: dict[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Return x, y, z, vx, vy where range, azimuth, elevation or range rate are mapped."""
    has_elevation = ~np.isnan(polar["elevation"])
    elevation = np.nan_to_num(polar["elevation"])
    ground_m = polar["range"] * np.cos(elevation)
    is_polar = ~np.isnan(polar["range"])
    x = np.where(is_polar, ground_m * np.cos(polar["azimuth"]), columns["x"])
    y = np.where(is_polar, ground_m * np.sin(polar["azimuth"]), columns["y"])
    z = np.where(is_polar & has_elevation, polar["range"] * np.sin(elevation), columns["z"])
    radial = polar["range_rate"] / np.maximum(_distance_m(x, y, z), 1e-9)
    has_rate = ~np.isnan(radial)
    return {
        "x": x,
        "y": y,
        "z": z,
        "vx": np.where(has_rate, radial * x, columns["vx"]),
        "vy": np.where(has_rate, radial * y, columns["vy"]),
    }


def _distance_m(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    return np.sqrt(x**2 + y**2 + np.nan_to_num(z) ** 2)


def encode_vendor_frames(
    objects: xr.Dataset, layout: VendorLayout, bus: CanFd, *, first: int = 0
) -> list[CanFrame]:
    """Encode an object list as CAN frames of a vendor's radar, list by list.

    Frames are those of CAN FD where the DBC declares them or a message has more than 8 bytes, else
    those of classical CAN.

    An object keeps its number as the number of its message where that exists and is free; the
    others get free messages. Messages without an object have the `empty` status and values.

    Warns
    -----
    PhysicsWarning
        If objects are left out, values are clipped, unknown values are sent as 0, or a list takes
        longer than the time to the next.
    """
    objects = check_object_list(objects)
    by_slot: dict[int | None, list[Any]] = {}
    for identifier, message in layout.messages.items():
        by_slot.setdefault(layout.slots[identifier], []).append(message)
    numbers = sorted(number for number in by_slot if number is not None)
    is_fixed = bool(numbers)
    if is_fixed:
        objects = keep_most_important(
            objects,
            len(numbers),
            reason=f"{layout.name} has {len(numbers)} messages of objects",
            fix="Use a DBC with more of them.",
        )
    rows = _encode_quantities(objects, layout)
    sent: list[CanFrame] = []
    frame, number = objects["frame"].values, objects["number"].values
    for index, (cycle, time_s) in enumerate(
        zip(objects["cycle_frame"].values, objects["cycle_time"].values, strict=True)
    ):
        indices = np.flatnonzero(frame == cycle)
        counter = (
            {}
            if layout.mapping.counter is None
            else {layout.mapping.counter: (first + index) % layout.counter_period}
        )
        messages: list[tuple[Any, dict[str, int]]]
        messages = [] if layout.start is None else [(layout.start, {})]
        if is_fixed:
            row_of_slot = _assign_slots(number[indices], indices, numbers)
            messages += [
                (message, {**counter, **_row_or_empty(rows, row_of_slot.get(slot), layout)})
                for slot in numbers
                for message in by_slot[slot]
            ]
        else:
            messages += [
                (message, {**counter, **_row_or_empty(rows, int(row), layout)})
                for row in indices
                for message in by_slot[None]
            ]
        sent += _time_messages(messages, float(np.clip(time_s, 0, _MAX_TIME_S)), bus, layout)
    _warn_lists_beyond_cycle(sent, objects["cycle_time"].values)
    return sent


def _warn_lists_beyond_cycle(sent: list[CanFrame], cycle_time_s: np.ndarray) -> None:
    """Warn if the frames of a list begin after the time of the next one."""
    times_s = np.array([frame.time_s for frame in sent])
    if cycle_time_s.size > 1 and np.any(np.diff(times_s) < 0):
        finding = Finding(
            level="warning",
            setting="objects",
            value=f"lists of {len(sent) // cycle_time_s.size} messages take longer than their"
            f" cycle of {format_si(float(np.diff(cycle_time_s).min()), 's', 3)}",
            expected="lists that end before the next begins",
            fix="raise the bit rates of the bus, or list every second frame",
        )
        warnings.warn(PhysicsWarning(finding), stacklevel=4)


def _time_messages(
    messages: list[tuple[Any, dict[str, int]]], time_s: float, bus: CanFd, layout: VendorLayout
) -> Iterator[CanFrame]:
    checksum = layout.mapping.checksum
    for message, codes in messages:
        bits = {signal.name: signal.length for signal in message.signals}
        known = {name: code for name, code in codes.items() if name in bits}
        if checksum is not None and checksum in bits:
            known[checksum] = 0
            total = _sum_of_message(message.frame_id, encode_dbc_message(message, known))
            known[checksum] = total % 2 ** bits[checksum]
        data = encode_dbc_message(message, known)
        extended = message.is_extended_frame
        fd = is_fd_message(message)
        yield CanFrame(time_s, message.frame_id, extended, data, fd=fd)
        time_s += (
            bus.frame_duration_s(message.length, extended=extended)
            if fd
            else bus.classic_frame_duration_s(message.length, extended=extended)
        )


def _sum_of_message(identifier: int, data: bytes) -> int:
    """Return the sum of the bytes of an identifier, the number of bytes, and the bytes."""
    return sum(identifier.to_bytes(4, "big")) + len(data) + sum(data)


def is_fd_message(message: Any) -> bool:
    """Return True if the DBC declares CAN FD, or the message is too long for classical CAN."""
    return bool(message.is_fd) or message.length > _MAX_CLASSIC_BYTES


def _assign_slots(number: np.ndarray, indices: np.ndarray, slots: list[int]) -> dict[int, int]:
    """Return the row of each used slot: that of its number, and free ones for the others."""
    row_of_slot: dict[int, int] = {}
    others = []
    for object_number, row in zip(number.tolist(), indices.tolist(), strict=True):
        if object_number in slots and object_number not in row_of_slot:
            row_of_slot[object_number] = row
        else:
            others.append(row)
    free = (slot for slot in slots if slot not in row_of_slot)
    return {**row_of_slot, **{slot: row for row, slot in zip(others, list(free), strict=False)}}


def _row_or_empty(
    rows: dict[str, np.ndarray], row: int | None, layout: VendorLayout
) -> dict[str, int]:
    if row is not None:
        return {name: int(codes[row]) for name, codes in rows.items()}
    return layout.empty_codes


def _encode_quantities(objects: xr.Dataset, layout: VendorLayout) -> dict[str, np.ndarray]:
    """Return the codes of each mapped signal for all objects."""
    values = _quantities_of_objects(objects)
    rows: dict[str, np.ndarray] = {}
    n_clipped, n_unknown = {}, {}
    for name, mapped in layout.mapping.signals.items():
        codes = layout.codes[mapped.signal]
        physical = mapped.physical_from_quantity(values[name])
        is_unknown = np.isnan(physical)
        if codes.unknown_code is None:
            n_unknown[name] = int(is_unknown.sum())
            physical = np.where(is_unknown, 0.0, physical)
        limits = f"{mapped.signal} ({codes.min_value:.6g} to {codes.max_value:.6g})"
        n_clipped[limits] = int((codes.out_of_range_mask(physical) & ~is_unknown).sum())
        rows[mapped.signal] = codes.encode_values(physical)
        if mapped.empty is not None:  # the nearest other code: this one would hide the object
            empty_code = layout.empty_codes[mapped.signal]
            other_code = empty_code + (1 if empty_code < codes.max_code else -1)
            is_empty_code = rows[mapped.signal] == empty_code
            rows[mapped.signal] = np.where(is_empty_code, other_code, rows[mapped.signal])
    warn_clipped_values("the DBC", n_clipped)
    _warn_unknown_values(n_unknown)
    if layout.mapping.number is not None:
        codes = layout.codes[layout.mapping.number]
        rows[layout.mapping.number] = codes.encode_values(objects["number"].values.astype(float))
    status = layout.mapping.status
    if status is not None:
        fallback = next(codes[0] for codes in status.codes.values() if codes)
        code_of = {name: codes[0] if codes else fallback for name, codes in status.codes.items()}
        names = objects["status"].values
        rows[status.signal] = np.array([code_of[name] for name in names], np.int64)
    return rows


def _quantities_of_objects(objects: xr.Dataset) -> dict[str, np.ndarray]:
    values = {name: objects[name].values for name in MEASURED}
    x, y, z = (values[name] for name in ("x", "y", "z"))
    distance_m = _distance_m(x, y, z)
    with np.errstate(invalid="ignore", divide="ignore"):
        values["range_rate"] = (values["vx"] * x + values["vy"] * y) / (
            distance_m * (np.hypot(x, y) / distance_m) ** 2
        )
    values["range"] = distance_m
    values["azimuth"] = np.arctan2(y, x)
    values["elevation"] = np.arctan2(z, np.hypot(x, y))
    return values


def _warn_unknown_values(n_unknown: dict[str, int]) -> None:
    counts = {name: n for name, n in n_unknown.items() if n}
    if counts:
        finding = Finding(
            level="warning",
            setting="objects",
            value=f"{sum(counts.values())} unknown values sent as 0: "
            + ", ".join(f"{n} of {name}" for name, n in counts.items()),
            expected="values for all signals: the DBC has no code for unknown ones",
            fix="leave such objects out, or name a code NotAvailable in the DBC",
        )
        warnings.warn(PhysicsWarning(finding), stacklevel=4)
