"""Requirements on a radar, and limits of its parts, the regulator and the memory."""

from typing import Literal

from dechirp.core.checks import check_non_negative_fields, check_positive_fields
from dechirp.core.errors import InvalidSetting
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.core.values import frozen_dataclass

Band = Literal["76-77 GHz", "77-81 GHz"]

BANDS_HZ: dict[Band, tuple[float, float]] = {
    "76-77 GHz": (76e9, 77e9),
    "77-81 GHz": (77e9, 81e9),
}

_SLOWEST_M_PER_S, _FASTEST_M_PER_S = 1e-9, SPEED_OF_LIGHT / 1000


@frozen_dataclass
class Requirements:
    """Requirements on a radar; `design` finds out if they can be met."""

    max_range_m: float
    """Largest unaliased range."""
    range_resolution_m: float
    """Largest width of a range bin."""
    max_velocity_m_per_s: float
    """Largest unambiguous velocity of either sign."""
    velocity_resolution_m_per_s: float | None = None
    """Largest width of a velocity bin; none: that of 128 chirps."""
    carrier_hz: float = 77e9
    """Frequency at the start of the ramp."""
    sampling: Literal["complex", "real"] = "complex"
    """Complex: an I/Q mixer. Real: a single mixer, half the range at the same sample rate."""
    band: Band | None = None
    """Band that the whole ramp must stay in; none: a carrier from 76 to 81 GHz allows a ramp of
    up to 5 GHz."""
    rcs_m2: float | None = None
    """RCS of a target to detect at the largest range; none: no link budget."""
    detection_probability: float = 0.9
    """Detection probability of that target, steady, in one frame; only used with `rcs_m2`."""
    false_alarm_probability: float = 1e-6
    """False-alarm probability of each cell, in noise only; only used with `rcs_m2`."""

    def __post_init__(self) -> None:
        # Bounds of scenes and chirps: a value outside has a wrong unit, and squares may overflow.
        check_positive_fields(self, "max_range_m", "range_resolution_m", at_least=1e-6, at_most=1e9)
        speeds = {"at_least": _SLOWEST_M_PER_S, "at_most": _FASTEST_M_PER_S}
        check_positive_fields(self, "max_velocity_m_per_s", **speeds)
        if self.velocity_resolution_m_per_s is not None:
            check_positive_fields(self, "velocity_resolution_m_per_s", **speeds)
        check_positive_fields(self, "carrier_hz", at_least=1e6, at_most=1e13)
        if self.rcs_m2 is not None:
            check_positive_fields(self, "rcs_m2", at_least=1e-12, at_most=1e12)
        self._check_sampling_and_band()
        self._check_range_to_resolution_ratio()
        self._check_probabilities()

    def _check_sampling_and_band(self) -> None:
        choices: tuple[tuple[str, tuple[str | None, ...]], ...] = (
            ("sampling", ("complex", "real")),
            ("band", (None, *BANDS_HZ)),
        )
        for name, allowed in choices:
            if getattr(self, name) not in allowed:
                raise InvalidSetting(
                    f"Requirements.{name}",
                    value=getattr(self, name),
                    expected=" or ".join(str(choice) for choice in allowed if choice),
                    fix="choose one",
                )

    def _check_range_to_resolution_ratio(self) -> None:
        # No converter or memory comes near this ratio: a larger one has a wrong unit.
        if self.max_range_m > 1e6 * self.range_resolution_m:
            raise InvalidSetting(
                "Requirements.range_resolution_m",
                value=f"{self.range_resolution_m:.4g} m at a largest range of"
                f" {self.max_range_m:.4g} m",
                expected="at least a millionth of the largest range",
                fix="check the units of both",
            )

    def _check_probabilities(self) -> None:
        wrong, right = self.false_alarm_probability, self.detection_probability
        if not 0 < wrong < right < 1:
            raise InvalidSetting(
                "Requirements.detection_probability",
                value=f"{right} with a false-alarm probability of {wrong}",
                expected="0 < false-alarm probability < detection probability < 1",
                fix="correct the probability that is out of order",
            )


@frozen_dataclass
class Limits:
    """Limits of parts, regulator and memory, for the rule `constraints`.

    The defaults are round figures for 76-81 GHz hardware with one receiver. Replace them by those
    of your parts.
    """

    idle_s: float = 2e-6
    """Time from the end of a ramp to the start of the next, for fly-back and lock of the
    synthesiser. Wide ramps need more, up to about 7 us for 4 GHz."""
    settling_s: float = 1e-6
    """Time from the echo of the largest range to the first sample, for the ramp to become linear
    and the filters to settle."""
    ramp_end_margin_s: float = 0.2e-6
    """Time from the last sample to the end of the ramp, for the delay of the digital filter."""
    max_slope_hz_per_s: float = 100e12
    """100 MHz/us, typical of synthesisers of single-chip radars."""
    max_sample_rate_hz: float = 50e6
    """Complex samples per second, or half the rate of real ones. Many single-chip radars stop
    at 22.5 MS/s."""
    usable_band: float = 0.9
    """Share of the alias-free beat frequencies in the pass band of the anti-alias filter."""
    max_data_rate_bits_per_s: float = 1e9
    """Mean data rate over a frame, in 16-bit words; Gigabit Ethernet of capture boards."""
    max_cube_bytes: float = 4 * 2**20
    """Memory for the samples of one frame, in 16-bit words; that of a large single-chip radar."""
    max_mean_eirp_w: float = 100.0
    """50 dBm, 47 CFR 95.3367(a), for 76-81 GHz."""
    max_peak_eirp_w: float = 10**2.5
    """55 dBm, 47 CFR 95.3367(b), for 76-81 GHz."""

    def __post_init__(self) -> None:
        check_non_negative_fields(self, "idle_s", "settling_s", "ramp_end_margin_s")
        check_positive_fields(
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
                value=self.usable_band,
                expected="a fraction of at most 1",
                fix="give 0.9 for a usual filter, or 1 for one without a slope",
            )
