"""Sinusoidal ramp nonlinearity: level and delay dependence of paired echoes."""

import numpy as np
import pytest
from scipy.special import j0, j1

import dechirp as dc
from dechirp.core.errors import InvalidSetting
from dechirp.core.units import SPEED_OF_LIGHT, to_decibels
from dechirp.simulation.impairments.sweep_nonlinearity import SinusoidalNonlinearity

BIN_HZ = 10e6 / 256


def measure_paired_echoes_db(radar, ranges_m, ripple, *, bins):
    """Return the levels of the paired echoes below and above each echo in dB."""
    cubes = [
        dc.simulate(
            dc.Scene(targets=[dc.Target(position_m=(r, 0, 0)) for r in ranges_m]),
            radar,
            impairments=impairments,
            dtype=np.complex128,
        ).values[0, 0, 0]
        for impairments in ((), [ripple])
    ]
    levels = []
    for r in ranges_m:
        beat_hz = radar.frame.chirp.beat_frequency_hz(r)
        frequencies_hz = [beat_hz + k * BIN_HZ for k in (-bins, 0, bins)]
        times_s = np.arange(256) / 10e6
        tones = np.exp(-2j * np.pi * np.multiply.outer(frequencies_hz, times_s)) * np.hanning(256)
        # Other echoes leak slightly, with and without the ripple.
        low, carrier, high = abs(tones @ (cubes[1] - [0, 1][bins == 0] * cubes[0]))
        levels.append((2 * to_decibels(low / carrier), 2 * to_decibels(high / carrier)))
    return levels


@pytest.mark.parametrize("range_m", [3.0, 20.0, 60.0])
@pytest.mark.parametrize(("deviation_hz", "bins"), [(20e3, 24), (300e3, 40)])
def test_paired_echo_level_matches_bessel_ratio(radar, range_m, deviation_hz, bins):
    rate_hz = bins * BIN_HZ
    ripple = SinusoidalNonlinearity(deviation_hz=deviation_hz, rate_hz=rate_hz, start_phase_rad=1)

    ((below_db, above_db),) = measure_paired_echoes_db(radar, [range_m], ripple, bins=bins)

    delay_s = 2 * range_m / SPEED_OF_LIGHT
    beta = 2 * deviation_hz / rate_hz * np.sin(np.pi * rate_hz * delay_s)
    expected_db = 2 * to_decibels(abs(j1(beta) / j0(beta)))
    # The receiver passes beats from 0 to 10 MHz; a line beyond does not alias into them.
    beat_hz = radar.frame.chirp.beat_frequency_hz(range_m)
    for level_db, line_hz in ((below_db, beat_hz - rate_hz), (above_db, beat_hz + rate_hz)):
        if 0 < line_hz < 10e6:
            assert level_db == pytest.approx(expected_db, abs=0.2)
        else:
            assert level_db < expected_db - 15


def test_paired_echoes_follow_delay_of_each_target(radar):
    ranges_m, bins = (6.0, 35.0, 62.0), 20
    ripple = SinusoidalNonlinearity(deviation_hz=60e3, rate_hz=bins * BIN_HZ)

    scene = dc.Scene(
        targets=[
            dc.Target(name=str(r), position_m=(r, 0, 0), rcs_m2=(r / 10) ** 4) for r in ranges_m
        ]
    )
    cube = dc.simulate(scene, radar, impairments=[ripple], dtype=np.complex128).values[0, 0, 0]
    times_s = radar.frame.chirp.adc_start_s + np.arange(256) / 10e6

    expected = 0
    for target in scene.targets:
        echo = dc.simulate(
            dc.Scene(targets=[target]), radar, impairments=(), dtype=np.complex128
        ).values[0, 0, 0]
        delay_s = 2 * target.position_m[0] / SPEED_OF_LIGHT
        beta = 2 * 60e3 / ripple.rate_hz * np.sin(np.pi * ripple.rate_hz * delay_s)
        modulation = np.cos(2 * np.pi * ripple.rate_hz * (times_s - delay_s / 2))
        expected = expected + echo * np.exp(1j * beta * modulation)

    # Paired echoes are 20 to 40 dB below the echoes and accurate to 0.1 dB.
    assert abs(cube - expected).max() < 5e-4 * abs(expected).max()


def test_rejects_rate_above_the_sample_rate(radar):
    with pytest.raises(InvalidSetting, match=r"rate: 10 MHz; expected below 10 MHz"):
        SinusoidalNonlinearity(deviation_hz=1e3, rate_hz=10e6).check(None, radar)


@pytest.mark.parametrize(
    ("field", "invalid_value"),
    [("deviation_hz", -1.0), ("rate_hz", 0.0), ("start_phase_rad", np.nan)],
)
def test_rejects_invalid_ripple(field, invalid_value):
    with pytest.raises(InvalidSetting, match=field):
        SinusoidalNonlinearity(**{"deviation_hz": 1e3, "rate_hz": 1e6, field: invalid_value})
