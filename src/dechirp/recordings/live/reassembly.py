"""Reassembly of DCA1000 packets into frames, by the byte count of each packet.

A packet has a uint32 number from 1, a uint48 count of the bytes sent before, and the payload, which
is full except in the last packet: so the count determines the number, and packets with
inconsistent counters are not packets of samples.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from dechirp.core.compiled_kernels import AS_WRITTEN, kernel
from dechirp.core.memory import check_free_memory
from dechirp.recordings.live.socket_reader import PacketSlots
from dechirp.recordings.streams.packets import MAX_PAYLOAD_BYTES, read_unsigned

HEADER_BYTES = 10
MAX_DELAY_BYTES = 256 * MAX_PAYLOAD_BYTES
"""Largest delay of a packet in any frame: networks exchange neighbours."""
# Consecutive packets too distant for network delay or loss: another recording.
_MAX_DISTANT_PACKETS = 16

# Indices of the counters that the compiled code shares with `ReassemblyWindow`.
(
    _OLDEST_FRAME,  # number of the oldest frame that is open; -1 before the first packet
    _REQUIRED_OLDEST,  # required for the next packet
    _SENDER,
    _HAS_RESTARTED,  # 1 after the radar restarted
    _FIRST_BYTE,  # bytes sent before the first packet
    _END_BYTE,  # bytes sent up to the end of the farthest packet
    N_BYTES,
    N_PACKETS,
    N_REORDERED,
    N_DUPLICATES,  # or too late for their frame
    N_WRONG_SIZE,
    N_INCONSISTENT,
    N_TOO_FAR_AHEAD,  # ahead
    N_FOREIGN_SENDER,
    _N_DISTANT,  # consecutive packets that are later than allowed or too far ahead
    _N_COUNTERS,
) = range(16)


class FrameBytes(NamedTuple):
    """Bytes of a frame; valid until the next one is requested."""

    number: int
    """Zero-based, from the first frame that the radar sent."""
    content: np.ndarray
    """(frame_bytes,) uint8, zero where bytes were lost."""
    received_mask: np.ndarray
    """(frame_bytes,) bool."""


class ReassemblyWindow:
    """Frames that can still receive packets: two, or more if they are small.

    Parameters
    ----------
    frame_bytes : int
    max_lost_frames : int
        Frames that may be lost in a row; packets further ahead are rejected.

    Raises
    ------
    NotEnoughMemory
        If they do not fit.
    """

    def __init__(self, frame_bytes: int, *, max_lost_frames: int) -> None:
        n_open = 2 + MAX_DELAY_BYTES // frame_bytes
        check_free_memory(
            "the frames that are received",
            needed_bytes=2.0 * n_open * frame_bytes,
            fix="check the settings of the radar, or send smaller frames",
        )
        self._content = np.zeros((n_open, frame_bytes), np.uint8)
        self._received = np.zeros((n_open, frame_bytes), np.bool_)
        self._filled_bytes = np.zeros(n_open, np.int64)  # bytes
        self._farthest_bytes = max_lost_frames * frame_bytes
        self.counters = np.zeros(_N_COUNTERS, np.int64)
        self.counters[_OLDEST_FRAME] = -1
        no_packets = PacketSlots(
            np.zeros((0, 1), np.uint8), np.zeros(0, np.int64), np.zeros(0, np.int64)
        )
        self._insert_into_open_frames(no_packets)  # compiles before packets arrive

    @property
    def has_radar_restarted(self) -> bool:
        """True if the radar restarted, or resumed too late; later packets are not inserted."""
        return bool(self.counters[_HAS_RESTARTED])

    @property
    def lost_bytes(self) -> int:
        """Bytes lost between the first packet and the farthest one."""
        counters = self.counters
        return int(counters[_END_BYTE] - counters[_FIRST_BYTE] - counters[N_BYTES])

    def reassemble_frames(self, packets: PacketSlots) -> Iterator[FrameBytes]:
        """Insert packets, and yield each frame that is complete or no longer awaited."""
        n_processed, n = 0, len(packets.sizes)
        while n_processed < n and not self.has_radar_restarted:
            n_processed += self._insert_into_open_frames(packets.slice_slots(n_processed, n))
            while self._filled_bytes[self._slot_of_oldest_frame] == self._content.shape[1]:
                yield from self._yield_and_reset_oldest_frame()
            if n_processed < n:
                yield from self.flush_frames_before(int(self.counters[_REQUIRED_OLDEST]))

    @property
    def frame_number_in_progress(self) -> int:
        """Number of the frame that contains the byte after the farthest one."""
        return int(self.counters[_END_BYTE]) // self._content.shape[1]

    def flush_frames_before(self, frame_number: int) -> Iterator[FrameBytes]:
        """Yield the received part of all frames before this number, and close them."""
        while self.counters[_OLDEST_FRAME] < frame_number and self._filled_bytes.any():
            yield from self._yield_and_reset_oldest_frame()
        self.counters[_OLDEST_FRAME] = max(self.counters[_OLDEST_FRAME], frame_number)

    def _insert_into_open_frames(self, packets: PacketSlots) -> int:
        frames = self._content, self._received, self._filled_bytes
        return int(
            _insert_packets_into_frames(*packets, self._farthest_bytes, self.counters, *frames)
        )

    @property
    def _slot_of_oldest_frame(self) -> int:
        return int(self.counters[_OLDEST_FRAME]) % len(self._filled_bytes)

    def _yield_and_reset_oldest_frame(self) -> Iterator[FrameBytes]:
        """Close the oldest frame, and open the one after the last."""
        slot, number = self._slot_of_oldest_frame, int(self.counters[_OLDEST_FRAME])
        if self._filled_bytes[slot]:
            yield FrameBytes(number, self._content[slot], self._received[slot])
        self._content[slot] = 0
        self._received[slot] = False
        self._filled_bytes[slot] = 0
        self.counters[_OLDEST_FRAME] += 1


@kernel(plain=AS_WRITTEN, error_model="python")
def _has_conflicting_bytes(
    payload: np.ndarray, start_byte: int, content: np.ndarray, received: np.ndarray
) -> bool:
    """Return True if received bytes have other values: those of another recording."""
    n_open, frame_bytes = content.shape
    k = 0
    while k < len(payload):  # frame by frame: one division a byte would dominate
        frame, offset = divmod(start_byte + k, frame_bytes)
        n = min(len(payload) - k, frame_bytes - offset)
        span = slice(offset, offset + n)
        is_received, stored = received[frame % n_open, span], content[frame % n_open, span]
        for j in range(n):
            if is_received[j] and stored[j] != payload[k + j]:
                return True
        k += n
    return False


@kernel(plain=AS_WRITTEN, error_model="python")
def _copy_payload_to_frames(
    payload: np.ndarray,
    start_byte: int,
    content: np.ndarray,
    received: np.ndarray,
    filled_bytes: np.ndarray,
) -> int:
    """Copy bytes into the open frames and return the number of new ones."""
    n_open, frame_bytes = content.shape
    k, n_new = 0, 0
    while k < len(payload):
        frame, offset = divmod(start_byte + k, frame_bytes)
        n = min(len(payload) - k, frame_bytes - offset)
        span, slot = slice(offset, offset + n), frame % n_open
        is_received, stored = received[slot, span], content[slot, span]
        n_copied = 0
        for j in range(n):
            n_copied += not is_received[j]
            stored[j] = payload[k + j]
            is_received[j] = True
        filled_bytes[slot] += n_copied
        n_new += n_copied
        k += n
    return n_new


@kernel(plain=AS_WRITTEN, error_model="python")
def _insert_packets_into_frames(
    packets: np.ndarray,
    sizes: np.ndarray,
    senders: np.ndarray,
    max_bytes_ahead: int,
    counters: np.ndarray,
    content: np.ndarray,
    received: np.ndarray,
    filled_bytes: np.ndarray,
) -> int:
    """Insert packets until one belongs to a frame that is not open; return the number processed."""
    n_open, frame_bytes = content.shape
    for i in range(len(sizes)):
        size = sizes[i] - HEADER_BYTES
        if size < 1 or size > MAX_PAYLOAD_BYTES:
            counters[N_WRONG_SIZE] += 1
            continue
        number, start = read_unsigned(packets[i], 0, 4, True), read_unsigned(packets[i], 4, 6, True)
        stop = start + size
        is_first = counters[_OLDEST_FRAME] < 0
        is_consistent = start % MAX_PAYLOAD_BYTES == 0 and (
            (start // MAX_PAYLOAD_BYTES + 1) % 2**32 == number
        )
        if not is_consistent:
            counters[N_INCONSISTENT] += 1
            continue
        if is_first:
            counters[_OLDEST_FRAME] = max(start - MAX_DELAY_BYTES, 0) // frame_bytes
            counters[_SENDER] = senders[i]
            counters[_FIRST_BYTE] = counters[_END_BYTE] = start
        if senders[i] != counters[_SENDER]:
            counters[N_FOREIGN_SENDER] += 1
            continue
        is_behind = start < counters[_END_BYTE] - MAX_DELAY_BYTES
        is_ahead = start > counters[_END_BYTE] + max_bytes_ahead
        is_distant = is_behind or is_ahead
        if is_distant and (start == 0 or counters[_N_DISTANT] == _MAX_DISTANT_PACKETS):
            counters[_HAS_RESTARTED] = 1
            return i
        if is_ahead:
            counters[N_TOO_FAR_AHEAD] += 1
            counters[_N_DISTANT] += 1
            continue
        required_oldest = (stop - 1) // frame_bytes - n_open + 1
        if required_oldest > counters[_OLDEST_FRAME]:
            counters[_REQUIRED_OLDEST] = required_oldest
            return i
        insert_start = max(start, counters[_OLDEST_FRAME] * frame_bytes)
        payload = packets[i, HEADER_BYTES + insert_start - start : HEADER_BYTES + size]
        if _has_conflicting_bytes(payload, insert_start, content, received):
            counters[_HAS_RESTARTED] = 1
            return i
        n_new = _copy_payload_to_frames(payload, insert_start, content, received, filled_bytes)
        if n_new == 0:
            counters[N_DUPLICATES] += 1
            counters[_N_DISTANT] += is_behind
            continue
        counters[_N_DISTANT] = 0
        counters[N_PACKETS] += 1
        counters[N_BYTES] += n_new
        counters[N_REORDERED] += stop < counters[_END_BYTE]
        counters[_FIRST_BYTE] = min(counters[_FIRST_BYTE], start)
        counters[_END_BYTE] = max(counters[_END_BYTE], stop)
    return len(sizes)
