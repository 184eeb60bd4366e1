"""Frame player of the studio: reproducible frames, cuts, cursor, tracks and recordings."""

import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.core.findings import Finding
from dechirp.core.threads import thread_count
from dechirp.experiments.scenario import RecordingSource
from dechirp.processing.chain import Chain
from dechirp.processing.range_doppler_map import power_map, threshold_map
from dechirp.scene.aliasing import RangeVelocity, range_doppler_map_position
from dechirp.simulation.simulate import build_stages_with_warnings
from dechirp.studio import frame_player, frame_sources
from dechirp.studio.cursor import Cursor, cursor_at_followed_detection, nearest_cell_indices
from dechirp.studio.frame_player import FramePlayer
from dechirp.studio.option_hints import translate_finding_to_page
from dechirp.studio.scenario_edits import PageLimits
from nightly import nightly, nightly_except
from recordings.triangle_wav import RADAR as SOUND_CARD_RADAR
from recordings.triangle_wav import record_triangle, walker_range_m

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
# Few guard cells: the threshold factor is computed in 0.1 s.
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


def use_real_sampling(scenario: dc.Scenario) -> dc.Scenario:
    """Switch to real samples, for which rows around DC are not searched."""
    frame = replace(RADAR.frame, chirp=replace(CHIRP, sampling="real"))
    return replace(scenario, radar=replace(RADAR, frame=frame))


def use_mean_subtraction(scenario: dc.Scenario) -> dc.Scenario:
    """Add mean subtraction, which removes static targets."""
    return replace(scenario, chain=replace(CHAIN, mitigation=[dc.mitigation.MeanSubtraction()]))


def use_triangular_modulation(scenario: dc.Scenario) -> dc.Scenario:
    frame = replace(RADAR.frame, modulation=dc.modulations.Triangular())
    return replace(scenario, radar=replace(RADAR, frame=frame))


def use_ordered_statistic(scenario: dc.Scenario) -> dc.Scenario:
    """Switch the estimator to ordered statistic; without windows its factor has a closed form."""
    cfar = replace(CHAIN.cfar, estimator=dc.cfar.OrderedStatistic())
    chain = replace(CHAIN, cfar=cfar, range_window="rectangular", doppler_window="rectangular")
    return replace(scenario, chain=chain)


def test_steps_are_bitwise_identical_in_any_order(scenario):
    player = FramePlayer(scenario)
    first = {step: player.process_frame_at_step(step, None) for step in (0, 1, 2, 11)}
    for step in (11, 1, 0, 2):
        repeated_state = player.process_frame_at_step(step, None)
        xr.testing.assert_identical(repeated_state.samples, first[step].samples)
        xr.testing.assert_identical(repeated_state.power, first[step].power)
        xr.testing.assert_identical(repeated_state.detections, first[step].detections)
        xr.testing.assert_identical(repeated_state.azimuth_power, first[step].azimuth_power)


def test_scene_repeats_with_new_noise(scenario):
    player = FramePlayer(scenario)
    first, second = player.process_frame_at_step(1, None), player.process_frame_at_step(9, None)
    assert (first.number, second.number) == (1, 1)
    assert first.time_s == second.time_s
    xr.testing.assert_identical(first.truth, second.truth)
    assert not np.any(first.samples.values == second.samples.values)


def test_findings_of_an_unchanged_scene_are_kept(scenario, monkeypatch):
    """They take 30 ms of a change; the first of these changes only concerns the processing."""
    aliased = dc.Scene(targets=[NEAR, replace(FAR, position_m=(500.0, -4.0, 0))])
    quieter = replace(RADAR, hardware=replace(RADAR.hardware, noise_factor=2.0))
    changes = [
        (lambda s: replace(s, chain=replace(CHAIN, range_window="hamming"), seed=4), False),
        (lambda s: replace(s, scene=aliased), True),
        (lambda s: replace(s, radar=quieter), True),
        (lambda s: replace(s, n_frames=9), True),
        (lambda s: replace(s, impairments=()), True),
        (lambda s: replace(s, scene=dc.Scene(targets=[NEAR, FAR])), True),
    ]
    n_judged: list[int] = []
    monkeypatch.setattr(
        frame_sources,
        "build_stages_with_warnings",
        lambda *args, **options: n_judged.append(1) or build_stages_with_warnings(*args, **options),
    )
    player = FramePlayer(scenario)
    assert not player.open_source().findings
    for change, must_judge in changes:
        n_judged.clear()
        scenario = change(scenario)
        player = FramePlayer(scenario, previous=player)
        settings = {finding.setting for finding in player.open_source().findings}
        assert bool(n_judged) == must_judge
        is_aliased = scenario.scene == aliased
        assert settings == ({"scene.targets.far.position"} if is_aliased else set())


@pytest.mark.parametrize(
    "change",
    nightly_except(
        2, [lambda s: s, use_real_sampling, use_mean_subtraction, use_triangular_modulation]
    ),
)
def test_first_step_equals_run_of_one_frame(scenario, change):
    one_frame_scenario = replace(change(scenario), n_frames=1)
    result = dc.run(one_frame_scenario)
    frame_state = FramePlayer(one_frame_scenario).process_frame_at_step(0, None)
    xr.testing.assert_identical(frame_state.samples, result.cube.isel(frame=0))
    xr.testing.assert_identical(frame_state.detections, result.detections)
    xr.testing.assert_identical(frame_state.truth, result.truth.drop_vars("snr", errors="ignore"))
    assert frame_state.detections.sizes["detection"] >= 2
    assert set(frame_state.findings) == set(map(translate_finding_to_page, result.findings))


@pytest.mark.parametrize(
    "change",
    nightly_except(
        2,
        [
            lambda s: s,
            use_real_sampling,
            use_mean_subtraction,
            use_triangular_modulation,
            use_ordered_statistic,
        ],
    ),
)
@pytest.mark.parametrize("cursor", [None, Cursor(0.0, 3.0), Cursor(17.0, -9.6), Cursor(60.0, 0.1)])
def test_cuts_equal_row_and_column_of_map_and_threshold(scenario, change, cursor):
    changed = change(scenario)
    player = FramePlayer(changed)
    frame_state = player.process_frame_at_step(0, cursor)
    full_map = power_map(frame_state.samples, frame_state.radar, frame_state.chain)
    threshold = threshold_map(full_map, frame_state.radar, frame_state.chain)
    cell = {
        "velocity": int(
            abs(full_map.velocity.values - frame_state.cursor.velocity_m_per_s).argmin()
        ),
        "range": int(abs(full_map.range.values - frame_state.cursor.range_m).argmin()),
    }
    for cut, axis, other_axis in (
        (frame_state.cuts_through_cursor[0], "range", "velocity"),
        (frame_state.cuts_through_cursor[1], "velocity", "range"),
    ):
        selection = {other_axis: cell[other_axis]}
        np.testing.assert_array_equal(cut.positions, full_map[axis].values)
        np.testing.assert_array_equal(cut.power, frame_state.power.isel(selection).values)
        np.testing.assert_allclose(cut.threshold, threshold.isel(selection).values, rtol=1e-5)
    if change is not use_mean_subtraction:  # with it, the map of the detector has no notch
        np.testing.assert_array_equal(frame_state.power.values, full_map.values)


def test_default_cursor_is_at_strongest_detection(scenario):
    frame_state = FramePlayer(scenario).process_frame_at_step(0, None)
    strongest = frame_state.detections.isel(
        detection=int(frame_state.detections.snr.values.argmax())
    )
    position = range_doppler_map_position(
        RangeVelocity(strongest["range"].values, strongest["velocity"].values), frame_state.radar
    )
    assert frame_state.cursor.range_m == pytest.approx(
        float(position.range_m), abs=float(frame_state.power["range"][1])
    )
    step = float(np.diff(frame_state.power.velocity.values)[0])
    assert frame_state.cursor.velocity_m_per_s == pytest.approx(
        float(position.velocity_m_per_s), abs=step
    )


def test_cursor_follows_its_echo_while_another_is_stronger(scenario):
    power = FramePlayer(scenario).process_frame_at_step(0, None).power
    range_m, velocity = power.range.values, power.velocity.values

    def detections(*rows: tuple[int, int, float]) -> xr.Dataset:
        columns = {
            "range": [range_m[column] for _, column, _ in rows],
            "velocity": [velocity[row] for row, _, _ in rows],
            "snr": [snr for _, _, snr in rows],
        }
        return xr.Dataset({key: ("detection", np.array(v)) for key, v in columns.items()})

    def follow(found: xr.Dataset, previous: Cursor | None) -> tuple[int, int]:
        cursor = cursor_at_followed_detection(power, found, RADAR, previous)
        return nearest_cell_indices(power, cursor)

    def is_near(cell: tuple[int, int], row: int, column: int) -> bool:
        return max(abs(cell[0] - row), abs(cell[1] - column)) <= 1

    first, second = (8, 10, 200.0), (20, 30, 100.0)
    assert is_near(follow(detections(first, second), None), 8, 10)
    at_first = Cursor(float(range_m[10]), float(velocity[8]))
    moved_and_faded = (9, 11, 50.0)
    assert is_near(follow(detections(second, moved_and_faded), at_first), 9, 11)
    assert is_near(follow(detections(second), at_first), 20, 30)  # it is gone
    assert is_near(follow(detections((20, 30, 1e5), moved_and_faded), at_first), 20, 30)


def test_default_cursor_without_detections_is_at_strongest_cell(scenario):
    insensitive_chain = replace(
        CHAIN, cfar=replace(CHAIN.cfar, false_alarm_probability=None, offset=1e9)
    )
    frame_state = FramePlayer(replace(scenario, chain=insensitive_chain)).process_frame_at_step(
        0, None
    )
    assert frame_state.detections.sizes["detection"] == 0
    cell = {"range": frame_state.cursor.range_m, "velocity": frame_state.cursor.velocity_m_per_s}
    assert float(frame_state.power.sel(cell)) == float(frame_state.power.max())


def test_moving_cursor_keeps_frame(scenario):
    player = FramePlayer(scenario)
    initial_state = player.process_frame_at_step(2, None)
    moved_state = player.process_frame_at_step(2, Cursor(17.0, -4.0))
    assert (
        moved_state.samples is initial_state.samples and moved_state.tracks == initial_state.tracks
    )
    assert moved_state.cursor == Cursor(17.0, -4.0)
    assert moved_state.micro_doppler.sizes["time"] == initial_state.micro_doppler.sizes["time"]


def test_previous_frame_is_cached_after_next_one(scenario):
    player = FramePlayer(scenario)
    frame_states = [player.process_frame_at_step(step, None) for step in range(3)]
    repeated_state = player.process_frame_at_step(1, None)
    assert repeated_state.samples is frame_states[1].samples
    xr.testing.assert_identical(repeated_state.micro_doppler, frame_states[1].micro_doppler)
    assert player.process_frame_at_step(3, None).micro_doppler.sizes["time"] == 4


def test_micro_doppler_equals_spectrogram_with_one_window_per_frame(scenario):
    player = FramePlayer(scenario)
    frame_states = [player.process_frame_at_step(step, Cursor(12.0, 3.0)) for step in range(3)]
    cube = xr.concat([state.samples for state in frame_states], "frame")
    cube = cube.transpose("frame", "chirp", "rx", "sample").drop_vars("frame", errors="ignore")
    expected = dc.spectrogram(cube, RADAR, range_m=(10.0, 14.0), hop=40)
    micro_doppler = frame_states[-1].micro_doppler
    np.testing.assert_allclose(micro_doppler.values, expected.values, rtol=1e-3)
    np.testing.assert_allclose(micro_doppler.velocity, expected.velocity)
    np.testing.assert_allclose(micro_doppler.time, expected.time, atol=RADAR.frame.interval_s)


def test_tracks_and_micro_doppler_restart_after_rewind_and_jump(scenario):
    pytest.importorskip("stonesoup")
    player = FramePlayer(replace(scenario, tracker=dc.Tracker()))
    frame_states = [player.process_frame_at_step(step, None) for step in range(6)]
    assert {state.status for state in frame_states[4].tracks} == {"confirmed"}
    assert [state.micro_doppler.sizes["time"] for state in frame_states] == [1, 2, 3, 4, 5, 6]
    for step in (0, 3):
        restarted_state = player.process_frame_at_step(step, None)
        assert {state.age for state in restarted_state.tracks} == {0}
        assert restarted_state.micro_doppler.sizes["time"] == 1
    # The scene repeats after its last frame: targets return to their initial positions.
    player = FramePlayer(replace(scenario, tracker=dc.Tracker()))
    last_state, repeated_state = (
        player.process_frame_at_step(7, None),
        player.process_frame_at_step(8, None),
    )
    assert repeated_state.time_s < last_state.time_s
    assert {state.age for state in repeated_state.tracks} == {0}


def test_frame_by_frame_tracks_equal_tracks_of_run(scenario):
    pytest.importorskip("stonesoup")
    tracking_scenario = replace(
        scenario, n_frames=6, tracker=dc.Tracker(), chain=replace(CHAIN, cluster=dc.Dbscan())
    )
    player = FramePlayer(tracking_scenario)
    frame_states = [player.process_frame_at_step(step, None) for step in range(6)]
    detections = xr.concat([item.detections for item in frame_states], "detection")
    clusters = xr.concat([item.clusters for item in frame_states], "cluster")
    assert set(frame_states[-1].detections["cluster"].values) == {0, 1}
    tracks = dc.track(
        clusters.drop_vars("n_detections"),
        [item.time_s for item in frame_states],
        dc.Tracker(),
        velocity_span_m_per_s=2 * RADAR.frame.max_velocity_m_per_s,
    )
    assert detections.sizes["detection"] >= 12
    last_tracks = tracks.isel(frame=-1)
    for name, state_index in (("x", 0), ("vx", 1), ("y", 2), ("vy", 3)):
        states = [
            item.state[state_index]
            for item in frame_states[-1].tracks
            if item.status == "confirmed"
        ]
        np.testing.assert_allclose(last_tracks[name].values, states)


def test_array_without_azimuth_has_no_azimuth_map(scenario):
    upright = replace(RADAR, array=dc.Array(rx_m=[(0, 0, 1.9e-3 * k) for k in range(4)]))
    assert (
        FramePlayer(replace(scenario, radar=upright)).process_frame_at_step(0, None).azimuth_power
        is None
    )
    single = replace(RADAR, array=dc.Array(rx_m=[(0, 0, 0)]))
    assert (
        FramePlayer(replace(scenario, radar=single)).process_frame_at_step(0, None).azimuth_power
        is None
    )


@pytest.mark.parametrize(("n_chirps", "is_small"), [(40, True), (1400, False)])
def test_small_frame_takes_one_thread_and_its_azimuth_map_waits(
    scenario, monkeypatch, n_chirps, is_small
):
    n_threads = []
    detect = frame_player.process_cubes

    def detect_and_count(*arguments, **options):
        n_threads.append(thread_count())
        return detect(*arguments, **options)

    monkeypatch.setattr(frame_player, "process_cubes", detect_and_count)
    frame = replace(RADAR.frame, n_chirps=n_chirps, period_s=0.1)
    player = FramePlayer(replace(scenario, radar=replace(RADAR, frame=frame)))
    second = [player.process_frame_at_step(step, None) for step in range(2)][1]
    assert n_threads == [1 if is_small else thread_count()] * 2
    assert ("azimuth_power" not in vars(second)) == is_small
    assert second.azimuth_power.values.max() > 0


@pytest.mark.parametrize("step", [-1, 1.5, "2", None])
def test_rejects_invalid_step(scenario, step):
    with pytest.raises(dc.InvalidSetting, match=r"^step"):
        FramePlayer(scenario).process_frame_at_step(step, None)


def test_missing_recording_is_named_in_error(tmp_path):
    recording_scenario = dc.Scenario(recording=RecordingSource(path=str(tmp_path / "none.bin")))
    with pytest.raises(dc.DechirpError, match=r"none\.bin"):
        FramePlayer(recording_scenario).process_frame_at_step(0, None)


def test_next_frame_is_computed_after_failed_frame(scenario, monkeypatch):
    player = FramePlayer(scenario)
    expected = player.process_frame_at_step(1, None)
    cube = player._prepared.frames.cube
    monkeypatch.setattr(player._prepared.frames, "cube", lambda step: cube(step) * np.nan)
    with pytest.raises(dc.InvalidSetting, match="not finite"):
        player.process_frame_at_step(2, None)
    monkeypatch.undo()
    repeated_state = player.process_frame_at_step(1, None)
    xr.testing.assert_identical(repeated_state.detections, expected.detections)
    assert repeated_state.micro_doppler.sizes["time"] == 1


def test_recording_plays_all_frames_and_repeats(scenario, tmp_path):
    cube = dc.simulate(scenario.scene, RADAR, n_frames=3, seed=5)
    path = tmp_path / "cube.npy"
    np.save(path, cube.values)
    source = RecordingSource(path=str(path), axes=("frame", "chirp", "rx", "sample"))
    recording_scenario = dc.Scenario(radar=RADAR, recording=source, chain=CHAIN)
    result, player = dc.run(recording_scenario), FramePlayer(recording_scenario)
    for step, number in ((0, 0), (2, 2), (1, 1), (4, 1)):
        frame_state = player.process_frame_at_step(step, None)
        assert (frame_state.number, frame_state.n_frames, frame_state.truth) == (number, 3, None)
        indices = np.flatnonzero(result.detections["frame"].values == number)
        xr.testing.assert_identical(
            frame_state.detections, result.detections.isel(detection=indices)
        )
        np.testing.assert_array_equal(frame_state.samples.values, cube.values[number])


def test_recording_obeys_limits_of_scenes(scenario, tmp_path):
    path = tmp_path / "cube.npz"
    cube = dc.simulate(scenario.scene, RADAR, n_frames=1, seed=5)
    dc.write(dc.recording_from_cube(cube, RADAR), path)
    recording_scenario = dc.Scenario(recording=RecordingSource(path=str(path)), chain=CHAIN)
    padded_scenario = replace(recording_scenario, chain=replace(CHAIN, n_range_bins=2**17))
    with pytest.raises(dc.InvalidSetting, match="15,360 samples; expected at most 15,359"):
        FramePlayer(recording_scenario, PageLimits(max_samples=15_359)).process_frame_at_step(
            0, None
        )
    with pytest.raises(dc.InvalidSetting, match="5,242,880 cells of the map"):  # 40 chirps
        FramePlayer(padded_scenario).process_frame_at_step(0, None)


@nightly
def test_damaged_recording_is_repaired_and_fitted_as_by_run(scenario, tmp_path):
    samples = dc.simulate(scenario.scene, RADAR, n_frames=3, seed=5).values.copy()
    samples[:, :, 2] = samples[:, :, 1]  # a receiver without a signal of its own
    samples[0, 7] *= -3  # a chirp unlike the others
    bursts = np.random.default_rng(4).normal(size=(3, 40, 8)) > 1.5  # of 8 samples each
    burst = 30 * abs(samples).max() * np.exp(2j * np.arange(96) ** 2 / 96)
    samples[:, :, :, 40:48] += np.where(bursts.any(-1), 1, 0)[:, :, None, None] * burst[40:48]
    samples *= np.exp(1j * np.array([0.0, 0.3, 0.3, 0.5]))[:, None]  # not calibrated
    path = tmp_path / "cube.npy"
    np.save(path, samples)
    source = RecordingSource(path=str(path), axes=("frame", "chirp", "rx", "sample"))
    recording_scenario = dc.Scenario(radar=RADAR, recording=source)
    result, player = dc.run(recording_scenario), FramePlayer(recording_scenario)
    player.detect_in_all_frames(lambda *_: None)
    for number in range(3):
        frame_state = player.process_frame_at_step(number, None)
        indices = np.flatnonzero(result.detections["frame"].values == number)
        assert indices.size
        xr.testing.assert_identical(
            frame_state.detections, result.detections.isel(detection=indices)
        )
    assert frame_state.samples.sizes["rx"] == result.radar.array.n_rx == 3
    chosen = {finding.setting for finding in result.findings}
    assert {"radar.array.rx", "chain.mitigation", "recording.repair_faults"} <= chosen
    # The last frame reports on all; the page has no command line.
    expected = {translate_finding_to_page(finding) for finding in result.findings}
    assert set(frame_state.findings) == expected
    values = " ".join(finding.value for finding in expected)
    assert all(text in values for text in ("not calibrated", "chirps repaired,"))
    options = [finding.fix for finding in expected if re.search(r"--(?!azimuth|out)", finding.fix)]
    assert options == []
    # A frame that is shown again counts once.
    assert set(player.process_frame_at_step(4, None).findings) == expected


@nightly
def test_recording_shows_velocities_and_notes_of_all_frames_as_run(tmp_path):
    path = tmp_path / "walk.wav"
    record_triangle(path, walker_range_m, inverted=False)
    recording_scenario = dc.Scenario(
        radar=SOUND_CARD_RADAR, recording=RecordingSource(path=str(path))
    )
    result, player = dc.run(recording_scenario), FramePlayer(recording_scenario)
    player.process_frame_at_step(0, None)
    n_done = []

    player.detect_in_all_frames(lambda n, _: n_done.append(n))

    def check(player: FramePlayer) -> set[Finding]:
        for number in (5, 6):
            frame_state = player.process_frame_at_step(number, None)
            indices = np.flatnonzero(result.detections["frame"].values == number)
            xr.testing.assert_identical(
                frame_state.detections, result.detections.isel(detection=indices)
            )
        texts = ("chosen recording.encoding=upright because", "with an aliased velocity")
        return {f for f in frame_state.findings if any(text in f.value for text in texts)}

    findings = check(player)
    assert len(findings) == 2
    assert len(n_done) >= result.n_frames
    # After a change of settings the chosen ramps stay.
    changed = replace(recording_scenario, name="other")
    next_player = FramePlayer(changed, previous=player)
    next_player.process_frame_at_step(0, None)
    next_player.detect_in_all_frames(lambda *_: None)
    assert check(next_player) == findings


@pytest.mark.skipif(
    "DECHIRP_REAL_DATA" not in os.environ,
    reason="no recordings: set DECHIRP_REAL_DATA to their folder",
)
def test_real_recording_is_shown_in_units_of_full_scale():
    folder = Path(os.environ["DECHIRP_REAL_DATA"]) / "bgt60_two_reflectors"
    player = FramePlayer(
        dc.Scenario(recording=RecordingSource(path=str(folder / "RadarIfxAvian_00")))
    )
    first, second = (player.process_frame_at_step(step, None) for step in (0, 1))
    assert first.power.attrs["units"] == first.micro_doppler.attrs["units"] == "1"
    assert first.detections.sizes["detection"] > 0
    assert second.time_s > first.time_s


def test_start_scenario_fills_all_views():
    from importlib import resources

    with resources.as_file(resources.files("dechirp.studio") / "start.yaml") as file:
        start_scenario = dc.load(file)
    radar = start_scenario.radar
    assert (radar.frame.n_chirps, radar.n_channels, radar.frame.chirp.n_samples) == (128, 12, 256)
    player = FramePlayer(replace(start_scenario, tracker=None))
    for step in (0, 1, 199):
        frame_state = player.process_frame_at_step(step, None)
        # Three targets pass behind the pedestrian: notes, no warning.
        assert {finding.level for finding in frame_state.findings} == {"note"}
        assert all("in the shadow of" in finding.value for finding in frame_state.findings)
        truth, clusters = frame_state.truth, frame_state.clusters
        range_errors_m = abs(truth["range"].values - clusters["range"].values)
        azimuth_errors_rad = abs(truth["azimuth"].values - clusters["azimuth"].values)
        is_found = (range_errors_m < 1.0).any(axis=1) & (azimuth_errors_rad < 0.1).any(axis=1)
        losses = dc.truth(start_scenario.scene, radar, first_frame=step)["shadow_loss"].values
        is_hidden = losses[:, 0] > 10  # the car at last
        assert is_hidden.sum() == (step == 199)
        assert np.all(is_found | is_hidden)
    assert frame_state.azimuth_power is not None and frame_state.micro_doppler.values.max() > 0
