"""Object lists over Automotive Ethernet: one ASAM OSI `SensorData` message per UDP datagram.

A datagram contains the bytes of one message and nothing else, see `osi` for its fields. IP divides
datagrams that exceed an Ethernet packet, and the checksum of UDP detects damage. Gaps of the
`cycle_counter` of the messages, which is the frame, are the lists that were lost.
"""

import socket
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from operator import itemgetter
from typing import Any

import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_integer, check_number
from dechirp.core.errors import InvalidSetting
from dechirp.results.object_lists.list_columns import check_object_list, warn_lost_messages
from dechirp.results.object_lists.osi import (
    message_cycle_counter,
    object_list_from_messages,
    osi_messages,
    osi_version,
    parse_sensor_data,
    timestamp_ns,
)
from dechirp.results.object_lists.priority import keep_most_important

__all__ = ["open_receiver", "receive_datagrams", "send_datagrams"]

MAX_OBJECTS_PER_LIST = 400  # of up to 150 bytes each, within the 65507 of a UDP datagram
_SEND_BUFFER = 2**17  # bytes; macOS sends no datagram that exceeds it, 9216 by default
_RECEIVE_BUFFER = 2**22  # bytes; a system may grant less


@check_argument_types
def send_datagrams(objects: xr.Dataset, host: str, port: int) -> int:
    """Send an object list by UDP, without pacing: an ASAM OSI `SensorData` message for each cycle.

    Parameters
    ----------
    objects : Dataset
        As `object_list` returns it.
    host : str
        Name or address.
    port : int
        1 to 65535.

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
    datagrams = encode_datagrams(objects)
    kind, address = _resolve_address(host, port)
    try:
        with socket.socket(kind, socket.SOCK_DGRAM) as udp_socket:
            udp_socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
            for datagram in datagrams:
                udp_socket.sendto(datagram, address)
    except OSError as error:
        raise _unreachable_error(host, port, error) from None
    return len(datagrams)


def encode_datagrams(objects: xr.Dataset) -> list[bytes]:
    """Encode an object list as datagrams, one for each cycle, see `send_datagrams`."""
    objects = keep_most_important(
        check_object_list(objects),
        MAX_OBJECTS_PER_LIST,
        reason="a message has to fit in one UDP datagram",
        fix="send fewer objects, or write an .osi trace",
    )
    return [message.SerializeToString() for message in osi_messages(objects)]


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
    udp_socket: socket.socket, *, idle_s: float = 1.0, at_most_s: float = 3600.0
) -> xr.Dataset:
    """Receive object lists on an open socket until it is idle for `idle_s`.

    Parameters
    ----------
    udp_socket : socket
        From `open_receiver`.
    idle_s, at_most_s : float
        Idle time after which reception ends, and largest total time.

    Raises
    ------
    InvalidSetting
        If the socket is closed or not a UDP socket, frames decrease while time increases, or the
        extra `io` is missing.

    Warns
    -----
    PhysicsWarning
        If datagrams are damaged or foreign, missing, duplicate or out of order.
    """
    if not isinstance(udp_socket, socket.socket):
        raise _socket_error(repr(udp_socket))
    check_number("idle_s", idle_s, above=0.0, at_most=1e6)
    check_number("at_most_s", at_most_s, above=0.0, at_most=1e6)
    osi_version()  # a missing extra is reported before waiting for packets
    # Decoding takes 5 ms for 100 objects, so it waits until the last datagram is out of the buffer.
    return object_list_from_datagrams([*_iter_received_datagrams(udp_socket, idle_s, at_most_s)])


def object_list_from_datagrams(received: Iterable[bytes]) -> xr.Dataset:
    """Assemble an object list from received datagrams, sorted by time, see `receive_datagrams`."""
    messages: dict[tuple[int, int | None], Any] = {}
    counts: Counter[str] = Counter()
    latest_ns: int | None = None
    for datagram in received:
        message = _parse_datagram(datagram)
        if message is None:
            counts["damaged or foreign"] += 1
            continue
        time_ns = timestamp_ns(message)
        key = (time_ns, message_cycle_counter(message))
        if key in messages:
            counts["duplicate"] += 1
            continue
        messages[key] = message
        counts["late"] += latest_ns is not None and time_ns < latest_ns
        latest_ns = time_ns if latest_ns is None else max(latest_ns, time_ns)
    counts["missing"] = _count_missing_frames({frame for _, frame in messages})
    warn_lost_messages(
        counts,
        remaining=f"{len(messages)} lists received",
        expected="every datagram once, in order",
        fix="check the network load",
    )
    return object_list_from_messages(messages[key] for key in sorted(messages, key=itemgetter(0)))


def _parse_datagram(datagram: bytes) -> Any | None:
    """Return the message of a datagram, None if it is damaged or contains no object list."""
    message = parse_sensor_data(datagram)
    if message is None or not message.HasField("timestamp"):
        return None
    try:
        object_list_from_messages([message])
    except InvalidSetting:
        return None
    return message


def _count_missing_frames(frames: set[int | None]) -> int:
    """Return the number of frames missing between the first and the last; 0 without counters."""
    known = {frame for frame in frames if frame is not None}
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
