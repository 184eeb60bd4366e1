"""Packets sent over loopback from this process, and the stream that hears them.

The sender waits for the receiver, so that nothing is lost but what a test loses, however busy the
machine is.
"""

import socket
import threading
import time
from collections.abc import Iterable

import xarray as xr

import dechirp as dc

_GIVE_UP_S = 20.0


def heard(sent: Iterable[bytes], radar: dc.Radar, **told) -> tuple[list[xr.DataArray], dc.Listener]:
    """Frames that a stream gives of packets, and the stream when it has ended."""
    stream = dc.listen("127.0.0.1:0", radar=radar, **{"idle_s": 0.5, **told})
    sender = threading.Thread(target=send, args=(stream, list(sent)))
    sender.start()
    try:
        return list(stream), stream
    finally:
        sender.join()


def send(stream: dc.Listener, sent: list[bytes]) -> None:
    """Send, but never more than 64 packets ahead of what the receiver has taken."""
    host, port = stream.address.split(":")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        for n, one in enumerate(sent):
            give_up_s = time.monotonic() + _GIVE_UP_S
            while n - stream._receiver._n_came > 64 and time.monotonic() < give_up_s:
                time.sleep(1e-3)
            out.sendto(one, (host, int(port)))
