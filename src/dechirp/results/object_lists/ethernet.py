"""Object lists over Automotive Ethernet, as UDP datagrams (see `datagrams`)."""

import socket
import time
from collections.abc import Iterator

import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_integer, check_number
from dechirp.core.errors import InvalidSetting
from dechirp.results.object_lists.datagrams import encode_datagrams, object_list_from_datagrams

__all__ = ["open_receiver", "receive_datagrams", "send_datagrams"]

_RECEIVE_BUFFER = 2**22  # bytes; a system may grant less


@check_argument_types
def send_datagrams(objects: xr.Dataset, host: str, port: int, *, sequence: int = 0) -> int:
    """Send an object list by UDP, without pacing.

    Parameters
    ----------
    objects : Dataset
        As `object_list` returns it; one list for each cycle.
    host : str
        Name or address.
    port : int
        1 to 65535.
    sequence : int
        Sequence number of the first datagram.

    Returns
    -------
    int
        Sequence number for the next call.

    Raises
    ------
    InvalidSetting
        If it is not an object list, or the host cannot be found or reached.

    Warns
    -----
    PhysicsWarning
        If values exceed the range of a datagram.
    """
    check_integer("port", port, at_least=1, at_most=65535)
    check_integer("sequence", sequence, at_least=0, at_most=2**32 - 1)
    sent = encode_datagrams(objects, sequence=sequence)
    kind, address = _resolve_address(host, port)
    try:
        with socket.socket(kind, socket.SOCK_DGRAM) as udp_socket:
            for datagram in sent:
                udp_socket.sendto(datagram, address)
    except OSError as error:
        raise _unreachable_error(host, port, error) from None
    return (sequence + len(sent)) % 2**32


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
        If the socket is closed or not a UDP socket, or time decreases from list to list.

    Warns
    -----
    PhysicsWarning
        If datagrams are damaged, missing, duplicate or out of order; incomplete lists are
        omitted.
    """
    if not isinstance(udp_socket, socket.socket):
        raise _socket_error(repr(udp_socket))
    check_number("idle_s", idle_s, above=0.0, at_most=1e6)
    check_number("at_most_s", at_most_s, above=0.0, at_most=1e6)
    return object_list_from_datagrams(_iter_received_datagrams(udp_socket, idle_s, at_most_s))


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
