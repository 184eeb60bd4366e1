"""The rules of a device, one function a rule: what a radar breaks, and why it matters."""

import math
from collections.abc import Iterator

from dechirp.core.findings import Finding
from dechirp.radar.chirp import Chirp
from dechirp.radar.devices.limits import Limits
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar

# Share of the sampled band in which the filter of the converter is flat: TI's rates of
# 6.25, 12.5 and 18.75 MS/s belong to filters of 5, 10 and 15 MHz.
USABLE_BAND = 0.8
_ROUNDING = 1 + 1e-9


def broken_rules(
    radar: Radar, limits: Limits, *, name: str, n_tx: int, n_rx: int, demo: bool
) -> tuple[Finding, ...]:
    """Every rule that a radar breaks on the device of that name, in the order of its settings."""
    frame, chirp = radar.frame, radar.frame.chirp
    found = [*_antennas(radar, name, n_tx, n_rx), *_band(chirp, limits, name)]
    found += [*_slope(chirp, limits, name), *_sampling(chirp, limits, name)]
    found += [*_beat_frequency(chirp, limits, name), *_buffer(radar, limits, name)]
    found += [*_adc_start(chirp, limits, name), *_ramp_end(chirp, limits, name)]
    each = [frame.at(index) for index in range(frame.n_intervals)]
    found += [*_idle(min(each, key=lambda one: one.only_interval_s), limits, name)]
    found += [*_count(frame, limits, name)]
    found += _gap(max(each, key=lambda one: one.only_interval_s), limits, name)
    if demo:
        found += [*_points(chirp, limits, name), *_demo_count(frame, limits, name)]
        found += _memory(radar, limits, name)
    return tuple(found)


def memory_bytes(radar: Radar) -> int:
    """Memory that a frame takes on the chip: range spectra of 16-bit I/Q, and one map.

    The transform over samples has the next power of two of points, of which real samples
    fill half; the map has 16 bits a cell and the next power of two of velocities.
    """
    chirp, n_chirps = radar.frame.chirp, radar.frame.n_chirps
    n_points = _power_of_two(chirp.n_samples)
    n_bins = n_points if chirp.sampling == "complex" else n_points // 2
    return n_bins * (4 * n_chirps * radar.n_summed + 2 * _power_of_two(n_chirps))


def _antennas(radar: Radar, name: str, n_tx: int, n_rx: int) -> Iterator[Finding]:
    counts = (
        ("tx", "transmitters", len(radar.array.tx_m), n_tx),
        ("rx", "receivers", radar.array.n_rx, n_rx),
    )
    for side, what, got, most in counts:
        if got > most:
            yield _error(
                f"radar.array.{side}",
                got=f"{got} {what}",
                need=f"at most {most}: {name} has no more",
                fix=f"Keep the {what} that the board has.",
            )


def _band(chirp: Chirp, limits: Limits, name: str) -> Iterator[Finding]:
    low_hz = chirp.start_frequency_hz
    high_hz = low_hz + chirp.ramp_bandwidth_hz
    if any(
        low <= low_hz * _ROUNDING and high_hz <= high * _ROUNDING for low, high in limits.bands_hz
    ):
        return
    bands = " or ".join(f"{low / 1e9:g} to {high / 1e9:g} GHz" for low, high in limits.bands_hz)
    yield _error(
        "radar.frame.chirp.start_frequency",
        got=f"a ramp from {low_hz / 1e9:.6g} to {high_hz / 1e9:.6g} GHz",
        need=f"all of it within {bands}: an oscillator of {name} goes no further",
        fix="Move the start, or shorten or flatten the ramp.",
    )


def _slope(chirp: Chirp, limits: Limits, name: str) -> Iterator[Finding]:
    most = limits.max_slope_hz_per_s
    if most is not None and chirp.slope_hz_per_s > most * _ROUNDING:
        yield _error(
            "radar.frame.chirp.slope",
            got=f"{chirp.slope_hz_per_s / 1e12:.6g} MHz/us",
            need=f"at most {most / 1e12:.6g} MHz/us: the ramp of {name} is no steeper",
            fix="Sweep the bandwidth in a longer ramp, or sweep less.",
        )


def _sampling(chirp: Chirp, limits: Limits, name: str) -> Iterator[Finding]:
    rates_hz = {"complex": limits.max_complex_rate_hz, "real": limits.max_real_rate_hz}
    most_hz = rates_hz[chirp.sampling]
    if most_hz is None:
        other = "real" if chirp.sampling == "complex" else "complex"
        yield _error(
            "radar.frame.chirp.sampling",
            got=chirp.sampling,
            need=f"{other}: the receivers of {name} give no other samples",
            fix="Take real samples, at twice the rate for the same range."
            if other == "real"
            else "Take complex samples, at half the rate for the same range.",
        )
        return
    rate_hz, least_hz = chirp.sample_rate_hz, limits.min_sample_rate_hz or 0.0
    setting, got = "radar.frame.chirp.sample_rate", f"{rate_hz / 1e6:.7g} MS/s"
    if not least_hz <= rate_hz * _ROUNDING <= most_hz * _ROUNDING**2:
        yield _error(
            setting,
            got=got,
            need=f"from {least_hz / 1e6:.4g} to {most_hz / 1e6:.4g} MS/s, {chirp.sampling}:"
            f" what the converter of {name} does",
            fix="Change the slope as well, to keep the range.",
        )
    elif limits.sample_clock_hz is not None:
        divider = round(limits.sample_clock_hz / rate_hz)
        nearest_hz = limits.sample_clock_hz / divider
        # Settings files of the vendor give whole hertz: 2352941 for 80 MHz / 34.
        if abs(nearest_hz - rate_hz) > 1.0:
            yield _error(
                setting,
                got=got,
                need=f"{limits.sample_clock_hz / 1e6:g} MHz over a whole number: {name}"
                " divides its clock",
                fix=f"Take {nearest_hz / 1e6:.7g} MS/s, the clock over {divider}.",
            )


def _beat_frequency(chirp: Chirp, limits: Limits, name: str) -> Iterator[Finding]:
    most_hz = limits.max_beat_frequency_hz
    got_hz = USABLE_BAND * chirp.max_beat_frequency_hz
    if most_hz is not None and got_hz > most_hz * _ROUNDING:
        yield _error(
            "radar.frame.chirp.sample_rate",
            got=f"a largest range of {chirp.range_m(got_hz):.4g} m, at {USABLE_BAND:g} of the"
            f" sampled band, which beats at {got_hz / 1e6:.4g} MHz",
            need=f"beats of at most {most_hz / 1e6:.4g} MHz, {chirp.range_m(most_hz):.4g} m at"
            f" this slope: the filter of {name} ends there",
            fix="Sample slower, or lower the slope to see as far.",
        )


def _buffer(radar: Radar, limits: Limits, name: str) -> Iterator[Finding]:
    most = limits.adc_buffer_bytes
    chirp, n_rx = radar.frame.chirp, radar.array.n_rx
    per_sample = limits.real_sample_bytes * (2 if chirp.sampling == "complex" else 1)
    got = chirp.n_samples * n_rx * per_sample
    if most is not None and got > most:
        yield _error(
            "radar.frame.chirp.n_samples",
            got=f"{chirp.n_samples} samples of {n_rx} receivers, {got:.0f} bytes a chirp",
            need=f"at most {most} bytes, {int(most / per_sample / n_rx)} samples: the converter"
            f" of {name} writes a chirp into a buffer of that size",
            fix="Take fewer samples, or switch receivers off.",
        )


def _adc_start(chirp: Chirp, limits: Limits, name: str) -> Iterator[Finding]:
    least_s = _step(limits.min_adc_start_s, chirp.slope_hz_per_s)
    got = f"{chirp.adc_start_s * 1e6:.5g} us"
    setting = "radar.frame.chirp.adc_start"
    if chirp.adc_start_s * _ROUNDING < least_s:
        yield _error(
            setting,
            got=got,
            need=f"at least {least_s * 1e6:.4g} us at {chirp.slope_hz_per_s / 1e12:.4g} MHz/us:"
            f" the ramp of {name} is not straight before",
            fix="Start sampling later.",
        )
    yield from _counted(
        setting,
        got=got,
        time_s=chirp.adc_start_s,
        most_s=limits.max_adc_start_s,
        name=name,
        fix="Start sampling earlier, and the ramp later if it has to be.",
    )


def _ramp_end(chirp: Chirp, limits: Limits, name: str) -> Iterator[Finding]:
    least_s = chirp.adc_start_s + chirp.sampled_duration_s
    got = f"{chirp.ramp_duration_s * 1e6:.5g} us"
    setting = "radar.frame.chirp.ramp_duration"
    if chirp.ramp_duration_s * _ROUNDING < least_s:
        yield _error(
            setting,
            got=got,
            need=f"at least {least_s * 1e6:.5g} us, the end of the last sample: the filter of"
            f" {name} needs the ramp until then",
            fix="Lengthen the ramp, or take fewer samples.",
        )
    yield from _counted(
        setting,
        got=got,
        time_s=chirp.ramp_duration_s,
        most_s=limits.max_ramp_duration_s,
        name=name,
        fix="Shorten the ramp; lengthen the interval to keep the velocity resolution.",
    )


def _idle(frame: Frame, limits: Limits, name: str) -> Iterator[Finding]:
    chirp = frame.chirp
    idle_s = frame.only_interval_s - chirp.ramp_duration_s
    least_s = _step(limits.min_idle_s, chirp.ramp_bandwidth_hz)
    setting, got = "radar.frame.interval", f"{idle_s * 1e6:.5g} us from ramp to ramp"
    # An interval of 100 us is exact to 1e-14 us only: a fraction of it, not of the difference.
    slack_s = 1e-9 * frame.only_interval_s
    if idle_s < least_s - slack_s:
        yield _error(
            setting,
            got=got,
            need=f"at least {least_s * 1e6:.4g} us after a ramp of"
            f" {chirp.ramp_bandwidth_hz / 1e9:.4g} GHz: the oscillator of {name} has to return"
            " and settle",
            fix=f"Lengthen the interval to {(chirp.ramp_duration_s + least_s) * 1e6:.5g} us.",
        )
    yield from _counted(
        setting,
        got=got,
        time_s=idle_s - slack_s,
        most_s=limits.max_idle_s,
        name=name,
        fix="Shorten the interval, or send one chirp a frame.",
    )


def _count(frame: Frame, limits: Limits, name: str) -> Iterator[Finding]:
    most = limits.max_chirps
    if most is not None and frame.n_chirps > most:
        yield _error(
            "radar.frame.n_chirps",
            got=f"{frame.n_chirps} of each transmitter",
            need=f"at most {most}: {name} repeats the chirps of a frame no more often",
            fix="Send fewer in a frame, and more frames.",
        )


def _demo_count(frame: Frame, limits: Limits, name: str) -> Iterator[Finding]:
    n_chirps = frame.n_chirps
    wrong = {
        "any": False,
        "multiple of 4": n_chirps % 4 != 0,
        "power of two": n_chirps != _power_of_two(n_chirps),
    }
    if not wrong[limits.chirps] and n_chirps >= limits.min_chirps:
        return
    least = f", at least {limits.min_chirps}" if limits.min_chirps > 1 else ""
    yield _error(
        "radar.frame.n_chirps",
        got=f"{n_chirps} of each transmitter",
        need=f"a {limits.chirps}{least}: the Doppler transform of the demo on {name} takes no"
        " other number",
        fix="Round it, or capture raw samples instead.",
    )


def _points(chirp: Chirp, limits: Limits, name: str) -> Iterator[Finding]:
    most = limits.max_points
    if most is not None and chirp.n_samples > most:
        yield _error(
            "radar.frame.chirp.n_samples",
            got=f"{chirp.n_samples}",
            need=f"at most {most}: the accelerator with which the demo on {name} transforms a"
            " chirp takes no more",
            fix="Take fewer samples, or capture raw samples instead.",
        )


def _memory(radar: Radar, limits: Limits, name: str) -> Iterator[Finding]:
    most, got = limits.cube_bytes, memory_bytes(radar)
    if most is None or got <= most:
        return
    chirp = radar.frame.chirp
    yield _error(
        "radar.frame.n_chirps",
        got=f"a frame of {got / 1024:.5g} kB: {radar.frame.n_chirps} chirps times"
        f" {radar.n_summed} channels times {chirp.n_samples} samples, rounded up to"
        f" {_power_of_two(chirp.n_samples)}",
        need=f"at most {most / 1024:.5g} kB: the demo on {name} keeps the range spectra of a"
        " frame and its map in that memory",
        fix="Send fewer chirps, take fewer samples, use fewer antennas, or capture raw samples.",
    )


def _gap(frame: Frame, limits: Limits, name: str) -> Iterator[Finding]:
    period_s = frame.duration_s if frame.period_s is None else frame.period_s
    gap_s, least_s = period_s - frame.duration_s, limits.min_gap_s
    if least_s is not None and gap_s < least_s - 1e-9 * period_s:
        yield _error(
            "radar.frame.period",
            got=f"{gap_s * 1e6:.4g} us between the frames",
            need=f"at least {least_s * 1e6:.4g} us: {name} calibrates itself between frames",
            fix=f"Give a period of {(frame.duration_s + least_s) * 1e3:.5g} ms or more.",
        )
    yield from _counted(
        "radar.frame.period",
        got=f"{period_s * 1e3:.5g} ms",
        time_s=period_s,
        most_s=limits.max_period_s,
        name=name,
        fix="Start frames more often, or start each by software.",
    )


def _step(steps: tuple[tuple[float, float], ...], at: float) -> float:
    """What holds at a place: that of the last step below it, 0 without steps."""
    return max((least for above, least in steps if at > above * _ROUNDING), default=0.0)


def _power_of_two(number: int) -> int:
    return 1 << math.ceil(math.log2(number)) if number > 1 else 1


def _counted(
    setting: str, *, got: str, time_s: float, most_s: float | None, name: str, fix: str
) -> Iterator[Finding]:
    """A time for which the chip's counter is too short."""
    if most_s is None or time_s <= most_s * _ROUNDING:
        return
    most = f"{most_s * 1e6:.5g} us" if most_s < 1e-3 else f"{most_s * 1e3:.5g} ms"
    yield _error(setting, got=got, need=f"at most {most}: {name} counts no further", fix=fix)


def _error(setting: str, *, got: str, need: str, fix: str) -> Finding:
    return Finding(level="error", setting=setting, got=got, need=need, fix=fix)
