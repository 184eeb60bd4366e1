"""Checks of a radar against the limits of a device, one function for each rule."""

import math
from collections.abc import Iterator

from dechirp.core.findings import Finding
from dechirp.radar.chirp import Chirp
from dechirp.radar.devices.limits import DeviceLimits
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar

# Share of the sampled band with a flat anti-alias filter: TI's rates of 6.25, 12.5 and
# 18.75 MS/s belong to filters of 5, 10 and 15 MHz.
USABLE_BAND = 0.8
_TOLERANCE = 1 + 1e-9


def find_broken_rules(
    radar: Radar, limits: DeviceLimits, *, name: str, n_tx: int, n_rx: int, demo: bool
) -> tuple[Finding, ...]:
    """Return all rules of a device that a radar breaks, in the order of its settings."""
    frame, chirp = radar.frame, radar.frame.chirp
    findings = [
        *_check_antenna_counts(radar, name, n_tx, n_rx),
        *_check_ramp_within_band(chirp, limits, name),
    ]
    findings += [
        *_check_slope(chirp, limits, name),
        *_check_sampling_type_and_rate(chirp, limits, name),
    ]
    findings += [
        *_check_beat_frequency(chirp, limits, name),
        *_check_adc_buffer(radar, limits, name),
    ]
    findings += [*_check_adc_start(chirp, limits, name), *_check_ramp_duration(chirp, limits, name)]
    frames = [frame.for_frame(index) for index in range(frame.n_intervals)]
    findings += [
        *_check_idle_time(min(frames, key=lambda item: item.single_interval_s), limits, name)
    ]
    findings += [*_check_chirp_count(frame, limits, name)]
    findings += _check_frame_gap_and_period(
        max(frames, key=lambda item: item.single_interval_s), limits, name
    )
    if demo:
        findings += [
            *_check_demo_fft_points(chirp, limits, name),
            *_check_demo_chirp_count(frame, limits, name),
        ]
        findings += _check_demo_memory(radar, limits, name)
    return tuple(findings)


def demo_memory_bytes(radar: Radar) -> int:
    """Return the on-chip memory of a frame: range spectra of 16-bit I/Q, and one map.

    The range FFT has the next power of two of points, of which real samples fill half; the map
    has 16 bits a cell and the next power of two of velocities.
    """
    chirp, n_chirps = radar.frame.chirp, radar.frame.n_chirps
    n_points = _next_power_of_two(chirp.n_samples)
    n_bins = n_points if chirp.sampling == "complex" else n_points // 2
    return n_bins * (4 * n_chirps * radar.n_summed_maps + 2 * _next_power_of_two(n_chirps))


def _check_antenna_counts(radar: Radar, name: str, n_tx: int, n_rx: int) -> Iterator[Finding]:
    counts = (
        ("tx", "transmitters", len(radar.array.tx_m), n_tx),
        ("rx", "receivers", radar.array.n_rx, n_rx),
    )
    for side, noun, count, max_count in counts:
        if count > max_count:
            yield _error_finding(
                f"radar.array.{side}",
                value=f"{count} {noun}",
                expected=f"at most {max_count}: {name} has no more",
                fix=f"keep the {noun} that the board has",
            )


def _check_ramp_within_band(chirp: Chirp, limits: DeviceLimits, name: str) -> Iterator[Finding]:
    low_hz = chirp.start_frequency_hz
    high_hz = low_hz + chirp.ramp_bandwidth_hz
    if any(
        low <= low_hz * _TOLERANCE and high_hz <= high * _TOLERANCE for low, high in limits.bands_hz
    ):
        return
    bands = " or ".join(f"{low / 1e9:g} to {high / 1e9:g} GHz" for low, high in limits.bands_hz)
    yield _error_finding(
        "radar.frame.chirp.start_frequency",
        value=f"a ramp from {low_hz / 1e9:.6g} to {high_hz / 1e9:.6g} GHz",
        expected=f"all of it within {bands}: an oscillator of {name} goes no further",
        fix="move the start, or shorten or flatten the ramp",
    )


def _check_slope(chirp: Chirp, limits: DeviceLimits, name: str) -> Iterator[Finding]:
    max_slope = limits.max_slope_hz_per_s
    if max_slope is not None and chirp.slope_hz_per_s > max_slope * _TOLERANCE:
        yield _error_finding(
            "radar.frame.chirp.slope",
            value=f"{chirp.slope_hz_per_s / 1e12:.6g} MHz/us",
            expected=f"at most {max_slope / 1e12:.6g} MHz/us: the ramp of {name} is no steeper",
            fix="sweep the bandwidth in a longer ramp, or sweep less",
        )


def _check_sampling_type_and_rate(
    chirp: Chirp, limits: DeviceLimits, name: str
) -> Iterator[Finding]:
    rates_hz = {"complex": limits.max_complex_rate_hz, "real": limits.max_real_rate_hz}
    max_hz = rates_hz[chirp.sampling]
    if max_hz is None:
        other = "real" if chirp.sampling == "complex" else "complex"
        yield _error_finding(
            "radar.frame.chirp.sampling",
            value=chirp.sampling,
            expected=f"{other}: the receivers of {name} give no other samples",
            fix="take real samples, at twice the rate for the same range"
            if other == "real"
            else "take complex samples, at half the rate for the same range",
        )
        return
    rate_hz, min_hz = chirp.sample_rate_hz, limits.min_sample_rate_hz or 0.0
    setting, value = "radar.frame.chirp.sample_rate", f"{rate_hz / 1e6:.7g} MS/s"
    if not min_hz <= rate_hz * _TOLERANCE <= max_hz * _TOLERANCE**2:
        yield _error_finding(
            setting,
            value=value,
            expected=f"from {min_hz / 1e6:.4g} to {max_hz / 1e6:.4g} MS/s, {chirp.sampling}:"
            f" what the converter of {name} does",
            fix="change the slope as well, to keep the range",
        )
    elif limits.sample_clock_hz is not None:
        divider = round(limits.sample_clock_hz / rate_hz)
        nearest_hz = limits.sample_clock_hz / divider
        # Settings files of the vendor give whole hertz: 2352941 for 80 MHz / 34.
        if abs(nearest_hz - rate_hz) > 1.0:
            yield _error_finding(
                setting,
                value=value,
                expected=f"{limits.sample_clock_hz / 1e6:g} MHz over a whole number: {name}"
                " divides its clock",
                fix=f"take {nearest_hz / 1e6:.7g} MS/s, the clock over {divider}",
            )


def _check_beat_frequency(chirp: Chirp, limits: DeviceLimits, name: str) -> Iterator[Finding]:
    max_hz = limits.max_beat_frequency_hz
    beat_hz = USABLE_BAND * chirp.max_beat_frequency_hz
    if max_hz is not None and beat_hz > max_hz * _TOLERANCE:
        yield _error_finding(
            "radar.frame.chirp.sample_rate",
            value=f"a largest range of {chirp.range_m(beat_hz):.4g} m, at {USABLE_BAND:g} of the"
            f" sampled band, which beats at {beat_hz / 1e6:.4g} MHz",
            expected=f"beats of at most {max_hz / 1e6:.4g} MHz, {chirp.range_m(max_hz):.4g} m at"
            f" this slope: the filter of {name} ends there",
            fix="sample slower, or lower the slope to see as far",
        )


def _check_adc_buffer(radar: Radar, limits: DeviceLimits, name: str) -> Iterator[Finding]:
    max_bytes = limits.adc_buffer_bytes
    chirp, n_rx = radar.frame.chirp, radar.array.n_rx
    sample_bytes = limits.real_sample_bytes * (2 if chirp.sampling == "complex" else 1)
    chirp_bytes = chirp.n_samples * n_rx * sample_bytes
    if max_bytes is not None and chirp_bytes > max_bytes:
        yield _error_finding(
            "radar.frame.chirp.n_samples",
            value=f"{chirp.n_samples} samples of {n_rx} receivers, {chirp_bytes:.0f} bytes a chirp",
            expected=f"at most {max_bytes} bytes, {int(max_bytes / sample_bytes / n_rx)}"
            " samples: the converter"
            f" of {name} writes a chirp into a buffer of that size",
            fix="take fewer samples, or switch receivers off",
        )


def _check_adc_start(chirp: Chirp, limits: DeviceLimits, name: str) -> Iterator[Finding]:
    min_s = _minimum_of_highest_exceeded_threshold(limits.min_adc_start_s, chirp.slope_hz_per_s)
    value = f"{chirp.adc_start_s * 1e6:.5g} us"
    setting = "radar.frame.chirp.adc_start"
    if chirp.adc_start_s * _TOLERANCE < min_s:
        yield _error_finding(
            setting,
            value=value,
            expected=f"at least {min_s * 1e6:.4g} us at {chirp.slope_hz_per_s / 1e12:.4g} MHz/us:"
            f" the ramp of {name} is not straight before",
            fix="start sampling later",
        )
    yield from _check_time_below_counter_limit(
        setting,
        value=value,
        time_s=chirp.adc_start_s,
        max_s=limits.max_adc_start_s,
        name=name,
        fix="start sampling earlier, and the ramp later if it has to be",
    )


def _check_ramp_duration(chirp: Chirp, limits: DeviceLimits, name: str) -> Iterator[Finding]:
    min_s = chirp.adc_start_s + chirp.sampled_duration_s
    value = f"{chirp.ramp_duration_s * 1e6:.5g} us"
    setting = "radar.frame.chirp.ramp_duration"
    if chirp.ramp_duration_s * _TOLERANCE < min_s:
        yield _error_finding(
            setting,
            value=value,
            expected=f"at least {min_s * 1e6:.5g} us, the end of the last sample: the filter of"
            f" {name} needs the ramp until then",
            fix="lengthen the ramp, or take fewer samples",
        )
    yield from _check_time_below_counter_limit(
        setting,
        value=value,
        time_s=chirp.ramp_duration_s,
        max_s=limits.max_ramp_duration_s,
        name=name,
        fix="shorten the ramp; lengthen the interval to keep the velocity resolution",
    )


def _check_idle_time(frame: Frame, limits: DeviceLimits, name: str) -> Iterator[Finding]:
    chirp = frame.chirp
    idle_s = frame.single_interval_s - chirp.ramp_duration_s
    min_s = _minimum_of_highest_exceeded_threshold(limits.min_idle_s, chirp.ramp_bandwidth_hz)
    setting, value = "radar.frame.interval", f"{idle_s * 1e6:.5g} us from ramp to ramp"
    # An interval of 100 us is exact to 1e-14 us only: a fraction of it, not of the difference.
    tolerance_s = 1e-9 * frame.single_interval_s
    if idle_s < min_s - tolerance_s:
        yield _error_finding(
            setting,
            value=value,
            expected=f"at least {min_s * 1e6:.4g} us after a ramp of"
            f" {chirp.ramp_bandwidth_hz / 1e9:.4g} GHz: the oscillator of {name} has to return"
            " and settle",
            fix=f"lengthen the interval to {(chirp.ramp_duration_s + min_s) * 1e6:.5g} us",
        )
    yield from _check_time_below_counter_limit(
        setting,
        value=value,
        time_s=idle_s - tolerance_s,
        max_s=limits.max_idle_s,
        name=name,
        fix="shorten the interval, or send one chirp a frame",
    )


def _check_chirp_count(frame: Frame, limits: DeviceLimits, name: str) -> Iterator[Finding]:
    max_chirps = limits.max_chirps
    if max_chirps is not None and frame.n_chirps > max_chirps:
        yield _error_finding(
            "radar.frame.n_chirps",
            value=f"{frame.n_chirps} of each transmitter",
            expected=f"at most {max_chirps}: {name} repeats the chirps of a frame no more often",
            fix="send fewer in a frame, and more frames",
        )


def _check_demo_chirp_count(frame: Frame, limits: DeviceLimits, name: str) -> Iterator[Finding]:
    n_chirps = frame.n_chirps
    breaks_rule = {
        "any": False,
        "multiple of 4": n_chirps % 4 != 0,
        "power of two": n_chirps != _next_power_of_two(n_chirps),
    }
    if not breaks_rule[limits.chirp_count_rule] and n_chirps >= limits.min_chirps:
        return
    minimum = f", at least {limits.min_chirps}" if limits.min_chirps > 1 else ""
    yield _error_finding(
        "radar.frame.n_chirps",
        value=f"{n_chirps} of each transmitter",
        expected=f"a {limits.chirp_count_rule}{minimum}: the Doppler transform of the demo on"
        f" {name} takes no"
        " other number",
        fix="round it, or capture raw samples instead",
    )


def _check_demo_fft_points(chirp: Chirp, limits: DeviceLimits, name: str) -> Iterator[Finding]:
    max_points = limits.max_fft_points
    if max_points is not None and chirp.n_samples > max_points:
        yield _error_finding(
            "radar.frame.chirp.n_samples",
            value=f"{chirp.n_samples}",
            expected=f"at most {max_points}: the accelerator with which the demo on {name}"
            " transforms a"
            " chirp takes no more",
            fix="take fewer samples, or capture raw samples instead",
        )


def _check_demo_memory(radar: Radar, limits: DeviceLimits, name: str) -> Iterator[Finding]:
    max_bytes, frame_bytes = limits.cube_bytes, demo_memory_bytes(radar)
    if max_bytes is None or frame_bytes <= max_bytes:
        return
    chirp = radar.frame.chirp
    yield _error_finding(
        "radar.frame.n_chirps",
        value=f"a frame of {frame_bytes / 1024:.5g} kB: {radar.frame.n_chirps} chirps times"
        f" {radar.n_summed_maps} channels times {chirp.n_samples} samples, rounded up to"
        f" {_next_power_of_two(chirp.n_samples)}",
        expected=f"at most {max_bytes / 1024:.5g} kB: the demo on {name} keeps the range spectra"
        " of a"
        " frame and its map in that memory",
        fix="send fewer chirps, take fewer samples, use fewer antennas, or capture raw samples",
    )


def _check_frame_gap_and_period(frame: Frame, limits: DeviceLimits, name: str) -> Iterator[Finding]:
    period_s = frame.duration_s if frame.period_s is None else frame.period_s
    gap_s, min_s = period_s - frame.duration_s, limits.min_gap_s
    if min_s is not None and gap_s < min_s - 1e-9 * period_s:
        yield _error_finding(
            "radar.frame.period",
            value=f"{gap_s * 1e6:.4g} us between the frames",
            expected=f"at least {min_s * 1e6:.4g} us: {name} calibrates itself between frames",
            fix=f"give a period of {(frame.duration_s + min_s) * 1e3:.5g} ms or more",
        )
    yield from _check_time_below_counter_limit(
        "radar.frame.period",
        value=f"{period_s * 1e3:.5g} ms",
        time_s=period_s,
        max_s=limits.max_period_s,
        name=name,
        fix="start frames more often, or start each by software",
    )


def _minimum_of_highest_exceeded_threshold(
    thresholds_and_minima: tuple[tuple[float, float], ...], value: float
) -> float:
    """Return the minimum of the last step below a position; 0 without steps."""
    return max(
        (least for above, least in thresholds_and_minima if value > above * _TOLERANCE), default=0.0
    )


def _next_power_of_two(number: int) -> int:
    return 1 << math.ceil(math.log2(number)) if number > 1 else 1


def _check_time_below_counter_limit(
    setting: str, *, value: str, time_s: float, max_s: float | None, name: str, fix: str
) -> Iterator[Finding]:
    """Check a time against the largest value of a counter of the chip."""
    if max_s is None or time_s <= max_s * _TOLERANCE:
        return
    limit = f"{max_s * 1e6:.5g} us" if max_s < 1e-3 else f"{max_s * 1e3:.5g} ms"
    yield _error_finding(
        setting, value=value, expected=f"at most {limit}: {name} counts no further", fix=fix
    )


def _error_finding(setting: str, *, value: str, expected: str, fix: str) -> Finding:
    return Finding(level="error", setting=setting, value=value, expected=expected, fix=fix)
