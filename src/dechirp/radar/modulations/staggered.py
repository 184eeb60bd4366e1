"""Staggered intervals: pauses that differ from ramp to ramp, equal in every round."""

from dechirp.core.checks import check_numbers
from dechirp.core.errors import InvalidSetting
from dechirp.core.text import format_si
from dechirp.core.values import frozen_dataclass
from dechirp.radar.chirp import Chirp
from dechirp.radar.modulations.base import Modulation, Ramp


@frozen_dataclass
class Staggered(Modulation):
    """A different pause after each ramp of a round.

    Ramps in the same slot of their rounds form a sequence of equal intervals. From sequence to
    sequence the phase of the echo changes by the Doppler frequency times the time between them:
    unless those times are even, the phases differ for more ambiguity numbers than there are
    ramps.
    """

    pauses_s: tuple[float, ...]
    """Pauses added to the interval after each ramp of a round, 0 or more: [0 s, 5 us] sends
    pairs."""

    def __post_init__(self) -> None:
        pauses_s = check_numbers("Staggered.pauses_s", self.pauses_s, at_least=0.0, at_most=1e6)
        object.__setattr__(self, "pauses_s", pauses_s)
        if len(set(pauses_s)) < 2:
            raise InvalidSetting(
                "Staggered.pauses_s",
                value=", ".join(format_si(pause_s, "s") for pause_s in pauses_s) or "empty",
                expected="two or more pauses that differ; equal pauses are a longer interval",
                fix="give one for each ramp of a round, such as [0 s, 5 us]",
            )

    def ramps(self, chirp: Chirp) -> tuple[Ramp, ...]:
        return tuple(Ramp(pause_s=pause_s) for pause_s in self.pauses_s)
