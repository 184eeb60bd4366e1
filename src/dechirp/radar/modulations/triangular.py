"""A triangle of frequency over time: up, then down."""

from dechirp.core.values import value
from dechirp.radar.chirp import Chirp
from dechirp.radar.modulations.base import Modulation, Ramp


@value
class Triangular(Modulation):
    """Each ramp up is followed by one down, from where the first ended.

    The Doppler frequency adds to the beat of the one and is taken off that of the other: both
    together tell range and velocity, even where a frame has one of each (Stove 1992).
    """

    def ramps(self, chirp: Chirp) -> tuple[Ramp, ...]:
        """Up and down, see `Modulation.ramps`."""
        return Ramp(), Ramp(sign=-1, shift_hz=chirp.ramp_bandwidth_hz)
