"""Worst-case duration of CAN FD frames on a bus."""

from typing import NamedTuple

from dechirp.core.checks import check_number, check_positive_fields
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass

__all__ = ["CanFd"]

FRAME_LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)
"""Data lengths of CAN FD frames in bytes."""

# SOF, identifier, RRS (with SRR and 18 more bits where it is extended), IDE, FDF, res, BRS.
_ARBITRATION_BITS = {False: 17, True: 36}
_CONTROL_BITS = 5  # ESI and the length code, at the data bit rate
_TRAILER_BITS = 13  # CRC delimiter, acknowledgement and its delimiter, end of frame, intermission
_FIXED_STUFF_BITS = {17: 6, 21: 7}  # before the stuff count, then after each fourth bit


class FrameBits(NamedTuple):
    """Bits of a frame at the two bit rates, with stuff bits and intermission."""

    arbitration: int
    data: int


def worst_case_frame_bits(n_bytes: int, *, extended: bool = False) -> FrameBits:
    """Return the largest number of bits of a CAN FD frame with `n_bytes` bytes of data.

    A stuff bit follows five equal bits, and begins the next five: at most (n - 1) / 4 in n bits.
    The stuff count, 4 bits, and the CRC, 17 bits up to 16 bytes and 21 above, have stuff bits at
    fixed positions. Bits in which the rate changes count fully at the slow rate.

    References
    ----------
    ISO 11898-1:2015, 10.4.2.6 (CRC field) and 10.5 (stuffing).
    """
    if n_bytes not in FRAME_LENGTHS:
        raise InvalidSetting(
            "n_bytes",
            value=n_bytes,
            expected=f"one of {', '.join(map(str, FRAME_LENGTHS))}",
            fix="use the next longer length and pad the data",
        )
    crc = 17 if n_bytes <= 16 else 21
    arbitration = _ARBITRATION_BITS[extended]
    data = _CONTROL_BITS + 8 * n_bytes
    slow_stuff = (arbitration - 1) // 4
    stuff = (arbitration + data - 1) // 4
    return FrameBits(
        arbitration=arbitration + slow_stuff + _TRAILER_BITS,
        data=data + stuff - slow_stuff + 4 + crc + _FIXED_STUFF_BITS[crc],
    )


@frozen_dataclass
class CanFd:
    """CAN FD bus, and the share of it that the object list may use."""

    arbitration_bit_rate_hz: float = 500e3
    data_bit_rate_hz: float = 2e6
    largest_load: float = 0.5
    """Largest share of time in which the object list may occupy the bus."""
    cycle_s: float | None = None
    """Time from list to list; None: the shortest one in the object list, and no limit for a single
    list.
    """

    def __post_init__(self) -> None:
        check_positive_fields(self, "arbitration_bit_rate_hz", at_most=1e6)
        check_positive_fields(self, "data_bit_rate_hz", at_most=20e6)
        check_number("CanFd.largest_load", self.largest_load, above=0.0, at_most=1.0)
        if self.cycle_s is not None:
            check_positive_fields(self, "cycle_s", at_most=1e6)
        if self.data_bit_rate_hz < self.arbitration_bit_rate_hz:
            raise InvalidSetting(
                "CanFd.data_bit_rate_hz",
                value=self.data_bit_rate_hz,
                expected=f"at least the arbitration bit rate, {self.arbitration_bit_rate_hz:.6g}",
                fix="raise it, or lower the arbitration bit rate",
            )

    def frame_duration_s(self, n_bytes: int, *, extended: bool = False) -> float:
        """Return the longest time that a frame with `n_bytes` bytes occupies the bus."""
        bits = worst_case_frame_bits(n_bytes, extended=extended)
        return bits.arbitration / self.arbitration_bit_rate_hz + bits.data / self.data_bit_rate_hz

    def classic_frame_duration_s(self, n_bytes: int, *, extended: bool = False) -> float:
        """Return the longest time of a classical CAN frame, all at the arbitration bit rate.

        34 bits (54 with an extended identifier) and the data may be stuffed, 13 follow.
        """
        stuffed = (54 if extended else 34) + 8 * n_bytes
        return (stuffed + (stuffed - 1) // 4 + 13) / self.arbitration_bit_rate_hz
