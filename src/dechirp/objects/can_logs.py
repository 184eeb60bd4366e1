"""Object lists in logs of a CAN bus (BLF, ASC, candump), and on a bus."""

import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import IO, Any

import xarray as xr

from dechirp.core.checks import number, whole
from dechirp.core.errors import InvalidSetting, RecordingError
from dechirp.core.extra import library
from dechirp.objects.can_bus import CanFd
from dechirp.objects.can_frames import Frame, frames
from dechirp.objects.can_layout import Layout, layout
from dechirp.objects.can_lists import gathered
from dechirp.objects.whole import named, whole_file

_MODULES = {".blf": "blf.BLF", ".asc": "asc.ASC", ".log": "canutils.CanutilsLog"}
"""Where python-can has the reader and the writer of each suffix."""

SUFFIXES = tuple(_MODULES)


def write_can_log(
    objects: xr.Dataset,
    path: str | Path,
    *,
    dbc: str | Path | None = None,
    bus: CanFd | None = None,
) -> None:
    """Write an object list as the log of a CAN FD bus, whole or not at all.

    Parameters
    ----------
    objects : Dataset
        As `object_list` makes it.
    path : path
        `.blf`, `.asc` or `.log`, as `candump -L` writes.
    dbc : path, optional
        How objects are coded; the DBC of the package without it.
    bus : CanFd, optional
        500 kbit/s and 2 Mbit/s, half of it for the list, without it.

    Raises
    ------
    InvalidSetting
        If the list, the DBC or the path cannot be used, or the extra `io` is missing.

    Warns
    -----
    PhysicsWarning
        As `frames`: what is left out, and what is beyond what can be told.
    """
    path = named(path, SUFFIXES)
    sent = frames(objects, layout(dbc), bus or CanFd())
    writer = _of(path, "Writer")
    with whole_file(path) as made, writer(str(made)) as log:
        for frame in sent:
            log.on_message_received(_message(frame))


def read_can_log(path: str | Path, *, dbc: str | Path | None = None) -> xr.Dataset:
    """Read the object list in the log of a CAN bus; other traffic is passed over.

    Raises
    ------
    RecordingError
        If it cannot be read, or has frames but no object list.
    InvalidSetting
        If the DBC cannot be used, time goes backwards, or the extra `io` is missing.

    Warns
    -----
    PhysicsWarning
        If lists are missing, not whole or damaged; they are left out.
    """
    path, found = named(path, SUFFIXES), layout(dbc)
    reader = _of(path, "Reader")
    try:
        # A reader that fails on its first bytes would leave a file open that it opened itself.
        with _opened(path) as file, reader(file) as log:
            n_frames, received = _ours(log, found)
            is_none = n_frames == 0 and not _is_whole(log, path)
    except OSError as error:
        raise RecordingError(
            path, got=error.strerror or error, need="a file that can be read", fix="Check the path."
        ) from None
    except Exception as error:
        # A damaged log makes the readers fail wherever their parsers happen to be.
        raise RecordingError(
            path,
            got=f"no {path.suffix} log ({' '.join(str(error).split()) or type(error).__name__})",
            need="a whole log",
            fix="Write it again, or cut off its damaged end.",
        ) from None
    if is_none:
        raise RecordingError(
            path,
            got="cut off, or no log of a CAN bus: no frame can be read of it",
            need="a whole log",
            fix="Write it again, or give the file that is one.",
        )
    if n_frames and not received:
        raise RecordingError(
            path,
            got=f"{n_frames} frames, none with the identifier {found.header.frame_id:#x}",
            need=f"an {found.header.name}",
            fix="Give the DBC that it was written with.",
        )
    return gathered(received, found)


def send_can(
    objects: xr.Dataset,
    bus: Any,
    *,
    dbc: str | Path | None = None,
    rates: CanFd | None = None,
    first: int = 0,
) -> int:
    """Send an object list on a bus of python-can, as fast as that takes it.

    Parameters
    ----------
    objects : Dataset
        As `object_list` makes it; one list for each cycle.
    bus : can.BusABC
    dbc, rates
        As `dbc` and `bus` of `write_can_log`.
    first : int
        Counter of the first list.

    Returns
    -------
    int
        Counter to go on with.

    Raises
    ------
    InvalidSetting
        As `write_can_log`, or if the bus does not take a frame.
    """
    found = layout(dbc)
    whole("first", first, at_least=0)
    sent = frames(objects, found, rates or CanFd(), first=first)
    _must_be_bus(bus)
    try:
        for frame in sent:
            bus.send(_message(frame))
    except library("can").CanError as error:
        raise _not_a_bus(f"one that says: {error}") from None
    return (first + objects.sizes.get("cycle", 0)) % found.n_counts


def receive_can(
    bus: Any,
    *,
    dbc: str | Path | None = None,
    idle_s: float = 1.0,
    at_most_s: float = 3600.0,
) -> xr.Dataset:
    """Receive object lists from a bus of python-can until it is idle for `idle_s`.

    It ends after `at_most_s` all the same; what is wrong with lists is told as by `read_can_log`.

    Raises
    ------
    InvalidSetting
        If the bus or the DBC cannot be used, or time goes backwards.
    """
    _must_be_bus(bus)
    number("idle_s", idle_s, above=0.0, at_most=1e6)
    number("at_most_s", at_most_s, above=0.0, at_most=1e6)
    return gathered(_heard(bus, idle_s, at_most_s), layout(dbc))


def _is_whole(log: Any, path: Path) -> bool:
    """Whether a log without frames is one: the readers pass over what they do not know."""
    if path.suffix.lower() == ".asc":
        return log.date is not None or log.timestamps_format is not None
    return getattr(log, "object_count", 0) == 0  # as the head of a BLF says


def _ours(log: Iterable[Any], found: Layout) -> tuple[int, list[Frame]]:
    """Frames in a log, and those of object lists: other traffic may be gigabytes."""
    ours = {(m.frame_id, m.is_extended_frame) for m in (found.header, found.part)}
    n_frames, received = 0, []
    for message in log:
        n_frames += 1
        if (message.arbitration_id, message.is_extended_id) in ours:
            received.append(_frame(message))
    return n_frames, received


def _heard(bus: Any, idle_s: float, at_most_s: float) -> Iterator[Frame]:
    end_s = time.monotonic() + at_most_s
    try:
        while time.monotonic() < end_s and (message := bus.recv(idle_s)) is not None:
            yield _frame(message)
    except library("can").CanError as error:
        raise _not_a_bus(f"one that says: {error}") from None


def _must_be_bus(bus: object) -> None:
    if not isinstance(bus, library("can").BusABC):
        raise _not_a_bus(repr(bus))


def _not_a_bus(got: str) -> InvalidSetting:
    need, fix = "an open bus of python-can that takes CAN FD", "Give can.Bus(..., fd=True)."
    return InvalidSetting("bus", got=got, need=need, fix=fix)


def _opened(path: Path) -> IO[Any]:
    if path.suffix.lower() == ".blf":
        return path.open("rb")
    return path.open(encoding="utf-8", errors="replace")


def _of(path: Path, kind: str) -> Callable[[object], Any]:
    module, name = _MODULES[path.suffix.lower()].split(".")
    return getattr(library(f"can.io.{module}"), f"{name}{kind}")


def _message(frame: Frame) -> Any:
    return library("can").Message(
        timestamp=frame.time_s,
        arbitration_id=frame.identifier,
        is_extended_id=frame.extended,
        is_fd=True,
        bitrate_switch=True,
        is_rx=False,
        data=frame.data,
        channel=0,
    )


def _frame(message: Any) -> Frame:
    return Frame(
        message.timestamp, message.arbitration_id, message.is_extended_id, bytes(message.data)
    )
