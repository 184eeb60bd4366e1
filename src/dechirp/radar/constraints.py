"""The rule by constraints: the gentlest chirp that the timeline and the parts allow.

An interval holds, one after the other: the round trip to the largest range and a settling
time, the samples, a margin to the end of the ramp, and the fly-back. It is as long as the
largest velocity allows, since a longer chirp needs less slope and fewer samples per second.
"""

import math

from dechirp.core.findings import Finding
from dechirp.core.units import SPEED_OF_LIGHT, decibels
from dechirp.radar.chirp import Chirp
from dechirp.radar.choices import (
    n_chirps,
    outside_band,
    start_frequency_hz,
    too_many_chirps,
)
from dechirp.radar.derived import Derived, cube_bytes, data_rate_bits_per_s, mean_eirp_w
from dechirp.radar.frame import Frame
from dechirp.radar.nearest import Broken
from dechirp.radar.radar import Radar
from dechirp.radar.requirements import Limits, Requirements


def frame(asked: Requirements, *, limits: Limits, speed_of_light_m_per_s: float) -> Frame | None:
    """Longest intervals that keep the largest velocity unambiguous; none: no time to sample."""
    c = speed_of_light_m_per_s
    bandwidth_hz = c / (2 * asked.range_resolution_m)
    start_hz = start_frequency_hz(asked, bandwidth_hz)
    made = _frame_from(start_hz, bandwidth_hz, asked, limits, c)
    if made is not None and asked.band is not None:
        moved_hz = start_frequency_hz(asked, made.chirp.ramp_bandwidth_hz)
        if moved_hz != start_hz:
            made = _frame_from(moved_hz, bandwidth_hz, asked, limits, c)
    return made


def _frame_from(
    start_hz: float, bandwidth_hz: float, asked: Requirements, limits: Limits, c: float
) -> Frame | None:
    adc_start_s = 2 * asked.max_range_m / c + limits.settling_s
    unsampled_s = limits.idle_s + adc_start_s + limits.ramp_end_margin_s
    sampled_s = _longest_sampling_s(
        adc_start_s=adc_start_s,
        unsampled_s=unsampled_s,
        frequency_hz=start_hz + bandwidth_hz / 2,
        bandwidth_hz=bandwidth_hz,
        n_periods=c / (4 * asked.max_velocity_m_per_s),
    )
    if sampled_s is None:
        return None
    n_samples = max(2, math.ceil(_cells(asked) / limits.usable_band - 1e-9))
    ramp_s = adc_start_s + sampled_s + limits.ramp_end_margin_s
    chirp = Chirp(
        start_frequency_hz=start_hz,
        slope_hz_per_s=bandwidth_hz / sampled_s,
        adc_start_s=adc_start_s,
        ramp_duration_s=ramp_s,
        sample_rate_hz=n_samples / sampled_s,
        n_samples=n_samples,
        sampling=asked.sampling,
    )
    interval_s = limits.idle_s + ramp_s
    wavelength_m = chirp.wavelength_m * c / SPEED_OF_LIGHT
    chirps = n_chirps(asked, wavelength_m=wavelength_m, interval_s=interval_s)
    return Frame(chirp=chirp, n_chirps=chirps, interval_s=interval_s)


def _cells(asked: Requirements) -> float:
    # Periods of the highest beat frequency while sampling: one for each range bin, and for
    # the Doppler frequency at most half of one, since an interval has at most half a period.
    periods = asked.max_range_m / asked.range_resolution_m + 0.5
    return periods if asked.sampling == "complex" else 2 * periods


def _longest_sampling_s(
    *,
    adc_start_s: float,
    unsampled_s: float,
    frequency_hz: float,
    bandwidth_hz: float,
    n_periods: float,
) -> float | None:
    """Time x to sample that fills T = lambda / 4v, lambda that at mid-window.

    The shorter x, the steeper the ramp and the higher the frequency f + B a / x at the
    middle of the samples (a: start of sampling, u: all that is not sampled), so that
    (x + u) (f + B a / x) = c / 4v, the periods of the wave in T: a quadratic equation, of which
    the larger root counts.
    """
    climbed = bandwidth_hz * adc_start_s
    half = (n_periods - unsampled_s * frequency_hz - climbed) / 2
    under_root = half**2 - frequency_hz * unsampled_s * climbed
    if half <= 0 or under_root < 0:
        return None
    # 1e-9 shorter, so that rounding never leaves the velocity just short of what is asked.
    return (half + math.sqrt(under_root)) / frequency_hz * (1 - 1e-9)


def breaks(asked: Requirements, *, limits: Limits, speed_of_light_m_per_s: float) -> list[Broken]:
    """Limits that requirements break."""
    made = frame(asked, limits=limits, speed_of_light_m_per_s=speed_of_light_m_per_s)
    if made is None:
        return [_no_time(asked, limits, speed_of_light_m_per_s)]
    radar, chirp = Radar(frame=made), made.chirp
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
        ("max_cube", "a cube", cube_bytes(radar), limits.max_cube_bytes, 2**20, "MiB"),
    )
    broken = outside_band(asked, chirp.ramp_bandwidth_hz) + too_many_chirps(asked, made)
    return broken + [
        Broken(
            limit=name,
            takes=f"{what} of {number / scale:.4g} {unit}",
            allowed=f"at most {most / scale:.4g} {unit} (limits.{name})",
        )
        for name, what, number, most, scale, unit in checks
        if number > most
    ]


def _no_time(asked: Requirements, limits: Limits, c: float) -> Broken:
    unsampled_s = (
        limits.idle_s + limits.settling_s + limits.ramp_end_margin_s + 2 * asked.max_range_m / c
    )
    longest_s = c / (4 * asked.max_velocity_m_per_s * asked.carrier_hz)
    return Broken(
        limit="interval",
        takes=f"an interval of at most {longest_s * 1e6:.4g} us, lambda / 4v",
        allowed=f"{unsampled_s * 1e6:.4g} us of it for fly-back, round trip, settling and margin,"
        " and time left to sample",
    )


def over_eirp(radar: Radar, limits: Limits) -> tuple[Finding, ...]:
    """Power that the regulator does not allow, as findings: the hardware is given, not designed."""
    checks = (
        ("peak", radar.known_hardware().eirp_w, limits.max_peak_eirp_w),
        ("mean", mean_eirp_w(radar), limits.max_mean_eirp_w),
    )
    return tuple(
        Finding(
            level="error",
            setting="hardware.transmit_power",
            got=f"a {kind} EIRP of {decibels(eirp_w) + 30:.4g} dBm",
            need=f"at most {decibels(most_w) + 30:.4g} dBm (limits.max_{kind}_eirp)",
            fix="Lower the transmit power or the antenna gain by"
            f" {math.ceil(decibels(eirp_w / most_w) * 10) / 10:.1f} dB.",
        )
        for kind, eirp_w, most_w in checks
        if eirp_w > most_w * (1 + 1e-9)
    )


def derived(
    asked: Requirements, made: Frame, *, limits: Limits, speed_of_light_m_per_s: float
) -> tuple[Derived, ...]:
    """Choices of the rule, in the order in which it makes them."""
    chirp = made.chirp
    farthest, resolution = (
        f"R = {asked.max_range_m:.6g} m",
        f"dR = {asked.range_resolution_m:.6g} m",
    )
    cells = "R / dR + 1/2" if chirp.sampling == "complex" else "2 (R / dR + 1/2)"
    us = 1e6
    return (
        Derived(
            name="bandwidth",
            value=chirp.sampled_bandwidth_hz,
            unit="Hz",
            formula="c / 2 dR",
            uses=f"{resolution}; swept while sampling",
        ),
        Derived(
            name="round_trip",
            value=2 * asked.max_range_m / speed_of_light_m_per_s,
            unit="s",
            formula="2 R / c",
            uses=farthest,
        ),
        Derived(
            name="adc_start",
            value=chirp.adc_start_s,
            unit="s",
            formula="2 R / c + settling",
            uses=f"settling = {limits.settling_s * us:.4g} us",
        ),
        Derived(
            name="sampled_duration",
            value=chirp.sampled_duration_s,
            unit="s",
            formula="lambda / 4v - idle - adc_start - margin",
            uses=f"v = {asked.max_velocity_m_per_s:.6g} m/s, lambda at mid-window,"
            f" idle = {limits.idle_s * us:.4g} us, margin = {limits.ramp_end_margin_s * us:.4g} us",
        ),
        Derived(
            name="ramp_duration",
            value=chirp.ramp_duration_s,
            unit="s",
            formula="adc_start + sampled_duration + margin",
        ),
        Derived(
            name="slope",
            value=chirp.slope_hz_per_s,
            unit="Hz/s",
            formula="B / sampled_duration",
        ),
        Derived(
            name="n_samples",
            value=chirp.n_samples,
            unit="1",
            formula=f"({cells}) / usable band, rounded up",
            uses=f"{farthest}, {resolution}, half a bin for Doppler,"
            f" usable band = {limits.usable_band:.4g}",
        ),
        Derived(
            name="sample_rate",
            value=chirp.sample_rate_hz,
            unit="Hz",
            formula="N / sampled_duration",
            uses=f"{chirp.sampling} samples",
        ),
    )
