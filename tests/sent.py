"""Packets sent over loopback from this process, and the stream that hears them.

The sender waits for the receiver, so that nothing is lost but what a test loses, and the stream
ends when all that was sent is taken, however busy the machine is.
"""

import socket
import threading
import time
from collections.abc import Iterable

import xarray as xr

import dechirp as dc
from dechirp.recordings.live.udp import Listener

_GIVE_UP_S = 60.0  # only a failure takes so long


def heard(sent: Iterable[bytes], radar: dc.Radar, **told) -> tuple[list[xr.DataArray], Listener]:
    """Frames that a stream gives of packets, and the stream when it has ended."""
    stream = dc.listen("127.0.0.1:0", radar=radar, idle_s=_GIVE_UP_S, **told)
    ended = threading.Event()
    sender = threading.Thread(target=_send_all, args=(stream, list(sent), ended))
    sender.start()
    try:
        return list(stream), stream
    finally:
        ended.set()
        sender.join()


def _send_all(stream: Listener, sent: list[bytes], ended: threading.Event) -> None:
    send(stream, sent, ended)
    wait_for(stream, len(sent), ended)
    while stream.n_waiting and not ended.is_set():
        time.sleep(1e-3)
    stream._idle_s = 0.0  # as if nothing had come for so long


def send(stream: Listener, sent: list[bytes], ended: threading.Event | None = None) -> None:
    """Send, but never more than 64 packets ahead of what the receiver has taken, until it ends."""
    host, port = stream.address.split(":")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        for n, one in enumerate(sent):
            wait_for(stream, n - 64, ended)
            out.sendto(one, (host, int(port)))


def wait_for(stream: Listener, n: int, ended: threading.Event | None = None) -> None:
    """Until so many packets came, or no more are taken."""
    give_up_s = time.monotonic() + _GIVE_UP_S
    while stream.n_packets < n and time.monotonic() < give_up_s:
        if ended is not None and ended.is_set():
            return
        time.sleep(1e-3)
