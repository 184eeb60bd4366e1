"""Frames of one chirp: ranges without velocities."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.scene.aliasing import apparent_range_and_velocity
from dechirp.scene.scene_warnings import scene_findings
from nightly import nightly
from noise_cubes import add_noise, simulate_noise_cube

RANGE_CFAR = dc.Cfar(
    estimator=dc.cfar.CellAveraging(),
    n_training=dc.Cells(range=10, velocity=0),
    n_guard=dc.Cells(range=4, velocity=0),
    false_alarm_probability=1e-4,
)


def reduce_to_one_chirp(radar, sampling="complex"):
    chirp = replace(radar.frame.chirp, sampling=sampling)
    return replace(radar, frame=replace(radar.frame, chirp=chirp, n_chirps=1))


@nightly
@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_static_target_range_reaches_bound_without_velocity(radar, sampling):
    radar = reduce_to_one_chirp(radar, sampling)
    clean = dc.simulate(
        dc.Scene(targets=[dc.Target(position_m=(13.37, 0, 0))]), radar, impairments=()
    )
    rng = np.random.default_rng(1)
    errors = []
    for _ in range(400):
        detection = dc.detect(add_noise(clean, 3, rng), radar, dc.Chain(cfar=RANGE_CFAR))
        detection = detection.isel(detection=0)
        assert np.isnan(detection.velocity) and np.isnan(detection.velocity_std)
        errors.append((detection.range.item() - 13.37) / detection.range_std.item())

    # Mean of 400 squares: 7 %; stated standard errors use a noise level of some 20 cells in two
    # channels, which adds as much; unequal half paths add 0.1 mm to 10 mm.
    assert np.mean(np.square(errors)) == pytest.approx(1, abs=0.5)


@nightly
def test_false_alarm_rate_of_one_chirp_matches_design(radar):
    radar, chain = (
        reduce_to_one_chirp(radar),
        dc.Chain(cfar=replace(RANGE_CFAR, false_alarm_probability=1e-2)),
    )
    rng = np.random.default_rng(2)
    n_alarms = n_cells = 0
    for _ in range(400):
        power = dc.power_map(simulate_noise_cube(radar, rng).isel(frame=0), radar, chain)
        n_alarms += int((power > dc.threshold_map(power, radar, chain)).sum())
        n_cells += power.size

    # 1,020 alarms in clusters of up to 2.5: five standard errors of 5 %.
    assert n_alarms / n_cells == pytest.approx(1e-2, rel=0.25)


def test_fast_target_is_detected_at_beat_range_without_velocity_aliasing(radar):
    target = dc.Target(name="car", position_m=(30, 0, 0), velocity_m_per_s=(40, 0, 0), rcs_m2=10)
    scene = dc.Scene(targets=[target])
    assert [f.setting for f in scene_findings(scene, radar)] == ["scene.targets.car.velocity"]
    radar = reduce_to_one_chirp(radar)
    assert scene_findings(scene, radar) == []
    apparent = apparent_range_and_velocity(dc.truth(scene, radar), radar)
    coupling_m = radar.frame.chirp.range_doppler_coupling_m(40)

    assert apparent.range_m.item() == pytest.approx(30 + coupling_m, abs=1e-3)  # 15 us at 40 m/s
    assert np.isnan(apparent.velocity_m_per_s.item())
    detection = dc.detect(dc.simulate(scene, radar, seed=3), radar, dc.Chain(cfar=RANGE_CFAR))
    detection = detection.isel(detection=0)
    assert detection.range.item() == pytest.approx(
        apparent.range_m.item(), abs=5 * detection.range_std.item()
    )


def test_warns_of_aliased_range_without_velocity(radar):
    scene = dc.Scene(targets=[dc.Target(position_m=(90, 0, 0))])

    findings = scene_findings(scene, reduce_to_one_chirp(radar))
    assert "90 m at 0 m/s is aliased to 15.05 m" in [finding.value for finding in findings]


def test_rejects_velocity_padding_of_one_chirp(radar):
    radar = reduce_to_one_chirp(radar)
    chain = dc.Chain(cfar=RANGE_CFAR, n_velocity_bins=64)

    with pytest.raises(dc.InvalidSetting, match="one point has the same power in every bin"):
        dc.detect(dc.simulate(dc.Scene(), radar), radar, chain)
