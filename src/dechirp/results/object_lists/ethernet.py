"""Object lists over Automotive Ethernet: one ASAM OSI `SensorData` message per UDP datagram.

A datagram contains the bytes of one message and nothing else, see `osi` for its fields. IP divides
datagrams that exceed an Ethernet packet, and the checksum of UDP detects damage. Gaps of the
`cycle_counter` of the messages, which is the frame, are the lists that were lost. A sender whose
time or counter goes back has restarted.
"""

import socket
import time
import warnings
from bisect import bisect_left
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from operator import attrgetter
from statistics import median

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
    DecodedMessage,
    build_decoded_lists,
    decode_message,
    has_object_list,
    osi_messages,
    osi_version,
    parse_sensor_data,
)
from dechirp.results.object_lists.priority import keep_most_important

__all__ = ["open_receiver", "receive_datagrams", "send_datagrams"]

MAX_OBJECTS_PER_LIST = 400  # of up to 150 bytes each, within the 65507 of a UDP datagram
_SEND_BUFFER = 2**17  # bytes; macOS sends no datagram that exceeds it, 9216 by default
_RECEIVE_BUFFER = 2**22  # bytes; a system may grant less
_MAX_LATE_LISTS = 8  # later ones that arrive before a list; networks reorder by fewer
_MAX_TIME_S = 2.0**33  # 272 years; float64 then resolves 2 us
_MIN_PERIOD_S = 1e-5
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

    If the sender restarts, so that its times or frames go back, the lists that follow continue one
    cycle after the last, and all frames are counted from 0.

    Parameters
    ----------
    udp_socket : socket
        From `open_receiver`.
    sensor_id : int, optional
        Number of the sensor in the messages; by default that of the first list.
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
    n_of_sensor: Counter[int] = Counter()
    arrivals: list[tuple[DecodedMessage, bytes]] = []
    is_sensor_given = sensor_id is not None
    for datagram in received:
        decoded = _decode_datagram(datagram, counts)
        if decoded is None:
            continue
        sensor_id = decoded.sensor_id if sensor_id is None else sensor_id
        n_of_sensor[decoded.sensor_id] += 1
        if decoded.sensor_id == sensor_id:
            arrivals.append((decoded, datagram))
    runs = _split_at_restarts(arrivals, counts)
    counts["missing"] = sum(map(_count_missing_frames, runs))
    n_lists = format_count_with_noun(sum(map(len, runs)), "list")
    warn_lost_messages(
        counts,
        remaining=f"{n_lists} received",
        expected="every datagram once, in order, with objects or radar detections",
        fix="check the network load, and which programs send to this port",
    )
    if not (is_sensor_given and arrivals):
        del n_of_sensor[sensor_id]
        warn_lost_messages(
            {f"of sensor {number}": n for number, n in n_of_sensor.items()},
            remaining=f"{n_lists} of sensor {sensor_id} received",
            expected="the lists of one sensor at a port",
            fix="receive another sensor with sensor_id=, or send it to a port of its own",
        )
    return build_decoded_lists(_join_runs(runs))


def _decode_datagram(datagram: bytes, counts: Counter[str]) -> DecodedMessage | None:
    """Return the list in a datagram; count those without one, and return None."""
    message = parse_sensor_data(datagram)
    if message is None or not message.HasField("timestamp"):
        counts["damaged or foreign"] += 1
        return None
    if not has_object_list(message):
        counts[NO_OBJECT_LIST] += 1
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


def _split_at_restarts(
    arrivals: Iterable[tuple[DecodedMessage, bytes]], counts: Counter[str]
) -> list[list[DecodedMessage]]:
    """Return the lists between restarts of their sender, by time; count late and duplicate ones.

    A list that has no place in the order of times and frames before it is the first after a
    restart.
    """
    runs: list[list[DecodedMessage]] = [[]]
    contents: dict[float, bytes] = {}
    for decoded, datagram in arrivals:
        if contents.get(decoded.time_s) == datagram:
            counts["duplicate"] += 1
            continue
        index = bisect_left(runs[-1], decoded.time_s, key=attrgetter("time_s"))
        if not _has_place(decoded, runs[-1], index):
            runs.append([])
            contents.clear()
            index = 0
        counts["late"] += index < len(runs[-1])
        runs[-1].insert(index, decoded)
        contents[decoded.time_s] = datagram
    return runs


def _has_place(decoded: DecodedMessage, run: list[DecodedMessage], index: int) -> bool:
    """Return whether a list is in order of time and frame at an index of a run."""
    if len(run) - index > _MAX_LATE_LISTS:
        return False
    neighbours = [*run[max(index - 1, 0) : index], decoded, *run[index : index + 1]]
    return all(
        second.time_s - first.time_s >= _MIN_PERIOD_S
        and (first.frame is None or second.frame is None or first.frame < second.frame)
        for first, second in pairwise(neighbours)
    )


def _join_runs(runs: Sequence[Sequence[DecodedMessage]]) -> list[DecodedMessage]:
    """Join the lists between restarts: frames from 0, and times that continue.

    Warns
    -----
    PhysicsWarning
        If there were restarts.
    """
    lists = list(runs[0])
    if len(runs) == 1:
        return lists
    periods_s = [later.time_s - earlier.time_s for run in runs for earlier, later in pairwise(run)]
    period_s = median(periods_s) if periods_s else _UNKNOWN_PERIOD_S
    shifts = []
    for run in runs[1:]:
        shift_s = max(lists[-1].time_s + period_s - run[0].time_s, 0.0)
        shifts.append(f"{format_si(shift_s, 's')} from frame {len(lists)} on")
        lists += [decoded._replace(time_s=decoded.time_s + shift_s) for decoded in run]
    more = f" and {len(shifts) - 3} more" if len(shifts) > 3 else ""
    finding = Finding(
        level="warning",
        setting="objects",
        value=f"{format_count_with_noun(len(shifts), 'restart')} of the sender, whose times or"
        f" frames went back; frames counted from 0, times increased by"
        f" {', '.join(shifts[:3])}{more}",
        expected="times and frames that increase",
        fix="subtract these times where the clock of the sender is needed; if several programs"
        " send to this port, give each its own sensor_id",
    )
    warnings.warn(PhysicsWarning(finding), stacklevel=4)
    return [decoded._replace(frame=frame) for frame, decoded in enumerate(lists)]


def _count_missing_frames(run: Iterable[DecodedMessage]) -> int:
    """Return the number of frames missing between the first and the last; 0 without counters."""
    known = {decoded.frame for decoded in run if decoded.frame is not None}
    return max(known) - min(known) + 1 - len(known) if known else 0


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
