"""Time-division multiplexing: transmitters take turns, one chirp each."""

from functools import cached_property

from dechirp.core.values import frozen_dataclass
from dechirp.radar.multiplexing.base import Multiplexing, check_transmitter_order


@frozen_dataclass
class Tdm(Multiplexing):
    """One active transmitter at a time, each once in a round."""

    order: tuple[int, ...]
    """Transmitter of each slot: zero-based index into the transmitters of the array."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "order", check_transmitter_order("Tdm.order", self.order))

    @cached_property
    def weights(self) -> tuple[tuple[complex, ...], ...]:
        transmitters = range(1 + max(self.order))
        return tuple(
            tuple(complex(transmitter == active) for transmitter in transmitters)
            for active in self.order
        )
