"""Object lists over Automotive Ethernet: one ASAM OSI `SensorData` message per UDP datagram.

A datagram contains the bytes of one message and nothing else, see `osi` for its fields. IP divides
datagrams that exceed an Ethernet packet, and the checksum of UDP detects damage. Gaps of the
`cycle_counter` of the messages, which is the frame, are the lists that were lost. Lists that arrive
late are sorted, and others whose time or counter goes back begin a new run, see
`receive_datagrams`.
"""

import socket
import time
import warnings
from bisect import bisect_left
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from statistics import median
from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_integer, check_number
from dechirp.core.display import format_count_with_noun
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding, PhysicsWarning
from dechirp.core.text import format_si
from dechirp.results.object_lists.list_columns import (
    check_measured_columns,
    check_non_negative_integers,
    check_object_list,
    warn_lost_messages,
)
from dechirp.results.object_lists.osi import (
    NO_OBJECT_LIST,
    SECOND_OF_CYCLE,
    DecodedMessage,
    build_decoded_lists,
    decode_message,
    find_list_senders,
    merge_cycle_messages,
    osi_messages,
    osi_version,
    parse_sensor_data,
    unset_constant_counters,
)
from dechirp.results.object_lists.priority import keep_most_important

__all__ = ["open_receiver", "receive_datagrams", "send_datagrams"]

MAX_OBJECTS_PER_LIST = 400  # of up to 150 bytes each, within the 65507 of a UDP datagram
_SEND_BUFFER = 2**17  # bytes; macOS sends no datagram that exceeds it, 9216 by default
_RECEIVE_BUFFER = 2**22  # bytes; a system may grant less
_MAX_LATE_S = 1.0 + 1e-6  # networks delay by less, restarts take longer; and rounding
_MAX_TIME_S = 2.0**33  # 272 years; float64 then resolves 2 us
_MIN_PERIOD_S = 1e-5  # between lists of equal time
_UNKNOWN_PERIOD_S = 0.1  # between single lists of senders that restart


@check_argument_types
def send_datagrams(objects: xr.Dataset, host: str, port: int, *, sensor_id: int = 0) -> int:
    """Send an object list by UDP, without pacing: an ASAM OSI `SensorData` message for each cycle.

    Parameters
    ----------
    objects : Dataset
        As `object_list` returns it.
    host : str
        Name or address.
    port : int
        1 to 65535.
    sensor_id : int
        Number of the sensor in the messages; unique among the sensors that send to this port.

    Returns
    -------
    int
        Number of datagrams, one for each cycle.

    Raises
    ------
    InvalidSetting
        If it is not an object list, the host cannot be found or reached, or the extra `io` is
        missing.

    Warns
    -----
    PhysicsWarning
        If a list has more than 400 objects; the least important of them are left out.
    """
    check_integer("port", port, at_least=1, at_most=65535)
    check_integer("sensor_id", sensor_id, at_least=0, at_most=2**63 - 1)
    datagrams = encode_datagrams(objects, sensor_id)
    kind, address = _resolve_address(host, port)
    try:
        with socket.socket(kind, socket.SOCK_DGRAM) as udp_socket:
            udp_socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
            for datagram in datagrams:
                udp_socket.sendto(datagram, address)
    except OSError as error:
        raise _unreachable_error(host, port, error) from None
    return len(datagrams)


def encode_datagrams(objects: xr.Dataset, sensor_id: int = 0) -> list[bytes]:
    """Encode an object list as datagrams, one for each cycle, see `send_datagrams`."""
    objects = keep_most_important(
        check_object_list(objects),
        MAX_OBJECTS_PER_LIST,
        reason="a message has to fit in one UDP datagram",
        fix="send fewer objects, or write an .osi trace",
    )
    return [message.SerializeToString() for message in osi_messages(objects, sensor_id)]


@check_argument_types
def open_receiver(port: int, host: str = "127.0.0.1") -> socket.socket:
    """Open a socket that receives object lists; the caller closes it.

    Parameters
    ----------
    port : int
        0 for any free one: `getsockname()` returns it.
    host : str
        Address of the network interface, this machine's loopback by default.

    Raises
    ------
    InvalidSetting
        If it cannot be opened.
    """
    check_integer("port", port, at_least=0, at_most=65535)
    kind, address = _resolve_address(host, port)
    udp_socket = socket.socket(kind, socket.SOCK_DGRAM)
    try:
        udp_socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
        udp_socket.bind(address)
    except OSError as error:
        udp_socket.close()
        raise _unreachable_error(host, port, error) from None
    return udp_socket


@check_argument_types
def receive_datagrams(
    udp_socket: socket.socket,
    *,
    sensor_id: int | None = None,
    idle_s: float = 1.0,
    at_most_s: float = 3600.0,
) -> xr.Dataset:
    """Receive the object lists of one sensor on an open socket until it is idle for `idle_s`.

    A message without objects is an empty list if its sensor sends lists in other messages, is the
    only one, or is `sensor_id`; otherwise it is left out. It is merged with another message of its
    sensor that has the same time, unless their frames differ. Frames that are all equal, although
    times differ, count as unknown.

    Identical datagrams are duplicates. A list whose time is at most 1 s before the latest is
    sorted by time, then by frame; of equal times, the later list is moved by 10 us. A list begins a
    new run, as after a restart of the sender, if its time is earlier than that, its frame is not
    between those of the lists before and after it, or another list has its time and no frame
    differs. Late lists and duplicates of the previous run, within 1 s of its end, are sorted into
    it. Runs are kept in order of arrival, with frames counted from 0. The times of a run that
    overlaps the one before are increased, so that it begins one cycle (the median one) later.

    Parameters
    ----------
    udp_socket : socket
        From `open_receiver`.
    sensor_id : int, optional
        Number of the sensor in the messages; by default that of the first list with objects, or
        with the fields of a list.
    idle_s, at_most_s : float
        Idle time after which reception ends, and largest total time.

    Raises
    ------
    InvalidSetting
        If the socket is closed or not a UDP socket, or the extra `io` is missing.

    Warns
    -----
    PhysicsWarning
        If datagrams are damaged or foreign, missing, duplicate or out of order, the sender
        restarts, or lists of other sensors are left out.
    """
    if not isinstance(udp_socket, socket.socket):
        raise _socket_error(repr(udp_socket))
    if sensor_id is not None:
        check_integer("sensor_id", sensor_id, at_least=0, at_most=2**64 - 1)
    check_number("idle_s", idle_s, above=0.0, at_most=1e6)
    check_number("at_most_s", at_most_s, above=0.0, at_most=1e6)
    osi_version()  # a missing extra is reported before waiting for packets
    # Decoding takes 2 ms for 100 objects, so it waits until the last datagram is out of the buffer.
    return object_list_from_datagrams(
        [*_iter_received_datagrams(udp_socket, idle_s, at_most_s)], sensor_id
    )


def object_list_from_datagrams(
    received: Iterable[bytes], sensor_id: int | None = None
) -> xr.Dataset:
    """Assemble an object list from received datagrams, sorted by time, see `receive_datagrams`."""
    counts: Counter[str] = Counter()
    messages = [
        (decoded, datagram)
        for datagram in received
        if (decoded := _decode_datagram(datagram, counts)) is not None
    ]
    senders, counts[NO_OBJECT_LIST] = find_list_senders(
        [decoded for decoded, _ in messages if decoded.sensor_id != sensor_id]
    )
    chosen_id = next(iter(senders), None) if sensor_id is None else sensor_id
    of_chosen = [message for message in messages if message[0].sensor_id == chosen_id]
    lists_of_chosen = unset_constant_counters([decoded for decoded, _ in of_chosen])
    arrivals = [*zip(lists_of_chosen, (datagram for _, datagram in of_chosen), strict=True)]
    runs = _split_at_restarts(arrivals, counts)
    counts["missing"] = sum(map(_count_missing_frames, runs))
    lists = _join_runs(runs, counts)
    n_lists = format_count_with_noun(len(lists), "list")
    warn_lost_messages(
        counts,
        remaining=f"{n_lists} received",
        expected="every datagram once, in order, with objects or radar detections",
        fix="check the network load, and which programs send to this port",
        stacklevel=5,
    )
    if sensor_id is None or not arrivals:
        n_of_sensor = Counter(decoded.sensor_id for decoded, _ in messages if decoded.has_list)
        warn_lost_messages(
            {f"of sensor {other}": n for other, n in n_of_sensor.items() if other != chosen_id},
            remaining=f"{n_lists} of sensor {chosen_id} received",
            expected="the lists of one sensor at a port",
            fix="receive another sensor with sensor_id=, or send it to a port of its own",
            stacklevel=5,
        )
    return build_decoded_lists(lists)


def _decode_datagram(datagram: bytes, counts: Counter[str]) -> DecodedMessage | None:
    """Return the list in a datagram; count damaged and foreign ones, and return None."""
    message = parse_sensor_data(datagram)
    if message is None or not message.HasField("timestamp"):
        counts["damaged or foreign"] += 1
        return None
    decoded = decode_message(message)
    try:
        check_measured_columns(decoded.columns)
        check_non_negative_integers("objects.number", decoded.columns["number"])
        check_non_negative_integers("objects.frame", np.array([decoded.frame or 0]))
        check_number("objects.time", decoded.time_s, at_least=-_MAX_TIME_S, at_most=_MAX_TIME_S)
    except InvalidSetting:
        counts["damaged or foreign"] += 1
        return None
    return decoded


class _Run(NamedTuple):
    """Lists between two restarts of the sender, by time, and the datagrams they arrived in."""

    lists: list[DecodedMessage]
    datagrams: set[bytes]


def _split_at_restarts(
    arrivals: Iterable[tuple[DecodedMessage, bytes]], counts: Counter[str]
) -> list[list[DecodedMessage]]:
    """Return the runs between restarts of the sender; count late, duplicate and merged lists."""
    runs: list[_Run] = []
    for message, datagram in arrivals:
        decoded = message
        for run in _find_possible_runs(message.time_s, runs):
            if datagram in run.datagrams:
                counts["duplicate"] += 1
                break
            decoded = _merge_rest_of_cycle(decoded, run.lists, counts)
            if _insert_in_order(decoded, run.lists, counts):
                run.datagrams.add(datagram)
                break
        else:
            runs.append(_Run([decoded], {datagram}))
    return [run.lists for run in runs]


def _find_possible_runs(time_s: float, runs: Sequence[_Run]) -> list[_Run]:
    """Return the runs to which a list of this time may belong, the most probable first.

    These are the current one, and the previous one if it ended within 1 s of this time.
    """
    is_near = [abs(run.lists[-1].time_s - time_s) <= _MAX_LATE_S for run in runs[-2:]]
    if len(runs) < 2 or not is_near[0]:
        return [*runs[-1:]]
    return [runs[-1], runs[-2]] if is_near[1] else [runs[-2], runs[-1]]


def _merge_rest_of_cycle(
    decoded: DecodedMessage, run: list[DecodedMessage], counts: Counter[str]
) -> DecodedMessage:
    """Merge a message with the one of its cycle in a run, if there is one, and remove that."""
    if not _is_too_late(decoded, run):
        index = bisect_left(run, _time_and_frame(decoded), key=_time_and_frame)
        for neighbour in range(max(index - 1, 0), min(index + 1, len(run))):
            if merged := merge_cycle_messages(run[neighbour], decoded):
                del run[neighbour]
                counts[SECOND_OF_CYCLE] += 1
                return merged
    return decoded


def _insert_in_order(
    decoded: DecodedMessage, run: list[DecodedMessage], counts: Counter[str]
) -> bool:
    """Insert a list into a run by its time; return False if it is too late or not in order."""
    index = bisect_left(run, _time_and_frame(decoded), key=_time_and_frame)
    if _is_too_late(decoded, run) or not _is_in_order(decoded, run, index):
        return False
    counts["late"] += index < len(run)
    run.insert(index, decoded)
    return True


def _time_and_frame(decoded: DecodedMessage) -> tuple[float, int]:
    return decoded.time_s, -1 if decoded.frame is None else decoded.frame


def _is_too_late(decoded: DecodedMessage, run: list[DecodedMessage]) -> bool:
    return bool(run) and run[-1].time_s - decoded.time_s > _MAX_LATE_S


def _is_in_order(decoded: DecodedMessage, run: list[DecodedMessage], index: int) -> bool:
    """Return whether a list at an index of a run has a frame between others, or its own time."""
    for neighbour in run[max(index - 1, 0) : index + 1]:
        if neighbour.time_s == decoded.time_s and None in (neighbour.frame, decoded.frame):
            return False
    if decoded.frame is None:
        return True
    frames_before = (run[i].frame for i in range(index - 1, -1, -1))
    frames_after = (run[i].frame for i in range(index, len(run)))
    previous = next((frame for frame in frames_before if frame is not None), -1)
    following = next((frame for frame in frames_after if frame is not None), np.inf)
    return previous < decoded.frame < following


def _join_runs(
    runs: Sequence[Sequence[DecodedMessage]], counts: Counter[str]
) -> list[DecodedMessage]:
    """Join the runs with increasing times, and frames from 0 if there are several.

    Warns
    -----
    PhysicsWarning
        If there were restarts.
    """
    periods_s = [later.time_s - earlier.time_s for run in runs for earlier, later in pairwise(run)]
    period_s = median([period for period in periods_s if period > 0] or [_UNKNOWN_PERIOD_S])
    lists: list[DecodedMessage] = []
    restarts = []
    for run in runs:
        shift_s = 0.0
        if lists:
            restarts.append(f"from frame {len(lists)} on")
            if run[0].time_s <= lists[-1].time_s:
                shift_s = lists[-1].time_s + period_s - run[0].time_s
                restarts[-1] += f" times increased by {format_si(shift_s, 's')}"
        for decoded in run:
            time_s = decoded.time_s + shift_s
            if lists and time_s <= lists[-1].time_s:
                counts["of equal times, moved by 10 us"] += 1
            earliest_s = lists[-1].time_s + _MIN_PERIOD_S if lists else time_s
            lists.append(decoded._replace(time_s=max(time_s, earliest_s)))
    if not restarts:
        return lists
    more = f" and {len(restarts) - 3} more" if len(restarts) > 3 else ""
    finding = Finding(
        level="warning",
        setting="objects",
        value=f"{format_count_with_noun(len(restarts), 'restart')} of the sender, whose times or"
        f" frames went back: {', '.join(restarts[:3])}{more}; frames counted from 0",
        expected="times and frames that increase",
        fix="subtract any increase where the clock of the sender is needed; if several programs"
        " send to this port, give each its own sensor_id",
    )
    warnings.warn(PhysicsWarning(finding), stacklevel=5)
    return [decoded._replace(frame=frame) for frame, decoded in enumerate(lists)]


def _count_missing_frames(run: Sequence[DecodedMessage]) -> int:
    """Return the number of frames missing between the first and the last; 0 without counters."""
    known = {decoded.frame for decoded in run if decoded.frame is not None}
    return max(max(known) - min(known) + 1 - len(run), 0) if known else 0


def _iter_received_datagrams(
    udp_socket: socket.socket, idle_s: float, at_most_s: float
) -> Iterator[bytes]:
    end_s = time.monotonic() + at_most_s
    while time.monotonic() < end_s:
        try:
            udp_socket.settimeout(idle_s)
            yield udp_socket.recv(2**16)
        except TimeoutError:
            return
        except OSError as error:
            raise _socket_error(f"a socket that fails with: {error.strerror or error}") from None


def _socket_error(value: str) -> InvalidSetting:
    expected, fix = "an open UDP socket", "give one from open_receiver()"
    return InvalidSetting("udp_socket", value=value, expected=expected, fix=fix)


def _resolve_address(host: str, port: int) -> tuple[int, tuple[object, ...]]:
    try:
        addresses = socket.getaddrinfo(host, int(port), type=socket.SOCK_DGRAM)
    except (OSError, UnicodeError, TypeError) as error:
        raise _unreachable_error(host, port, error) from None
    # IPv4 first, the usual family of `open_receiver`; UDP does not report the wrong one.
    kind, _, _, _, address = min(addresses, key=lambda item: item[0] != socket.AF_INET)
    return kind, address


def _unreachable_error(host: object, port: int, error: Exception) -> InvalidSetting:
    why = error.strerror if isinstance(error, OSError) and error.strerror else error
    return InvalidSetting(
        "host",
        value=f"{host!r} port {port} ({why})",
        expected="a reachable host and a free port",
        fix="check the name, the port and the network",
    )
