"""A twin of a simulated recording finds what was put into it, and says what it cannot."""

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
from printed import check_captions, check_pdf

NEAR = dc.Target(position_m=(12.3, 1.0, 0), velocity_m_per_s=(-4.7, 0, 0), rcs_m2=0.3)
FAR = dc.Target(position_m=(31.7, -6.0, 0), velocity_m_per_s=(2.2, 0, 0), rcs_m2=30.0)
STILL = dc.Target(position_m=(20.45, 3.0, 0), rcs_m2=5.0)
SLOPED = dc.impairments.ColouredNoise(beat_hz=(0.0, 10e6), level=(1.0, 30.0))


@pytest.fixture(scope="module")
def small(radar):
    """The radar of all tests with fewer samples: 64 ranges and 64 velocities."""
    chirp = replace(radar.frame.chirp, n_samples=128)
    return replace(radar, frame=replace(radar.frame, chirp=chirp, n_chirps=64))


def recorded(radar, *targets, impairments=None, full_scale_w=None, n_frames=1):
    """A recording of a scene; with a full scale it says no watts, and knows no hardware."""
    scene = dc.Scene(targets=targets)
    cube = dc.simulate(scene, radar, impairments=impairments, n_frames=n_frames, seed=3)
    if full_scale_w is None:
        return recording_from_cube(cube, radar)
    cube = (cube / np.sqrt(full_scale_w)).astype(cube.dtype).assign_attrs(units="full scale")
    return recording_from_cube(cube, replace(radar, hardware=None))


def in_radar(radar, sampling):
    chirp = replace(radar.frame.chirp, sampling=sampling)
    return replace(radar, frame=replace(radar.frame, chirp=chirp))


@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_the_targets_of_a_calibrated_recording_come_back_with_their_cross_sections(small, sampling):
    small = in_radar(small, sampling)
    targets = [NEAR, STILL] if sampling == "real" else [NEAR, FAR, STILL]

    made = dc.twin(recorded(small, *targets), seed=8)

    found = made.scenario.scene
    assert len(found.targets) == len(targets)
    assert made.watts_per_unit == 1
    for target in targets:
        # Known but for the noise: 0.02 of a cell, 1.5 % of the power.
        away = [np.linalg.norm(np.subtract(t.position_m, target.position_m)) for t in found.targets]
        twin = found.targets[int(np.argmin(away))]
        assert np.hypot(*twin.position_m[:2]) == pytest.approx(
            np.hypot(*target.position_m[:2]), abs=0.03
        )
        assert float(to_decibels(twin.rcs_m2 / target.rcs_m2)) == pytest.approx(0, abs=0.3)
    assert made.is_within(TwinTolerance(power=10**0.05, cells=0.1))


@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_noise_that_rises_with_range_is_found_within_two_tenths_of_a_decibel(small, sampling):
    small = in_radar(small, sampling)

    made = dc.twin(recorded(small, impairments=[SLOPED]), seed=9)

    assert made.differences.sizes["peak"] == 0
    assert made.scenario.scene.targets == ()
    assert abs(to_decibels(made.noise.ratio)) < 0.2
    (noise,) = made.scenario.impairments
    at = np.array(noise.beat_hz)
    truth_db = np.interp(at, SLOPED.beat_hz, to_decibels(np.array(SLOPED.level)))
    # A stretch is known to 0.3 dB, one standard deviation; at both ends of the band the lobe of
    # the window also takes from the other end.
    off_db = (to_decibels(np.array(noise.level)) - truth_db)[1:-1]
    assert np.all(abs(off_db) < 1.2)
    assert abs(np.mean(off_db)) < 0.2


def test_what_full_scale_is_does_not_change_differences(small):
    one, other = (
        dc.twin(recorded(small, NEAR, FAR, full_scale_w=watts), seed=1) for watts in (1e-9, 1e-4)
    )

    np.testing.assert_allclose(one.differences.power_ratio, other.differences.power_ratio, 1e-3)
    np.testing.assert_allclose(
        one.differences.range_cells, other.differences.range_cells, atol=1e-3
    )
    assert float(one.noise.recorded) == pytest.approx(float(other.noise.recorded), rel=1e-3)
    # Noise of 16 (12 dB) was recorded, and 12 dB is assumed: the factor is nearly the true one.
    assert one.watts_per_unit == pytest.approx(1e-9, rel=0.05)
    assert any(finding.setting == "radar.hardware" for finding in one.findings)


def test_two_points_closer_than_a_lobe_give_the_same_two_peaks(small):
    # 3 cells apart, 4 dB weaker: the lobes of both overlap.
    other = replace(NEAR, position_m=(14.06, 1.0, 0), rcs_m2=0.2)
    made = dc.twin(recorded(small, NEAR, other), seed=2)

    assert made.differences.sizes["peak"] == 2
    np.testing.assert_allclose(to_decibels(made.differences.power_ratio_clean), 0, atol=0.1)
    assert made.is_within(TwinTolerance())


def test_noise_moves_a_peak_by_more_cells_of_a_padded_map(small):
    strong = recorded(small, replace(NEAR, rcs_m2=300.0))
    stds = []
    # A factor that is said needs no calibration, which takes seconds.
    plain = dc.Chain(cfar=dc.Cfar(estimator=dc.cfar.CellAveraging(), offset=15.0))
    for chain in (plain, replace(plain, n_velocity_bins=128)):
        found = dc.twin(strong, chain=chain, max_peaks=1).differences
        stds.append(float(found.cells_std[0] * np.sqrt(found.snr[0])))

    # 64 velocities become 128: a cell is half a bin.
    assert stds[1] == pytest.approx(2 * stds[0], rel=0.01)


def test_leakage_is_told_from_targets_with_its_power(small):
    leakage = dc.impairments.Leakage(isolation=1e9, extra_length_m=1.1)

    made = dc.twin(recorded(small, FAR, impairments=[leakage, dc.impairments.ThermalNoise()]))

    found = made.scenario.impairments[0]
    assert found.kind() == "leakage"
    assert float(to_decibels(found.isolation / leakage.isolation)) == pytest.approx(0, abs=0.3)
    assert found.extra_length_m == pytest.approx(1.1, abs=0.05)
    assert len(made.scenario.scene.targets) == 1


def test_the_scenario_of_a_twin_gives_its_map_again(small, tmp_path):
    from dechirp.config.dumping import dump

    made = dc.twin(recorded(small, NEAR, STILL, full_scale_w=1e-6), seed=6)
    (tmp_path / "twin.yaml").write_text(dump(made.scenario))

    again = dc.run(dc.load(tmp_path / "twin.yaml"))

    np.testing.assert_array_equal(again.power, made.simulated)


def test_the_frame_that_is_chosen_is_the_one_simulated(small):
    small = replace(small, frame=replace(small.frame, period_s=0.2))
    every = recorded(small, NEAR, n_frames=3)

    first, last = (dc.twin(every.select_frames(number, number + 1)) for number in (0, 2))

    assert (first.frame_number, last.frame_number) == (0, 2)
    # 4.7 m/s for 0.4 s, seen a little from the side.
    came = float(first.differences.range[0] - last.differences.range[0])
    assert came == pytest.approx(1.87, abs=0.05)


def test_a_frame_of_one_chirp_is_matched_in_range_alone(small):
    small = replace(small, frame=replace(small.frame, n_chirps=1))
    near, far = (replace(one, velocity_m_per_s=(0, 0, 0)) for one in (NEAR, FAR))

    made = dc.twin(recorded(small, near, replace(far, rcs_m2=1e4)))

    assert made.differences.sizes["peak"] == 2
    assert np.all(made.differences.velocity == 0)
    np.testing.assert_allclose(to_decibels(made.differences.power_ratio_clean), 0, atol=0.1)


def test_samples_without_noise_have_a_twin_without_noise(small):
    made = dc.twin(recorded(small, NEAR, impairments=[]))

    assert made.scenario.impairments == ()
    assert made.differences.sizes["peak"] == 1
    strongest = made.differences.isel(peak=0)
    assert float(to_decibels(strongest.power_ratio)) == pytest.approx(0, abs=0.1)
    assert np.hypot(*made.scenario.scene.targets[0].position_m[:2]) == pytest.approx(
        np.hypot(12.3, 1.0), abs=0.02
    )


def test_full_scale_is_taken_below_what_is_sent_where_no_noise_tells_it(small):
    made = dc.twin(recorded(small, NEAR, impairments=[], full_scale_w=1e-6))

    strongest = float(made.recorded.max())
    assert strongest == pytest.approx(1e-6 * made.scenario.radar.hardware.transmit_power_w)
    assert made.scenario.impairments == ()
    assert float(to_decibels(made.differences.power_ratio[0])) == pytest.approx(0, abs=0.1)
    assert np.isnan(made.noise.ratio)
    assert made.is_within(TwinTolerance())


def test_a_constant_alone_is_leakage_of_its_power(small):
    cube = dc.simulate(dc.Scene(), small, impairments=[])
    constant = (cube + 0.7).astype(cube.dtype).assign_attrs(units="full scale")

    made = dc.twin(recording_from_cube(constant, replace(small, hardware=None)))

    assert float(to_decibels(made.differences.power_ratio[0])) == pytest.approx(0, abs=0.1)
    assert any("silent" in finding.value for finding in made.findings)


def test_samples_cut_off_at_full_scale_are_told_of(small):
    cube = recorded(small, NEAR, full_scale_w=1e-6).cube
    loud = cube / float(abs(cube.real).max()) * 3
    clipped = loud.copy(data=np.clip(loud.real, -1, 1) + 1j * np.clip(loud.imag, -1, 1))
    clipped = clipped.astype(cube.dtype).assign_attrs(units="full scale")

    made = dc.twin(recording_from_cube(clipped, replace(small, hardware=None)))

    assert "recording.clipping" in [finding.setting for finding in made.findings]


def test_a_frame_of_very_many_chirps_has_a_chain_that_can_be_calibrated(small):
    many = replace(small, frame=replace(small.frame, n_chirps=4096))

    made = dc.twin(recorded(many, STILL))

    assert made.differences.sizes["peak"] == 1


def test_max_peaks_keeps_the_strongest_and_says_that_there_are_more(small):
    made = dc.twin(recorded(small, NEAR, FAR, STILL), max_peaks=1)

    assert made.differences.sizes["peak"] == 1
    (told,) = [finding for finding in made.findings if finding.setting == "max_peaks"]
    assert told.value == "3 peaks, of which the 1 strongest are simulated"
    whole = dc.twin(recorded(small, NEAR, FAR, STILL)).differences
    assert float(made.differences.power[0]) == float(whole.power.max())


def test_nothing_but_zeros_is_refused(small):
    cube = dc.simulate(dc.Scene(), small, impairments=[])

    with pytest.raises(dc.RecordingError, match="nothing but zeros"):
        dc.twin(recording_from_cube(cube, small))


def test_samples_that_are_not_finite_are_refused(small):
    cube = dc.simulate(dc.Scene(), small, seed=1)
    cube[0, 3, 0, 5] = np.nan

    with pytest.raises(dc.RecordingError, match="not finite"):
        dc.twin(recording_from_cube(cube, small))


def test_a_number_of_peaks_that_is_none_is_refused(small):
    with pytest.raises(dc.InvalidSetting, match="max_peaks"):
        dc.twin(recorded(small, NEAR), max_peaks=0)


def test_ramps_that_fall_are_refused(small):
    frame = replace(small.frame, modulation=dc.modulations.Triangular(), interval_s=70e-6)
    falling = replace(small, frame=frame)

    with pytest.raises(dc.RecordingError, match="rise and fall"):
        dc.twin(recorded(falling, NEAR))


def test_detections_without_samples_are_refused(small, tmp_path):
    contents = Contents(radar=small, n_frames=1, decode=None, points=xr.Dataset())
    points = Recording(
        path=tmp_path / "points", format="ti-uart", contents=contents, frame_numbers=range(1)
    )

    with pytest.raises(
        dc.RecordingError, match="detections without samples; expected a recording with samples"
    ):
        dc.twin(points)


def call(capsys, *words):
    with pytest.raises(SystemExit) as ended:
        main([*words])
    said = capsys.readouterr()
    return int(ended.value.code or 0), said.out, said.err


@pytest.fixture
def saved(small, tmp_path, monkeypatch):
    """A bare array of full-scale samples, and the settings of its radar beside it."""
    from dechirp.config.dumping import dump

    monkeypatch.chdir(tmp_path)
    samples = recorded(small, NEAR, STILL, full_scale_w=1e-6).cube.values
    np.save("walk.npy", samples / abs(samples).max())
    (tmp_path / "walk.yaml").write_text(dump(replace(small, hardware=None)))
    return tmp_path


def test_the_command_writes_a_page_and_a_scenario_and_says_the_differences(saved, capsys):
    status, out, err = call(
        capsys, "twin", "walk.npy", "--axes", "frame,chirp,rx,sample", "--pdf", "--json"
    )

    assert (status, err) == (0, "")
    document = json.loads(out)
    assert document["passed"] and len(document["differences"]) == 2
    assert abs(document["floor"]["difference_db"]) < 1
    assert dc.load(document["scenario"]).scene is not None
    page = (saved / "dechirp-twin" / "report.html").read_text()
    assert "2 of 2 judged peaks within 1 dB and 0.2 bins" in page
    check_captions(page)
    assert (saved / document["files"]["report.pdf"]).read_bytes() == check_pdf(page)
    assert json.loads((saved / "dechirp-twin" / "twin.json").read_text()) == document


def test_a_twin_of_noise_says_that_no_peak_is_judged(small, tmp_path, monkeypatch, capsys):
    from dechirp.config.dumping import dump

    monkeypatch.chdir(tmp_path)
    np.save("noise.npy", recorded(small, full_scale_w=1e-6).cube.values / 10)
    (tmp_path / "noise.yaml").write_text(dump(replace(small, hardware=None)))

    status, out, _ = call(capsys, "twin", "noise.npy", "--axes", "frame,chirp,rx,sample")

    assert status == 0
    assert re.search(r"Noise difference [\d.]+ dB, no peak to judge", out)


def test_the_answer_no_ends_with_1(saved, capsys):
    asked = ("twin", "walk.npy", "--axes", "frame,chirp,rx,sample", "--power-tolerance", "0.001 dB")

    status, _, _ = call(capsys, *asked)

    assert status == 1


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--power-tolerance", "-1 dB"), "--power-tolerance"),
        (("--bin-tolerance", "many"), "--bin-tolerance"),
        (("--bin-tolerance", "2"), "--bin-tolerance"),
        (("--seed", "-1"), "--seed"),
        (("--frames", "3:4"), "frames"),
    ],
)
def test_wrong_calls_end_with_2_and_write_nothing(saved, capsys, words, said):
    status, out, err = call(
        capsys, "twin", "walk.npy", "--axes", "frame,chirp,rx,sample", *words, "--json"
    )

    assert status == 2
    assert said in out + err
    assert not (saved / "dechirp-twin").exists()


def test_without_a_radar_the_call_is_wrong(saved, capsys):
    (saved / "walk.yaml").unlink()

    status, out, _ = call(capsys, "twin", "walk.npy", "--axes", "frame,chirp,rx,sample", "--json")

    assert status == 2
    assert json.loads(out)["errors"]
