"""Binary phase modulation: all transmitters send in every chirp, with signs that part them."""

from functools import cached_property

from dechirp.core.values import value
from dechirp.radar.multiplexing.base import Multiplexing, transmitters_in


@value
class Bpm(Multiplexing):
    """Every transmitter sends in every chirp, with the signs of a row of a Hadamard matrix.

    The matrix has the next power of two of rows, as many as a round has chirps, and begins
    with a row without a minus (Sylvester 1867). Two transmitters: + +, then + -. Over a round
    the echoes of different transmitters are orthogonal.
    """

    order: tuple[int, ...]
    """Which transmitter sends each row of the matrix: its place in the list of the array's
    transmitters, counted from 0."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "order", transmitters_in("Bpm.order", self.order))

    @cached_property
    def weights(self) -> tuple[tuple[complex, ...], ...]:
        """The signs, see `Multiplexing.weights`."""
        n_slots = 1 << (len(self.order) - 1).bit_length()
        row_of = {transmitter: row for row, transmitter in enumerate(self.order)}
        return tuple(
            tuple(
                _sign(row_of[place], slot) if place in row_of else 0j
                for place in range(1 + max(self.order))
            )
            for slot in range(n_slots)
        )


def _sign(row: int, column: int) -> complex:
    """Element of Sylvester's matrix: minus where row and column share an odd number of bits."""
    return complex(1 - 2 * ((row & column).bit_count() & 1))
