"""`dechirp convert`: round trips of every writer, simulated scenes, maps, and errors."""

import csv
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.cli.main import main
from dechirp.core.errors import RecordingError
from dechirp.processing.chain import Chain
from dechirp.processing.range_doppler_map import power_map
from dechirp.recordings.convert import find_writer
from dechirp.recordings.writers.base import Writer
from formats.native_recordings import (
    limit_file_size,
    make_complex_code_recording,
    make_gap_recording,
    make_radar,
    make_table_recording,
)
from formats.test_ti_uart import encode_scene as points_of_frame
from nightly import nightly, nightly_except

pytestmark = pytest.mark.usefixtures("without_figures")


WRITERS = Writer.members()
SUFFIXES = [suffix for writer in WRITERS.values() for suffix in writer.suffixes]
DETECTION_WRITERS = ("mcap", "ros2-bag")
"""Writers of detections without samples."""
MAP_WRITERS = ("csv",)
SAMPLE_WRITERS = [kind for kind in WRITERS if kind not in (*DETECTION_WRITERS, *MAP_WRITERS)]
FLOAT_WRITERS = [kind for kind in SAMPLE_WRITERS if kind != "dca1000"]
"""Writers that store floats; a DCA1000 capture has 16 bits."""

SCENARIO = """\
name: two-cars
seed: 5
n_frames: 3
radar:
  frame:
    chirp: {start_frequency: 77 GHz, slope: 20 MHz/us, adc_start: 2 us, ramp_duration: 30 us,
            sample_rate: 10 MHz, n_samples: 128, sampling: complex}
    n_chirps: 32
    interval: 35 us
    period: 50 ms
  array: {rx: [[0, 0, 0], [0, 1.95 mm, 0]]}
  hardware: {transmit_power: 12 dBm, antenna_gain: 10 dBi, noise_factor: 12 dB}
scene:
  targets:
    - {name: near, position: [20 m, 2 m, 0 m], velocity: [5 m/s, 0 m/s, 0 m/s], rcs: 10 dBsm}
    - {name: far, position: [45 m, -4 m, 0 m], velocity: [-8 m/s, 0 m/s, 0 m/s], rcs: 20 dBsm}
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.yaml").write_text(SCENARIO)
    return tmp_path


def run_cli(capsys, *arguments) -> tuple[int, str, str]:
    capsys.readouterr()
    with pytest.raises(SystemExit) as exit_info:
        main(["convert", *map(str, arguments)])
    captured = capsys.readouterr()
    return int(exit_info.value.code or 0), captured.out, captured.err


def run_invalid(capsys, *arguments) -> dict:
    status, out, err = run_cli(capsys, *arguments, "--json")
    assert (status, err) == (2, "")
    (error,) = json.loads(out)["errors"]
    return error


def read_all_files(folder):
    return {
        file.relative_to(folder).as_posix(): file.read_bytes()
        for file in folder.rglob("*")
        if file.is_file()
    }


@nightly
@pytest.mark.parametrize("kind", FLOAT_WRITERS)
@pytest.mark.parametrize(
    "make_recording",
    [make_gap_recording, make_complex_code_recording, make_table_recording],
)
def test_samples_and_tables_survive_conversion_to_every_format_and_back(
    folder, capsys, kind, make_recording
):
    recording = make_recording()
    dc.write(recording, "in.zarr")
    out = f"out{WRITERS[kind].suffixes[0]}"

    status, output, err = run_cli(capsys, "in.zarr", out, "--json")
    document = json.loads(output)
    assert (status, err) == (0, "")
    assert document["format"] == kind
    assert document["frames"] == 3
    assert document["findings"] == []
    assert document["written"][0] == out
    assert all((folder / name).exists() for name in document["written"])
    status, _, err = run_cli(capsys, out, "back.zarr", "--quiet")
    assert (status, err) == (0, "")

    for copy in (dc.open(out), dc.open("back.zarr")):
        assert copy.radar == recording.radar
        assert copy.cube.values.tobytes() == recording.cube.values.tobytes()
        assert copy.contents.scale == recording.contents.scale
        xr.testing.assert_identical(copy.cube.drop_attrs(), recording.cube.drop_attrs())
        assert set(copy.tables) == set(recording.tables)
        for name, table in recording.tables.items():
            xr.testing.assert_identical(copy.tables[name], table)


@pytest.mark.parametrize("kind", nightly_except(3, SAMPLE_WRITERS))
def test_converted_scene_contains_samples_and_truth(folder, capsys, kind):
    out = f"out{WRITERS[kind].suffixes[0]}"
    status, _, err = run_cli(capsys, "scene.yaml", out, "--frames", "2")
    assert (status, err) == (0, "")

    scenario = dc.load("scene.yaml", ["n_frames=2"])
    result = dc.run(scenario)
    recording = dc.open(out)
    xr.testing.assert_identical(recording.tables["truth"], result.truth)
    assert recording.radar == result.radar
    if kind in FLOAT_WRITERS:
        assert recording.cube.values.tobytes() == result.cube.values.tobytes()
    detections = dc.detect(recording.cube, recording.radar)
    assert detections.sizes == result.detections.sizes
    assert np.allclose(detections.range, result.detections.range, atol=1e-3)


@pytest.mark.parametrize(
    "kind", nightly_except(("hdf5", "mcap"), [*SAMPLE_WRITERS, *DETECTION_WRITERS])
)
def test_converted_run_contains_detections_and_truth(folder, capsys, kind):
    pytest.importorskip("mcap" if kind == "mcap" else "rosbags" if kind == "ros2-bag" else "numpy")
    with pytest.raises(SystemExit):
        main(["run", "scene.yaml", "--out", "run", "--quiet"])
    run_recording = dc.open("run")
    assert {"detections", "truth"} <= set(run_recording.tables)
    out = f"out{WRITERS[kind].suffixes[0]}"
    status, _, err = run_cli(capsys, "run", out)
    assert (status, err) == (0, "")
    recording = dc.open(out)
    tables = {
        **recording.tables,
        **({} if recording.points is None else {"detections": recording.points}),
    }
    for name in ("detections", "truth"):
        for column, variable in run_recording.tables[name].variables.items():
            np.testing.assert_array_equal(tables[name][column], variable, f"{name}.{column}")


@pytest.mark.parametrize("kind", DETECTION_WRITERS)
def test_scene_is_converted_to_point_clouds_of_its_detections(folder, capsys, kind):
    pytest.importorskip("mcap" if kind == "mcap" else "rosbags")
    out = f"out{WRITERS[kind].suffixes[0]}"
    status, _, err = run_cli(capsys, "scene.yaml", out)
    assert (status, err) == (0, "")
    recording, result = dc.open(out), dc.run(dc.load("scene.yaml"))
    assert recording.radar == result.radar
    assert recording.points.sizes["detection"] > 0
    xr.testing.assert_identical(recording.points, result.detections)
    xr.testing.assert_identical(recording.tables["truth"], result.truth)


@pytest.mark.parametrize("kind", DETECTION_WRITERS)
def test_point_clouds_of_recording_without_detections_suggest_run(folder, capsys, kind):
    pytest.importorskip("mcap" if kind == "mcap" else "rosbags")
    dc.write(make_complex_code_recording(), "in.zarr")
    error = run_invalid(capsys, "in.zarr", f"out{WRITERS[kind].suffixes[0]}")
    assert error["fix"].count("dechirp ") == 2


def test_conversion_reports_change_of_scale(folder, capsys):
    for suffix, expected_names in (("bin", {"scale"}), ("npz", set())):
        _, out, _ = run_cli(capsys, "scene.yaml", f"x.{suffix}", "--json")
        names = {finding["setting"] for finding in json.loads(out)["findings"]}
        assert names & {"scale"} == expected_names
    _, out, _ = run_cli(capsys, "x.bin", "y.npz", "--json")
    run_cli(capsys, "y.npz", "z.bin")
    assert Path("z.bin").read_bytes() == Path("x.bin").read_bytes()


@nightly
def test_frames_option_selects_frames_of_recording(folder, capsys):
    recording = make_table_recording()
    dc.write(recording, "in.zarr")
    status, out, _ = run_cli(capsys, "in.zarr", "out.npz", "--frames", "1:3")
    assert status == 0
    assert out.splitlines()[0] == "Written: out.npz"
    assert np.array_equal(dc.open("out.npz").cube.values, recording.cube.values[1:])


def test_radar_option_overrides_radar_of_recording(folder, capsys):
    dc.write(make_complex_code_recording(), "in.zarr")
    text = SCENARIO[SCENARIO.index("  frame:") : SCENARIO.index("scene:")].replace("\n  ", "\n")
    text = text.replace("n_samples: 128", "n_samples: 32").replace("n_chirps: 32", "n_chirps: 6")
    (folder / "radar.yaml").write_text(text.replace("period: 50 ms", "period: 80 ms").lstrip(" "))
    status, _, err = run_cli(capsys, "in.zarr", "out.npz", "--radar", "radar.yaml")
    assert (status, err) == (0, "")
    assert dc.open("out.npz").radar.frame.period_s == 0.08


# --- Maps -----------------------------------------------------------------------------


def test_csv_map_has_ranges_in_columns_velocities_in_rows_and_dbm(folder, capsys):
    status, out, _ = run_cli(capsys, "scene.yaml", "map.csv", "--frames", "1")
    assert status == 0
    assert "not read back" in out

    with Path("map.csv").open(newline="") as file:
        corner, *ranges_m = next(rows := csv.reader(file))
        table = np.array([[float(cell) for cell in row] for row in rows])
    scenario = dc.load("scene.yaml", ["n_frames=1"])
    frame = dc.run(scenario).cube.isel(frame=0)
    power = power_map(frame, scenario.radar, Chain())
    assert corner == "power in dBm: velocity_m_per_s down and range_m across"
    assert np.allclose(np.array(ranges_m, float), power.range, rtol=1e-5)
    assert np.allclose(table[:, 0], power.velocity, rtol=1e-5, atol=1e-5)
    assert np.allclose(table[:, 1:], 10 * np.log10(power) + 30, atol=0.0051)
    row, column = np.unravel_index(table[:, 1:].argmax(), table[:, 1:].shape)
    assert abs(float(ranges_m[column]) - np.hypot(20, 2)) < 0.6
    assert abs(table[row, 0] - 5) < 1.8


def test_map_of_uncalibrated_samples_is_in_dbfs(folder, capsys):
    radar = make_radar()
    cube = make_complex_code_recording().cube.isel(frame=slice(0, 1))
    cube = (cube / abs(cube).max()).assign_attrs(units="1")
    dc.write(dc.recording_from_cube(cube, radar), "in.npz")
    assert run_cli(capsys, "in.npz", "map.csv")[0] == 0
    with Path("map.csv").open(newline="") as file:
        assert next(csv.reader(file))[0].startswith("power in dBFS:")


def test_several_frames_give_numbered_maps(folder, capsys):
    suffix = ".csv"
    status, out, _ = run_cli(capsys, "scene.yaml", f"map{suffix}", "--json")
    names = [f"map_000{number}{suffix}" for number in range(3)]
    assert status == 0
    assert json.loads(out)["written"] == names
    assert {file.name for file in folder.iterdir()} == {"scene.yaml", *names}
    assert len({(folder / name).read_bytes() for name in names}) == 3

    error = run_invalid(capsys, "scene.yaml", f"map{suffix}")
    assert error["value"] == f"map_0000{suffix} and 2 more, which already exist"


def test_map_files_are_not_readable(folder, capsys):
    for suffix in MAP_WRITERS:
        assert run_cli(capsys, "scene.yaml", f"map.{suffix}", "--frames", "1")[0] == 0
        with pytest.raises(RecordingError):
            dc.open(f"map.{suffix}")


# --- Invalid calls --------------------------------------------------------------------


def test_help_lists_every_suffix(capsys):
    _, out, _ = run_cli(capsys, "--help")
    help_words = out.replace(",", " ").split()
    assert [suffix for suffix in SUFFIXES if suffix not in help_words] == []


def test_every_suffix_belongs_to_one_format():
    assert len(set(SUFFIXES)) == len(SUFFIXES)
    for kind, writer in WRITERS.items():
        for suffix in writer.suffixes:
            assert find_writer(Path(f"x{suffix}")).kind() == kind


@pytest.mark.parametrize(
    ("out", "fix"),
    [
        ("x.hdf", "did you mean .hdf5?"),
        ("x.zar", "did you mean .zarr?"),
        ("x", "change its suffix, or give --to FORMAT"),
    ],
)
def test_rejects_unknown_suffix_and_suggests_nearest(folder, capsys, out, fix):
    error = run_invalid(capsys, "scene.yaml", out)
    assert (error["setting"], error["value"], error["fix"]) == ("OUT", out, fix)
    assert ".zarr (zarr)" in error["expected"]
    assert not (folder / out).exists()


def test_to_option_sets_format_for_unknown_suffix(folder, capsys):
    dc.write(make_complex_code_recording(), "in.zarr")
    assert run_cli(capsys, "in.zarr", "x.data", "--to", "hdf5")[0] == 0
    assert dc.open("x.data").format == "hdf5"
    error = run_invalid(capsys, "in.zarr", "y.data", "--to", "hdf")
    assert (error["setting"], error["fix"]) == ("--to", "did you mean hdf5?")


def test_missing_recording_is_named(folder, capsys):
    error = run_invalid(capsys, "nowhere.bin", "x.h5")
    assert error["file"] == "nowhere.bin"
    assert "no such file" in error["value"]
    assert not (folder / "x.h5").exists()


def test_rejects_frames_beyond_end_of_recording(folder, capsys):
    dc.write(make_complex_code_recording(), "in.zarr")
    assert (
        "of 3 frames, with frames"
        in run_invalid(capsys, "in.zarr", "x.h5", "--frames", "2:9")["value"]
    )
    assert run_invalid(capsys, "in.zarr", "x.h5", "--frames", "many")["setting"] == "--frames"
    assert not (folder / "x.h5").exists()


def test_existing_output_is_replaced_only_with_replace_option(folder, capsys):
    dc.write(make_complex_code_recording(), "in.zarr")
    (folder / "x.npz").write_text("mine")
    error = run_invalid(capsys, "in.zarr", "x.npz")
    assert error["value"] == "x.npz, which already exists"
    assert (folder / "x.npz").read_text() == "mine"
    assert run_cli(capsys, "in.zarr", "x.npz", "--replace")[0] == 0
    assert dc.open("x.npz").n_frames == 3

    foreign_folder = folder / "folder.zarr"
    foreign_folder.mkdir()
    (foreign_folder / "mine.txt").write_text("mine")
    error = run_invalid(capsys, "in.zarr", foreign_folder, "--replace")
    assert error["setting"] == "OUT"
    assert "a folder with mine.txt" in error["value"]


def test_existing_companion_file_is_not_replaced(folder, capsys):
    dc.write(make_complex_code_recording(), "in.zarr")
    (folder / "x.sigmf-data").write_text("mine")
    assert (
        "x.sigmf-data, which already exists"
        in run_invalid(capsys, "in.zarr", "x.sigmf-meta")["value"]
    )


@pytest.mark.parametrize("out", ["run.zarr", "./run.zarr", "run.zarr/x.h5", "link.zarr"])
def test_input_is_never_changed(folder, capsys, out):
    dc.write(make_complex_code_recording(), "run.zarr")
    (folder / "link.zarr").symlink_to("run.zarr")
    old_files = read_all_files(folder)
    error = run_invalid(capsys, "run.zarr", out, "--replace")
    assert error["setting"] == "OUT"
    assert error["expected"] == "a path outside IN, which must not change"
    assert read_all_files(folder) == old_files


def test_folder_that_contains_input_is_not_replaced(folder, capsys):
    dc.write(make_complex_code_recording(), "all.zarr")
    (folder / "all.zarr" / "in.npz").write_bytes(b"")
    dc.write(make_complex_code_recording(), folder / "in.npz")
    shutil.copy(folder / "in.npz", folder / "all.zarr" / "in.npz")
    error = run_invalid(capsys, "all.zarr/in.npz", "all.zarr", "--replace")
    assert error["value"] == "all.zarr, around IN"


def test_rejects_output_path_that_is_not_writable(folder, capsys):
    dc.write(make_complex_code_recording(), "in.zarr")
    (folder / "file").write_text("")
    for kind in FLOAT_WRITERS:
        error = run_invalid(capsys, "in.zarr", f"file/x{WRITERS[kind].suffixes[0]}")
        assert error["setting"] == "OUT", kind
        assert "not writable" in error["value"], kind


@nightly
@pytest.mark.parametrize("kind", [*FLOAT_WRITERS, *MAP_WRITERS])
def test_full_disk_keeps_existing_output(folder, capsys, kind):
    dc.write(make_table_recording(), "in.zarr")
    out = f"out{WRITERS[kind].suffixes[0]}"
    assert run_cli(capsys, "in.zarr", out, "--frames", "1")[0] == 0
    old_files = read_all_files(folder)
    with limit_file_size(300):
        error = run_invalid(capsys, "in.zarr", out, "--frames", "1:2", "--replace")
    assert (error["setting"], "not writable" in error["value"]) == ("OUT", True)
    assert read_all_files(folder) == old_files


@pytest.mark.parametrize("kind", [*SAMPLE_WRITERS, *MAP_WRITERS])
def test_rejects_conversion_of_detections_to_sample_formats(folder, capsys, kind):
    (folder / "points.dat").write_bytes(b"".join(points_of_frame(n) for n in range(3)))
    error = run_invalid(capsys, "points.dat", f"out{WRITERS[kind].suffixes[0]}")
    assert "contains detections without samples" in error["value"]


def test_invalid_scene_is_reported_with_line(folder, capsys):
    (folder / "scene.yaml").write_text(SCENARIO.replace("n_chirps: 32", "n_chirps: -1"))
    error = run_invalid(capsys, "scene.yaml", "x.zarr")
    assert (error["file"], error["line"]) == ("scene.yaml", 8)
    assert run_scene_with_device(capsys)["setting"] == "--device"
    assert not (folder / "x.zarr").exists()


def run_scene_with_device(capsys) -> dict:
    """Convert a scene with an option for recordings only, and return the error."""
    Path("good.yaml").write_text(SCENARIO)
    return run_invalid(capsys, "good.yaml", "x.zarr", "--device", "xwr1843")
