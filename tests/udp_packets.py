"""UDP packets over loopback from this process, and the stream that receives them.

The sender waits for the receiver, so packets are lost only where a test drops them. The stream ends
when it has received all packets, even on a busy machine.
"""

import socket
import threading
import time
from collections.abc import Iterable

import xarray as xr

import dechirp as dc
from dechirp.recordings.live.udp import Listener

_TIMEOUT_S = 60.0  # reached only by failures


def receive_packets(
    packets: Iterable[bytes], radar: dc.Radar, **settings
) -> tuple[list[xr.DataArray], Listener]:
    """Return the frames that a stream builds from packets, and the ended stream."""
    stream = dc.listen("127.0.0.1:0", radar=radar, idle_s=_TIMEOUT_S, **settings)
    ended = threading.Event()
    sender = threading.Thread(target=_send_all, args=(stream, list(packets), ended))
    sender.start()
    try:
        return list(stream), stream
    finally:
        ended.set()
        sender.join()


def _send_all(stream: Listener, packets: list[bytes], ended: threading.Event) -> None:
    send_packets(stream, packets, ended)
    wait_for_packets(stream, len(packets), ended)
    while stream.n_waiting and not ended.is_set():
        time.sleep(1e-3)
    stream._idle_s = 0.0  # end the stream as after a long silence


def send_packets(
    stream: Listener, packets: list[bytes], ended: threading.Event | None = None
) -> None:
    """Send packets, at most 64 ahead of the receiver, until the stream ends."""
    host, port = stream.address.split(":")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for n, packet in enumerate(packets):
            wait_for_packets(stream, n - 64, ended)
            sender.sendto(packet, (host, int(port)))


def wait_for_packets(
    stream: Listener, n_packets: int, ended: threading.Event | None = None
) -> None:
    """Wait until n packets have arrived, or the stream has ended."""
    deadline_s = time.monotonic() + _TIMEOUT_S
    while stream.n_packets < n_packets and time.monotonic() < deadline_s:
        if ended is not None and ended.is_set():
            return
        time.sleep(1e-3)
