"""Link budget, findings and progress of a run."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.core.units import to_decibels
from dechirp.experiments import run as of_run
from nightly import nightly


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("n_rx", [1, 8])
def test_link_budget_matches_simulated_snr_of_map(radar, n_rx, sampling):
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

    # 32,768 cells or more, correlated over at most 4: the mean is known within 0.05 dB; range
    # migration is 0.06 of a bin in the frame, which lowers the peak by less than 0.01 dB.
    assert lines["SNR in the map"] == pytest.approx(float(to_decibels(peak / level)), abs=0.25)
    # PHYSICS 1.3 for a single map; eight summed maps need less SNR of each.
    assert lines["SNR needed"] == pytest.approx({1: 13.183, 8: 5.96}[n_rx], abs=0.02)
    assert lines["margin"] == pytest.approx(lines["SNR in the map"] - lines["SNR needed"])


@nightly
def test_run_reports_limit_on_number_of_peaks(radar):
    cfar = dc.Cfar(estimator=dc.cfar.CellAveraging(), offset=0.5)
    chain = dc.Chain(range_window="rectangular", cfar=cfar)
    scenario = dc.Scenario(radar=radar, scene=dc.Scene(), chain=chain, n_frames=2)
    result = dc.run(scenario)
    (finding,) = (finding for finding in result.findings if finding.setting == "chain.cfar")
    assert (finding.level, finding.setting) == ("warning", "chain.cfar")
    assert "in 2 frames" in finding.value


def test_other_warnings_during_processing_give_no_finding(radar, monkeypatch):
    processor = of_run.FrameProcessor

    def warn_and_process(*arguments, **options):
        warnings.warn("divided by zero", RuntimeWarning, stacklevel=1)
        return processor(*arguments, **options)

    monkeypatch.setattr(of_run, "FrameProcessor", warn_and_process)
    with pytest.warns(RuntimeWarning, match="divided by zero"):
        result = dc.run(dc.Scenario(radar=radar, scene=dc.Scene()))
    assert result.findings == ()


def test_impairment_warning_becomes_one_finding_of_run(radar):
    # An additional warning would be an error here.
    interferer = dc.impairments.Interferer(
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
        dc.impairments.Interference(interferers=[interferer]),
    ]
    scenario = dc.Scenario(radar=radar, scene=dc.Scene(), impairments=impairments)
    (finding,) = dc.run(scenario).findings
    assert finding.setting == "impairments.interference.interferers.far off"


@pytest.mark.parametrize(
    "wrong", [dc.impairments.ThermalNoise(), [dc.impairments.ThermalNoise], "thermal-noise"]
)
def test_rejects_impairments_that_are_no_list(radar, wrong):
    with pytest.raises(dc.InvalidSetting, match=r"Scenario\.impairments"):
        dc.Scenario(radar=radar, scene=dc.Scene(), impairments=wrong)


def test_progress_covers_simulation_and_processing(radar):
    scene = dc.Scene(targets=[dc.Target(position_m=(20, 0, 0))])
    progress_calls = []
    dc.run(
        dc.Scenario(radar=radar, scene=scene, n_frames=2),
        progress=lambda *n: progress_calls.append(n),
    )
    assert progress_calls == [(1, 4), (2, 4), (3, 4), (4, 4)]
