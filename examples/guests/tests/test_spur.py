"""Spur plug-in: samples, power, apparent target and validation."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from dechirp_guests.spur import Spur

import dechirp as dc

C = 299_792_458.0
SPUR = Spur(frequency_hz=4.009e6, power_w=1e-12)
SCENARIO = Path(__file__).parents[1] / "spur.yaml"
EMPTY = dc.Scene(targets=[])


def test_spur_is_phase_continuous_tone(radar):
    cube = dc.simulate(EMPTY, radar, impairments=[SPUR], n_frames=2, seed=1)
    t_s = np.arange(64)[:, None] * 35e-6 + np.arange(256) / 10e6
    tone = 1e-6 * np.exp(2j * np.pi * 4.009e6 * t_s)

    for frame in cube.values:
        phasors = frame / tone[:, None]
        assert abs(phasors - phasors.flat[0]).max() < 1e-5  # one phase, in both receivers
        assert abs(phasors.flat[0]) == pytest.approx(1, abs=1e-5)


def test_real_samples_have_the_same_power(radar):
    real = replace(radar, frame=replace(radar.frame, chirp=_real(radar.frame.chirp)))
    cube = dc.simulate(EMPTY, real, impairments=[SPUR], seed=1)
    assert not np.iscomplexobj(cube.values)
    assert float((cube**2).mean()) == pytest.approx(1e-12, rel=1e-2)


def test_spur_appears_as_false_target_at_predicted_range_and_velocity():
    scenario = dc.load(SCENARIO)
    detections = dc.run(scenario).detections.sortby("range")
    frame = scenario.radar.frame
    doppler_hz = 4.009e6 - round(4.009e6 * 35e-6) / 35e-6
    velocity_m_per_s = doppler_hz * frame.chirp.wavelength_m / 2
    range_m = (4.009e6 - doppler_hz) * C / (2 * 20e12)

    expected_values = {"range": [range_m, 50.0], "velocity": [velocity_m_per_s, -8.0]}
    for name, expected in expected_values.items():
        tolerance = 5 * float(detections[f"{name}_std"].max())
        assert detections[name].values == pytest.approx(expected, abs=tolerance)


def test_rejects_frequency_beyond_filter_by_setting_name(radar):
    with pytest.raises(dc.InvalidSetting, match=r"frequency: 12 MHz; expected at most 10 MHz"):
        dc.simulate(EMPTY, radar, impairments=[replace(SPUR, frequency_hz=12e6)])
    with pytest.raises(dc.InvalidSetting, match="power_w"):
        replace(SPUR, power_w=-1.0)
    with pytest.raises(dc.DechirpError, match=r"impairments.spur.frequency: 12 MHz"):
        dc.load(SCENARIO, ["impairments.spur.frequency=12MHz"])


def _real(chirp):
    return replace(chirp, sampling="real")
