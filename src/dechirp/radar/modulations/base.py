"""What a modulation is: how the ramps of a round differ."""

from abc import abstractmethod
from typing import ClassVar, NamedTuple

from dechirp.core.families import Family
from dechirp.radar.chirp import Chirp


class Ramp(NamedTuple):
    """One ramp of a round, by what sets it apart from the chirp of its frame."""

    sign: int = 1
    """1: it rises with the slope of the chirp; -1: it falls as steeply."""
    shift_hz: float = 0.0
    """Where it starts, over the start frequency of the chirp."""
    pause_s: float = 0.0
    """What passes after its interval, until the next ramp starts."""


class Modulation(Family):
    """Sends ramps that differ, in rounds: a slot of a round is one ramp."""

    group: ClassVar[str] = "dechirp.modulation"

    @abstractmethod
    def ramps(self, chirp: Chirp) -> tuple[Ramp, ...]:
        """The ramps of a round in the order sent; at least two.

        Raises `InvalidSetting` where they do not go with the chirp.
        """
