"""Time-division multiplexing: transmitters take turns, one chirp each."""

from functools import cached_property

from dechirp.core.checks import check_number
from dechirp.core.values import frozen_dataclass
from dechirp.radar.multiplexing.base import Multiplexing, check_transmitter_order

_MAX_PAUSE_S = 1e6  # as intervals


@frozen_dataclass
class Tdm(Multiplexing):
    """One active transmitter at a time, each once in a round; rounds with or without a pause."""

    order: tuple[int, ...]
    """Transmitter of each slot: zero-based index into the transmitters of the array."""

    pause_s: float | None = None
    """Pause after each round, beside the interval of its last chirp; none: evenly spaced chirps."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "order", check_transmitter_order("Tdm.order", self.order))
        if self.pause_s is not None:
            check_number("Tdm.pause_s", self.pause_s, at_least=0, at_most=_MAX_PAUSE_S)

    @property
    def round_pause_s(self) -> float:
        return self.pause_s or 0.0

    @cached_property
    def weights(self) -> tuple[tuple[complex, ...], ...]:
        transmitters = range(1 + max(self.order))
        return tuple(
            tuple(complex(transmitter == active) for transmitter in transmitters)
            for active in self.order
        )
