"""Object lists as CAN FD frames.

A list is a header frame, then as many part frames as its objects need, all with the same
counter. The header has the CRC-32 of itself, its checksum 0, and of all its parts, in order: so
a list is read whole or not at all, see `can_lists`.
"""

import zlib
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.errors import InvalidSetting
from dechirp.core.units import decibels
from dechirp.objects.can_bus import CanFd
from dechirp.objects.can_layout import OBJECT, Layout
from dechirp.objects.priority import most_important
from dechirp.objects.rows import cycle_of, must_be_objects, status_codes
from dechirp.objects.saturation import say_beyond

_LATEST_S = 2.0**32  # in 2106: what logs can write as a date


class Frame(NamedTuple):
    """One frame on the bus."""

    time_s: float
    """At which it begins: a header at the time of its cycle, parts after each other."""
    identifier: int
    extended: bool
    data: bytes


def list_s(n_objects: int, layout: Layout, bus: CanFd) -> float:
    """Longest time for which a list of so many objects occupies the bus."""
    n_parts = -(-n_objects // layout.n_per_part)
    return _frame_s(layout.header, bus) + n_parts * _frame_s(layout.part, bus)


def n_fitting(cycle_s: float | None, layout: Layout, bus: CanFd) -> int:
    """Objects that fit into a list, by the bus and by the signals of the DBC."""
    if cycle_s is None:
        return layout.most_objects
    spare_s = cycle_s * bus.largest_load - _frame_s(layout.header, bus)
    n_parts = int(spare_s / _frame_s(layout.part, bus) + 1e-9)
    return min(max(n_parts, 0) * layout.n_per_part, layout.most_objects)


def bus_load(objects: xr.Dataset, layout: Layout, bus: CanFd) -> float:
    """Share of the bus that the longest list takes; NaN where the time between lists is unknown.

    Worst case in stuff bits, see `can_bus.frame_bits`, and before anything is left out.
    """
    objects = must_be_objects(objects)
    return list_s(int(_lengths(objects).max(initial=0)), layout, bus) / (
        _cycle_s(objects, bus) or np.nan
    )


def frames(objects: xr.Dataset, layout: Layout, bus: CanFd, *, first: int = 0) -> list[Frame]:
    """Frames of an object list, one list for each cycle, in the order in which they are sent.

    Parameters
    ----------
    objects : Dataset
        As `object_list` makes it.
    layout : Layout
        Of the DBC.
    bus : CanFd
        How fast it is, and how much of it may be taken.
    first : int
        Counter of the first list; it goes round where its bits end.

    Raises
    ------
    InvalidSetting
        If it is no object list, or the DBC has no code for something that is not told.

    Warns
    -----
    PhysicsWarning
        If a list is longer than what fits: the least important objects are left out, see
        `priority`. If values are beyond what signals can say: they are told as the nearest.
    """
    if not isinstance(bus, CanFd):
        raise InvalidSetting("bus", got=repr(bus), need="a CanFd", fix="Give CanFd().")
    objects = must_be_objects(objects)
    n_all = _lengths(objects)
    objects = _cut(objects, layout, bus)
    n_kept = _lengths(objects)
    lists = _coded(_cycle_values(objects), layout)
    rows = _coded(_object_values(objects), layout)
    ends = np.cumsum(n_kept)
    sent: list[Frame] = []
    for place, (n, end) in enumerate(zip(n_kept, ends, strict=True)):
        counter = (first + place) % layout.n_counts
        own = {name: codes[end - n : end] for name, codes in rows.items()}
        parts = [
            _part(own, number, counter, layout) for number in range(-(-int(n) // layout.n_per_part))
        ]
        header = {
            "Counter": counter,
            "NumberOfObjects": int(n),
            "LeftOut": min(int(n_all[place] - n), layout.codes["LeftOut"].high),
            **{name: int(codes[place]) for name, codes in lists.items()},
        }
        header["Checksum"] = checksum(header, parts, layout)
        time_s = float(np.clip(objects["cycle_time"].values[place], 0, _LATEST_S))
        sent.append(_frame(layout.header, encoded(layout.header, header), time_s))
        time_s += _frame_s(layout.header, bus)
        for number, data in enumerate(parts):
            at_s = time_s + number * _frame_s(layout.part, bus)
            sent.append(_frame(layout.part, data, at_s))
    return sent


def checksum(header: dict[str, int], parts: Sequence[bytes], layout: Layout) -> int:
    """CRC-32 of a header without its checksum, and of all its parts."""
    data = encoded(layout.header, {**header, "Checksum": 0})
    return zlib.crc32(b"".join([data, *parts]))


def encoded(message: Any, codes: dict[str, int]) -> bytes:
    """Bytes of a message; signals that are not ours are as the DBC has them at first, or 0."""
    others = {signal.name: int(signal.raw_initial or 0) for signal in message.signals}
    return bytes(message.encode({**others, **codes}, scaling=False, strict=False))


def _part(rows: dict[str, np.ndarray], number: int, counter: int, layout: Layout) -> bytes:
    start = number * layout.n_per_part
    codes = {
        f"{name}_{place}": int(code)
        for name, column in rows.items()
        for place, code in enumerate(column[start : start + layout.n_per_part])
    }
    return encoded(layout.part, {"Counter": counter, "Part": number, **codes})


def _cut(objects: xr.Dataset, layout: Layout, bus: CanFd) -> xr.Dataset:
    cycle_s = _cycle_s(objects, bus)
    at_most = n_fitting(cycle_s, layout, bus)
    why, fix = "the DBC has no room for more", "Give NumberOfObjects and Part more bits."
    if cycle_s is not None and at_most < layout.most_objects:
        why = (
            f"the longest takes {bus_load(objects, layout, bus):.0%} of the bus at one every "
            f"{cycle_s:.4g} s, and {bus.largest_load:.0%} are allowed"
        )
        fix = "Raise the bit rates or the largest load."
    return most_important(objects, at_most, why=why, fix=fix)


def _lengths(objects: xr.Dataset) -> np.ndarray:
    """Objects of each cycle."""
    return np.bincount(cycle_of(objects), minlength=objects.sizes["cycle"])


def _cycle_s(objects: xr.Dataset, bus: CanFd) -> float | None:
    times_s = objects["cycle_time"].values
    if bus.cycle_s is not None or len(times_s) < 2:
        return bus.cycle_s
    return float(np.diff(times_s).min())


def _frame_s(message: Any, bus: CanFd) -> float:
    return bus.frame_s(message.length, extended=message.is_extended_frame)


def _frame(message: Any, data: bytes, time_s: float) -> Frame:
    return Frame(time_s, message.frame_id, message.is_extended_frame, data)


def _cycle_values(objects: xr.Dataset) -> dict[str, np.ndarray]:
    return {
        "Frame": objects["cycle_frame"].values.astype(float),
        "Time": objects["cycle_time"].values,
    }


def _object_values(objects: xr.Dataset) -> dict[str, np.ndarray]:
    """Values of each signal of an object."""
    with np.errstate(divide="ignore"):  # no signal at all is minus infinity
        special = {
            "status": status_codes(objects).astype(float),
            "snr": decibels(objects["snr"].values),
        }
    return {
        name: special[one.column] if one.column in special else objects[one.column].values * 1.0
        for name, one in OBJECT.items()
    }


def _coded(values: dict[str, np.ndarray], layout: Layout) -> dict[str, np.ndarray]:
    beyond = {
        f"{name} ({layout.codes[name].least:.6g} to {layout.codes[name].most:.6g})": int(
            layout.codes[name].beyond(column).sum()
        )
        for name, column in values.items()
    }
    say_beyond("the DBC", beyond)
    return {name: layout.coded(name, column) for name, column in values.items()}
