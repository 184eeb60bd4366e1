"""Moments of the studio: frame after frame, each the same to the bit whenever it is looked at."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.experiments.scenario import RecordingSource
from dechirp.processing.chain import Chain
from dechirp.processing.range_doppler_map import power_map, threshold_map
from dechirp.scene.aliasing import RangeVelocity, range_doppler_map_position
from dechirp.studio.cursor import Cursor
from dechirp.studio.frame_player import FramePlayer
from dechirp.studio.scenario_edits import PageLimits

CHIRP = dc.Chirp(
    start_frequency_hz=77e9,
    slope_hz_per_s=30e12,
    adc_start_s=2e-6,
    ramp_duration_s=14e-6,
    sample_rate_hz=8e6,
    n_samples=96,
    sampling="complex",
)
RADAR = dc.Radar(
    frame=dc.Frame(chirp=CHIRP, n_chirps=40, interval_s=50e-6, period_s=50e-3),
    array=dc.Array(rx_m=[(0, 1.9e-3 * k, 0) for k in range(4)]),
    hardware=dc.Hardware(transmit_power_w=0.01, antenna_gain=10.0, noise_factor=10.0),
)
NEAR = dc.Target(name="near", position_m=(12.0, 2.0, 0), velocity_m_per_s=(3.0, 0, 0), rcs_m2=10.0)
FAR = dc.Target(name="far", position_m=(17.0, -4.0, 0), velocity_m_per_s=(-4.0, 0, 0), rcs_m2=10.0)
# Few guard cells, for a factor that is found in a tenth of a second.
CHAIN = Chain(
    cfar=dc.Cfar(
        estimator=dc.cfar.CellAveraging(),
        n_training=dc.Cells(range=5, velocity=4),
        n_guard=dc.Cells(range=2, velocity=2),
        false_alarm_probability=1e-4,
    )
)


@pytest.fixture(scope="module")
def scenario() -> dc.Scenario:
    return dc.Scenario(
        seed=3, n_frames=8, radar=RADAR, scene=dc.Scene(targets=[NEAR, FAR]), chain=CHAIN
    )


def real(scenario: dc.Scenario) -> dc.Scenario:
    """The same with real samples: rows about DC are not searched."""
    frame = replace(RADAR.frame, chirp=replace(CHIRP, sampling="real"))
    return replace(scenario, radar=replace(RADAR, frame=frame))


def filtered(scenario: dc.Scenario) -> dc.Scenario:
    """The same without what stands still."""
    return replace(scenario, chain=replace(CHAIN, mitigation=[dc.mitigation.MeanSubtraction()]))


def triangles(scenario: dc.Scenario) -> dc.Scenario:
    frame = replace(RADAR.frame, modulation=dc.modulations.Triangular())
    return replace(scenario, radar=replace(RADAR, frame=frame))


def ordered(scenario: dc.Scenario) -> dc.Scenario:
    """The same with another detector; without windows its factor has a closed form."""
    cfar = replace(CHAIN.cfar, estimator=dc.cfar.OrderedStatistic())
    chain = replace(CHAIN, cfar=cfar, range_window="rectangular", doppler_window="rectangular")
    return replace(scenario, chain=chain)


def test_a_step_is_the_same_to_the_bit_in_any_order(scenario):
    player = FramePlayer(scenario)
    first = {step: player.frame_at(step, None) for step in (0, 1, 2, 11)}
    for step in (11, 1, 0, 2):
        again = player.frame_at(step, None)
        xr.testing.assert_identical(again.samples, first[step].samples)
        xr.testing.assert_identical(again.power, first[step].power)
        xr.testing.assert_identical(again.detections, first[step].detections)
        xr.testing.assert_identical(again.azimuth_power, first[step].azimuth_power)


def test_a_scene_goes_round_with_other_noise(scenario):
    player = FramePlayer(scenario)
    first, second = player.frame_at(1, None), player.frame_at(9, None)
    assert (first.number, second.number) == (1, 1)
    assert first.time_s == second.time_s
    xr.testing.assert_identical(first.truth, second.truth)
    assert not np.any(first.samples.values == second.samples.values)


@pytest.mark.parametrize("change", [lambda s: s, real, filtered, triangles])
def test_the_first_step_is_what_a_run_of_one_frame_gives(scenario, change):
    alone = replace(change(scenario), n_frames=1)
    result = dc.run(alone)
    seen = FramePlayer(alone).frame_at(0, None)
    xr.testing.assert_identical(seen.samples, result.cube.isel(frame=0))
    xr.testing.assert_identical(seen.detections, result.detections)
    xr.testing.assert_identical(seen.truth, result.truth)
    assert seen.detections.sizes["detection"] >= 2
    assert set(seen.findings) == set(result.findings)


@pytest.mark.parametrize("change", [lambda s: s, real, filtered, triangles, ordered])
@pytest.mark.parametrize("at", [None, Cursor(0.0, 3.0), Cursor(17.0, -9.6), Cursor(60.0, 0.1)])
def test_cuts_are_the_row_and_the_column_of_both_maps(scenario, change, at):
    changed = change(scenario)
    player = FramePlayer(changed)
    seen = player.frame_at(0, at)
    whole = power_map(seen.samples, seen.radar, seen.chain)
    threshold = threshold_map(whole, seen.radar, seen.chain)
    cell = {
        "velocity": int(abs(whole.velocity.values - seen.cursor.velocity_m_per_s).argmin()),
        "range": int(abs(whole.range.values - seen.cursor.range_m).argmin()),
    }
    for cut, along, across in (
        (seen.cuts[0], "range", "velocity"),
        (seen.cuts[1], "velocity", "range"),
    ):
        line = {across: cell[across]}
        np.testing.assert_array_equal(cut.positions, whole[along].values)
        np.testing.assert_array_equal(cut.power, seen.power.isel(line).values)
        np.testing.assert_allclose(cut.threshold, threshold.isel(line).values, rtol=1e-5)
    if change is not filtered:  # whose map, as the detector sees it, has no notch
        np.testing.assert_array_equal(seen.power.values, whole.values)


def test_without_a_cursor_all_look_at_the_strongest_detection(scenario):
    seen = FramePlayer(scenario).frame_at(0, None)
    first = seen.detections.isel(detection=int(seen.detections.snr.values.argmax()))
    on = range_doppler_map_position(
        RangeVelocity(first["range"].values, first["velocity"].values), seen.radar
    )
    assert seen.cursor.range_m == pytest.approx(
        float(on.range_m), abs=float(seen.power["range"][1])
    )
    step = float(np.diff(seen.power.velocity.values)[0])
    assert seen.cursor.velocity_m_per_s == pytest.approx(float(on.velocity_m_per_s), abs=step)


def test_where_nothing_is_detected_they_look_at_the_strongest_cell(scenario):
    deaf = replace(CHAIN, cfar=replace(CHAIN.cfar, false_alarm_probability=None, offset=1e9))
    seen = FramePlayer(replace(scenario, chain=deaf)).frame_at(0, None)
    assert seen.detections.sizes["detection"] == 0
    at = {"range": seen.cursor.range_m, "velocity": seen.cursor.velocity_m_per_s}
    assert float(seen.power.sel(at)) == float(seen.power.max())


def test_the_cursor_moves_and_the_frame_stays(scenario):
    player = FramePlayer(scenario)
    before = player.frame_at(2, None)
    after = player.frame_at(2, Cursor(17.0, -4.0))
    assert after.samples is before.samples and after.tracks == before.tracks
    assert after.cursor == Cursor(17.0, -4.0)
    assert after.micro_doppler.sizes["time"] == before.micro_doppler.sizes["time"]


def test_the_frame_before_is_still_there_when_the_next_one_was_made_already(scenario):
    player = FramePlayer(scenario)
    shown = [player.frame_at(step, None) for step in range(3)]
    again = player.frame_at(1, None)
    assert again.samples is shown[1].samples
    xr.testing.assert_identical(again.micro_doppler, shown[1].micro_doppler)
    assert player.frame_at(3, None).micro_doppler.sizes["time"] == 4


def test_micro_doppler_is_a_spectrogram_with_a_window_a_frame(scenario):
    player = FramePlayer(scenario)
    seen = [player.frame_at(step, Cursor(12.0, 3.0)) for step in range(3)]
    cube = xr.concat([one.samples for one in seen], "frame")
    cube = cube.transpose("frame", "chirp", "rx", "sample").drop_vars("frame", errors="ignore")
    known = dc.spectrogram(cube, RADAR, range_m=(10.0, 14.0), hop=40)
    found = seen[-1].micro_doppler
    np.testing.assert_allclose(found.values, known.values, rtol=1e-3)
    np.testing.assert_allclose(found.velocity, known.velocity)
    np.testing.assert_allclose(found.time, known.time, atol=RADAR.frame.interval_s)


def test_tracks_and_micro_doppler_begin_again_after_a_rewind_and_a_jump(scenario):
    pytest.importorskip("stonesoup")
    player = FramePlayer(replace(scenario, tracker=dc.Tracker()))
    seen = [player.frame_at(step, None) for step in range(6)]
    assert {one.status for one in seen[4].tracks} == {"confirmed"}
    assert [one.micro_doppler.sizes["time"] for one in seen] == [1, 2, 3, 4, 5, 6]
    for step in (0, 3):
        begun = player.frame_at(step, None)
        assert {one.age for one in begun.tracks} == {0}
        assert begun.micro_doppler.sizes["time"] == 1
    # The scene goes round after its last frame: targets are where they began.
    player = FramePlayer(replace(scenario, tracker=dc.Tracker()))
    last, round_again = player.frame_at(7, None), player.frame_at(8, None)
    assert round_again.time_s < last.time_s
    assert {one.age for one in round_again.tracks} == {0}


def test_tracks_frame_by_frame_are_those_of_a_run(scenario):
    pytest.importorskip("stonesoup")
    followed = replace(
        scenario, n_frames=6, tracker=dc.Tracker(), chain=replace(CHAIN, cluster=dc.Dbscan())
    )
    player = FramePlayer(followed)
    seen = [player.frame_at(step, None) for step in range(6)]
    detections = xr.concat([one.detections for one in seen], "detection")
    clusters = xr.concat([one.clusters for one in seen], "cluster")
    assert set(seen[-1].detections["cluster"].values) == {0, 1}
    known = dc.track(
        clusters.drop_vars("n_detections"),
        [one.time_s for one in seen],
        dc.Tracker(),
        velocity_span_m_per_s=2 * RADAR.frame.max_velocity_m_per_s,
    )
    assert detections.sizes["detection"] >= 12
    last = known.isel(frame=-1)
    for name, place in (("x", 0), ("vx", 1), ("y", 2), ("vy", 3)):
        states = [one.state[place] for one in seen[-1].tracks if one.status == "confirmed"]
        np.testing.assert_allclose(last[name].values, states)


def test_an_array_that_tells_no_azimuth_has_no_map_of_it(scenario):
    upright = replace(RADAR, array=dc.Array(rx_m=[(0, 0, 1.9e-3 * k) for k in range(4)]))
    assert FramePlayer(replace(scenario, radar=upright)).frame_at(0, None).azimuth_power is None
    single = replace(RADAR, array=dc.Array(rx_m=[(0, 0, 0)]))
    assert FramePlayer(replace(scenario, radar=single)).frame_at(0, None).azimuth_power is None


@pytest.mark.parametrize("step", [-1, 1.5, "2", None])
def test_a_step_that_is_none_is_refused_by_name(scenario, step):
    with pytest.raises(dc.InvalidSetting, match=r"^step"):
        FramePlayer(scenario).frame_at(step, None)


def test_a_recording_that_is_not_there_is_named(tmp_path):
    there = dc.Scenario(recording=RecordingSource(path=str(tmp_path / "none.bin")))
    with pytest.raises(dc.DechirpError, match=r"none\.bin"):
        FramePlayer(there).frame_at(0, None)


def test_after_a_frame_that_fails_the_next_one_is_seen(scenario, monkeypatch):
    player = FramePlayer(scenario)
    known = player.frame_at(1, None)
    cube = player._prepared.frames.cube
    monkeypatch.setattr(player._prepared.frames, "cube", lambda step: cube(step) * np.nan)
    with pytest.raises(dc.InvalidSetting, match="not finite"):
        player.frame_at(2, None)
    monkeypatch.undo()
    again = player.frame_at(1, None)
    xr.testing.assert_identical(again.detections, known.detections)
    assert again.micro_doppler.sizes["time"] == 1


def test_a_recording_is_walked_through_and_goes_round(scenario, tmp_path):
    cube = dc.simulate(scenario.scene, RADAR, n_frames=3, seed=5)
    path = tmp_path / "cube.npy"
    np.save(path, cube.values)
    source = RecordingSource(path=str(path), axes=("frame", "chirp", "rx", "sample"))
    recorded = dc.Scenario(radar=RADAR, recording=source, chain=CHAIN)
    result, player = dc.run(recorded), FramePlayer(recorded)
    for step, number in ((0, 0), (2, 2), (1, 1), (4, 1)):
        seen = player.frame_at(step, None)
        assert (seen.number, seen.n_frames, seen.truth) == (number, 3, None)
        own = np.flatnonzero(result.detections["frame"].values == number)
        xr.testing.assert_identical(seen.detections, result.detections.isel(detection=own))
        np.testing.assert_array_equal(seen.samples.values, cube.values[number])


def test_a_recording_is_held_to_the_limits_that_scenes_are_held_to(scenario, tmp_path):
    path = tmp_path / "cube.npz"
    cube = dc.simulate(scenario.scene, RADAR, n_frames=1, seed=5)
    dc.write(dc.recording_from_cube(cube, RADAR), path)
    recorded = dc.Scenario(recording=RecordingSource(path=str(path)), chain=CHAIN)
    finer = replace(recorded, chain=replace(CHAIN, n_range_bins=2**17))
    with pytest.raises(dc.InvalidSetting, match="15,360 samples; expected at most 15,359"):
        FramePlayer(recorded, PageLimits(max_samples=15_359)).frame_at(0, None)
    with pytest.raises(dc.InvalidSetting, match="5,242,880 cells of the map"):  # of 40 chirps
        FramePlayer(finer).frame_at(0, None)


@pytest.mark.skipif("DECHIRP_REAL_DATA" not in os.environ, reason="no recordings named")
def test_a_real_recording_is_seen_in_units_of_full_scale():
    folder = Path(os.environ["DECHIRP_REAL_DATA"]) / "bgt60_two_reflectors"
    player = FramePlayer(
        dc.Scenario(recording=RecordingSource(path=str(folder / "RadarIfxAvian_00")))
    )
    first, second = (player.frame_at(step, None) for step in (0, 1))
    assert first.power.attrs["units"] == first.micro_doppler.attrs["units"] == "full scale squared"
    assert first.detections.sizes["detection"] > 0
    assert second.time_s > first.time_s


def test_what_the_studio_opens_with_shows_something_everywhere():
    from importlib import resources

    with resources.as_file(resources.files("dechirp.studio") / "start.yaml") as file:
        opened = dc.load(file)
    radar = opened.radar
    assert (radar.frame.n_chirps, radar.n_channels, radar.frame.chirp.n_samples) == (128, 12, 256)
    player = FramePlayer(replace(opened, tracker=None))
    for step in (0, 1, 199):
        seen = player.frame_at(step, None)
        assert not seen.findings
        truth, found = seen.truth, seen.clusters
        off_m = abs(truth["range"].values - found["range"].values)
        off_rad = abs(truth["azimuth"].values - found["azimuth"].values)
        assert np.all((off_m < 1.0).any(axis=1) & (off_rad < 0.1).any(axis=1))
    assert seen.azimuth_power is not None and seen.micro_doppler.values.max() > 0
