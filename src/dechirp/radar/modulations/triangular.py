"""Triangular modulation: a rising and a falling ramp in turns."""

from dechirp.core.values import frozen_dataclass
from dechirp.radar.chirp import Chirp
from dechirp.radar.modulations.base import Modulation, Ramp


@frozen_dataclass
class Triangular(Modulation):
    """Each rising ramp is followed by a falling one from the frequency where it ended.

    The Doppler frequency adds to the beat of one and subtracts from that of the other: both
    together determine range and velocity, even where a frame has one of each (Stove 1992).
    """

    def ramps(self, chirp: Chirp) -> tuple[Ramp, ...]:
        return Ramp(), Ramp(sign=-1, shift_hz=chirp.ramp_bandwidth_hz)
