"""Object lists in logs of a CAN bus (BLF, ASC, candump), and on a live bus.

With the argument `mapping`, they are those of a vendor's radar, see `can_mapping`.
"""

import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import IO, Any

import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.atomic_files import atomic_output_file, check_file_suffix
from dechirp.core.checks import check_integer, check_number
from dechirp.core.errors import InvalidSetting, RecordingError
from dechirp.core.findings import Finding, PhysicsWarning
from dechirp.core.optional_imports import import_from_extra
from dechirp.results.object_lists.can_bus import CanFd
from dechirp.results.object_lists.can_frames import CanFrame, encode_can_frames
from dechirp.results.object_lists.can_layout import DbcLayout, read_dbc_layout
from dechirp.results.object_lists.can_lists import assemble_object_list
from dechirp.results.object_lists.can_mapping import (
    CanMapping,
    VendorLayout,
    message_identifier,
    read_vendor_layout,
)
from dechirp.results.object_lists.vendor_lists import assemble_vendor_list, encode_vendor_frames

__all__ = ["read_can_log", "receive_can", "send_can", "write_can_log"]

_MODULES = {".blf": "blf.BLF", ".asc": "asc.ASC", ".log": "canutils.CanutilsLog"}
"""Module and class prefix in python-can for each suffix."""

SUFFIXES = tuple(_MODULES)

_ENDS_BYTES = 4096
_BLF_SIZE_FIELD = slice(16, 24)  # size of the file in bytes, in its header


@check_argument_types
def write_can_log(
    objects: xr.Dataset,
    path: str | Path,
    *,
    dbc: str | Path | None = None,
    mapping: str | Path | CanMapping | None = None,
    bus: CanFd | None = None,
) -> None:
    """Write an object list as the log of a CAN FD bus, atomically.

    Parameters
    ----------
    objects : Dataset
        As `object_list` returns it.
    path : path
        `.blf`, `.asc` or `.log`, as `candump -L` writes.
    dbc : path, optional
        Coding of the objects; default: the DBC of the package.
    mapping : name, path or CanMapping, optional
        Signals of a vendor's DBC, as `read_vendor_layout` reads it: the log has its messages, in
        frames of CAN FD where the DBC declares them or they have more than 8 bytes.
    bus : CanFd, optional
        Default: 500 kbit/s and 2 Mbit/s, half of it for the list.

    Raises
    ------
    InvalidSetting
        If the list, the DBC or the path cannot be used, or the extra `io` is missing.

    Warns
    -----
    PhysicsWarning
        As `encode_can_frames`: for omitted objects and clipped values.
    """
    path = check_file_suffix(path, SUFFIXES)
    sent = _encode_frames(objects, _read_layout(dbc, mapping), bus or CanFd())
    writer = _python_can_log_class(path, "Writer")
    with atomic_output_file(path) as made, writer(str(made)) as log:
        for frame in sent:
            log.on_message_received(_to_can_message(frame))


@check_argument_types
def read_can_log(
    path: str | Path,
    *,
    dbc: str | Path | None = None,
    mapping: str | Path | CanMapping | None = None,
) -> xr.Dataset:
    """Read the object list in the log of a CAN bus; other messages are ignored.

    `dbc` and `mapping` are those of `write_can_log`.

    Parameters
    ----------
    path : path
        `.blf`, `.asc` or `.log`, as `candump -L` writes.
    dbc : path, optional
        Coding of the objects; default: the DBC of the package.
    mapping : name, path or CanMapping, optional
        Signals of a vendor's DBC.

    Raises
    ------
    RecordingError
        If it cannot be read, or has frames but no object list.
    InvalidSetting
        If the DBC cannot be used, time decreases, or the extra `io` is missing.

    Warns
    -----
    PhysicsWarning
        If lists are missing, incomplete or damaged; they are omitted. If the log is cut off: a BLF
        shorter than its header states, an ASC without the end of its trigger block, a candump
        that ends within a line, or a last list of a vendor's radar without all of its messages. One
        that ends between two lists cannot be told from a whole log.
    """
    path, layout = check_file_suffix(path, SUFFIXES), _read_layout(dbc, mapping)
    reader = _python_can_log_class(path, "Reader")
    try:
        # Readers that fail on their first bytes do not close files that they opened themselves.
        with _open_log_file(path) as file, reader(file) as log:
            n_frames, received = _count_and_select_object_frames(log, _identifiers(layout))
            is_invalid = n_frames == 0 and not _is_valid_empty_log(log, path)
    except OSError as error:
        raise RecordingError(
            path,
            value=error.strerror or error,
            expected="a readable file",
            fix="check the path",
        ) from None
    except Exception as error:
        # Readers raise various exceptions for damaged logs.
        reason = " ".join(str(error).split()) or type(error).__name__
        raise RecordingError(
            path,
            value=f"not a {path.suffix} log ({'; '.join(filter(None, [reason, _cut(path)]))})",
            expected="a complete log",
            fix="write it again, or remove its damaged end",
        ) from None
    if is_invalid:
        raise RecordingError(
            path,
            value="truncated, or not a log of a CAN bus: it has no readable frame",
            expected="a complete log",
            fix="write it again, or give a valid file",
        )
    if n_frames and not received:
        raise RecordingError(
            path,
            value=f"{n_frames} frames, none with the identifier"
            f" {min(_identifiers(layout))[0]:#x} of an object list",
            expected=f"messages of {Path(layout.name).name}",
            fix="give the DBC with which it was written",
        )
    if cut := _cut(path):
        finding = Finding(
            level="warning",
            setting=str(path),
            value=f"{cut}; {n_frames} frames before it",
            expected="a complete log",
            fix="copy it again from its source, if the lists after it matter",
        )
        warnings.warn(PhysicsWarning(finding), stacklevel=3)
    return _assemble_frames(received, layout)


@check_argument_types
def send_can(
    objects: xr.Dataset,
    bus: Any,
    *,
    dbc: str | Path | None = None,
    mapping: str | Path | CanMapping | None = None,
    rates: CanFd | None = None,
    first: int = 0,
) -> int:
    """Send an object list on a bus of python-can, at the rate at which it accepts frames.

    Parameters
    ----------
    objects : Dataset
        As `object_list` returns it; one list for each cycle.
    bus : can.BusABC
    dbc, mapping, rates
        As `dbc`, `mapping` and `bus` of `write_can_log`.
    first : int
        Counter of the first list.

    Returns
    -------
    int
        Counter for the next call.

    Raises
    ------
    InvalidSetting
        As `write_can_log`, or if the bus rejects a frame.
    """
    layout = _read_layout(dbc, mapping)
    check_integer("first", first, at_least=0)
    sent = _encode_frames(objects, layout, rates or CanFd(), first=first)
    _check_python_can_bus(bus)
    try:
        for frame in sent:
            bus.send(_to_can_message(frame))
    except import_from_extra("io", "can").CanError as error:
        raise _bus_error(f"a bus that fails with: {error}") from None
    return (first + objects.sizes.get("cycle", 0)) % layout.counter_period


@check_argument_types
def receive_can(
    bus: Any,
    *,
    dbc: str | Path | None = None,
    mapping: str | Path | CanMapping | None = None,
    idle_s: float = 1.0,
    at_most_s: float = 3600.0,
) -> xr.Dataset:
    """Receive object lists from a bus of python-can until it is idle for `idle_s`.

    Reception ends after `at_most_s` in any case; losses are reported as by `read_can_log`.

    Parameters
    ----------
    bus : can.BusABC
        An open bus of python-can that takes CAN FD.
    dbc : path, optional
        Coding of the objects; default: the DBC of the package.
    mapping : name, path or CanMapping, optional
        Signals of a vendor's DBC.
    idle_s : float
        Time without a message that ends the reception, above 0 and at most 1e6 s.
    at_most_s : float
        Longest time of reception, above 0 and at most 1e6 s.

    Raises
    ------
    InvalidSetting
        If the bus or the DBC cannot be used, or time decreases.
    """
    _check_python_can_bus(bus)
    check_number("idle_s", idle_s, above=0.0, at_most=1e6)
    check_number("at_most_s", at_most_s, above=0.0, at_most=1e6)
    return _assemble_frames(_iter_bus_frames(bus, idle_s, at_most_s), _read_layout(dbc, mapping))


def _read_layout(
    dbc: str | Path | None, mapping: str | Path | CanMapping | None
) -> DbcLayout | VendorLayout:
    if mapping is None:
        return read_dbc_layout(dbc)
    if dbc is None:
        raise InvalidSetting(
            "dbc",
            value="None, with a mapping",
            expected="the DBC of the vendor's radar, which the package does not contain",
            fix="give its path",
        )
    return read_vendor_layout(dbc, mapping)


def _identifiers(layout: DbcLayout | VendorLayout) -> set[tuple[int, bool]]:
    if isinstance(layout, VendorLayout):
        return layout.identifiers
    return {message_identifier(message) for message in (layout.header, layout.part)}


def _encode_frames(
    objects: xr.Dataset, layout: DbcLayout | VendorLayout, bus: CanFd, *, first: int = 0
) -> list[CanFrame]:
    if isinstance(layout, VendorLayout):
        return encode_vendor_frames(objects, layout, bus, first=first)
    return encode_can_frames(objects, layout, bus, first=first)


def _assemble_frames(received: Iterable[CanFrame], layout: DbcLayout | VendorLayout) -> xr.Dataset:
    if isinstance(layout, VendorLayout):
        return assemble_vendor_list(received, layout)
    return assemble_object_list(received, layout)


def _is_valid_empty_log(log: Any, path: Path) -> bool:
    """Return True if a log without frames is valid: the readers skip unknown content."""
    if path.suffix.lower() == ".asc":
        return log.date is not None or log.timestamps_format is not None
    return getattr(log, "object_count", 0) == 0  # from the header of a BLF


def _cut(path: Path) -> str:
    """Return where a log is cut off; empty if nothing shows it."""
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(_ENDS_BYTES)
        file.seek(max(size - _ENDS_BYTES, 0))
        tail = file.read()
    if path.suffix.lower() == ".blf":
        stated = int.from_bytes(head[_BLF_SIZE_FIELD], "little")
        return f"cut off at byte {size} of {stated} in its header" if size < stated else ""
    if tail and not tail.endswith((b"\n", b"\r")):
        return f"cut off within a line, at byte {size}"
    has_block, has_end = (
        word in part.lower()
        for word, part in ((b"begin triggerblock", head), (b"end triggerblock", tail))
    )
    if path.suffix.lower() == ".asc" and has_block and not has_end:
        return f"cut off before the end of its trigger block, at byte {size}"
    return ""


def _count_and_select_object_frames(
    log: Iterable[Any], identifiers: set[tuple[int, bool]]
) -> tuple[int, list[CanFrame]]:
    """Count the frames in a log, and keep those of object lists: logs may have gigabytes."""
    n_frames, received = 0, []
    for message in log:
        n_frames += 1
        if (message.arbitration_id, message.is_extended_id) in identifiers:
            received.append(_from_can_message(message))
    return n_frames, received


def _iter_bus_frames(bus: Any, idle_s: float, at_most_s: float) -> Iterator[CanFrame]:
    end_s = time.monotonic() + at_most_s
    try:
        while time.monotonic() < end_s and (message := bus.recv(idle_s)) is not None:
            yield _from_can_message(message)
    except import_from_extra("io", "can").CanError as error:
        raise _bus_error(f"a bus that fails with: {error}") from None


def _check_python_can_bus(bus: object) -> None:
    if not isinstance(bus, import_from_extra("io", "can").BusABC):
        raise _bus_error(repr(bus))


def _bus_error(value: str) -> InvalidSetting:
    need, fix = "an open bus of python-can that takes CAN FD", "give can.Bus(..., fd=True)"
    return InvalidSetting("bus", value=value, expected=need, fix=fix)


def _open_log_file(path: Path) -> IO[Any]:
    if path.suffix.lower() == ".blf":
        return path.open("rb")
    return path.open(encoding="utf-8", errors="replace")


def _python_can_log_class(path: Path, reader_or_writer: str) -> Callable[[object], Any]:
    module, name = _MODULES[path.suffix.lower()].split(".")
    return getattr(import_from_extra("io", f"can.io.{module}"), f"{name}{reader_or_writer}")


def _to_can_message(frame: CanFrame) -> Any:
    return import_from_extra("io", "can").Message(
        timestamp=frame.time_s,
        arbitration_id=frame.identifier,
        is_extended_id=frame.extended,
        is_fd=frame.fd,
        bitrate_switch=frame.fd,
        is_rx=False,
        data=frame.data,
        channel=0,
    )


def _from_can_message(message: Any) -> CanFrame:
    return CanFrame(
        message.timestamp, message.arbitration_id, message.is_extended_id, bytes(message.data)
    )
