"""Time division: transmitters take turns, a chirp each."""

from functools import cached_property

from dechirp.core.values import value
from dechirp.radar.multiplexing.base import Multiplexing, transmitters_in


@value
class Tdm(Multiplexing):
    """One transmitter sends at a time, every one once in a round."""

    order: tuple[int, ...]
    """Which transmitter sends in each slot: its place in the list of the array's
    transmitters, counted from 0."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "order", transmitters_in("Tdm.order", self.order))

    @cached_property
    def weights(self) -> tuple[tuple[complex, ...], ...]:
        """1 for the one that sends, see `Multiplexing.weights`."""
        places = range(1 + max(self.order))
        return tuple(tuple(complex(place == sends) for place in places) for sends in self.order)
