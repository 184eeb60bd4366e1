"""Encoder of object lists into CAN FD frames.

A list is a header frame followed by part frames for its objects, all with the same counter. The
header contains the CRC-32 of the header (with checksum 0) and all parts, in order, so a receiver
accepts only complete lists, see `can_lists`.
"""

import zlib
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.errors import InvalidSetting
from dechirp.core.text import format_si
from dechirp.core.units import to_decibels
from dechirp.results.object_lists.can_bus import CanFd
from dechirp.results.object_lists.can_layout import OBJECT_SIGNALS, DbcLayout
from dechirp.results.object_lists.list_columns import (
    check_object_list,
    cycle_indices,
    status_codes,
    warn_clipped_values,
)
from dechirp.results.object_lists.priority import keep_most_important

__all__ = ["largest_bus_load"]

_MAX_TIME_S = 2.0**32  # in 2106: the latest date in logs


class CanFrame(NamedTuple):
    """One frame on the bus."""

    time_s: float
    """Start time: that of the cycle for a header; parts follow each other."""
    identifier: int
    extended: bool
    data: bytes
    fd: bool = True
    """False for a frame of classical CAN."""


def object_list_duration_s(n_objects: int, layout: DbcLayout, bus: CanFd) -> float:
    """Return the longest time that a list of `n_objects` objects occupies the bus."""
    n_parts = -(-n_objects // layout.objects_per_part)
    return _frame_duration_s(layout.header, bus) + n_parts * _frame_duration_s(layout.part, bus)


def max_objects_per_list(cycle_s: float | None, layout: DbcLayout, bus: CanFd) -> int:
    """Return the number of objects that fit into a list, by bus load and DBC signals."""
    if cycle_s is None:
        return layout.max_objects
    spare_s = cycle_s * bus.largest_load - _frame_duration_s(layout.header, bus)
    n_parts = int(spare_s / _frame_duration_s(layout.part, bus) + 1e-9)
    return min(max(n_parts, 0) * layout.objects_per_part, layout.max_objects)


@check_argument_types
def largest_bus_load(objects: xr.Dataset, layout: DbcLayout, bus: CanFd) -> float:
    """Return the share of the bus that the longest list uses; NaN if the cycle time is unknown.

    Worst case in stuff bits, see `can_bus.worst_case_frame_bits`, and before objects are left out.

    Parameters
    ----------
    objects : Dataset
        As `object_list` returns it.
    layout : DbcLayout
        Coding of the objects.
    bus : CanFd
        Bit rates of the bus and its share for the list.
    """
    objects = check_object_list(objects)
    return object_list_duration_s(
        int(_object_counts_per_cycle(objects).max(initial=0)), layout, bus
    ) / (_configured_or_shortest_cycle_s(objects, bus) or np.nan)


def encode_can_frames(
    objects: xr.Dataset, layout: DbcLayout, bus: CanFd, *, first: int = 0
) -> list[CanFrame]:
    """Encode an object list as CAN FD frames, one list for each cycle, in sending order.

    Parameters
    ----------
    objects : Dataset
        As `object_list` returns it.
    layout : DbcLayout
        Signals of the DBC.
    bus : CanFd
        Bit rates and largest load.
    first : int
        Counter of the first list; it wraps at the end of its bits.

    Raises
    ------
    InvalidSetting
        If it is not an object list, or a value is unknown and its signal has no code for that.

    Warns
    -----
    PhysicsWarning
        If a list is too long: the least important objects are left out, see `priority`. If values
        exceed the range of their signals: they are clipped.
    """
    if not isinstance(bus, CanFd):
        raise InvalidSetting("bus", value=repr(bus), expected="a CanFd", fix="give CanFd()")
    objects = check_object_list(objects)
    n_objects = _object_counts_per_cycle(objects)
    objects = _limit_objects_to_bus_load(objects, layout, bus)
    n_kept = _object_counts_per_cycle(objects)
    lists = _encode_signal_columns(_header_signal_values(objects), layout)
    rows = _encode_signal_columns(_object_signal_values(objects), layout)
    ends = np.cumsum(n_kept)
    sent: list[CanFrame] = []
    for index, (n_list, stop) in enumerate(zip(n_kept, ends, strict=True)):
        counter = (first + index) % layout.counter_period
        list_rows = {name: codes[stop - n_list : stop] for name, codes in rows.items()}
        parts = [
            _encode_part_frame(list_rows, number, counter, layout)
            for number in range(-(-int(n_list) // layout.objects_per_part))
        ]
        header = {
            "Counter": counter,
            "NumberOfObjects": int(n_list),
            "LeftOut": min(int(n_objects[index] - n_list), layout.codes["LeftOut"].max_code),
            **{name: int(codes[index]) for name, codes in lists.items()},
        }
        header["Checksum"] = object_list_checksum(header, parts, layout)
        time_s = float(np.clip(objects["cycle_time"].values[index], 0, _MAX_TIME_S))
        sent.append(
            _make_can_frame(layout.header, encode_dbc_message(layout.header, header), time_s)
        )
        time_s += _frame_duration_s(layout.header, bus)
        for number, data in enumerate(parts):
            part_time_s = time_s + number * _frame_duration_s(layout.part, bus)
            sent.append(_make_can_frame(layout.part, data, part_time_s))
    return sent


def object_list_checksum(header: dict[str, int], parts: Sequence[bytes], layout: DbcLayout) -> int:
    """Return the CRC-32 of a header without its checksum, and of all its parts."""
    data = encode_dbc_message(layout.header, {**header, "Checksum": 0})
    return zlib.crc32(b"".join([data, *parts]))


def encode_dbc_message(message: Any, signal_codes: dict[str, int]) -> bytes:
    """Encode a message; signals that dechirp does not use have their initial value, or 0."""
    others = {signal.name: int(signal.raw_initial or 0) for signal in message.signals}
    return bytes(message.encode({**others, **signal_codes}, scaling=False, strict=False))


def _encode_part_frame(
    codes_by_signal: dict[str, np.ndarray], part_number: int, counter: int, layout: DbcLayout
) -> bytes:
    start = part_number * layout.objects_per_part
    codes = {
        f"{name}_{index}": int(code)
        for name, column in codes_by_signal.items()
        for index, code in enumerate(column[start : start + layout.objects_per_part])
    }
    return encode_dbc_message(layout.part, {"Counter": counter, "Part": part_number, **codes})


def _limit_objects_to_bus_load(objects: xr.Dataset, layout: DbcLayout, bus: CanFd) -> xr.Dataset:
    cycle_s = _configured_or_shortest_cycle_s(objects, bus)
    max_objects = max_objects_per_list(cycle_s, layout, bus)
    reason, fix = "the DBC has no room for more", "Give NumberOfObjects and Part more bits."
    if cycle_s is not None and max_objects < layout.max_objects:
        reason = (
            f"the longest takes {largest_bus_load(objects, layout, bus):.0%} of the bus at one"
            f" every {format_si(cycle_s, 's', 4)}, and {bus.largest_load:.0%} are allowed"
        )
        fix = "Raise the bit rates or the largest load."
    return keep_most_important(objects, max_objects, reason=reason, fix=fix)


def _object_counts_per_cycle(objects: xr.Dataset) -> np.ndarray:
    """Return the number of objects in each cycle."""
    return np.bincount(cycle_indices(objects), minlength=objects.sizes["cycle"])


def _configured_or_shortest_cycle_s(objects: xr.Dataset, bus: CanFd) -> float | None:
    times_s = objects["cycle_time"].values
    if bus.cycle_s is not None or len(times_s) < 2:
        return bus.cycle_s
    return float(np.diff(times_s).min())


def _frame_duration_s(message: Any, bus: CanFd) -> float:
    return bus.frame_duration_s(message.length, extended=message.is_extended_frame)


def _make_can_frame(message: Any, data: bytes, time_s: float) -> CanFrame:
    return CanFrame(time_s, message.frame_id, message.is_extended_frame, data)


def _header_signal_values(objects: xr.Dataset) -> dict[str, np.ndarray]:
    return {
        "Frame": objects["cycle_frame"].values.astype(float),
        "Time": objects["cycle_time"].values,
    }


def _object_signal_values(objects: xr.Dataset) -> dict[str, np.ndarray]:
    """Return the values of each signal of an object."""
    with np.errstate(divide="ignore"):  # no signal at all is minus infinity
        converted = {
            "status": status_codes(objects).astype(float),
            "snr": to_decibels(objects["snr"].values),
        }
    return {
        name: converted[signal.column]
        if signal.column in converted
        else objects[signal.column].values * 1.0
        for name, signal in OBJECT_SIGNALS.items()
    }


def _encode_signal_columns(
    values: dict[str, np.ndarray], layout: DbcLayout
) -> dict[str, np.ndarray]:
    n_clipped = {
        f"{name} ({layout.codes[name].min_value:.6g} to {layout.codes[name].max_value:.6g})": int(
            layout.codes[name].out_of_range_mask(column).sum()
        )
        for name, column in values.items()
    }
    warn_clipped_values("the DBC", n_clipped)
    return {name: layout.encode_signal_values(name, column) for name, column in values.items()}
