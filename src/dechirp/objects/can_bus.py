"""How long a CAN FD frame occupies its bus, at worst, and how many of them fit."""

from typing import NamedTuple

from dechirp.core.checks import number, positive
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value

LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)
"""Bytes that a CAN FD frame can hold."""

# SOF, identifier, RRS (with SRR and 18 more bits where it is extended), IDE, FDF, res, BRS.
_ARBITRATION = {False: 17, True: 36}
_CONTROL = 5  # ESI and the length code, at the data bit rate
_TAIL = 13  # CRC delimiter, acknowledgement and its delimiter, end of frame, intermission
_FIXED_STUFF = {17: 6, 21: 7}  # before the stuff count, then after each fourth bit


class Bits(NamedTuple):
    """Bits of a frame at the two bit rates, stuff bits and intermission included."""

    arbitration: int
    data: int


def frame_bits(n_bytes: int, *, extended: bool = False) -> Bits:
    """Most bits that a CAN FD frame with so many bytes can have.

    A stuff bit follows five equal bits, and begins the next five: (n - 1) / 4 in n bits at
    most. The stuff count, 4 bits, and the CRC, 17 bits up to 16 bytes and 21 above, have stuff
    bits at fixed places. The bits in which the rate changes count as slow ones whole.

    References
    ----------
    ISO 11898-1:2015, 10.4.2.6 (CRC field) and 10.5 (stuffing).
    """
    if n_bytes not in LENGTHS:
        raise InvalidSetting(
            "n_bytes",
            got=n_bytes,
            need=f"one of {', '.join(map(str, LENGTHS))}",
            fix="Take the next longer one and fill it up.",
        )
    crc = 17 if n_bytes <= 16 else 21
    arbitration = _ARBITRATION[extended]
    data = _CONTROL + 8 * n_bytes
    slow_stuff = (arbitration - 1) // 4
    stuff = (arbitration + data - 1) // 4
    return Bits(
        arbitration=arbitration + slow_stuff + _TAIL,
        data=data + stuff - slow_stuff + 4 + crc + _FIXED_STUFF[crc],
    )


@value
class CanFd:
    """A CAN FD bus, and how much of it the object list may take."""

    arbitration_bit_rate_hz: float = 500e3
    data_bit_rate_hz: float = 2e6
    largest_load: float = 0.5
    """Share of the time in which the object list may occupy the bus."""
    cycle_s: float | None = None
    """From a list to the next; none: the shortest between those of the list, and no limit where
    there is only one."""

    def __post_init__(self) -> None:
        positive(self, "arbitration_bit_rate_hz", at_most=1e6)
        positive(self, "data_bit_rate_hz", at_most=20e6)
        number("CanFd.largest_load", self.largest_load, above=0.0, at_most=1.0)
        if self.cycle_s is not None:
            positive(self, "cycle_s", at_most=1e6)
        if self.data_bit_rate_hz < self.arbitration_bit_rate_hz:
            raise InvalidSetting(
                "CanFd.data_bit_rate_hz",
                got=self.data_bit_rate_hz,
                need=f"at least the arbitration bit rate, {self.arbitration_bit_rate_hz:.6g}",
                fix="Raise it, or lower the other.",
            )

    def frame_s(self, n_bytes: int, *, extended: bool = False) -> float:
        """Longest time that a frame with so many bytes occupies the bus, to the next one."""
        bits = frame_bits(n_bytes, extended=extended)
        return bits.arbitration / self.arbitration_bit_rate_hz + bits.data / self.data_bit_rate_hz
