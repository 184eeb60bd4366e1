"""Static-target and leakage mitigation in the processing chain."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.processing.range_doppler_map import power_map, threshold_map

CHIRP = dc.Chirp(
    start_frequency_hz=77e9,
    slope_hz_per_s=20e12,
    adc_start_s=3e-6,
    ramp_duration_s=30e-6,
    sample_rate_hz=10e6,
    n_samples=256,
    sampling="complex",
)
RADAR = dc.Radar(
    frame=dc.Frame(chirp=CHIRP, n_chirps=64, interval_s=35e-6),
    array=dc.Array(tx_m=[(0, 0, 0)], rx_m=[(0, 0, 0)]),
    hardware=dc.Hardware(transmit_power_w=0.01, antenna_gain=10.0, noise_factor=10.0),
)
STOPPED_TARGET = dc.Target(name="stopped", position_m=(20, 0, 0), rcs_m2=1.0)
NEAR_TARGET = dc.Target(name="near", position_m=(5, 0, 0), rcs_m2=0.01)
MOVING_TARGET = dc.Target(
    name="moving", position_m=(30, 0, 0), velocity_m_per_s=(20, 0, 0), rcs_m2=1.0
)


def make_scenario(*methods, targets=(STOPPED_TARGET, NEAR_TARGET, MOVING_TARGET)) -> dc.Scenario:
    chain = dc.Chain(mitigation=methods)
    return dc.Scenario(radar=RADAR, scene=dc.Scene(targets=targets), chain=chain, seed=4)


def detected_ranges_m(result: dc.Result) -> list[int]:
    return sorted(result.detections.range.values.round().astype(int).tolist())


@pytest.mark.parametrize(
    ("method", "remaining_ranges_m"),
    [
        (dc.mitigation.MeanSubtraction(), [30]),
        (dc.mitigation.MovingTargetIndication(order=2), [30]),
        (dc.mitigation.LeakageSubtraction(max_range_m=10), [20, 30]),
    ],
)
def test_mitigation_removes_static_targets_and_reports_power(method, remaining_ranges_m):
    assert detected_ranges_m(dc.run(make_scenario())) == [5, 20, 30]
    result = dc.run(make_scenario(method))
    assert detected_ranges_m(result) == remaining_ranges_m
    findings = [str(finding) for finding in result.findings if method.kind() in finding.setting]
    assert any("removed power" in finding for finding in findings)  # removed power
    assert any("removal of static targets" in finding for finding in findings)


@pytest.mark.parametrize(
    "method", [dc.mitigation.MeanSubtraction(), dc.mitigation.MovingTargetIndication(order=1)]
)
def test_mitigation_keeps_snr_and_position_of_moving_target(method):
    [original] = (
        dc.run(make_scenario(targets=[MOVING_TARGET])).detections.to_dataframe().itertuples()
    )
    [filtered] = (
        dc.run(make_scenario(method, targets=[MOVING_TARGET]))
        .detections.to_dataframe()
        .itertuples()
    )
    # Both results share one noise realisation with different weights: four standard deviations at
    # 25 dB.
    assert filtered.range == pytest.approx(original.range, abs=4 * original.range_std)
    assert filtered.velocity == pytest.approx(original.velocity, abs=4 * original.velocity_std)
    # The canceller drops the first chirp, 0.07 dB; the mean over 60 seeds is -0.16 dB, each with
    # 0.09 dB.
    assert 10 * np.log10(filtered.snr / original.snr) == pytest.approx(0, abs=0.7)


def test_blind_velocities_are_not_searched():
    chain = dc.Chain(mitigation=[dc.mitigation.MovingTargetIndication(order=2)]).fit_to_radar(RADAR)
    cube = dc.simulate(dc.Scene(), RADAR, seed=5).isel(frame=0)
    power = power_map(cube, RADAR, chain)
    threshold = threshold_map(power, RADAR, chain)
    is_blind = np.isinf(threshold.values).all(axis=1)
    assert is_blind[32] and is_blind.sum() == 19  # of 64: |2 sin(pi f T)|^4 / 6 below 0.1
    # White noise has equal power in the other rows: means of 256 cells have 6 % standard error.
    level = power.values[~is_blind].mean(axis=1)
    assert np.all(abs(level / level.mean() - 1) < 0.36)
    assert not np.isinf(threshold.values[~is_blind]).any()


@pytest.mark.parametrize(
    "method", [dc.mitigation.MeanSubtraction(), dc.mitigation.LeakageSubtraction(max_range_m=60)]
)
def test_moving_target_leaves_no_residue_at_zero_velocity(method):
    """Check echoes of 60 dB, of which a plain mean leaves 1 / (pi k) at zero velocity."""
    for seed, speed in enumerate((3.1, 5.5, 9.3, 14.2, 21.7)):
        target = dc.Target(position_m=(20, 0, 0), velocity_m_per_s=(speed, 0, 0), rcs_m2=1000.0)
        result = dc.run(replace(make_scenario(method, targets=[target]), seed=seed))
        assert detected_ranges_m(result) == [20] and result.detections.snr.item() > 1e6


@pytest.mark.parametrize(
    ("methods", "setting"),
    [
        ("mean", "Chain.mitigation"),
        ([1], "Chain.mitigation"),
        (dc.mitigation.MeanSubtraction(), "mitigation"),
    ],
)
def test_rejects_invalid_mitigation(methods, setting):
    with pytest.raises(dc.InvalidSetting, match=setting):
        dc.Chain(mitigation=methods)


def test_rejects_static_target_removal_with_single_chirp():
    radar = replace(RADAR, frame=replace(RADAR.frame, n_chirps=1))
    with pytest.raises(dc.InvalidSetting, match="n_chirps: 1, under mitigation of kind"):
        replace(make_scenario(dc.mitigation.MeanSubtraction()), radar=radar)
