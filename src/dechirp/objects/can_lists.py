"""Object lists from CAN FD frames: whole ones, and what is missing between them."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr

from dechirp.core.units import from_decibels
from dechirp.objects.can_frames import Frame, checksum
from dechirp.objects.can_layout import OBJECT, Layout
from dechirp.objects.lost import say_lost
from dechirp.objects.rows import STATUSES, made, must_be_objects


@dataclass
class _List:
    """A header, and the parts that came after it by their numbers."""

    header: dict[str, int]
    parts: dict[int, bytes] = field(default_factory=dict)

    def n_parts(self, layout: Layout) -> int:
        return -(-self.header["NumberOfObjects"] // layout.n_per_part)


@dataclass
class _Lost:
    """What did not come through."""

    lists: int = 0
    not_whole: int = 0
    damaged: int = 0
    stray: int = 0


def gathered(received: Iterable[Frame], layout: Layout) -> xr.Dataset:
    """Object list of the frames that were received; other messages are passed over.

    Raises
    ------
    InvalidSetting
        If time goes backwards from list to list.

    Warns
    -----
    PhysicsWarning
        If lists are missing, not whole or damaged. They are left out, so that no object seems
        to be gone that only was not heard of.
    """
    lost = _Lost()
    whole = [one for one in _lists(received, layout, lost) if _is_whole(one, layout, lost)]
    _say(lost, len(whole))
    n_rows = np.array([one.header["NumberOfObjects"] for one in whole], int)
    frame, time_s = (
        layout.codes[name].values(np.array([one.header[name] for one in whole], np.int64))
        for name in ("Frame", "Time")
    )
    columns = _columns([row for one in whole for row in _rows(one, layout)], layout)
    columns["frame"], columns["time"] = np.repeat(frame, n_rows), np.repeat(time_s, n_rows)
    return must_be_objects(made(columns, frame, time_s))


def _lists(received: Iterable[Frame], layout: Layout, lost: _Lost) -> list[_List]:
    """Lists in the order of their headers, whatever became of their parts."""
    lists: list[_List] = []
    ids = {_id(layout.header): layout.header, _id(layout.part): layout.part}
    for frame in received:
        message = ids.get((frame.identifier, frame.extended))
        if message is None:
            continue
        if len(frame.data) < message.length:
            lost.damaged += 1
            continue
        codes = _decoded(message, frame.data)
        if message is layout.header:
            if lists:
                gap = (codes["Counter"] - lists[-1].header["Counter"] - 1) % layout.n_counts
                # Half a round or more is a sender that began again.
                lost.lists += gap if gap < layout.n_counts // 2 else 0
            lists.append(_List(codes))
        elif lists and lists[-1].header["Counter"] == codes["Counter"]:
            lists[-1].parts[codes["Part"]] = frame.data[: message.length]
        else:
            lost.stray += 1
    return lists


def _is_whole(one: _List, layout: Layout, lost: _Lost) -> bool:
    numbers = range(one.n_parts(layout))
    if any(number not in one.parts for number in numbers):
        lost.not_whole += 1
        return False
    header = {name: code for name, code in one.header.items() if name != "Checksum"}
    if (
        checksum(header, [one.parts[number] for number in numbers], layout)
        != one.header["Checksum"]
    ):
        lost.damaged += 1
        return False
    return True


def _rows(one: _List, layout: Layout) -> list[list[int]]:
    """Codes of each object of a list, in the order of `OBJECT`."""
    n_objects = one.header["NumberOfObjects"]
    parts = [_decoded(layout.part, one.parts[number]) for number in range(one.n_parts(layout))]
    return [
        [parts[at // layout.n_per_part][f"{name}_{at % layout.n_per_part}"] for name in OBJECT]
        for at in range(n_objects)
    ]


def _columns(rows: list[list[int]], layout: Layout) -> dict[str, np.ndarray]:
    table = np.array(rows, np.int64).reshape(-1, len(OBJECT))
    columns = {
        one.column: layout.codes[name].values(table[:, at])
        for at, (name, one) in enumerate(OBJECT.items())
    }
    believed = np.clip(columns["status"], 0, len(STATUSES) - 1).astype(int)
    return {
        **columns,
        "status": np.array(STATUSES)[believed],
        "snr": from_decibels(columns["snr"]),
    }


def _decoded(message: Any, data: bytes) -> dict[str, int]:
    return dict(message.decode(data, decode_choices=False, scaling=False, allow_excess=True))


def _id(message: Any) -> tuple[int, bool]:
    return message.frame_id, message.is_extended_frame


def _say(lost: _Lost, n_whole: int) -> None:
    counts = {
        "lists missing by their counters": lost.lists,
        "lists not whole": lost.not_whole,
        "damaged": lost.damaged,
        "parts without a header": lost.stray,
    }
    say_lost(
        counts,
        left=f"{n_whole} lists are whole",
        need="every frame of every list",
        fix="Look for errors and overload on the bus.",
    )
