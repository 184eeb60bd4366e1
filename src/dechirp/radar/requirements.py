"""What a radar should do, and what its parts, the regulator and the memory allow."""

from typing import Literal

from dechirp.core.checks import not_negative, positive
from dechirp.core.errors import InvalidSetting
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.core.values import value

Band = Literal["76-77 GHz", "77-81 GHz"]

BANDS_HZ: dict[Band, tuple[float, float]] = {
    "76-77 GHz": (76e9, 77e9),
    "77-81 GHz": (77e9, 81e9),
}

_SLOWEST_M_PER_S, _FASTEST_M_PER_S = 1e-9, SPEED_OF_LIGHT / 1000


@value
class Requirements:
    """What a radar should do. `design` says whether one can."""

    max_range_m: float
    """Farthest target that must not alias."""
    range_resolution_m: float
    """Width of a range bin, at most."""
    max_velocity_m_per_s: float
    """Fastest target, of either sign, that must not fold."""
    velocity_resolution_m_per_s: float | None = None
    """Width of a velocity bin, at most; none: what 128 chirps give."""
    carrier_hz: float = 77e9
    """Frequency at the start of the ramp."""
    sampling: Literal["complex", "real"] = "complex"
    """Complex: an I/Q mixer. Real: one mixer, half the range at the same sample rate."""
    band: Band | None = None
    """Band that the whole ramp must stay in; none: at most as wide as 76-81 GHz there."""
    rcs_m2: float | None = None
    """Target to detect at the largest range; none: the link budget is not checked."""
    detection_probability: float = 0.9
    """Of that target, steady, in one frame; only used with `rcs_m2`."""
    false_alarm_probability: float = 1e-6
    """For each cell tested, with noise alone; only used with `rcs_m2`."""

    def __post_init__(self) -> None:
        # The bounds of scenes and chirps. Beyond them a unit is wrong; squares far beyond overflow.
        positive(self, "max_range_m", "range_resolution_m", at_least=1e-6, at_most=1e9)
        speeds = {"at_least": _SLOWEST_M_PER_S, "at_most": _FASTEST_M_PER_S}
        positive(self, "max_velocity_m_per_s", **speeds)
        if self.velocity_resolution_m_per_s is not None:
            positive(self, "velocity_resolution_m_per_s", **speeds)
        positive(self, "carrier_hz", at_least=1e6, at_most=1e13)
        if self.rcs_m2 is not None:
            positive(self, "rcs_m2", at_least=1e-12, at_most=1e12)
        self._check_choices()
        self._check_sizes()
        self._check_probabilities()

    def _check_choices(self) -> None:
        choices: tuple[tuple[str, tuple[str | None, ...]], ...] = (
            ("sampling", ("complex", "real")),
            ("band", (None, *BANDS_HZ)),
        )
        for name, allowed in choices:
            if getattr(self, name) not in allowed:
                raise InvalidSetting(
                    f"Requirements.{name}",
                    got=getattr(self, name),
                    need=" or ".join(str(choice) for choice in allowed if choice),
                    fix="Choose one.",
                )

    def _check_sizes(self) -> None:
        # No converter or memory is near it; beyond it a unit is wrong.
        if self.max_range_m > 1e6 * self.range_resolution_m:
            raise InvalidSetting(
                "Requirements.range_resolution_m",
                got=f"{self.range_resolution_m:.4g} m at a largest range of"
                f" {self.max_range_m:.4g} m",
                need="at least a millionth of the largest range",
                fix="Check the units of both.",
            )

    def _check_probabilities(self) -> None:
        wrong, right = self.false_alarm_probability, self.detection_probability
        if not 0 < wrong < right < 1:
            raise InvalidSetting(
                "Requirements.detection_probability",
                got=f"{right} with a false-alarm probability of {wrong}",
                need="0 < false-alarm probability < detection probability < 1",
                fix="Mend the one that is out of place.",
            )


@value
class Limits:
    """What the parts, the regulator and the memory allow; for the rule `constraints`.

    The defaults are round figures for 76-81 GHz hardware with one receiver. Give those of
    your own parts.
    """

    idle_s: float = 2e-6
    """From the end of a ramp to the start of the next: the synthesiser flies back and locks.
    Wide ramps need more, up to about 7 us for 4 GHz."""
    settling_s: float = 1e-6
    """From the echo of the largest range to the first sample: the ramp becomes straight and
    the filters settle."""
    ramp_end_margin_s: float = 0.2e-6
    """From the last sample to the end of the ramp, for the delay of the digital filter."""
    max_slope_hz_per_s: float = 100e12
    """100 MHz/us, usual for synthesisers of single-chip radars."""
    max_sample_rate_hz: float = 50e6
    """Complex samples per second, or half the rate of real ones. Many single-chip radars stop
    at 22.5 MS/s."""
    usable_band: float = 0.9
    """Part of the alias-free beat frequencies that the anti-alias filter passes unharmed."""
    max_data_rate_bits_per_s: float = 1e9
    """Mean over a frame, in 16-bit words; Gigabit Ethernet, the link of capture boards."""
    max_cube_bytes: float = 4 * 2**20
    """Samples of one frame, in 16-bit words: the memory of a large single-chip radar."""
    max_mean_eirp_w: float = 100.0
    """50 dBm, 47 CFR 95.3367(a), for 76-81 GHz."""
    max_peak_eirp_w: float = 10**2.5
    """55 dBm, 47 CFR 95.3367(b), for 76-81 GHz."""

    def __post_init__(self) -> None:
        not_negative(self, "idle_s", "settling_s", "ramp_end_margin_s")
        positive(
            self,
            "max_slope_hz_per_s",
            "max_sample_rate_hz",
            "usable_band",
            "max_data_rate_bits_per_s",
            "max_cube_bytes",
            "max_mean_eirp_w",
            "max_peak_eirp_w",
        )
        if self.usable_band > 1:
            raise InvalidSetting(
                "Limits.usable_band",
                got=self.usable_band,
                need="a fraction of at most 1",
                fix="Give 0.9 for a usual filter, or 1 for one without a slope.",
            )
