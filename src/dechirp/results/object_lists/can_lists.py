"""Decoder of object lists from CAN FD frames, with a count of lost and damaged lists."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr

from dechirp.core.units import from_decibels
from dechirp.results.object_lists.can_frames import CanFrame, object_list_checksum
from dechirp.results.object_lists.can_layout import OBJECT_SIGNALS, DbcLayout
from dechirp.results.object_lists.list_columns import (
    STATUSES,
    build_object_list,
    check_object_list,
    warn_lost_messages,
)


@dataclass
class _ReceivedList:
    """A header, and the parts received after it by their numbers."""

    header: dict[str, int]
    parts: dict[int, bytes] = field(default_factory=dict)

    def n_expected_parts(self, layout: DbcLayout) -> int:
        return -(-self.header["NumberOfObjects"] // layout.objects_per_part)


@dataclass
class _LossCounts:
    """Counts of lost and damaged messages."""

    missing_lists: int = 0
    incomplete_lists: int = 0
    damaged_lists: int = 0
    stray_parts: int = 0


def assemble_object_list(received_frames: Iterable[CanFrame], layout: DbcLayout) -> xr.Dataset:
    """Assemble an object list from received frames; other messages are ignored.

    Raises
    ------
    InvalidSetting
        If time decreases from list to list.

    Warns
    -----
    PhysicsWarning
        If lists are missing, incomplete or damaged. They are omitted, so that no object seems to
        have disappeared.
    """
    losses = _LossCounts()
    complete = [
        received_list
        for received_list in _group_frames_by_list(received_frames, layout, losses)
        if _is_complete_else_count_loss(received_list, layout, losses)
    ]
    _warn_lost_lists(losses, len(complete))
    n_rows = np.array([received_list.header["NumberOfObjects"] for received_list in complete], int)
    frame, time_s = (
        layout.codes[name].decode_codes(
            np.array([received_list.header[name] for received_list in complete], np.int64)
        )
        for name in ("Frame", "Time")
    )
    columns = _decode_object_columns(
        [
            row
            for received_list in complete
            for row in _signal_codes_by_object(received_list, layout)
        ],
        layout,
    )
    columns["frame"], columns["time"] = np.repeat(frame, n_rows), np.repeat(time_s, n_rows)
    return check_object_list(build_object_list(columns, frame, time_s))


def _group_frames_by_list(
    received_frames: Iterable[CanFrame], layout: DbcLayout, losses: _LossCounts
) -> list[_ReceivedList]:
    """Return the lists in the order of their headers, complete or not."""
    lists: list[_ReceivedList] = []
    ids = {
        _can_id_and_extended_flag(layout.header): layout.header,
        _can_id_and_extended_flag(layout.part): layout.part,
    }
    for frame in received_frames:
        message = ids.get((frame.identifier, frame.extended))
        if message is None:
            continue
        if len(frame.data) < message.length:
            losses.damaged_lists += 1
            continue
        codes = _decode_signal_codes(message, frame.data)
        if message is layout.header:
            if lists:
                gap = (codes["Counter"] - lists[-1].header["Counter"] - 1) % layout.counter_period
                # A gap of half the period or more means that the sender restarted.
                losses.missing_lists += gap if gap < layout.counter_period // 2 else 0
            lists.append(_ReceivedList(codes))
        elif lists and lists[-1].header["Counter"] == codes["Counter"]:
            lists[-1].parts[codes["Part"]] = frame.data[: message.length]
        else:
            losses.stray_parts += 1
    return lists


def _is_complete_else_count_loss(
    received_list: _ReceivedList, layout: DbcLayout, losses: _LossCounts
) -> bool:
    numbers = range(received_list.n_expected_parts(layout))
    if any(number not in received_list.parts for number in numbers):
        losses.incomplete_lists += 1
        return False
    header = {name: code for name, code in received_list.header.items() if name != "Checksum"}
    if (
        object_list_checksum(header, [received_list.parts[number] for number in numbers], layout)
        != received_list.header["Checksum"]
    ):
        losses.damaged_lists += 1
        return False
    return True


def _signal_codes_by_object(received_list: _ReceivedList, layout: DbcLayout) -> list[list[int]]:
    """Return the codes of each object of a list, in the order of `OBJECT_SIGNALS`."""
    n_objects = received_list.header["NumberOfObjects"]
    parts = [
        _decode_signal_codes(layout.part, received_list.parts[number])
        for number in range(received_list.n_expected_parts(layout))
    ]
    return [
        [
            parts[index // layout.objects_per_part][f"{name}_{index % layout.objects_per_part}"]
            for name in OBJECT_SIGNALS
        ]
        for index in range(n_objects)
    ]


def _decode_object_columns(
    codes_of_objects: list[list[int]], layout: DbcLayout
) -> dict[str, np.ndarray]:
    table = np.array(codes_of_objects, np.int64).reshape(-1, len(OBJECT_SIGNALS))
    columns = {
        signal.column: layout.codes[name].decode_codes(table[:, index])
        for index, (name, signal) in enumerate(OBJECT_SIGNALS.items())
    }
    status_code = np.clip(columns["status"], 0, len(STATUSES) - 1).astype(int)
    return {
        **columns,
        "status": np.array(STATUSES)[status_code],
        "snr": from_decibels(columns["snr"]),
    }


def _decode_signal_codes(message: Any, data: bytes) -> dict[str, int]:
    return dict(message.decode(data, decode_choices=False, scaling=False, allow_excess=True))


def _can_id_and_extended_flag(message: Any) -> tuple[int, bool]:
    return message.frame_id, message.is_extended_frame


def _warn_lost_lists(losses: _LossCounts, n_complete: int) -> None:
    counts = {
        "lists missing by their counters": losses.missing_lists,
        "incomplete lists": losses.incomplete_lists,
        "damaged frames or lists": losses.damaged_lists,
        "parts without a header": losses.stray_parts,
    }
    warn_lost_messages(
        counts,
        remaining=f"{n_complete} lists are complete",
        expected="every frame of every list",
        fix="incomplete lists are omitted; look for errors and overload on the bus",
    )
