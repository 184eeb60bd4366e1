"""The tone is what its formula says, and shows where its docstring says."""

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


def test_it_is_a_tone_that_runs_on_from_chirp_to_chirp(radar):
    cube = dc.simulate(EMPTY, radar, impairments=[SPUR], n_frames=2, seed=1)
    t_s = np.arange(64)[:, None] * 35e-6 + np.arange(256) / 10e6
    tone = 1e-6 * np.exp(2j * np.pi * 4.009e6 * t_s)

    for frame in cube.values:
        turned = frame / tone[:, None]
        assert abs(turned - turned.flat[0]).max() < 1e-5  # one phase, in both receivers
        assert abs(turned.flat[0]) == pytest.approx(1, abs=1e-5)


def test_real_samples_have_the_same_power(radar):
    real = replace(radar, frame=replace(radar.frame, chirp=_real(radar.frame.chirp)))
    cube = dc.simulate(EMPTY, real, impairments=[SPUR], seed=1)
    assert not np.iscomplexobj(cube.values)
    assert float((cube**2).mean()) == pytest.approx(1e-12, rel=1e-2)


def test_a_scenario_that_has_it_has_a_detection_without_a_target():
    scenario = dc.load(SCENARIO)
    found = dc.run(scenario).detections.sortby("range")
    frame = scenario.radar.frame
    doppler_hz = 4.009e6 - round(4.009e6 * 35e-6) / 35e-6
    velocity_m_per_s = doppler_hz * frame.chirp.wavelength_m / 2
    range_m = (4.009e6 - doppler_hz) * C / (2 * 20e12)

    at = {"range": [range_m, 50.0], "velocity": [velocity_m_per_s, -8.0]}
    for name, expected in at.items():
        within = 5 * float(found[f"{name}_std"].max())
        assert found[name].values == pytest.approx(expected, abs=within)


def test_what_a_filter_would_take_out_is_refused_by_the_name_that_settings_have(radar):
    with pytest.raises(dc.InvalidSetting, match=r"frequency: 12 MHz; expected at most 10 MHz"):
        dc.simulate(EMPTY, radar, impairments=[replace(SPUR, frequency_hz=12e6)])
    with pytest.raises(dc.InvalidSetting, match="power_w"):
        replace(SPUR, power_w=-1.0)
    with pytest.raises(dc.DechirpError, match=r"impairments.spur.frequency: 12 MHz"):
        dc.load(SCENARIO, ["impairments.spur.frequency=12MHz"])


def _real(chirp):
    return replace(chirp, sampling="real")
