"""A design that is taken: its waveform, in numbers that can be read and typed, and the array."""

import math
from collections.abc import Callable
from dataclasses import replace

from dechirp.experiment.scenario import Scenario
from dechirp.radar.design import Design
from dechirp.radar.frame import Frame
from dechirp.studio.panels.arrays import with_radar

_DIGITS = 6


def with_design(scenario: Scenario, made: Design) -> Scenario:
    """A scenario with the waveform of a design, and the receivers that it had.

    One transmitter sends, for several that take turns would divide the largest velocity. Frames
    come as often as before where there is time.
    """
    radar, frame = scenario.radar, readable(made.radar.frame)
    if radar is None:
        return with_radar(scenario, replace(made.radar, frame=frame))
    period_s = radar.frame.period_s
    if period_s is not None and period_s >= frame.duration_s:
        frame = replace(frame, period_s=period_s)
    array = replace(radar.array, tx_m=radar.array.tx_m[:1])
    chain = replace(scenario.chain, n_range_bins=None, n_velocity_bins=None)
    taken = replace(made.radar, frame=frame, array=array)
    return with_radar(replace(scenario, chain=chain), taken)


def readable(frame: Frame) -> Frame:
    """A frame of a design in numbers of six digits: a crystal keeps five.

    Range cells become no wider for it, and velocities fold no sooner: each number is rounded to
    that side. Velocity cells become wider by 2e-5 at most, and ranges alias as much sooner: a
    design has a tenth of them to spare.
    """
    chirp = frame.chirp
    after_s = max(0.0, chirp.ramp_duration_s - chirp.adc_start_s - chirp.sampled_duration_s)
    # 1e-6 shorter, for a steeper ramp has a shorter wavelength in its middle.
    adc_start_s, ramp_s, interval_s = (
        _rounded(chirp.adc_start_s, math.ceil),
        _rounded(chirp.ramp_duration_s * (1 - 1e-6), math.floor),
        _rounded(frame.only_interval_s * (1 - 1e-6), math.floor),
    )
    rate_hz = _rounded(chirp.n_samples / (ramp_s - adc_start_s - after_s), math.ceil)
    slope_hz_per_s = _rounded(chirp.sampled_bandwidth_hz * rate_hz / chirp.n_samples, math.ceil)
    made = replace(
        chirp,
        adc_start_s=adc_start_s,
        ramp_duration_s=ramp_s,
        sample_rate_hz=rate_hz,
        slope_hz_per_s=slope_hz_per_s,
    )
    return replace(frame, chirp=made, interval_s=interval_s)


def _rounded(number: float, whole: Callable[[float], int]) -> float:
    """To so many digits, up or down; what has no more stays."""
    if not number:
        return number
    last = 10.0 ** (math.floor(math.log10(number)) + 1 - _DIGITS)
    near = round(number / last)
    digits = near if math.isclose(near, number / last, rel_tol=1e-12) else whole(number / last)
    return float(f"{digits * last:.{_DIGITS}g}")
