"""Transfer of a design to the scenario, with rounded numbers."""

import math
from collections.abc import Callable
from dataclasses import replace

from dechirp.experiments.scenario import Scenario
from dechirp.radar.design.design import Design
from dechirp.radar.frame import Frame
from dechirp.studio.panels.arrays import replace_radar

_DIGITS = 6


def apply_design(scenario: Scenario, design: Design) -> Scenario:
    """Return the scenario with the waveform of a design and its own receivers.

    Only one transmitter is used: TDM would divide the unambiguous velocity. The frame period is
    kept if there is time.
    """
    radar, frame = scenario.radar, round_frame(design.radar.frame)
    if radar is None:
        return replace_radar(scenario, replace(design.radar, frame=frame))
    period_s = radar.frame.period_s
    if period_s is not None and period_s >= frame.duration_s:
        frame = replace(frame, period_s=period_s)
    array = replace(radar.array, tx_m=radar.array.tx_m[:1])
    chain = replace(scenario.chain, n_range_bins=None, n_velocity_bins=None)
    new_radar = replace(design.radar, frame=frame, array=array)
    return replace_radar(replace(scenario, chain=chain), new_radar)


def round_frame(frame: Frame) -> Frame:
    """Round the frame of a design to six digits; a crystal is stable to five.

    Numbers are rounded so that range cells do not become wider and the unambiguous velocity does
    not decrease. Velocity cells become wider by at most 2e-5 and the unambiguous range decreases
    by as much; a design has a margin of 10 %.
    """
    chirp = frame.chirp
    margin_s = max(0.0, chirp.ramp_duration_s - chirp.adc_start_s - chirp.sampled_duration_s)
    # 1e-6 shorter: a steeper ramp has a shorter wavelength in its middle.
    adc_start_s, ramp_s, interval_s = (
        _round_to_digits(chirp.adc_start_s, math.ceil),
        _round_to_digits(chirp.ramp_duration_s * (1 - 1e-6), math.floor),
        _round_to_digits(frame.single_interval_s * (1 - 1e-6), math.floor),
    )
    rate_hz = _round_to_digits(chirp.n_samples / (ramp_s - adc_start_s - margin_s), math.ceil)
    slope_hz_per_s = _round_to_digits(
        chirp.sampled_bandwidth_hz * rate_hz / chirp.n_samples, math.ceil
    )
    rounded_chirp = replace(
        chirp,
        adc_start_s=adc_start_s,
        ramp_duration_s=ramp_s,
        sample_rate_hz=rate_hz,
        slope_hz_per_s=slope_hz_per_s,
    )
    return replace(frame, chirp=rounded_chirp, interval_s=interval_s)


def _round_to_digits(number: float, rounding: Callable[[float], int]) -> float:
    """Round to six digits, up or down; numbers with fewer digits stay unchanged."""
    if not number:
        return number
    unit = 10.0 ** (math.floor(math.log10(number)) + 1 - _DIGITS)
    nearest = round(number / unit)
    digits = (
        nearest if math.isclose(nearest, number / unit, rel_tol=1e-12) else rounding(number / unit)
    )
    return float(f"{digits * unit:.{_DIGITS}g}")
