"""Modulations: base class, and the deviation of a ramp from the chirp of its frame."""

from abc import abstractmethod
from typing import ClassVar, NamedTuple

from dechirp.core.families import Family
from dechirp.radar.chirp import Chirp


class Ramp(NamedTuple):
    """A ramp of a round, by its deviations from the chirp of the frame."""

    sign: int = 1
    """1: rises with the slope of the chirp; -1: falls with it."""
    shift_hz: float = 0.0
    """Start frequency relative to that of the chirp."""
    pause_s: float = 0.0
    """Pause after its interval, before the next ramp starts."""


class Modulation(Family):
    """A round of ramps that differ from each other: a slot of a round is one ramp."""

    group: ClassVar[str] = "dechirp.modulation"

    @abstractmethod
    def ramps(self, chirp: Chirp) -> tuple[Ramp, ...]:
        """Return the ramps of a round in transmit order; at least two.

        Raises `InvalidSetting` where they do not fit the chirp.
        """
