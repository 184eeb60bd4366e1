"""What a chip allows, as numbers; what no public source states is left out."""

from typing import Literal

from dechirp.core.values import value


@value
class Limits:
    """Bounds of one chip, and of the vendor's program that runs on it.

    None: no public source was found, and nothing is checked.
    """

    bands_hz: tuple[tuple[float, float], ...]
    """(low, high) of each oscillator; a whole ramp stays within one of them."""
    max_slope_hz_per_s: float | None = None
    max_complex_rate_hz: float | None = None
    """None: complex samples are not offered."""
    max_real_rate_hz: float | None = None
    """None: real samples are not offered."""
    min_sample_rate_hz: float | None = None
    sample_clock_hz: float | None = None
    """Clock of which the sample rate is a whole fraction; None: any rate in steps."""
    max_beat_frequency_hz: float | None = None
    """Where the filter before the converter ends."""

    adc_buffer_bytes: int | None = None
    """Room for the samples of one chirp of all receivers."""
    real_sample_bytes: float = 2.0
    """One real sample in the buffer; a complex one takes twice that."""
    cube_bytes: int | None = None
    """Memory for the range spectra of a frame and its range-Doppler map."""
    max_points: int | None = None
    """Points of a chirp's transform in the vendor's program, a power of two."""

    max_chirps: int | None = None
    """Chirps of each transmitter in a frame."""
    min_chirps: int = 1
    chirps: Literal["any", "multiple of 4", "power of two"] = "any"
    """Numbers of chirps of each transmitter that the vendor's program takes."""

    min_idle_s: tuple[tuple[float, float], ...] = ()
    """(bandwidth of the ramp above which it holds, Hz; from its end to the next ramp, s)."""
    max_idle_s: float | None = None
    min_adc_start_s: tuple[tuple[float, float], ...] = ()
    """(slope above which it holds, Hz/s; from the start of the ramp to the first sample, s)."""
    max_adc_start_s: float | None = None
    max_ramp_duration_s: float | None = None
    min_gap_s: float | None = None
    """From the end of the chirps of a frame to the start of the next frame."""
    max_period_s: float | None = None

    frequency_step_hz: float | None = None
    """Start frequencies are kept as multiples of it."""
    slope_step_hz_per_s: float | None = None
    time_step_s: float | None = None
    """Of the idle time, the start of sampling and the end of the ramp."""
    period_step_s: float | None = None
    sample_rate_step_hz: float | None = None
