"""Design rule by constraints: the lowest slope that the timeline and the parts allow.

An interval holds, one after the other: the round trip to the largest range and a settling time,
the samples, a margin to the end of the ramp, and the fly-back. It is as long as the largest
velocity allows, since a longer chirp needs less slope and fewer samples per second.
"""

import math

from dechirp.core.findings import Finding
from dechirp.core.units import SPEED_OF_LIGHT, to_decibels
from dechirp.radar.chirp import Chirp
from dechirp.radar.design.common import (
    find_broken_band_limit,
    find_broken_chirp_count_limit,
    required_n_chirps,
    start_frequency_hz,
)
from dechirp.radar.design.derived import (
    DerivedValue,
    data_rate_bits_per_s,
    frame_cube_bytes,
    mean_eirp_w,
)
from dechirp.radar.design.relaxation import BrokenLimit
from dechirp.radar.design.requirements import Limits, Requirements
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar


def design_frame(
    requirements: Requirements, *, limits: Limits, speed_of_light_m_per_s: float
) -> Frame | None:
    """Design a frame with the longest interval that keeps the largest velocity unambiguous.

    None if the interval leaves no time to sample.
    """
    c = speed_of_light_m_per_s
    bandwidth_hz = c / (2 * requirements.range_resolution_m)
    start_hz = start_frequency_hz(requirements, bandwidth_hz)
    frame = _design_frame_from_start(start_hz, bandwidth_hz, requirements, limits, c)
    if frame is not None and requirements.band is not None:
        shifted_start_hz = start_frequency_hz(requirements, frame.chirp.ramp_bandwidth_hz)
        if shifted_start_hz != start_hz:
            frame = _design_frame_from_start(
                shifted_start_hz, bandwidth_hz, requirements, limits, c
            )
    return frame


def _design_frame_from_start(
    start_hz: float, bandwidth_hz: float, requirements: Requirements, limits: Limits, c: float
) -> Frame | None:
    adc_start_s = 2 * requirements.max_range_m / c + limits.settling_s
    unsampled_s = limits.idle_s + adc_start_s + limits.ramp_end_margin_s
    sampled_s = _longest_sampling_time_s(
        adc_start_s=adc_start_s,
        unsampled_s=unsampled_s,
        frequency_hz=start_hz + bandwidth_hz / 2,
        bandwidth_hz=bandwidth_hz,
        n_periods=c / (4 * requirements.max_velocity_m_per_s),
    )
    if sampled_s is None:
        return None
    n_samples = max(
        2, math.ceil(_min_nyquist_sample_count(requirements) / limits.usable_band - 1e-9)
    )
    ramp_s = adc_start_s + sampled_s + limits.ramp_end_margin_s
    chirp = Chirp(
        start_frequency_hz=start_hz,
        slope_hz_per_s=bandwidth_hz / sampled_s,
        adc_start_s=adc_start_s,
        ramp_duration_s=ramp_s,
        sample_rate_hz=n_samples / sampled_s,
        n_samples=n_samples,
        sampling=requirements.sampling,
    )
    interval_s = limits.idle_s + ramp_s
    wavelength_m = chirp.wavelength_m * c / SPEED_OF_LIGHT
    n_chirps = required_n_chirps(requirements, wavelength_m=wavelength_m, interval_s=interval_s)
    return Frame(chirp=chirp, n_chirps=n_chirps, interval_s=interval_s)


def _min_nyquist_sample_count(requirements: Requirements) -> float:
    # The highest beat frequency has one period for each range bin while sampling, and the
    # Doppler frequency at most half a period, since an interval has at most half a period.
    periods = requirements.max_range_m / requirements.range_resolution_m + 0.5
    return periods if requirements.sampling == "complex" else 2 * periods


def _longest_sampling_time_s(
    *,
    adc_start_s: float,
    unsampled_s: float,
    frequency_hz: float,
    bandwidth_hz: float,
    n_periods: float,
) -> float | None:
    """Return the sampling time x that fills T = lambda / 4v, with lambda at mid-window.

    The shorter x, the steeper the ramp and the higher the frequency f + B a / x at the middle of
    the samples (a: start of sampling, u: all time that is not sampled), so that (x + u) (f + B a
    / x) = c / 4v, the periods of the wave in T: a quadratic equation, of which the larger root
    counts.
    """
    swept_before_hz = bandwidth_hz * adc_start_s
    half_sum = (n_periods - unsampled_s * frequency_hz - swept_before_hz) / 2
    discriminant = half_sum**2 - frequency_hz * unsampled_s * swept_before_hz
    if half_sum <= 0 or discriminant < 0:
        return None
    # 1e-9 shorter, so that rounding never leaves the velocity just below the requirement.
    return (half_sum + math.sqrt(discriminant)) / frequency_hz * (1 - 1e-9)


def find_broken_limits(
    requirements: Requirements, *, limits: Limits, speed_of_light_m_per_s: float
) -> list[BrokenLimit]:
    """Return the limits that requirements break."""
    frame = design_frame(requirements, limits=limits, speed_of_light_m_per_s=speed_of_light_m_per_s)
    if frame is None:
        return [_interval_limit_without_sampling_time(requirements, limits, speed_of_light_m_per_s)]
    radar, chirp = Radar(frame=frame), frame.chirp
    max_sample_rate_hz = limits.max_sample_rate_hz * (1 if chirp.sampling == "complex" else 2)
    checks = (
        ("max_slope", "a slope", chirp.slope_hz_per_s, limits.max_slope_hz_per_s, 1e12, "MHz/us"),
        ("max_sample_rate", "a sample rate", chirp.sample_rate_hz, max_sample_rate_hz, 1e6, "MS/s"),
        (
            "max_data_rate",
            "a data rate",
            data_rate_bits_per_s(radar),
            limits.max_data_rate_bits_per_s,
            1e6,
            "Mbit/s",
        ),
        ("max_cube", "a cube", frame_cube_bytes(radar), limits.max_cube_bytes, 2**20, "MiB"),
    )
    broken_limits = find_broken_band_limit(
        requirements, chirp.ramp_bandwidth_hz
    ) + find_broken_chirp_count_limit(requirements, frame)
    return broken_limits + [
        BrokenLimit(
            limit=name,
            demand=f"{what} of {number / scale:.4g} {unit}",
            bound=f"at most {most / scale:.4g} {unit} (limits.{name})",
        )
        for name, what, number, most, scale, unit in checks
        if number > most
    ]


def _interval_limit_without_sampling_time(
    requirements: Requirements, limits: Limits, c: float
) -> BrokenLimit:
    unsampled_s = (
        limits.idle_s
        + limits.settling_s
        + limits.ramp_end_margin_s
        + 2 * requirements.max_range_m / c
    )
    longest_s = c / (4 * requirements.max_velocity_m_per_s * requirements.carrier_hz)
    return BrokenLimit(
        limit="interval",
        demand=f"an interval of at most {longest_s * 1e6:.4g} us, lambda / 4v",
        bound=f"more than {unsampled_s * 1e6:.4g} us, taken by fly-back, round trip, settling and"
        " margin",
    )


def eirp_findings(radar: Radar, limits: Limits) -> tuple[Finding, ...]:
    """Return findings where the EIRP of the given hardware exceeds the regulatory limits."""
    checks = (
        ("peak", radar.require_hardware().eirp_w, limits.max_peak_eirp_w),
        ("mean", mean_eirp_w(radar), limits.max_mean_eirp_w),
    )
    return tuple(
        Finding(
            level="error",
            setting="hardware.transmit_power",
            value=f"a {kind} EIRP of {to_decibels(eirp_w) + 30:.4g} dBm",
            expected=f"at most {to_decibels(most_w) + 30:.4g} dBm (limits.max_{kind}_eirp)",
            fix="lower the transmit power or the antenna gain by"
            f" {math.ceil(to_decibels(eirp_w / most_w) * 10) / 10:.1f} dB",
        )
        for kind, eirp_w, most_w in checks
        if eirp_w > most_w * (1 + 1e-9)
    )


def values_chosen_by_rule(
    requirements: Requirements, frame: Frame, *, limits: Limits, speed_of_light_m_per_s: float
) -> tuple[DerivedValue, ...]:
    """Return the values that the rule chooses, in the order of its choices."""
    chirp = frame.chirp
    farthest, resolution = (
        f"R = {requirements.max_range_m:.6g} m",
        f"dR = {requirements.range_resolution_m:.6g} m",
    )
    cells = "R / dR + 1/2" if chirp.sampling == "complex" else "2 (R / dR + 1/2)"
    us = 1e6
    return (
        DerivedValue(
            name="bandwidth",
            value=chirp.sampled_bandwidth_hz,
            unit="Hz",
            formula="c / 2 dR",
            symbols=f"{resolution}; swept while sampling",
        ),
        DerivedValue(
            name="round_trip",
            value=2 * requirements.max_range_m / speed_of_light_m_per_s,
            unit="s",
            formula="2 R / c",
            symbols=farthest,
        ),
        DerivedValue(
            name="adc_start",
            value=chirp.adc_start_s,
            unit="s",
            formula="2 R / c + settling",
            symbols=f"settling = {limits.settling_s * us:.4g} us",
        ),
        DerivedValue(
            name="sampled_duration",
            value=chirp.sampled_duration_s,
            unit="s",
            formula="lambda / 4v - idle - adc_start - margin",
            symbols=f"v = {requirements.max_velocity_m_per_s:.6g} m/s, lambda at mid-window,"
            f" idle = {limits.idle_s * us:.4g} us, margin = {limits.ramp_end_margin_s * us:.4g} us",
        ),
        DerivedValue(
            name="ramp_duration",
            value=chirp.ramp_duration_s,
            unit="s",
            formula="adc_start + sampled_duration + margin",
        ),
        DerivedValue(
            name="slope",
            value=chirp.slope_hz_per_s,
            unit="Hz/s",
            formula="B / sampled_duration",
        ),
        DerivedValue(
            name="n_samples",
            value=chirp.n_samples,
            unit="1",
            formula=f"({cells}) / usable band, rounded up",
            symbols=f"{farthest}, {resolution}, half a bin for Doppler,"
            f" usable band = {limits.usable_band:.4g}",
        ),
        DerivedValue(
            name="sample_rate",
            value=chirp.sample_rate_hz,
            unit="Hz",
            formula="N / sampled_duration",
            symbols=f"{chirp.sampling} samples",
        ),
    )
