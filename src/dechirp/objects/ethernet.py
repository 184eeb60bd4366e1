"""Object lists over Automotive Ethernet: UDP datagrams as `datagrams` says."""

import socket
import time
from collections.abc import Iterator

import xarray as xr

from dechirp.core.checks import number, whole
from dechirp.core.errors import InvalidSetting
from dechirp.objects.datagrams import datagrams, gathered

_RECEIVE_BUFFER = 2**22  # bytes; a system may grant less


def send(objects: xr.Dataset, host: str, port: int, *, sequence: int = 0) -> int:
    """Send an object list by UDP, as fast as it goes.

    Parameters
    ----------
    objects : Dataset
        As `object_list` makes it; one list for each cycle.
    host : str
        Name or address.
    port : int
        1 to 65535.
    sequence : int
        Of the first datagram.

    Returns
    -------
    int
        The sequence to go on with.

    Raises
    ------
    InvalidSetting
        If it is no object list, or the host cannot be found or reached.

    Warns
    -----
    PhysicsWarning
        If values are beyond what a datagram can tell.
    """
    whole("port", port, at_least=1, at_most=65535)
    whole("sequence", sequence, at_least=0, at_most=2**32 - 1)
    sent = datagrams(objects, sequence=sequence)
    kind, address = _address(host, port)
    try:
        with socket.socket(kind, socket.SOCK_DGRAM) as line:
            for datagram in sent:
                line.sendto(datagram, address)
    except OSError as error:
        raise _unreachable(host, port, error) from None
    return (sequence + len(sent)) % 2**32


def listen(port: int, host: str = "127.0.0.1") -> socket.socket:
    """Open a socket on which object lists can arrive; the caller closes it.

    Parameters
    ----------
    port : int
        0 for any that is free: `getsockname()` tells which.
    host : str
        Of the network to listen on, this machine's own by default.

    Raises
    ------
    InvalidSetting
        If it cannot be opened.
    """
    whole("port", port, at_least=0, at_most=65535)
    kind, address = _address(host, port)
    line = socket.socket(kind, socket.SOCK_DGRAM)
    try:
        line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
        line.bind(address)
    except OSError as error:
        line.close()
        raise _unreachable(host, port, error) from None
    return line


def receive(line: socket.socket, *, idle_s: float = 1.0, at_most_s: float = 3600.0) -> xr.Dataset:
    """Receive object lists on an open socket until nothing comes for `idle_s`.

    Parameters
    ----------
    line : socket
        From `listen`.
    idle_s, at_most_s : float
        Silence after which it ends, and time after which it ends all the same.

    Raises
    ------
    InvalidSetting
        If the socket is closed or no UDP socket, or time goes backwards from list to list.

    Warns
    -----
    PhysicsWarning
        If datagrams are damaged, missing, came twice or in another order; lists that are not
        whole are left out.
    """
    if not isinstance(line, socket.socket):
        raise _not_a_line(repr(line))
    number("idle_s", idle_s, above=0.0, at_most=1e6)
    number("at_most_s", at_most_s, above=0.0, at_most=1e6)
    return gathered(_heard(line, idle_s, at_most_s))


def _heard(line: socket.socket, idle_s: float, at_most_s: float) -> Iterator[bytes]:
    end_s = time.monotonic() + at_most_s
    while time.monotonic() < end_s:
        try:
            line.settimeout(idle_s)
            yield line.recv(2**16)
        except TimeoutError:
            return
        except OSError as error:
            raise _not_a_line(f"one that says: {error.strerror or error}") from None


def _not_a_line(got: str) -> InvalidSetting:
    need, fix = "an open UDP socket", "Give what listen() returned."
    return InvalidSetting("line", got=got, need=need, fix=fix)


def _address(host: str, port: int) -> tuple[int, tuple[object, ...]]:
    try:
        found = socket.getaddrinfo(host, int(port), type=socket.SOCK_DGRAM)
    except (OSError, UnicodeError, TypeError) as error:
        raise _unreachable(host, port, error) from None
    # IPv4 first, on which `listen` listens as a rule: of UDP nobody hears that it went elsewhere.
    kind, _, _, _, address = min(found, key=lambda one: one[0] != socket.AF_INET)
    return kind, address


def _unreachable(host: object, port: int, error: Exception) -> InvalidSetting:
    why = error.strerror if isinstance(error, OSError) and error.strerror else error
    return InvalidSetting(
        "host",
        got=f"{host!r} port {port} ({why})",
        need="a host that can be reached, and a port that is free to listen on",
        fix="Check the name, the port and the network.",
    )
