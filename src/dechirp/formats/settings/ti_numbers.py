"""A radar in the numbers of a TI chip: antennas of its board, and times in its steps."""

import math
from collections.abc import Sequence
from dataclasses import replace

from dechirp.core.checks import Vector
from dechirp.core.errors import InvalidSetting
from dechirp.radar.array import Array
from dechirp.radar.devices.base import Device
from dechirp.radar.frame import Frame

# Times count in 10 ns, frame periods in 5 ns, rates in 1 kS/s: `Limits` of every TI chip.
_TIMES_PER_S, _PERIODS_PER_S, _RATE_HZ = 1e8, 2e8, 1e3
_APART_M = 10e-6  # positions that are the same: 1 degree of phase


def antennas_on(array: Array, of: Device) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Which antennas of a device those of an array are: transmitters, then receivers, from 0.

    All transmitters may lie elsewhere by one vector, and all receivers: that turns the phases
    of all echoes alike.

    Raises
    ------
    InvalidSetting
        If they are not, or if receivers come in another order than their samples.
    """
    tx = _places("Radar.array.tx_m", array.tx_m, of.tx_m, of)
    rx = _places("Radar.array.rx_m", array.rx_m, of.rx_m, of)
    if list(rx) != sorted(rx):
        raise InvalidSetting(
            "Radar.array.rx_m",
            got=f"receivers {', '.join(str(place + 1) for place in rx)} of {of.name}",
            need="in the order of the board, in which their samples come",
            fix="Sort them.",
        )
    return tx, rx


def mask(places: Sequence[int]) -> int:
    """A bit for each antenna, the lowest for the first."""
    return sum(1 << place for place in places)


def must_be_one_profile(frame: Frame) -> None:
    """Raise `InvalidSetting` unless chirps are alike, evenly spaced, of one transmitter each."""
    if frame.n_intervals > 1 or frame.modulation is not None:
        several = frame.n_intervals > 1
        raise InvalidSetting(
            "Frame.interval_s" if several else "Frame.modulation",
            got=f"a list of {frame.n_intervals}" if several else "ramps that differ",
            need="one profile, with one interval: no other is written as .cfg or .mmwave.json",
            fix="Write each as a configuration of its own, such as of radar.at(0)."
            if several
            else "Leave the modulation out, or set the chip up with another tool.",
        )
    if frame.turns is None:
        raise InvalidSetting(
            "Frame.multiplexing",
            got="one in which several transmitters send in a chirp",
            need="of kind tdm, or none: no other is written as .cfg or .mmwave.json",
            fix="Let the transmitters take turns, or set the chip up with another tool.",
        )


def in_steps(frame: Frame) -> Frame:
    """Frame of which the chip can count every time and rate; without a period, it has none."""
    chirp = frame.chirp
    rate_hz = round(chirp.sample_rate_hz / _RATE_HZ) * _RATE_HZ
    adc_start_s = round(chirp.adc_start_s * _TIMES_PER_S) / _TIMES_PER_S
    # The end of the ramp, and the period, are rounded up, so that all that was in them fits.
    last_sample_s = adc_start_s + (chirp.n_samples - 1) / rate_hz if rate_hz else 0.0
    ramp_s = _up(max(chirp.ramp_duration_s, last_sample_s), _TIMES_PER_S)
    idle_s = max(round((frame.only_interval_s - ramp_s) * _TIMES_PER_S), 0) / _TIMES_PER_S
    return replace(
        frame,
        chirp=replace(
            chirp, sample_rate_hz=rate_hz, adc_start_s=adc_start_s, ramp_duration_s=ramp_s
        ),
        interval_s=ramp_s + idle_s,
        period_s=None if frame.period_s is None else _up(frame.period_s, _PERIODS_PER_S),
    )


def decimal(number: float, digits: int) -> str:
    """Fixed point, rounded up: what was a step of the chip must not become the one below.

    The last digit is at most 1/50 of a step of the chip, for start and slope.
    """
    text = f"{math.ceil(number * 10**digits - 1e-4) / 10**digits:.{digits}f}"
    return text.rstrip("0").rstrip(".") if digits else text


def _places(
    where: str, used: Sequence[Vector], there: Sequence[Vector], of: Device
) -> tuple[int, ...]:
    """Place of each used antenna among those that are there, with the smallest shift of all."""
    shifts = (tuple(b - a for a, b in zip(used[0], one, strict=True)) for one in there)
    for shift in sorted(shifts, key=lambda shift: math.hypot(*shift)):
        moved = [tuple(a + b for a, b in zip(one, shift, strict=True)) for one in used]
        places = [
            next((n for n, one in enumerate(there) if math.dist(one, at) < _APART_M), -1)
            for at in moved
        ]
        if -1 not in places and len(set(places)) == len(places):
            return tuple(places)
    raise InvalidSetting(
        where,
        got="at positions that are not those of the board",
        need=f"some of those of {of.name}: "
        + ", ".join(f"({x * 1e3:.3g}, {y * 1e3:.3g}, {z * 1e3:.3g}) mm" for x, y, z in there),
        fix=f"Take the array from the device: device('{of.kind()}').part(tx_mask, rx_mask).",
    )


def _up(time_s: float, steps_per_s: float) -> float:
    """Round up, but not for the sake of the last digits of a float."""
    return math.ceil(time_s * steps_per_s - 1e-4) / steps_per_s
