"""Packets of a DCA1000 put in their places, by the bytes sent before them, frame by frame.

A packet has a uint32 number from 1, a uint48 count of the bytes sent before, and the payload,
which is full in all but the last: so the number follows from the count, and what has others is no
packet of samples.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numba
import numpy as np

from dechirp.core.memory import must_fit
from dechirp.formats.streams.packets import LARGEST_PAYLOAD
from dechirp.formats.streams.whole_numbers import whole_number
from dechirp.live.taking import Slots

HEADER_BYTES = 10
LATE_BYTES = 256 * LARGEST_PAYLOAD
"""By which a packet may be late in any frame: networks exchange neighbours."""
_MOST_AWAY = 16  # packets in a row that no network delays or loses so: another recording

# Places in the counters that the compiled code shares with `Window`.
(
    _OLDEST,  # number of the oldest frame that is open; -1 before the first packet
    _NEEDED,  # what it has to be for the packet that comes next
    _SENDER,
    _IS_NEW,  # whether the radar began anew
    _BEGAN,  # bytes that were sent before the first packet
    _ENDED,  # and with the farthest one
    N_BYTES,
    N_PACKETS,
    N_SORTED,
    N_TWICE,  # or too late for their frame
    N_WRONG_SIZE,
    N_WRONG_COUNT,
    N_TOO_FAR,  # ahead
    N_STRANGERS,
    _N_AWAY,  # in a row, behind by more than a packet may be late, or too far ahead
    _N_COUNTERS,
) = range(16)


class Frame(NamedTuple):
    """Bytes of a frame; to be used before the next one is asked for."""

    number: int
    """Counted from 0, the first that the radar sent."""
    content: np.ndarray
    """(frame_bytes,) uint8, zero where they were lost."""
    arrived: np.ndarray
    """(frame_bytes,) bool."""


class Window:
    """The frames that packets may still come for: two, or more where they are small.

    Parameters
    ----------
    frame_bytes : int
    most_lost : int
        Frames that may be lost at a stretch; what is farther ahead is not placed.

    Raises
    ------
    NotEnoughMemory
        If they would not fit.
    """

    def __init__(self, frame_bytes: int, *, most_lost: int) -> None:
        n_open = 2 + LATE_BYTES // frame_bytes
        must_fit(
            "the frames that are received",
            needed_bytes=2.0 * n_open * frame_bytes,
            fix="Check the settings of the radar, or send smaller frames.",
        )
        self._content = np.zeros((n_open, frame_bytes), np.uint8)
        self._arrived = np.zeros((n_open, frame_bytes), np.bool_)
        self._filled = np.zeros(n_open, np.int64)  # bytes
        self._farthest_bytes = most_lost * frame_bytes
        self.counters = np.zeros(_N_COUNTERS, np.int64)
        self.counters[_OLDEST] = -1
        none = Slots(np.zeros((0, 1), np.uint8), np.zeros(0, np.int64), np.zeros(0, np.int64))
        self._put(none)  # compiles now, and not while packets wait

    @property
    def began_anew(self) -> bool:
        """Whether the radar started a second time, or came back too late; none of it is placed."""
        return bool(self.counters[_IS_NEW])

    @property
    def lost_bytes(self) -> int:
        """That never came, between the first packet and the farthest."""
        counters = self.counters
        return int(counters[_ENDED] - counters[_BEGAN] - counters[N_BYTES])

    def place(self, packets: Slots) -> Iterator[Frame]:
        """Place packets, and give each frame that is whole, or for which none is waited for."""
        at, n = 0, len(packets.sizes)
        while at < n and not self.began_anew:
            at += self._put(packets.some(at, n))
            while self._filled[self._slot] == self._content.shape[1]:
                yield from self._closed()
            if at < n:
                yield from self.up_to(int(self.counters[_NEEDED]))

    @property
    def sending(self) -> int:
        """Number of the frame that goes on with the byte after the farthest."""
        return int(self.counters[_ENDED]) // self._content.shape[1]

    def up_to(self, number: int) -> Iterator[Frame]:
        """Give what came of the frames before this one, and wait for no more of it."""
        while self.counters[_OLDEST] < number and self._filled.any():
            yield from self._closed()
        self.counters[_OLDEST] = max(self.counters[_OLDEST], number)

    def _put(self, packets: Slots) -> int:
        frames = self._content, self._arrived, self._filled
        return int(_place(*packets, self._farthest_bytes, self.counters, *frames))

    @property
    def _slot(self) -> int:
        return int(self.counters[_OLDEST]) % len(self._filled)

    def _closed(self) -> Iterator[Frame]:
        """Be done with the oldest frame, and open the one after the last."""
        slot, number = self._slot, int(self.counters[_OLDEST])
        if self._filled[slot]:
            yield Frame(number, self._content[slot], self._arrived[slot])
        self._content[slot] = 0
        self._arrived[slot] = False
        self._filled[slot] = 0
        self.counters[_OLDEST] += 1


@numba.njit(cache=True, nogil=True)
def _is_other(payload: np.ndarray, at: int, content: np.ndarray, arrived: np.ndarray) -> bool:
    """Whether bytes came before with other values: those of another recording."""
    n_open, frame_bytes = content.shape
    k = 0
    while k < len(payload):  # frame by frame: a division for each byte takes longer than the rest
        frame, inside = divmod(at + k, frame_bytes)
        n = min(len(payload) - k, frame_bytes - inside)
        part = slice(inside, inside + n)
        there, known = arrived[frame % n_open, part], content[frame % n_open, part]
        for j in range(n):
            if there[j] and known[j] != payload[k + j]:
                return True
        k += n
    return False


@numba.njit(cache=True, nogil=True)
def _take(
    payload: np.ndarray, at: int, content: np.ndarray, arrived: np.ndarray, filled: np.ndarray
) -> int:
    """Put bytes into the frames that are open; how many were not there before."""
    n_open, frame_bytes = content.shape
    k, n_new = 0, 0
    while k < len(payload):
        frame, inside = divmod(at + k, frame_bytes)
        n = min(len(payload) - k, frame_bytes - inside)
        part, slot = slice(inside, inside + n), frame % n_open
        there, known = arrived[slot, part], content[slot, part]
        taken = 0
        for j in range(n):
            taken += not there[j]
            known[j] = payload[k + j]
            there[j] = True
        filled[slot] += taken
        n_new += taken
        k += n
    return n_new


@numba.njit(cache=True, nogil=True)
def _place(
    packets: np.ndarray,
    sizes: np.ndarray,
    senders: np.ndarray,
    farthest_bytes: int,
    counters: np.ndarray,
    content: np.ndarray,
    arrived: np.ndarray,
    filled: np.ndarray,
) -> int:
    """Place packets until one is of a frame that is not open yet; how many are done with."""
    n_open, frame_bytes = content.shape
    for i in range(len(sizes)):
        size = sizes[i] - HEADER_BYTES
        if size < 1 or size > LARGEST_PAYLOAD:
            counters[N_WRONG_SIZE] += 1
            continue
        number, start = whole_number(packets[i], 0, 4, True), whole_number(packets[i], 4, 6, True)
        stop = start + size
        is_first = counters[_OLDEST] < 0
        in_step = start % LARGEST_PAYLOAD == 0 and (
            (start // LARGEST_PAYLOAD + 1) % 2**32 == number
        )
        if not in_step:
            counters[N_WRONG_COUNT] += 1
            continue
        if is_first:
            counters[_OLDEST] = max(start - LATE_BYTES, 0) // frame_bytes
            counters[_SENDER] = senders[i]
            counters[_BEGAN] = counters[_ENDED] = start
        if senders[i] != counters[_SENDER]:
            counters[N_STRANGERS] += 1
            continue
        is_behind = start < counters[_ENDED] - LATE_BYTES
        is_ahead = start > counters[_ENDED] + farthest_bytes
        is_away = is_behind or is_ahead
        if is_away and (start == 0 or counters[_N_AWAY] == _MOST_AWAY):
            counters[_IS_NEW] = 1
            return i
        if is_ahead:
            counters[N_TOO_FAR] += 1
            counters[_N_AWAY] += 1
            continue
        needed = (stop - 1) // frame_bytes - n_open + 1
        if needed > counters[_OLDEST]:
            counters[_NEEDED] = needed
            return i
        at = max(start, counters[_OLDEST] * frame_bytes)
        payload = packets[i, HEADER_BYTES + at - start : HEADER_BYTES + size]
        if _is_other(payload, at, content, arrived):
            counters[_IS_NEW] = 1
            return i
        n_new = _take(payload, at, content, arrived, filled)
        if n_new == 0:
            counters[N_TWICE] += 1
            counters[_N_AWAY] += is_behind
            continue
        counters[_N_AWAY] = 0
        counters[N_PACKETS] += 1
        counters[N_BYTES] += n_new
        counters[N_SORTED] += stop < counters[_ENDED]
        counters[_BEGAN] = min(counters[_BEGAN], start)
        counters[_ENDED] = max(counters[_ENDED], stop)
    return len(sizes)
