"""Conversion of a radar to the numbers of a TI chip: antennas of its board, times in its steps."""

import math
from collections.abc import Sequence
from dataclasses import replace

from dechirp.core.checks import Vector
from dechirp.core.errors import InvalidSetting
from dechirp.core.text import format_si
from dechirp.radar.array import Array
from dechirp.radar.devices.base import Device
from dechirp.radar.frame import Frame

# Times count in 10 ns, frame periods in 5 ns, rates in 1 kS/s: `Limits` of every TI chip.
_TIMES_PER_S, _PERIODS_PER_S, _RATE_HZ = 1e8, 2e8, 1e3
_APART_M = 10e-6  # tolerance of equal positions: 1 degree of phase


def match_antennas_to_device(
    array: Array, device: Device
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the indices of transmitters and receivers of a device that match an array, from 0.

    All transmitters, and all receivers, may be shifted by a common vector, which changes the phases
    of all echoes alike.

    Raises
    ------
    InvalidSetting
        If the positions do not match, or the receivers are in another order than their samples.
    """
    tx = _match_positions_up_to_shift("Radar.array.tx_m", array.tx_m, device.tx_m, device)
    rx = _match_positions_up_to_shift("Radar.array.rx_m", array.rx_m, device.rx_m, device)
    if list(rx) != sorted(rx):
        raise InvalidSetting(
            "Radar.array.rx_m",
            value=f"receivers {', '.join(str(place + 1) for place in rx)} of {device.name}",
            expected="the order of the board, which is that of the samples",
            fix="sort them",
        )
    return tx, rx


def indices_to_bit_mask(indices: Sequence[int]) -> int:
    """Return the mask of antenna indices, the lowest bit for the first."""
    return sum(1 << place for place in indices)


def check_equal_tdm_chirps(frame: Frame) -> None:
    """Raise `InvalidSetting` unless chirps are equal, evenly spaced, of one transmitter each."""
    if frame.n_intervals > 1 or frame.modulation is not None:
        has_intervals = frame.n_intervals > 1
        raise InvalidSetting(
            "Frame.interval_s" if has_intervals else "Frame.modulation",
            value=f"a list of {frame.n_intervals}" if has_intervals else "ramps that differ",
            expected="one profile with one interval, as .cfg and .mmwave.json require",
            fix="write a separate configuration for each, such as of radar.for_frame(0)"
            if has_intervals
            else "leave the modulation out, or set the chip up with another tool",
        )
    if frame.tdm_order is None:
        raise InvalidSetting(
            "Frame.multiplexing",
            value="several transmitters in a chirp",
            expected="kind tdm, or none, as .cfg and .mmwave.json require",
            fix="let the transmitters take turns, or set the chip up with another tool",
        )

    if frame.multiplexing is not None and frame.multiplexing.round_pause_s:
        raise InvalidSetting(
            "Frame.multiplexing",
            value=f"a pause of {format_si(frame.multiplexing.round_pause_s, 's')} after each round",
            expected="evenly spaced chirps, as this package writes .cfg and .mmwave.json",
            fix="write another format, such as .h5",
        )


def round_to_chip_steps(frame: Frame) -> Frame:
    """Round the times and rates of a frame to steps of the chip; a missing period stays missing."""
    chirp = frame.chirp
    rate_hz = round(chirp.sample_rate_hz / _RATE_HZ) * _RATE_HZ
    adc_start_s = round(chirp.adc_start_s * _TIMES_PER_S) / _TIMES_PER_S
    # The end of the ramp and the period are rounded up, so that their content still fits.
    last_sample_s = adc_start_s + (chirp.n_samples - 1) / rate_hz if rate_hz else 0.0
    ramp_s = _round_up_to_step(max(chirp.ramp_duration_s, last_sample_s), _TIMES_PER_S)
    idle_s = max(round((frame.single_interval_s - ramp_s) * _TIMES_PER_S), 0) / _TIMES_PER_S
    return replace(
        frame,
        chirp=replace(
            chirp, sample_rate_hz=rate_hz, adc_start_s=adc_start_s, ramp_duration_s=ramp_s
        ),
        interval_s=ramp_s + idle_s,
        period_s=None
        if frame.period_s is None
        else _round_up_to_step(frame.period_s, _PERIODS_PER_S),
    )


def format_decimal_rounded_up(number: float, digits: int) -> str:
    """Format a number in fixed point, rounded up so that no step of the chip becomes the one below.

    The last digit is at most 1/50 of a step of the chip, for start and slope.
    """
    text = f"{math.ceil(number * 10**digits - 1e-4) / 10**digits:.{digits}f}"
    return text.rstrip("0").rstrip(".") if digits else text


def _match_positions_up_to_shift(
    setting: str, used: Sequence[Vector], available: Sequence[Vector], device: Device
) -> tuple[int, ...]:
    """Return the index of each used antenna among the available ones.

    Of several common shifts of all antennas, the smallest is used.
    """
    shifts = (
        tuple(b - a for a, b in zip(used[0], position, strict=True)) for position in available
    )
    for shift in sorted(shifts, key=lambda shift: math.hypot(*shift)):
        shifted = [tuple(a + b for a, b in zip(position, shift, strict=True)) for position in used]
        places = [
            next(
                (
                    n
                    for n, position in enumerate(available)
                    if math.dist(position, target) < _APART_M
                ),
                -1,
            )
            for target in shifted
        ]
        if -1 not in places and len(set(places)) == len(places):
            return tuple(places)
    raise InvalidSetting(
        setting,
        value="positions that differ from those of the board",
        expected=f"positions of {device.name}: "
        + ", ".join(f"({x * 1e3:.3g}, {y * 1e3:.3g}, {z * 1e3:.3g}) mm" for x, y, z in available),
        fix=f"take the array from the device: device('{device.kind()}').part(tx_mask, rx_mask)",
    )


def _round_up_to_step(time_s: float, steps_per_s: float) -> float:
    """Round up to a step, tolerating floating-point error."""
    return math.ceil(time_s * steps_per_s - 1e-4) / steps_per_s
