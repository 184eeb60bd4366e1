"""One chirp: the ramp that is sent, and the samples taken of its echoes."""

from collections.abc import Iterable
from typing import Literal

import numpy as np

from dechirp.core.checks import count, not_negative, positive
from dechirp.core.displayed import Displayed, Table, follows, settings
from dechirp.core.errors import InvalidSetting
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.core.values import value
from dechirp.core.words import in_unit

Sampling = Literal["complex", "real"]


@value
class Chirp(Displayed):
    """A linear up-ramp, and when and how its dechirped echoes are sampled.

    Everything derived says which bandwidth and which frequency it uses: the bandwidth
    swept while sampling, not that of the whole ramp, and the frequency at the middle of
    the samples, not the start of the ramp (1.6 % apart for a 2.5 GHz chirp at 77 GHz).
    """

    start_frequency_hz: float
    """Frequency at the start of the ramp."""
    slope_hz_per_s: float
    """Rate of the ramp."""
    adc_start_s: float = 0.0
    """From the start of the ramp to the first sample."""
    ramp_duration_s: float
    """From the start of the ramp to its end."""
    sample_rate_hz: float
    """Samples per second: complex samples, or real ones, as `sampling` says."""
    n_samples: int
    """Samples taken of each chirp."""
    sampling: Sampling
    """Complex: an I/Q mixer. Real: one mixer, half the range and 3 dB less."""

    def __post_init__(self) -> None:
        # Wider than from over-the-horizon to terahertz radar: outside, a unit is wrong.
        positive(self, "start_frequency_hz", at_least=1e6, at_most=1e13)
        positive(self, "slope_hz_per_s", at_least=1.0, at_most=1e18)
        positive(self, "ramp_duration_s", at_least=1e-12, at_most=1e6)
        positive(self, "sample_rate_hz", at_least=1.0, at_most=1e13)
        not_negative(self, "adc_start_s", at_most=1e6)
        count(self, "n_samples", at_least=2)
        if self.sampling not in ("complex", "real"):
            raise InvalidSetting(
                "Chirp.sampling", got=self.sampling, need="complex or real", fix="Choose one."
            )
        last_sample_s = self.adc_start_s + (self.n_samples - 1) / self.sample_rate_hz
        if last_sample_s > self.ramp_duration_s * (1 + 1e-9):
            raise InvalidSetting(
                "Chirp.ramp_duration_s",
                # Ten digits, or 9.9999999 s would be called 10 s, and refused for less than that.
                got=f"{self.ramp_duration_s:.10g} s",
                need=f"at least {last_sample_s:.10g} s, when the last sample is taken",
                fix="Lengthen the ramp, start sampling earlier, take fewer samples or sample"
                " faster.",
            )

    @property
    def sampled_duration_s(self) -> float:
        """Time the samples take, N / fs: the part of the ramp that counts."""
        return self.n_samples / self.sample_rate_hz

    @property
    def sampled_bandwidth_hz(self) -> float:
        """Bandwidth swept while sampling, S N / fs."""
        return self.slope_hz_per_s * self.sampled_duration_s

    @property
    def ramp_bandwidth_hz(self) -> float:
        """Bandwidth swept by the whole ramp: what the regulator and the synthesiser see."""
        return self.slope_hz_per_s * self.ramp_duration_s

    @property
    def mid_window_s(self) -> float:
        """Mean of the sampling instants, from the start of the ramp."""
        return self.adc_start_s + (self.n_samples - 1) / (2 * self.sample_rate_hz)

    @property
    def mid_window_frequency_hz(self) -> float:
        """Frequency sent at the middle of the sampling window, f0 + S (adc_start + N / 2fs)."""
        middle_s = self.adc_start_s + self.sampled_duration_s / 2
        return self.start_frequency_hz + self.slope_hz_per_s * middle_s

    @property
    def mean_sampled_frequency_hz(self) -> float:
        """Mean of the frequencies sent at the sampling instants, f0 + S mid_window.

        Half a sample before `mid_window_frequency_hz`; estimates are exact with this one
        (0.07 % apart for 64 samples of 5.5 GHz at 60 GHz).
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
        """Highest beat frequency that does not alias: fs complex, fs / 2 real."""
        return self.sample_rate_hz if self.sampling == "complex" else self.sample_rate_hz / 2

    @property
    def max_range_m(self) -> float:
        """Range of the highest beat frequency: fs c / 2S complex, half of it real."""
        return self.range_m(self.max_beat_frequency_hz)

    def beat_frequency_hz(self, range_m: float) -> float:
        """Beat frequency of a target at rest, 2 S R / c."""
        return 2 * self.slope_hz_per_s * range_m / SPEED_OF_LIGHT

    def range_m(self, beat_frequency_hz: float) -> float:
        """Range of a target at rest, c f / 2S: the inverse of `beat_frequency_hz`."""
        return SPEED_OF_LIGHT * beat_frequency_hz / (2 * self.slope_hz_per_s)

    def range_bins_m(self, n_bins: int | None = None) -> np.ndarray:
        """Range of each bin of a beat spectrum of n_bins points; none: n_samples.

        (n_bins,) for complex samples, (n_bins // 2 + 1,) for real ones: the other half is a
        mirror image. Steps of c fs / 2 S n_bins, the range resolution when not padded.
        """
        n_bins = n_bins or self.n_samples
        n_kept = n_bins if self.sampling == "complex" else n_bins // 2 + 1
        return np.arange(n_kept) * self.range_m(self.sample_rate_hz) / n_bins

    def echo_frequencies_hz(
        self, range_m: np.ndarray, velocity_m_per_s: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Beat and Doppler frequencies at mid-window: S tau + f_D, f_D = 2 v (f - S tau) / c.

        Before sampling folds them; any shape.
        """
        delay_hz = range_m / self.range_m(1.0)
        sent_hz = self.mean_sampled_frequency_hz - delay_hz
        doppler_hz = 2 * velocity_m_per_s * sent_hz / SPEED_OF_LIGHT
        return delay_hz + doppler_hz, doppler_hz

    def range_doppler_coupling_m(self, velocity_m_per_s: float) -> float:
        """How much too far a receding target seems, v f / S, f at mid-window.

        The Doppler frequency adds to the beat frequency of an up-chirp; 3.77 cm at
        10 m/s in the reference scenario (Griffiths 1990).
        """
        return velocity_m_per_s * self.mid_window_frequency_hz / self.slope_hz_per_s

    def _line(self) -> str:
        return (
            f"{in_unit(self.start_frequency_hz, 'hz')},"
            f" {in_unit(self.sampled_bandwidth_hz, 'hz')} in"
            f" {in_unit(self.sampled_duration_s, 's')}, {self.n_samples:,} {self.sampling} samples:"
            f" {in_unit(self.range_resolution_m, 'm', 3)} to {in_unit(self.max_range_m, 'm', 3)}"
        )

    def _tables(self) -> Iterable[Table]:
        return (settings(self), Table("What follows", self._follows()))

    def _follows(self) -> list[tuple[str, str, str]]:
        return follows(
            self,
            "sampled_bandwidth_hz",
            "ramp_bandwidth_hz",
            "wavelength_m",
            "range_resolution_m",
            "max_range_m",
        )
