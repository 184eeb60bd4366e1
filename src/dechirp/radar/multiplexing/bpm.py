"""Binary phase modulation: all transmitters send in every chirp with orthogonal signs."""

from functools import cached_property

from dechirp.core.values import frozen_dataclass
from dechirp.radar.multiplexing.base import Multiplexing, check_transmitter_order


@frozen_dataclass
class Bpm(Multiplexing):
    """Simultaneous transmitters with the signs of the rows of a Hadamard matrix.

    The order of the matrix is the next power of two, as many as a round has chirps, and its first
    row has no minus (Sylvester 1867). Two transmitters: + +, then + -. Over a round the echoes of
    different transmitters are orthogonal.
    """

    order: tuple[int, ...]
    """Transmitter of each row of the matrix: zero-based index into the array's transmitters."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "order", check_transmitter_order("Bpm.order", self.order))

    @cached_property
    def weights(self) -> tuple[tuple[complex, ...], ...]:
        n_slots = 1 << (len(self.order) - 1).bit_length()
        row_of = {transmitter: row for row, transmitter in enumerate(self.order)}
        return tuple(
            tuple(
                _hadamard_element(row_of[transmitter_index], slot)
                if transmitter_index in row_of
                else 0j
                for transmitter_index in range(1 + max(self.order))
            )
            for slot in range(n_slots)
        )


def _hadamard_element(row: int, column: int) -> complex:
    """Return an element of Sylvester's matrix: -1 if row and column share an odd number of bits."""
    return complex(1 - 2 * ((row & column).bit_count() & 1))
