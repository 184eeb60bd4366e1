"""Time division: transmitters take turns, a chirp each."""

from collections.abc import Iterable

from dechirp.core.checks import whole
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.radar.multiplexing.base import Multiplexing


@value
class Tdm(Multiplexing):
    """One transmitter sends at a time, every one once in a round."""

    order: tuple[int, ...]
    """Which transmitter sends in each slot: its place in the list of the array's
    transmitters, counted from 0."""

    def __post_init__(self) -> None:
        is_list = isinstance(self.order, Iterable) and not isinstance(self.order, str)
        order = tuple(self.order) if is_list else ()
        if not order:
            raise InvalidSetting(
                "Tdm.order",
                got=repr(self.order),
                need="a list of at least one transmitter",
                fix="Write [0, 1] for two that take turns.",
            )
        for transmitter in order:
            whole("Tdm.order", transmitter, at_least=0)
        if len(set(order)) < len(order):
            raise InvalidSetting(
                "Tdm.order",
                got=f"{', '.join(map(str, order))}",
                need="every transmitter once",
                fix="Name the transmitters of one round; the rounds repeat by themselves.",
            )
        object.__setattr__(self, "order", tuple(int(transmitter) for transmitter in order))

    @property
    def slots(self) -> tuple[tuple[int, ...], ...]:
        """The transmitters in their order, one in each slot."""
        return tuple((transmitter,) for transmitter in self.order)
