"""Two chirp sequences, interleaved, a step of frequency apart."""

from dechirp.core.checks import number
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.radar.chirp import Chirp
from dechirp.radar.modulations.base import Modulation, Ramp


@value
class FrequencyShiftKeying(Modulation):
    """Ramps start half a step below and half a step above the chirp's frequency, in turns.

    From one sequence to the other the echo turns by the delay times the step, and by the
    Doppler frequency times the interval. The beat frequency tells the delay, so that the turn
    tells how often the Doppler frequency has folded (Rohling and Meinecke 2001; Kronauge and
    Rohling 2014): by n folds if (interval - step / slope) / repetition is a multiple of 1 / n.
    """

    step_hz: float
    """From the lower sequence, which is sent first, to the upper; below 0: the upper is first."""

    def __post_init__(self) -> None:
        number("FrequencyShiftKeying.step_hz", self.step_hz, at_least=-1e13, at_most=1e13)
        if self.step_hz == 0:
            raise InvalidSetting(
                "FrequencyShiftKeying.step_hz",
                got="0 Hz",
                need="a step: without one the sequences are one",
                fix="Leave the modulation out, or give a step of some MHz.",
            )

    def ramps(self, chirp: Chirp) -> tuple[Ramp, ...]:
        """The lower and the upper one, see `Modulation.ramps`."""
        if abs(self.step_hz) > chirp.ramp_bandwidth_hz:
            raise InvalidSetting(
                "Frame.modulation.step_hz",
                got=f"{self.step_hz:.6g} Hz",
                need=f"at most the bandwidth of the ramp, {chirp.ramp_bandwidth_hz:.6g} Hz: beyond,"
                " the range is not known well enough to tell what the step turns",
                fix="Lower the step.",
            )
        return Ramp(shift_hz=-self.step_hz / 2), Ramp(shift_hz=self.step_hz / 2)
