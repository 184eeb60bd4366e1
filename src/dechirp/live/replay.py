"""A capture sent again as packets, as the DCA1000 sent it: to try what receives them."""

import socket
import time
from collections.abc import Iterator
from pathlib import Path

from dechirp.core.checks import number
from dechirp.core.errors import InvalidSetting
from dechirp.formats.recognise import unreadable
from dechirp.formats.streams.packets import LARGEST_PAYLOAD
from dechirp.live.udp import parted

_AT_ONCE = 16  # packets, 1.1 ms at 21 MB/s: a sleep takes at least that


def packet(sequence: int, payload: bytes) -> bytes:
    """Packet of so many samples, `sequence` counted from 1, all before it having been full."""
    before = (sequence - 1) * LARGEST_PAYLOAD
    return (sequence % 2**32).to_bytes(4, "little") + before.to_bytes(6, "little") + payload


def packets(path: Path) -> Iterator[bytes]:
    """Packets of a file of bare samples, read one by one."""
    with path.open("rb") as file:
        sequence = 1
        while payload := file.read(LARGEST_PAYLOAD):
            yield packet(sequence, payload)
            sequence += 1


def replay(path: str | Path, address: str = "127.0.0.1:4098", *, bytes_per_s: float = 21e6) -> int:
    """Send a DCA1000 capture, a file of bare samples (`.bin`), as UDP packets.

    Parameters
    ----------
    path : path
    address : str
        Where to, as `listen` takes it.
    bytes_per_s : float
        Of samples: those of a frame over its period are as fast as the radar was. Without a
        receiver that keeps up, packets are lost, as they are from a radar.

    Returns
    -------
    int
        How many packets were sent.

    Raises
    ------
    InvalidSetting
        If the address is none, or nothing can be sent there.
    RecordingError
        If the file cannot be read.
    """
    path = Path(path)
    pace = number("bytes_per_s", bytes_per_s, above=0)
    to = parted(address)
    n_sent, began_s = 0, time.monotonic()
    try:
        every = packets(path)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            for one in every:
                _send(out, one, to)
                n_sent += 1
                if not n_sent % _AT_ONCE:
                    due_s = began_s + n_sent * LARGEST_PAYLOAD / pace
                    time.sleep(max(due_s - time.monotonic(), 0))
    except OSError as error:
        raise unreadable(path, error) from None
    return n_sent


def _send(out: socket.socket, one: bytes, to: tuple[str, int]) -> None:
    try:
        out.sendto(one, to)
    except (OSError, UnicodeError) as error:
        raise InvalidSetting(
            "address",
            got=f"{to[0]}:{to[1]}, to which nothing can be sent"
            f" ({getattr(error, 'strerror', None) or error})",
            need="the IPv4 address and port of a receiver",
            fix="Correct it.",
        ) from None
