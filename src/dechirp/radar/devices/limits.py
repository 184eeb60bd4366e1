"""Limits of a radar chip; those without a public source are left out."""

from typing import Literal

from dechirp.core.values import frozen_dataclass


@frozen_dataclass
class DeviceLimits:
    """Bounds of a chip, and of the vendor's demo on it.

    None: no public source was found, and nothing is checked.
    """

    bands_hz: tuple[tuple[float, float], ...]
    """(low, high) of each oscillator; a ramp must stay within one of them."""
    max_slope_hz_per_s: float | None = None
    max_complex_rate_hz: float | None = None
    """None: the chip has no complex samples."""
    max_real_rate_hz: float | None = None
    """None: the chip has no real samples."""
    min_sample_rate_hz: float | None = None
    sample_clock_hz: float | None = None
    """Clock of which the sample rate is an integer fraction; None: any rate in steps."""
    max_beat_frequency_hz: float | None = None
    """Edge of the anti-alias filter."""

    adc_buffer_bytes: int | None = None
    """Buffer for the samples of one chirp of all receivers."""
    real_sample_bytes: float = 2.0
    """Size of a real sample in the buffer; a complex one takes twice that."""
    cube_bytes: int | None = None
    """Memory for the range spectra of a frame and its range-Doppler map."""
    max_fft_points: int | None = None
    """Largest range FFT of the vendor's demo, a power of two."""

    max_chirps: int | None = None
    """Largest number of chirps of each transmitter in a frame."""
    min_chirps: int = 1
    chirp_count_rule: Literal["any", "multiple of 4", "power of two"] = "any"
    """Numbers of chirps of each transmitter that the vendor's demo accepts."""

    min_idle_s: tuple[tuple[float, float], ...] = ()
    """(ramp bandwidth above which it holds, Hz; time from its end to the next ramp, s)."""
    max_idle_s: float | None = None
    min_adc_start_s: tuple[tuple[float, float], ...] = ()
    """(slope above which it holds, Hz/s; time from ramp start to the first sample, s)."""
    max_adc_start_s: float | None = None
    max_ramp_duration_s: float | None = None
    min_gap_s: float | None = None
    """Time from the end of the chirps of a frame to the start of the next frame."""
    max_period_s: float | None = None

    frequency_step_hz: float | None = None
    """Step of start frequencies."""
    slope_step_hz_per_s: float | None = None
    time_step_s: float | None = None
    """Step of the idle time, the start of sampling and the end of the ramp."""
    period_step_s: float | None = None
    sample_rate_step_hz: float | None = None
