"""A chirp: the transmitted frequency ramp and the sampling of its echoes."""

from collections.abc import Iterable
from typing import Literal

import numpy as np

from dechirp.core.checks import (
    check_integer_fields,
    check_non_negative_fields,
    check_positive_fields,
)
from dechirp.core.display import Displayable, Table, property_display_rows, settings_display_table
from dechirp.core.errors import InvalidSetting
from dechirp.core.text import format_quantity, format_si
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.core.values import frozen_dataclass

Sampling = Literal["complex", "real"]


@frozen_dataclass
class Chirp(Displayable):
    """A linear up-ramp and the sampling of its dechirped echoes.

    Derived values name the bandwidth and the frequency that they use: the bandwidth swept while
    sampling, not that of the whole ramp, and the frequency at the middle of the sampling window,
    not the start of the ramp (1.6 % apart for a 2.5 GHz chirp at 77 GHz).
    """

    start_frequency_hz: float
    """Frequency at the start of the ramp."""
    slope_hz_per_s: float
    """Frequency slope of the ramp."""
    adc_start_s: float = 0.0
    """Time from the start of the ramp to the first sample."""
    ramp_duration_s: float
    """Time from the start of the ramp to its end."""
    sample_rate_hz: float
    """Sample rate, of complex or of real samples as in `sampling`."""
    n_samples: int
    """Number of samples of each chirp."""
    sampling: Sampling
    """Complex: an I/Q mixer. Real: a single mixer, half the range and 3 dB less."""

    def __post_init__(self) -> None:
        # The bounds span over-the-horizon to terahertz radar: a value outside has a wrong unit.
        check_positive_fields(self, "start_frequency_hz", at_least=1e6, at_most=1e13)
        check_positive_fields(self, "slope_hz_per_s", at_least=1.0, at_most=1e18)
        check_positive_fields(self, "ramp_duration_s", at_least=1e-12, at_most=1e6)
        check_positive_fields(self, "sample_rate_hz", at_least=1.0, at_most=1e13)
        check_non_negative_fields(self, "adc_start_s", at_most=1e6)
        check_integer_fields(self, "n_samples", at_least=2)
        if self.sampling not in ("complex", "real"):
            raise InvalidSetting(
                "Chirp.sampling", value=self.sampling, expected="complex or real", fix="choose one"
            )
        last_sample_s = self.adc_start_s + (self.n_samples - 1) / self.sample_rate_hz
        if last_sample_s > self.ramp_duration_s * (1 + 1e-9):
            raise InvalidSetting(
                "Chirp.ramp_duration_s",
                # Fewer than ten digits would print 9.9999999 s as 10 s in a message about 10 s.
                value=format_si(self.ramp_duration_s, "s", 10),
                expected=f"at least {format_si(last_sample_s, 's', 10)}, the time of the last"
                " sample",
                fix="lengthen the ramp, start sampling earlier, take fewer samples or sample"
                " faster",
            )

    @property
    def sampled_duration_s(self) -> float:
        """Duration of the sampling window, N / fs."""
        return self.n_samples / self.sample_rate_hz

    @property
    def sampled_bandwidth_hz(self) -> float:
        """Bandwidth swept while sampling, S N / fs."""
        return self.slope_hz_per_s * self.sampled_duration_s

    @property
    def ramp_bandwidth_hz(self) -> float:
        """Bandwidth swept by the whole ramp, the occupied bandwidth of the transmitter."""
        return self.slope_hz_per_s * self.ramp_duration_s

    @property
    def mid_window_s(self) -> float:
        """Mean of the sampling instants from the start of the ramp."""
        return self.adc_start_s + (self.n_samples - 1) / (2 * self.sample_rate_hz)

    @property
    def mid_window_frequency_hz(self) -> float:
        """Transmit frequency at mid-window, f0 + S (adc_start + N / 2fs)."""
        middle_s = self.adc_start_s + self.sampled_duration_s / 2
        return self.start_frequency_hz + self.slope_hz_per_s * middle_s

    @property
    def mean_sampled_frequency_hz(self) -> float:
        """Mean transmit frequency at the sampling instants, f0 + S mid_window.

        Half a sample before `mid_window_frequency_hz`; estimates are exact with this one (0.07 %
        apart for 64 samples of 5.5 GHz at 60 GHz).
        """
        return self.start_frequency_hz + self.slope_hz_per_s * self.mid_window_s

    @property
    def wavelength_m(self) -> float:
        """Wavelength at the middle of the sampling window."""
        return SPEED_OF_LIGHT / self.mid_window_frequency_hz

    @property
    def range_resolution_m(self) -> float:
        """Width of a range bin, c / 2B, with the sampled bandwidth."""
        return SPEED_OF_LIGHT / (2 * self.sampled_bandwidth_hz)

    @property
    def max_beat_frequency_hz(self) -> float:
        """Highest unaliased beat frequency: fs for complex samples, fs / 2 for real ones."""
        return self.sample_rate_hz if self.sampling == "complex" else self.sample_rate_hz / 2

    @property
    def max_range_m(self) -> float:
        """Range of the highest beat frequency: fs c / 2S complex, half of it real."""
        return self.range_m(self.max_beat_frequency_hz)

    def beat_frequency_hz(self, range_m: float) -> float:
        """Return the beat frequency of a static target, 2 S R / c."""
        return 2 * self.slope_hz_per_s * range_m / SPEED_OF_LIGHT

    def range_m(self, beat_frequency_hz: float) -> float:
        """Return the range of a static target, c f / 2S, the inverse of `beat_frequency_hz`."""
        return SPEED_OF_LIGHT * beat_frequency_hz / (2 * self.slope_hz_per_s)

    def range_bins_m(self, n_bins: int | None = None) -> np.ndarray:
        """Return the range of each bin of a beat spectrum of n_bins points; none: n_samples.

        (n_bins,) for complex samples, (n_bins // 2 + 1,) for real ones, whose other half is a
        mirror image. Steps of c fs / 2 S n_bins, the range resolution when not padded.
        """
        n_bins = n_bins or self.n_samples
        n_kept = n_bins if self.sampling == "complex" else n_bins // 2 + 1
        return np.arange(n_kept) * self.range_m(self.sample_rate_hz) / n_bins

    def echo_frequencies_hz(
        self, range_m: np.ndarray, velocity_m_per_s: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return beat (S tau + f_D) and Doppler frequency (2 v (f - S tau) / c) at mid-window.

        Both before aliasing by sampling; any shape.
        """
        delay_hz = range_m / self.range_m(1.0)
        sent_hz = self.mean_sampled_frequency_hz - delay_hz
        doppler_hz = 2 * velocity_m_per_s * sent_hz / SPEED_OF_LIGHT
        return delay_hz + doppler_hz, doppler_hz

    def range_doppler_coupling_m(self, velocity_m_per_s: float) -> float:
        """Return the range error of a receding target, v f / S, with f at mid-window.

        The Doppler frequency adds to the beat frequency of an up-chirp; 3.77 cm at 10 m/s in the
        reference scenario (Griffiths 1990).
        """
        return velocity_m_per_s * self.mid_window_frequency_hz / self.slope_hz_per_s

    def _display_line(self) -> str:
        return (
            f"{format_quantity(self.start_frequency_hz, 'hz')},"
            f" {format_quantity(self.sampled_bandwidth_hz, 'hz')} in"
            f" {format_quantity(self.sampled_duration_s, 's')}, {self.n_samples:,}"
            f" {self.sampling} samples:"
            f" {format_quantity(self.range_resolution_m, 'm', 3)} to"
            f" {format_quantity(self.max_range_m, 'm', 3)}"
        )

    def _display_tables(self) -> Iterable[Table]:
        return (settings_display_table(self), Table("What follows", self._derived_value_rows()))

    def _derived_value_rows(self) -> list[tuple[str, str, str]]:
        return property_display_rows(
            self,
            "sampled_bandwidth_hz",
            "ramp_bandwidth_hz",
            "wavelength_m",
            "range_resolution_m",
            "max_range_m",
        )
