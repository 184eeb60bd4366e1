"""Replay of a capture as UDP packets of a DCA1000, to test receivers."""

import socket
import time
from collections.abc import Iterator
from pathlib import Path

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_number
from dechirp.core.errors import InvalidSetting
from dechirp.recordings.live.udp import parse_udp_address
from dechirp.recordings.recognise import unreadable_path_error
from dechirp.recordings.streams.packets import MAX_PAYLOAD_BYTES

_PACKETS_PER_BURST = 16  # 1.1 ms at 21 MB/s, the shortest sleep


def build_dca1000_packet(sequence: int, payload: bytes) -> bytes:
    """Build a packet; `sequence` counts from 1, and all earlier packets were full."""
    n_bytes_before = (sequence - 1) * MAX_PAYLOAD_BYTES
    return (sequence % 2**32).to_bytes(4, "little") + n_bytes_before.to_bytes(6, "little") + payload


def iter_file_as_packets(path: Path) -> Iterator[bytes]:
    """Yield the packets of a file of raw samples, read one by one."""
    with path.open("rb") as file:
        sequence = 1
        while payload := file.read(MAX_PAYLOAD_BYTES):
            yield build_dca1000_packet(sequence, payload)
            sequence += 1


@check_argument_types
def replay(path: str | Path, address: str = "127.0.0.1:4098", *, bytes_per_s: float = 21e6) -> int:
    """Send a DCA1000 capture, a file of raw samples (`.bin`), as UDP packets.

    Parameters
    ----------
    path : path
    address : str
        Destination, as for `listen`.
    bytes_per_s : float
        Rate of sample bytes; the bytes of a frame over its period are the rate of the radar.
        Packets are lost if the receiver does not keep up, as with a radar.

    Returns
    -------
    int
        Number of packets sent.

    Raises
    ------
    InvalidSetting
        If the address is invalid, or cannot be reached.
    RecordingError
        If the file cannot be read.
    """
    path = Path(path)
    rate = check_number("bytes_per_s", bytes_per_s, above=0)
    destination = parse_udp_address(address)
    n_sent, start_s = 0, time.monotonic()
    try:
        capture_packets = iter_file_as_packets(path)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp_socket:
            for packet in capture_packets:
                _send_packet(udp_socket, packet, destination)
                n_sent += 1
                if not n_sent % _PACKETS_PER_BURST:
                    due_s = start_s + n_sent * MAX_PAYLOAD_BYTES / rate
                    time.sleep(max(due_s - time.monotonic(), 0))
    except OSError as error:
        raise unreadable_path_error(path, error) from None
    return n_sent


def _send_packet(udp_socket: socket.socket, packet: bytes, destination: tuple[str, int]) -> None:
    try:
        udp_socket.sendto(packet, destination)
    except (OSError, UnicodeError) as error:
        raise InvalidSetting(
            "address",
            value=f"{destination[0]}:{destination[1]}, not reachable"
            f" ({getattr(error, 'strerror', None) or error})",
            expected="the IPv4 address and port of a receiver",
            fix="correct it",
        ) from None
