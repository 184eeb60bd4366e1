"""Packets that wait in a socket, taken into slots of memory: many by one call, or one by one."""

import ctypes
import errno
import os
import socket
import sys
from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np

_TOO_LONG_ON_WINDOWS = 10040

# struct mmsghdr of Linux, with pointers of 64 bits.
_MESSAGE = np.dtype(
    {
        "names": ["sender", "sender_bytes", "parts", "n_parts", "size"],
        "formats": ["u8", "u4", "u8", "u8", "u4"],
        "offsets": [0, 8, 16, 24, 56],
        "itemsize": 64,
    }
)


class Slots(NamedTuple):
    """Packets in the order of arrival, or room for them."""

    content: np.ndarray
    """(n, bytes) uint8; packets are cut where they are longer."""
    sizes: np.ndarray
    """(n,) int64, in bytes."""
    senders: np.ndarray
    """(n,) int64: a number that stands for address and port."""

    def some(self, start: int, stop: int) -> "Slots":
        """Those from `start` to before `stop`."""
        return Slots(*(of[start:stop] for of in self))


class Taker(ABC):
    """Takes packets from a socket that does not wait."""

    def __init__(self, of: socket.socket, slots: Slots) -> None:
        self._socket, self._slots = of, slots

    @abstractmethod
    def take(self, start: int, n: int) -> int:
        """Fill the slots from `start` on, n at most, with what came; how many were filled.

        Raises
        ------
        OSError
            If the system lets none be taken any more.
        """


class ManyAtOnce(Taker):
    """By recvmmsg of Linux, which runs beside Python: one turn of the interpreter for all.

    One by one each packet waits for a turn: of 14,400 packets/s, 8 and 10 % were lost in two runs
    in which other code kept the interpreter for 0.5 s of every 0.75 s, and none so.
    """

    def __init__(self, of: socket.socket, slots: Slots) -> None:
        super().__init__(of, slots)
        n, n_bytes = slots.content.shape
        self._senders = np.zeros((n, 2), np.int64)  # struct sockaddr_in: the first half says all
        self._parts = np.empty((n, 2), np.uint64)  # struct iovec
        self._parts[:, 0] = slots.content.ctypes.data + n_bytes * np.arange(n, dtype=np.uint64)
        self._parts[:, 1] = n_bytes
        self._messages = np.zeros(n, _MESSAGE)
        each = 16 * np.arange(n, dtype=np.uint64)
        self._messages["sender"] = self._senders.ctypes.data + each
        self._messages["sender_bytes"] = 16
        self._messages["parts"] = self._parts.ctypes.data + each
        self._messages["n_parts"] = 1
        self._call = ctypes.CDLL(None, use_errno=True).recvmmsg

    def take(self, start: int, n: int) -> int:
        """See `Taker.take`."""
        at = self._messages.ctypes.data + _MESSAGE.itemsize * start
        got = self._call(
            self._socket.fileno(), ctypes.c_void_p(at), n, socket.MSG_DONTWAIT, ctypes.c_void_p()
        )
        if got < 0:
            why = ctypes.get_errno()
            if why in (errno.EAGAIN, errno.EINTR):
                return 0
            raise OSError(why, os.strerror(why))
        taken = slice(start, start + got)
        self._slots.sizes[taken] = self._messages["size"][taken]
        self._slots.senders[taken] = self._senders[taken, 0]
        return int(got)


class OneByOne(Taker):
    """By a call for each packet, as every system has it."""

    def take(self, start: int, n: int) -> int:
        """See `Taker.take`."""
        for slot in range(start, start + n):
            try:
                size, sender = self._socket.recvfrom_into(self._slots.content[slot].data)
            except BlockingIOError:
                return slot - start
            except OSError as error:
                if getattr(error, "winerror", None) != _TOO_LONG_ON_WINDOWS:
                    raise
                size, sender = self._slots.content.shape[1], None
            self._slots.sizes[slot] = size
            self._slots.senders[slot] = hash(sender)
        return n


def taker(of: socket.socket, slots: Slots) -> Taker:
    """Give the fastest that this system has."""
    is_64_bit = sys.platform == "linux" and sys.maxsize > 2**32
    return (ManyAtOnce if is_64_bit else OneByOne)(of, slots)
