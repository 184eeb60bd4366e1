"""Frequency-shift keying: two interleaved chirp sequences, a frequency step apart."""

from dechirp.core.checks import check_number
from dechirp.core.errors import InvalidSetting
from dechirp.core.text import format_si
from dechirp.core.values import frozen_dataclass
from dechirp.radar.chirp import Chirp
from dechirp.radar.modulations.base import Modulation, Ramp


@frozen_dataclass
class FrequencyShiftKeying(Modulation):
    """Ramps that start alternately half a step below and above the chirp's frequency.

    From one sequence to the other the phase of the echo changes by the delay times the step, and
    by the Doppler frequency times the interval. The beat frequency determines the delay, so the
    phase determines the velocity ambiguity (Rohling and Meinecke 2001; Kronauge and Rohling
    2014): n ambiguity numbers are resolved if (interval - step / slope) / repetition is k / n, a
    fraction in lowest terms.
    """

    step_hz: float
    """Frequency of the upper minus the lower sequence, which is sent first; below 0: the upper is
    first."""

    def __post_init__(self) -> None:
        check_number("FrequencyShiftKeying.step_hz", self.step_hz, at_least=-1e13, at_most=1e13)
        if self.step_hz == 0:
            raise InvalidSetting(
                "FrequencyShiftKeying.step_hz",
                value="0 Hz",
                expected="a step other than 0",
                fix="remove the modulation, or give a step of a few MHz",
            )

    def ramps(self, chirp: Chirp) -> tuple[Ramp, ...]:
        if abs(self.step_hz) > chirp.ramp_bandwidth_hz:
            raise InvalidSetting(
                "Frame.modulation.step_hz",
                value=format_si(self.step_hz, "hz"),
                expected=f"at most the bandwidth of the ramp,"
                f" {format_si(chirp.ramp_bandwidth_hz, 'hz')}:"
                " beyond,"
                " the range is too inaccurate to predict the phase of the step",
                fix="lower the step",
            )
        return Ramp(shift_hz=-self.step_hz / 2), Ramp(shift_hz=self.step_hz / 2)
