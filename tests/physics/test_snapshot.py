"""A frame of one chirp: ranges without velocities."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.scene.aliasing import apparent_truth
from dechirp.scene.scene_warnings import scene_findings
from noise import noise_cube, noisy

ALONG_RANGE = dc.Cfar(
    estimator=dc.cfar.CellAveraging(),
    n_training=dc.Cells(range=10, velocity=0),
    n_guard=dc.Cells(range=4, velocity=0),
    false_alarm_probability=1e-4,
)


def snapshot(radar, sampling="complex"):
    chirp = replace(radar.frame.chirp, sampling=sampling)
    return replace(radar, frame=replace(radar.frame, chirp=chirp, n_chirps=1))


@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_a_target_at_rest_is_found_to_the_bound_without_a_velocity(radar, sampling):
    radar = snapshot(radar, sampling)
    clean = dc.simulate(
        dc.Scene(targets=[dc.Target(position_m=(13.37, 0, 0))]), radar, impairments=()
    )
    rng = np.random.default_rng(1)
    errors = []
    for _ in range(400):
        found = dc.detect(noisy(clean, 3, rng), radar, dc.Chain(cfar=ALONG_RANGE))
        found = found.isel(detection=0)
        assert np.isnan(found.velocity) and np.isnan(found.velocity_std)
        errors.append((found.range.item() - 13.37) / found.range_std.item())

    # The mean of 400 squares, 7 %, of errors over standard errors from a noise level of some
    # 20 cells in two channels, which adds as much; the half paths add 0.1 mm to 10 mm.
    assert np.mean(np.square(errors)) == pytest.approx(1, abs=0.5)


def test_false_alarms_in_one_chirp_come_as_designed(radar):
    radar, chain = (
        snapshot(radar),
        dc.Chain(cfar=replace(ALONG_RANGE, false_alarm_probability=1e-2)),
    )
    rng = np.random.default_rng(2)
    hits = trials = 0
    for _ in range(1000):
        power = dc.power_map(noise_cube(radar, rng).isel(frame=0), radar, chain)
        hits += int((power > dc.threshold_map(power, radar, chain)).sum())
        trials += power.size

    # 2,560 alarms in clusters of up to two and a half: a standard error of 3 %; five.
    assert hits / trials == pytest.approx(1e-2, rel=0.15)


def test_a_fast_target_is_seen_at_its_beat_frequency_and_folds_in_no_velocity(radar):
    target = dc.Target(name="car", position_m=(30, 0, 0), velocity_m_per_s=(40, 0, 0), rcs_m2=10)
    scene = dc.Scene(targets=[target])
    assert [f.setting for f in scene_findings(scene, radar)] == ["scene.targets.car.velocity"]
    radar = snapshot(radar)
    assert scene_findings(scene, radar) == []
    place = apparent_truth(dc.truth(scene, radar), radar)
    coupling_m = radar.frame.chirp.range_doppler_coupling_m(40)

    assert place.range_m.item() == pytest.approx(30 + coupling_m, abs=1e-3)  # 15 us at 40 m/s
    assert np.isnan(place.velocity_m_per_s.item())
    found = dc.detect(dc.simulate(scene, radar, seed=3), radar, dc.Chain(cfar=ALONG_RANGE))
    found = found.isel(detection=0)
    assert found.range.item() == pytest.approx(place.range_m.item(), abs=5 * found.range_std.item())


def test_a_range_that_folds_is_told_without_a_velocity(radar):
    scene = dc.Scene(targets=[dc.Target(position_m=(90, 0, 0))])

    told = scene_findings(scene, snapshot(radar))
    assert "90 m at 0 m/s is aliased to 15.05 m" in [finding.value for finding in told]


def test_there_is_nothing_to_pad_in_one_chirp(radar):
    radar = snapshot(radar)
    chain = dc.Chain(cfar=ALONG_RANGE, n_velocity_bins=64)

    with pytest.raises(dc.InvalidSetting, match="one point has the same power in every bin"):
        dc.detect(dc.simulate(dc.Scene(), radar), radar, chain)
