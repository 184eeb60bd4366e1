"""Ring buffer of UDP packets, filled by a thread independently of the reader.

The thread reads all waiting packets every millisecond. While other code holds the interpreter, they
wait in the buffer of the operating system.
"""

import socket
import time
from threading import Thread

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.recordings.live.socket_reader import PacketSlots, fastest_socket_reader

_N_SLOTS = 2**15  # 48 MiB: buffers 2.2 s at 21 MB/s
_SLOT_BYTES = 1472  # the longest packet of samples has 1466: longer ones are detected
_MAX_PACKETS_PER_CALL = 1024  # limit of Linux
_BUFFER_BYTES = 2**25  # requested; the system may grant less
_PAUSE_S = 1e-3


class UdpReceiver:
    """UDP port of this machine, and its received packets.

    Parameters
    ----------
    host : str
        An IPv4 address of this machine, or a name of one.
    port : int
        0: any free one.

    Raises
    ------
    InvalidSetting
        If the address is not of this machine, or another program uses the port.
    """

    def __init__(self, host: str, port: int) -> None:
        self._socket = _bind_udp_socket(host, port)
        self.address: tuple[str, int] = self._socket.getsockname()
        self.buffer_bytes: int = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
        """Buffer size that the system granted."""
        self.was_full = False
        """True if packets had to wait because the ring was full."""
        self.error: OSError | None = None
        """Error of the system that ended the reception."""
        self._ring = PacketSlots(
            content=np.zeros((_N_SLOTS, _SLOT_BYTES), np.uint8),
            sizes=np.zeros(_N_SLOTS, np.int64),
            senders=np.zeros(_N_SLOTS, np.int64),
        )
        self._reader = fastest_socket_reader(self._socket, self._ring)
        # Running totals; each is modified by one thread only, so no lock is needed.
        self._n_received, self._n_released = 0, 0
        self._is_closing = False
        self._thread = Thread(
            target=self._receive_until_closed, name="dechirp-receiver", daemon=True
        )
        self._thread.start()

    @property
    def n_packets(self) -> int:
        """Number of received packets of any content."""
        return self._n_received

    @property
    def n_waiting(self) -> int:
        """Number of received packets that were not released."""
        return self._n_received - self._n_released

    def contiguous_waiting_packets(self) -> PacketSlots:
        """Return waiting packets that are contiguous in the ring; possibly none."""
        start = self._n_released % _N_SLOTS
        n = min(self.n_waiting, _N_SLOTS - start, _MAX_PACKETS_PER_CALL)
        return self._ring.slice_slots(start, start + n)

    def release_packets(self, n: int) -> None:
        """Release the slots of the first n waiting packets."""
        self._n_released += n

    def close(self) -> None:
        """Stop the thread and close the port."""
        self._is_closing = True
        self._thread.join()
        self._socket.close()

    def _receive_until_closed(self) -> None:
        try:
            while not self._is_closing:
                start = self._n_received % _N_SLOTS
                free = min(_N_SLOTS - self.n_waiting, _N_SLOTS - start)
                self.was_full |= free == 0
                n = (
                    self._reader.read_packets_into_slots(start, min(free, _MAX_PACKETS_PER_CALL))
                    if free
                    else 0
                )
                self._n_received += n
                if n < _MAX_PACKETS_PER_CALL:
                    time.sleep(_PAUSE_S)
        except OSError as error:
            self.error = error


def _bind_udp_socket(host: str, port: int) -> socket.socket:
    """Bind a non-blocking socket with the largest permitted buffer."""
    udp_socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        udp_socket.setblocking(False)
        udp_socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
        udp_socket.bind((host, port))
    except (OSError, TypeError, ValueError) as error:  # the latter two for invalid names
        udp_socket.close()
        reason = getattr(error, "strerror", None) or error
        raise InvalidSetting(
            "address",
            value=f"{host}:{port}, not available ({reason})",
            expected="an address of this machine and a free port",
            fix="end the other program; or give 127.0.0.1, or the address of the network"
            " card of the radar",
        ) from None
    return udp_socket
