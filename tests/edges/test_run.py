"""What a run says of itself: its link budget agrees with its map, its findings with its peaks."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.core.units import to_decibels
from dechirp.experiments import run as of_run


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("n_rx", [1, 8])
def test_the_budget_says_how_high_the_echo_stands_in_the_map(radar, n_rx, sampling):
    chirp = replace(radar.frame.chirp, sampling=sampling)
    array = dc.Array(rx_m=[(0, 0.0019 * k, 0) for k in range(n_rx)])
    radar = replace(radar, frame=replace(radar.frame, chirp=chirp), array=array)
    target = dc.Target(position_m=(21.3, 0, 0), velocity_m_per_s=(4.1, 0, 0), rcs_m2=10)
    scene = dc.Scene(targets=[target])
    scenario = dc.Scenario(radar=radar, scene=scene, seed=3)
    lines = {line.name: line.level_db for line in dc.run(scenario).budget}

    echo = dc.simulate(scene, radar, impairments=())
    noise = dc.simulate(dc.Scene(), radar, n_frames=4, seed=3)
    chain = dc.Chain()
    peak = float(dc.power_map(echo.isel(frame=0), radar, chain).max())
    level = np.mean([dc.power_map(noise.isel(frame=i), radar, chain).mean() for i in range(4)])

    # 32,768 cells or more, correlated over at most 4: the mean is known within 0.05 dB; the
    # echo walks over 0.06 of a bin in the frame, which blurs the peak by less than 0.01 dB.
    assert lines["SNR in the map"] == pytest.approx(float(to_decibels(peak / level)), abs=0.25)
    # PHYSICS 1.3 for one look; eight added looks need less of each.
    assert lines["SNR needed"] == pytest.approx({1: 13.183, 8: 5.96}[n_rx], abs=0.02)
    assert lines["margin"] == pytest.approx(lines["SNR in the map"] - lines["SNR needed"])


def test_a_run_tells_that_it_kept_only_the_strongest_peaks(radar):
    cfar = dc.Cfar(estimator=dc.cfar.CellAveraging(), offset=0.5)
    chain = dc.Chain(range_window="rectangular", cfar=cfar)
    scenario = dc.Scenario(radar=radar, scene=dc.Scene(), chain=chain, n_frames=2)
    (finding,) = dc.run(scenario).findings
    assert (finding.level, finding.setting) == ("warning", "chain.cfar")
    assert "in 2 frames" in finding.value


def test_what_else_is_warned_of_while_frames_are_processed_is_no_crowd(radar, monkeypatch):
    processor = of_run.FrameProcessor

    def warning(*arguments, **more):
        warnings.warn("divided by zero", RuntimeWarning, stacklevel=1)
        return processor(*arguments, **more)

    monkeypatch.setattr(of_run, "FrameProcessor", warning)
    with pytest.warns(RuntimeWarning, match="divided by zero"):
        found = dc.run(dc.Scenario(radar=radar, scene=dc.Scene()))
    assert found.findings == ()


def test_what_surprises_an_impairment_is_said_once_as_a_finding_of_the_run(radar):
    # A warning beside it would be an error here.
    far_off = dc.impairments.Interferer(
        name="far off",
        start_frequency_hz=60e9,
        slope_hz_per_s=1e12,
        ramp_duration_s=1e-5,
        interval_s=1e-5,
        transmit_power_w=0.01,
        antenna_gain=1.0,
        position_m=(30, 0, 0),
    )
    impairments = [
        dc.impairments.ThermalNoise(),
        dc.impairments.Interference(interferers=[far_off]),
    ]
    scenario = dc.Scenario(radar=radar, scene=dc.Scene(), impairments=impairments)
    (finding,) = dc.run(scenario).findings
    assert finding.setting == "impairments.interference.interferers.far off"


@pytest.mark.parametrize(
    "wrong", [dc.impairments.ThermalNoise(), [dc.impairments.ThermalNoise], "thermal-noise"]
)
def test_impairments_are_a_list_of_them(radar, wrong):
    with pytest.raises(dc.InvalidSetting, match=r"Scenario\.impairments"):
        dc.Scenario(radar=radar, scene=dc.Scene(), impairments=wrong)


def test_a_run_says_how_far_it_is_while_it_simulates_and_while_it_processes(radar):
    scene = dc.Scene(targets=[dc.Target(position_m=(20, 0, 0))])
    told = []
    dc.run(dc.Scenario(radar=radar, scene=scene, n_frames=2), progress=lambda *n: told.append(n))
    assert told == [(1, 4), (2, 4), (3, 4), (4, 4)]
