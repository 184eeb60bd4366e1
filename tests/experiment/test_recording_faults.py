"""Faults of recordings in `dechirp run`: reported, and left out or repaired where that is safe."""

import json
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.cli.main import main
from dechirp.core.findings import Finding
from dechirp.experiments.recording_stage import note_rejected_images
from dechirp.experiments.scenario import RecordingSource
from dechirp.experiments.tune.trial_sources import RecordingTrialRunner
from dechirp.experiments.tune.tune import LabelledRecording
from nightly import nightly, nightly_except
from radars import street_radar

pytestmark = pytest.mark.usefixtures("without_figures")


AZIMUTH_DEG = 20.0
RX_M = tuple((0.0, 1.9e-3 * rx, 0.0) for rx in range(4))


def make_radar() -> dc.Radar:
    radar = street_radar(n_samples=128, n_chirps=64)
    return dc.Radar(
        frame=radar.frame, array=dc.Array(tx_m=radar.array.tx_m[:1], rx_m=RX_M),
        hardware=radar.hardware,
    )  # fmt: skip


def simulate_samples(radar: dc.Radar) -> np.ndarray:
    """Simulate a moving target in noise, (frame, chirp, rx, sample)."""
    azimuth = np.deg2rad(AZIMUTH_DEG)
    position_m = (12 * np.cos(azimuth), 12 * np.sin(azimuth), 0)
    target = dc.Target(name="t", position_m=position_m, velocity_m_per_s=(4, 0, 0), rcs_m2=10)
    scene = dc.Scene(targets=[target])
    return dc.simulate(scene, radar, n_frames=2, seed=3).values


def run_bare(tmp_path, capsys, samples: np.ndarray, *options: str) -> dict:
    """Write samples with the package's writer and run the file, by default without an option."""
    radar = make_radar()
    cube = dc.simulate(dc.Scene(targets=[]), radar, n_frames=len(samples), impairments=[])
    dc.write(dc.recording_from_cube(cube.copy(data=samples), radar), tmp_path / "x.zarr")
    with pytest.raises(SystemExit) as exit_info:
        main(["run", str(tmp_path / "x.zarr"), "--out", str(tmp_path / "out"), "--json", *options])
    assert exit_info.value.code in (0, None)
    return json.loads(capsys.readouterr().out)


def finding_text(document: dict, setting: str) -> str:
    return "; ".join(
        f"{f['level']}: {f['value']} -> {f['fix']}"
        for f in document["findings"]
        if f["setting"] == setting
    )


def assert_target_in_every_frame(document: dict) -> None:
    """Check that every frame shows the target, with its direction within 5 standard errors."""
    strongest = {}
    for row in document["detections"]:
        best = strongest.setdefault(row["frame"], row)
        strongest[row["frame"]] = max(best, row, key=lambda r: r["snr_db"])
    assert sorted(strongest) == [0, 1]
    for row in strongest.values():
        assert row["range_m"] == pytest.approx(12.0, abs=0.5)
        error_deg = AZIMUTH_DEG - row["azimuth_deg"]
        # A path of 3 cm within the frames turns by at most 0.2 degrees.
        assert abs(error_deg) < 5 * row["azimuth_std_deg"] + 0.2


def test_clean_recording_has_no_warning(tmp_path, capsys):
    document = run_bare(tmp_path, capsys, simulate_samples(make_radar()))

    assert_target_in_every_frame(document)
    assert [f for f in document["findings"] if f["level"] == "warning"] == []


@pytest.mark.parametrize("fault", nightly_except(["zero"], ["zero", "weak", "copied"]))
def test_faulty_receiver_takes_no_part_in_directions(tmp_path, capsys, fault):
    samples = simulate_samples(make_radar())
    other = samples[:, :, 1]
    samples[:, :, 2] = {"zero": 0 * other, "weak": 3e-3 * other, "copied": other}[fault]

    document = run_bare(tmp_path, capsys, samples)

    assert_target_in_every_frame(document)
    assert len(document["radar"]["array"]["rx_m"]) == 3
    assert "warning: " in finding_text(document, "recording.receivers")
    note = finding_text(document, "radar.array.rx")
    assert "receiver 2 left out, since it has no signal of its own" in note
    assert "repair_faults=true" not in note  # the default, which nothing chose
    assert "--set recording.repair_faults=false" in note


def test_receiver_copied_in_some_frames_takes_no_part_in_directions(tmp_path, capsys):
    samples = simulate_samples(make_radar())
    samples[1, :, 2] = samples[1, :, 1]

    document = run_bare(tmp_path, capsys, samples)

    # With the copy, the azimuth of frame 1 was off by degrees, without a finding.
    assert_target_in_every_frame(document)
    assert len(document["radar"]["array"]["rx_m"]) == 3
    assert "receiver 2 of frame 1 bit-identical to receiver 1" in finding_text(
        document, "recording.receivers"
    )


def test_single_working_receiver_gives_no_azimuth(tmp_path, capsys):
    samples = simulate_samples(make_radar())
    samples[:, :, 1:] = 0

    document = run_bare(tmp_path, capsys, samples)

    assert document["detections"]
    assert all(row["azimuth_deg"] is None for row in document["detections"])


def test_bursts_are_repaired_and_reported(tmp_path, capsys):
    samples = simulate_samples(make_radar())
    rng = np.random.default_rng(5)
    for chirp in (7, 23, 41):
        burst = rng.standard_normal((2, 6, 2)) @ [1, 1j]
        samples[:, chirp, :, 20:26] += 300 * np.abs(samples).mean() * burst[:, None]

    document = run_bare(tmp_path, capsys, samples)

    assert_target_in_every_frame(document)
    assert "bursts in 6 of 128 chirps" in finding_text(document, "recording.interference")
    assert "no action needed" in finding_text(document, "recording.interference")
    option = "--set 'chain.mitigation=[{kind: interference-autoregression}]'"
    assert option in finding_text(document, "chain.mitigation")
    assert "6 of 128 chirps repaired" in finding_text(
        document, "chain.mitigation.interference-autoregression"
    )
    # The option that the note names gives the same detections.
    again = ["run", str(tmp_path / "x.zarr"), "--out", str(tmp_path / "out"), "--json"]
    with pytest.raises(SystemExit):
        main([*again, "--set", option.split("'")[1]])
    assert json.loads(capsys.readouterr().out)["detections"] == document["detections"]


@nightly
def test_damaged_chirp_is_interpolated(tmp_path, capsys):
    clean = simulate_samples(make_radar())
    samples = clean.copy()
    samples[:, 0] *= 40  # 32 dB: over all velocities, 14 dB below a target of 64 chirps

    document = run_bare(tmp_path, capsys, samples)

    assert "chirp 0 of frames 0 to 1" in finding_text(document, "recording.chirps")
    note = finding_text(document, "recording.repair_faults")
    assert "2 of 128 chirps are lost or unlike the others" in note
    assert "repair_faults=true" not in note
    assert "--set recording.repair_faults=false" in note
    assert_target_in_every_frame(document)
    snr = max(row["snr_db"] for row in document["detections"])
    (tmp_path / "clean").mkdir()
    reference = max(
        row["snr_db"] for row in run_bare(tmp_path / "clean", capsys, clean)["detections"]
    )
    # One of 64 chirps is 0.07 dB; the noise estimates of two maps differ by less than 1 dB.
    assert snr == pytest.approx(reference, abs=1.5)


def simulate_static_samples(radar: dc.Radar, damaged_chirps: list[int]) -> np.ndarray:
    """Simulate a strong static target in noise, with noise in place of some chirps of 64."""
    target = dc.Target(name="t", position_m=(12, 0, 0), rcs_m2=1000)
    samples = dc.simulate(dc.Scene(targets=[target]), radar, n_frames=2, seed=4).values
    noise = np.random.default_rng(6).standard_normal((2, len(damaged_chirps), 4, 128, 2)) @ [1, 1j]
    samples[:, damaged_chirps] = 3 * np.sqrt(np.mean(np.abs(samples) ** 2)) * noise
    return samples


@nightly
def test_damaged_chirp_of_static_scene_gives_no_false_detections(tmp_path, capsys):
    samples = simulate_static_samples(make_radar(), [20])

    document = run_bare(tmp_path, capsys, samples)

    # Zeros give sidelobes of -36 dB at all velocities. Four maps of 8192 cells at a probability of
    # 1e-6: more than 3 false detections once in 10 million.
    rows = document["detections"]
    others = [r for r in rows if abs(r["range_m"] - 12) > 0.5 or abs(r["velocity_m_per_s"]) > 0.5]
    assert len(rows) - len(others) >= 2
    assert len(others) <= 3


def test_samples_as_recorded_and_undo_of_repair(tmp_path, capsys):
    samples = simulate_static_samples(make_radar(), [20])
    samples[:, :, 2] = 0

    document = run_bare(tmp_path, capsys, samples, "--set", "recording.repair_faults=false")

    assert len(document["radar"]["array"]["rx_m"]) == 4
    assert finding_text(document, "recording.repair_faults") == ""
    assert "chirp 20 of frames 0 to 1" in finding_text(document, "recording.chirps")


@pytest.fixture
def damaged_recording(tmp_path) -> dc.Recording:
    """Recording with a dead receiver, and noise in place of chirp 20."""
    radar = make_radar()
    samples = simulate_static_samples(radar, [20])
    samples[:, :, 2] = 0
    cube = dc.simulate(dc.Scene(targets=[]), radar, n_frames=2, impairments=[])
    dc.write(dc.recording_from_cube(cube.copy(data=samples), radar), tmp_path / "x.zarr")
    return dc.open(tmp_path / "x.zarr")


def assert_repaired(cube, damaged_recording):
    """Check that a cube has the working receivers, and chirp 20 like its neighbours."""
    recorded = damaged_recording.cube.values[:, :, [0, 1, 3]]
    assert cube.sizes["rx"] == 3
    others = np.arange(64) != 20
    assert np.array_equal(cube.values[:, others], recorded[:, others])
    difference = np.abs(cube.values[:, 20] - cube.values[:, 19])
    # The target is static: chirps differ by noise, 40 dB below the noise that replaced chirp 20.
    assert np.mean(difference**2) < 0.1 * np.mean(np.abs(recorded[:, 20]) ** 2)


def test_result_contains_processed_samples(damaged_recording):
    source = RecordingSource(path=str(damaged_recording.path))
    result = dc.run(dc.Scenario(recording=source))

    assert_repaired(result.cube, damaged_recording)
    assert_repaired(xr.concat(result.frames(), "frame"), damaged_recording)
    as_recorded = dc.run(dc.Scenario(recording=replace(source, repair_faults=False)))
    assert np.array_equal(as_recorded.cube.values, damaged_recording.cube.values)


def test_tune_processes_repaired_frames(damaged_recording):
    source = RecordingSource(path=str(damaged_recording.path))
    recorded = LabelledRecording(
        scenario=dc.Scenario(recording=source),
        truth=dc.Scene(targets=[dc.Target(name="t", position_m=(12, 0, 0), rcs_m2=1000)]),
    )
    runner = RecordingTrialRunner(recorded, (dc.scores.DetectionProbability(),))

    assert_repaired(runner.recording.cube, damaged_recording)
    assert runner.radar.array.n_rx == 3


@nightly
def test_twin_simulates_repaired_frame(damaged_recording):
    twin = dc.twin(damaged_recording)

    assert twin.scenario.radar.array.n_rx == 3
    # Noise in place of a chirp adds to all velocities, 13 dB over the noise of the others.
    assert len(twin.scenario.scene.targets) <= 3
    text = "; ".join(f"{f.value}: {f.fix}" for f in twin.findings)
    assert "receiver 2 left out" in text
    assert "1 of 64 chirps are lost" in text
    assert "dc.twin(recording, repair_faults=False)" in text
    assert dc.twin(damaged_recording, repair_faults=False).scenario.radar.array.n_rx == 4


def test_too_many_damaged_chirps_are_reported(tmp_path, capsys):
    damaged_chirps = [20, 21, 22, 23, 24, 25, 26, 27, 28]
    samples = simulate_static_samples(make_radar(), damaged_chirps)
    samples[:, damaged_chirps] = 0

    document = run_bare(tmp_path, capsys, samples)

    text = finding_text(document, "recording.repair_faults")
    assert "warning: 18 of 128 chirps are zero" in text


def test_mirrored_samples_give_option_for_iq(tmp_path, capsys):
    samples = 1j * simulate_samples(make_radar()).conj()

    document = run_bare(tmp_path, capsys, samples)

    text = finding_text(document, "recording.iq")
    assert "warning" in text
    assert "--iq" in text


def test_warning_of_images_is_a_note_where_the_chain_leaves_them_out():
    warning, other = (
        Finding(level="warning", setting=f"recording.{name}", value="a", expected="b", fix="c")
        for name in ("iq_image", "chirps")
    )
    assert list(note_rejected_images([warning, other], dc.Chain())) == [warning, other]

    image, unchanged = note_rejected_images([warning, other], dc.Chain(image_rejection=2.0))

    assert (image.level, image.value, unchanged) == ("note", "a", other)
    assert image.fix.startswith("no action needed")
