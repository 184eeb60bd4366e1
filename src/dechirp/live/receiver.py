"""Packets from the network into a ring of memory, without waiting for whoever reads them.

A thread takes, every millisecond, all that came. While other code holds the interpreter they wait
in the buffer of the system.
"""

import socket
import time
from threading import Thread

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.live.taking import Slots, taker

_SLOTS = 2**15  # 48 MiB: 2.2 s at 21 MB/s, for a reader that is late
_SLOT_BYTES = 1472  # the longest packet of samples has 1466: what is longer shows
_MOST_AT_ONCE = 1024  # that Linux takes
_BUFFER_BYTES = 2**25  # asked for; the system may grant less
_PAUSE_S = 1e-3


class Receiver:
    """A UDP port of this machine, and the packets that came to it and were not yet taken.

    Parameters
    ----------
    host : str
        An IPv4 address of this machine, or a name of one.
    port : int
        0: any that is free.

    Raises
    ------
    InvalidSetting
        If the address is not of this machine, or another program has the port.
    """

    def __init__(self, host: str, port: int) -> None:
        self._socket = _bound(host, port)
        self.address: tuple[str, int] = self._socket.getsockname()
        self.buffer_bytes: int = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
        """That the system granted."""
        self.was_full = False
        """Whether packets ever waited because the ring was full."""
        self.failed: OSError | None = None
        """Why the system lets none be taken any more."""
        self._ring = Slots(
            content=np.zeros((_SLOTS, _SLOT_BYTES), np.uint8),
            sizes=np.zeros(_SLOTS, np.int64),
            senders=np.zeros(_SLOTS, np.int64),
        )
        self._taker = taker(self._socket, self._ring)
        # Counted on without end; each is changed by one thread alone, so there is no lock.
        self._n_came, self._n_gone = 0, 0
        self._is_closing = False
        self._thread = Thread(target=self._receive, name="dechirp-receiver", daemon=True)
        self._thread.start()

    @property
    def n_packets(self) -> int:
        """Packets that came, whatever they are."""
        return self._n_came

    @property
    def n_waiting(self) -> int:
        """Those of them that were not yet taken."""
        return self._n_came - self._n_gone

    def waiting(self) -> Slots:
        """Packets that wait, some of those that lie side by side; maybe none."""
        start = self._n_gone % _SLOTS
        n = min(self.n_waiting, _SLOTS - start, _MOST_AT_ONCE)
        return self._ring.some(start, start + n)

    def done_with(self, n: int) -> None:
        """Give the room of the first n of them back."""
        self._n_gone += n

    def close(self) -> None:
        """Let the port go."""
        self._is_closing = True
        self._thread.join()
        self._socket.close()

    def _receive(self) -> None:
        try:
            while not self._is_closing:
                start = self._n_came % _SLOTS
                free = min(_SLOTS - self.n_waiting, _SLOTS - start)
                self.was_full |= free == 0
                n = self._taker.take(start, min(free, _MOST_AT_ONCE)) if free else 0
                self._n_came += n
                if n < _MOST_AT_ONCE:
                    time.sleep(_PAUSE_S)
        except OSError as error:
            self.failed = error


def _bound(host: str, port: int) -> socket.socket:
    """Socket that has the port, does not wait, and keeps as much as the system lets it."""
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        made.setblocking(False)
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
        made.bind((host, port))
    except (OSError, TypeError, ValueError) as error:  # the latter two of what is no name
        made.close()
        why = getattr(error, "strerror", None) or error
        raise InvalidSetting(
            "address",
            got=f"{host}:{port}, which cannot be listened to ({why})",
            need="an address of this machine, and a port that no other program has",
            fix="End the other program; or name 127.0.0.1, or the address of the network card that"
            " the radar is plugged into.",
        ) from None
    return made
