"""Twins of simulated recordings: recovered targets, noise and leakage, findings and refusals."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.cli.main import main
from dechirp.core.units import to_decibels
from dechirp.experiments.twin.twin import TwinTolerance
from dechirp.recordings.in_memory import recording_from_cube
from dechirp.recordings.readers.base import Contents
from dechirp.recordings.recording import Recording
from nightly import nightly
from page_checks import check_captions, check_pdf_contains_page_text, skip_without_pdf

NEAR = dc.Target(position_m=(12.3, 1.0, 0), velocity_m_per_s=(-4.7, 0, 0), rcs_m2=0.3)
FAR = dc.Target(position_m=(31.7, -6.0, 0), velocity_m_per_s=(2.2, 0, 0), rcs_m2=30.0)
STATIC = dc.Target(position_m=(20.45, 3.0, 0), rcs_m2=5.0)
SLOPED_NOISE = dc.impairments.ColouredNoise(beat_hz=(0.0, 10e6), level=(1.0, 30.0))


@pytest.fixture(scope="module")
def small_radar(radar):
    """Return the common radar with fewer samples: 64 ranges and 64 velocities."""
    chirp = replace(radar.frame.chirp, n_samples=128)
    return replace(radar, frame=replace(radar.frame, chirp=chirp, n_chirps=64))


def make_recording(radar, *targets, impairments=None, full_scale_w=None, n_frames=1):
    """Make a recording of a scene; with a full scale it has no units of power and no hardware."""
    scene = dc.Scene(targets=targets)
    cube = dc.simulate(scene, radar, impairments=impairments, n_frames=n_frames, seed=3)
    if full_scale_w is None:
        return recording_from_cube(cube, radar)
    cube = (cube / np.sqrt(full_scale_w)).astype(cube.dtype).assign_attrs(units="1")
    return recording_from_cube(cube, replace(radar, hardware=None))


def set_sampling(radar, sampling):
    chirp = replace(radar.frame.chirp, sampling=sampling)
    return replace(radar, frame=replace(radar.frame, chirp=chirp))


@nightly
@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_twin_recovers_targets_and_cross_sections(small_radar, sampling):
    small_radar = set_sampling(small_radar, sampling)
    targets = [NEAR, STATIC] if sampling == "real" else [NEAR, FAR, STATIC]

    twin = dc.twin(make_recording(small_radar, *targets), seed=8)

    scene = twin.scenario.scene
    assert len(scene.targets) == len(targets)
    assert twin.watts_per_unit == 1
    for target in targets:
        # Noise gives errors of 0.02 of a cell and 1.5 % of the power.
        distances = [
            np.linalg.norm(np.subtract(t.position_m, target.position_m)) for t in scene.targets
        ]
        twin_target = scene.targets[int(np.argmin(distances))]
        assert np.hypot(*twin_target.position_m[:2]) == pytest.approx(
            np.hypot(*target.position_m[:2]), abs=0.03
        )
        assert float(to_decibels(twin_target.rcs_m2 / target.rcs_m2)) == pytest.approx(0, abs=0.3)
    assert twin.is_twin_within_tolerance(TwinTolerance(power=10**0.05, cells=0.1))


@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_twin_recovers_sloped_noise_within_two_tenths_of_a_db(small_radar, sampling):
    small_radar = set_sampling(small_radar, sampling)

    twin = dc.twin(make_recording(small_radar, impairments=[SLOPED_NOISE]), seed=9)

    assert twin.differences.sizes["peak"] == 0
    assert twin.scenario.scene.targets == ()
    assert abs(to_decibels(twin.noise.ratio)) < 0.2
    (noise,) = twin.scenario.impairments
    beat_hz = np.array(noise.beat_hz)
    truth_db = np.interp(beat_hz, SLOPED_NOISE.beat_hz, to_decibels(np.array(SLOPED_NOISE.level)))
    # The standard deviation of a segment is 0.3 dB; at both ends of the band the main lobe also
    # includes noise of the opposite end.
    error_db = (to_decibels(np.array(noise.level)) - truth_db)[1:-1]
    assert np.all(abs(error_db) < 1.2)
    assert abs(np.mean(error_db)) < 0.2


def test_full_scale_does_not_change_differences(small_radar):
    quiet_twin, loud_twin = (
        dc.twin(make_recording(small_radar, NEAR, FAR, full_scale_w=watts), seed=1)
        for watts in (1e-9, 1e-4)
    )

    np.testing.assert_allclose(
        quiet_twin.differences.power_ratio, loud_twin.differences.power_ratio, 1e-3
    )
    np.testing.assert_allclose(
        quiet_twin.differences.range_cells, loud_twin.differences.range_cells, atol=1e-3
    )
    assert float(quiet_twin.noise.recorded) == pytest.approx(
        float(loud_twin.noise.recorded), rel=1e-3
    )
    # The recorded noise factor is 16 (12 dB) and 12 dB is assumed, so the scale is nearly true.
    assert quiet_twin.watts_per_unit == pytest.approx(1e-9, rel=0.05)
    assert any(finding.setting == "radar.hardware" for finding in quiet_twin.findings)


def test_two_points_closer_than_a_lobe_give_two_matched_peaks(small_radar):
    # 3 cells apart and 4 dB weaker: the main lobes overlap.
    weak_target = replace(NEAR, position_m=(14.06, 1.0, 0), rcs_m2=0.2)
    twin = dc.twin(make_recording(small_radar, NEAR, weak_target), seed=2)

    assert twin.differences.sizes["peak"] == 2
    np.testing.assert_allclose(to_decibels(twin.differences.power_ratio_clean), 0, atol=0.1)
    assert twin.is_twin_within_tolerance(TwinTolerance())


def test_peak_error_in_cells_doubles_on_padded_map(small_radar):
    recording = make_recording(small_radar, replace(NEAR, rcs_m2=300.0))
    stds = []
    # An explicit offset needs no calibration, which would take seconds.
    unpadded_chain = dc.Chain(cfar=dc.Cfar(estimator=dc.cfar.CellAveraging(), offset=15.0))
    for chain in (unpadded_chain, replace(unpadded_chain, n_velocity_bins=128)):
        differences = dc.twin(recording, chain=chain, max_peaks=1).differences
        stds.append(float(differences.cells_std[0] * np.sqrt(differences.snr[0])))

    # 64 velocities are padded to 128: a cell is half a bin.
    assert stds[1] == pytest.approx(2 * stds[0], rel=0.01)


def test_twin_separates_leakage_from_targets(small_radar):
    leakage = dc.impairments.Leakage(isolation=1e9, extra_length_m=1.1)

    twin = dc.twin(
        make_recording(small_radar, FAR, impairments=[leakage, dc.impairments.ThermalNoise()])
    )

    twin_leakage = twin.scenario.impairments[0]
    assert twin_leakage.kind() == "leakage"
    assert float(to_decibels(twin_leakage.isolation / leakage.isolation)) == pytest.approx(
        0, abs=0.3
    )
    assert twin_leakage.extra_length_m == pytest.approx(1.1, abs=0.05)
    assert len(twin.scenario.scene.targets) == 1


def test_scenario_of_twin_reproduces_its_map(small_radar, tmp_path):
    from dechirp.config.dumping import dump_yaml

    twin = dc.twin(make_recording(small_radar, NEAR, STATIC, full_scale_w=1e-6), seed=6)
    (tmp_path / "twin.yaml").write_text(dump_yaml(twin.scenario))

    result = dc.run(dc.load(tmp_path / "twin.yaml"))

    np.testing.assert_array_equal(result.power, twin.simulated)


def test_twin_simulates_selected_frame(small_radar):
    small_radar = replace(small_radar, frame=replace(small_radar.frame, period_s=0.2))
    recording = make_recording(small_radar, NEAR, n_frames=3)

    first, last = (dc.twin(recording.select_frames(number, number + 1)) for number in (0, 2))

    assert (first.frame_number, last.frame_number) == (0, 2)
    # 4.7 m/s for 0.4 s, slightly off boresight.
    displacement_m = float(first.differences.range[0] - last.differences.range[0])
    assert displacement_m == pytest.approx(1.87, abs=0.05)


def test_frame_of_one_chirp_is_matched_in_range_alone(small_radar):
    small_radar = replace(small_radar, frame=replace(small_radar.frame, n_chirps=1))
    near_target, far_target = (
        replace(target, velocity_m_per_s=(0, 0, 0)) for target in (NEAR, FAR)
    )

    twin = dc.twin(make_recording(small_radar, near_target, replace(far_target, rcs_m2=1e4)))

    assert twin.differences.sizes["peak"] == 2
    assert np.all(twin.differences.velocity == 0)
    np.testing.assert_allclose(to_decibels(twin.differences.power_ratio_clean), 0, atol=0.1)


def test_noise_free_samples_have_noise_free_twin(small_radar):
    twin = dc.twin(make_recording(small_radar, NEAR, impairments=[]))

    assert twin.scenario.impairments == ()
    assert twin.differences.sizes["peak"] == 1
    strongest = twin.differences.isel(peak=0)
    assert float(to_decibels(strongest.power_ratio)) == pytest.approx(0, abs=0.1)
    assert np.hypot(*twin.scenario.scene.targets[0].position_m[:2]) == pytest.approx(
        np.hypot(12.3, 1.0), abs=0.02
    )


def test_full_scale_without_noise_is_set_below_transmit_power(small_radar):
    twin = dc.twin(make_recording(small_radar, NEAR, impairments=[], full_scale_w=1e-6))

    strongest = float(twin.recorded.max())
    assert strongest == pytest.approx(1e-6 * twin.scenario.radar.hardware.transmit_power_w)
    assert twin.scenario.impairments == ()
    assert float(to_decibels(twin.differences.power_ratio[0])) == pytest.approx(0, abs=0.1)
    assert np.isnan(twin.noise.ratio)
    assert twin.is_twin_within_tolerance(TwinTolerance())


def test_constant_samples_are_leakage_of_their_power(small_radar):
    cube = dc.simulate(dc.Scene(), small_radar, impairments=[])
    constant = (cube + 0.7).astype(cube.dtype).assign_attrs(units="1")

    twin = dc.twin(recording_from_cube(constant, replace(small_radar, hardware=None)))

    assert float(to_decibels(twin.differences.power_ratio[0])) == pytest.approx(0, abs=0.1)
    assert any("silent" in finding.value for finding in twin.findings)


def test_clipped_samples_give_a_finding(small_radar):
    cube = make_recording(small_radar, NEAR, full_scale_w=1e-6).cube
    amplified_samples = cube / float(abs(cube.real).max()) * 3
    clipped_samples = amplified_samples.copy(
        data=np.clip(amplified_samples.real, -1, 1) + 1j * np.clip(amplified_samples.imag, -1, 1)
    )
    clipped_samples = clipped_samples.astype(cube.dtype).assign_attrs(units="1")

    twin = dc.twin(recording_from_cube(clipped_samples, replace(small_radar, hardware=None)))

    assert "recording.clipping" in [finding.setting for finding in twin.findings]


@nightly
def test_frame_of_4096_chirps_has_chain_that_can_be_calibrated(small_radar):
    long_radar = replace(small_radar, frame=replace(small_radar.frame, n_chirps=4096))

    twin = dc.twin(make_recording(long_radar, STATIC))

    assert twin.differences.sizes["peak"] == 1


def test_max_peaks_keeps_strongest_and_reports_total(small_radar):
    twin = dc.twin(make_recording(small_radar, NEAR, FAR, STATIC), max_peaks=1)

    assert twin.differences.sizes["peak"] == 1
    (finding,) = [finding for finding in twin.findings if finding.setting == "max_peaks"]
    assert finding.value == "3 peaks, of which the 1 strongest are simulated"
    all_differences = dc.twin(make_recording(small_radar, NEAR, FAR, STATIC)).differences
    assert float(twin.differences.power[0]) == float(all_differences.power.max())


def test_rejects_recording_of_zeros(small_radar):
    cube = dc.simulate(dc.Scene(), small_radar, impairments=[])

    with pytest.raises(dc.RecordingError, match="nothing but zeros"):
        dc.twin(recording_from_cube(cube, small_radar))


def test_rejects_samples_that_are_not_finite(small_radar):
    cube = dc.simulate(dc.Scene(), small_radar, seed=1)
    cube[0, 3, 0, 5] = np.nan

    with pytest.raises(dc.RecordingError, match="not finite"):
        dc.twin(recording_from_cube(cube, small_radar))


def test_rejects_max_peaks_of_zero(small_radar):
    with pytest.raises(dc.InvalidSetting, match="max_peaks"):
        dc.twin(make_recording(small_radar, NEAR), max_peaks=0)


def test_rejects_falling_ramps(small_radar):
    frame = replace(small_radar.frame, modulation=dc.modulations.Triangular(), interval_s=70e-6)
    triangular_radar = replace(small_radar, frame=frame)

    with pytest.raises(dc.RecordingError, match="rise and fall"):
        dc.twin(make_recording(triangular_radar, NEAR))


def test_rejects_detections_without_samples(small_radar, tmp_path):
    contents = Contents(radar=small_radar, n_frames=1, decode=None, points=xr.Dataset())
    points = Recording(
        path=tmp_path / "points", format="ti-uart", contents=contents, frame_numbers=range(1)
    )

    with pytest.raises(
        dc.RecordingError, match="detections without samples; expected a recording with samples"
    ):
        dc.twin(points)


def run_command(capsys, *arguments):
    with pytest.raises(SystemExit) as exit_info:
        main([*arguments])
    output = capsys.readouterr()
    return int(exit_info.value.code or 0), output.out, output.err


@pytest.fixture
def saved_capture(small_radar, tmp_path, monkeypatch):
    """Save a bare array of full-scale samples and a sidecar with the settings of its radar."""
    from dechirp.config.dumping import dump_yaml

    monkeypatch.chdir(tmp_path)
    samples = make_recording(small_radar, NEAR, STATIC, full_scale_w=1e-6).cube.values
    np.save("walk.npy", samples / abs(samples).max())
    (tmp_path / "walk.yaml").write_text(dump_yaml(replace(small_radar, hardware=None)))
    return tmp_path


@nightly
def test_command_writes_report_and_scenario_and_prints_differences(saved_capture, capsys):
    skip_without_pdf()
    status, out, err = run_command(
        capsys, "twin", "walk.npy", "--axes", "frame,chirp,rx,sample", "--pdf", "--json"
    )

    assert (status, err) == (0, "")
    document = json.loads(out)
    assert document["passed"] and len(document["differences"]) == 2
    assert abs(document["floor"]["difference_db"]) < 1
    assert dc.load(document["scenario"]).scene is not None
    page = (saved_capture / "dechirp-twin" / "report.html").read_text()
    assert "2 of 2 judged peaks within 1 dB and 0.2 bins" in page
    check_captions(page)
    pdf = (saved_capture / document["files"]["report.pdf"]).read_bytes()
    check_pdf_contains_page_text(page, pdf)
    assert json.loads((saved_capture / "dechirp-twin" / "twin.json").read_text()) == document


@nightly
def test_twin_of_noise_reports_no_peak_to_judge(small_radar, tmp_path, monkeypatch, capsys):
    from dechirp.config.dumping import dump_yaml

    monkeypatch.chdir(tmp_path)
    np.save("noise.npy", make_recording(small_radar, full_scale_w=1e-6).cube.values / 10)
    (tmp_path / "noise.yaml").write_text(dump_yaml(replace(small_radar, hardware=None)))

    status, out, _ = run_command(capsys, "twin", "noise.npy", "--axes", "frame,chirp,rx,sample")

    assert status == 0
    assert re.search(r"Noise difference [\d.]+ dB, no peak to judge", out)


@nightly
def test_failed_tolerance_exits_with_status_1(saved_capture, capsys):
    arguments = (
        "twin",
        "walk.npy",
        "--axes",
        "frame,chirp,rx,sample",
        "--power-tolerance",
        "0.001 dB",
    )

    status, _, _ = run_command(capsys, *arguments)

    assert status == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--power-tolerance", "-1 dB"), "--power-tolerance"),
        (("--bin-tolerance", "many"), "--bin-tolerance"),
        (("--bin-tolerance", "2"), "--bin-tolerance"),
        (("--seed", "-1"), "--seed"),
        (("--frames", "3:4"), "frames"),
    ],
)
def test_invalid_calls_exit_with_status_2_and_write_nothing(
    saved_capture, capsys, arguments, message
):
    status, out, err = run_command(
        capsys, "twin", "walk.npy", "--axes", "frame,chirp,rx,sample", *arguments, "--json"
    )

    assert status == 2
    assert message in out + err
    assert not (saved_capture / "dechirp-twin").exists()


def test_call_without_radar_exits_with_status_2(saved_capture, capsys):
    (saved_capture / "walk.yaml").unlink()

    status, out, _ = run_command(
        capsys, "twin", "walk.npy", "--axes", "frame,chirp,rx,sample", "--json"
    )

    assert status == 2
    assert json.loads(out)["errors"]
