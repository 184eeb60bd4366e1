"""Intervals that differ from ramp to ramp, alike in every round."""

from dechirp.core.checks import series
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.radar.chirp import Chirp
from dechirp.radar.modulations.base import Modulation, Ramp


@value
class Staggered(Modulation):
    """After each ramp of a round another pause.

    Ramps at the same place of their rounds are a sequence of equal intervals. From sequence
    to sequence the echo turns by the Doppler frequency times the time between them: unless
    those times are even, it turns otherwise for each of more folds than there are ramps.
    """

    pauses_s: tuple[float, ...]
    """Added to the interval after each ramp of a round, 0 or more: [0 s, 5 us] sends pairs."""

    def __post_init__(self) -> None:
        pauses_s = series("Staggered.pauses_s", self.pauses_s, at_least=0.0, at_most=1e6)
        object.__setattr__(self, "pauses_s", pauses_s)
        if len(set(pauses_s)) < 2:
            raise InvalidSetting(
                "Staggered.pauses_s",
                got=f"{', '.join(f'{pause_s:.6g} s' for pause_s in pauses_s) or 'none'}",
                need="two or more that differ: equal ones are a longer interval",
                fix="Give one for each ramp of a round, such as [0 s, 5 us].",
            )

    def ramps(self, chirp: Chirp) -> tuple[Ramp, ...]:
        """One for each pause, see `Modulation.ramps`."""
        return tuple(Ramp(pause_s=pause_s) for pause_s in self.pauses_s)
