"""`dechirp convert`: every ending in and out again, simulated scenes, and every way to be wrong."""

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
from formats.containers import of_complex_codes, of_lost_chirps, of_tables, room_for, small
from formats.test_ti_uart import scene as points_of_frame

WRITERS = Writer.members()
ENDINGS = [ending for made in WRITERS.values() for ending in made.suffixes]
CLOUDS = ("mcap", "ros2-bag")
"""Writers of detections alone."""
MAPS = ("csv",)
SAMPLES = [kind for kind in WRITERS if kind not in (*CLOUDS, *MAPS)]
EXACT = [kind for kind in SAMPLES if kind != "dca1000"]
"""Writers that keep floats; a DCA1000 has 16 bits."""

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


def call(capsys, *words) -> tuple[int, str, str]:
    capsys.readouterr()
    with pytest.raises(SystemExit) as ended:
        main(["convert", *map(str, words)])
    said = capsys.readouterr()
    return int(ended.value.code or 0), said.out, said.err


def mistake(capsys, *words) -> dict:
    status, out, err = call(capsys, *words, "--json")
    assert (status, err) == (2, "")
    (one,) = json.loads(out)["errors"]
    return one


def there(folder):
    return {
        file.relative_to(folder).as_posix(): file.read_bytes()
        for file in folder.rglob("*")
        if file.is_file()
    }


@pytest.mark.parametrize("kind", EXACT)
@pytest.mark.parametrize("made", [of_lost_chirps, of_complex_codes, of_tables])
def test_every_format_of_samples_goes_to_every_reader_and_back(folder, capsys, kind, made):
    recording = made()
    dc.write(recording, "in.zarr")
    out = f"out{WRITERS[kind].suffixes[0]}"

    status, said, err = call(capsys, "in.zarr", out, "--json")
    document = json.loads(said)
    assert (status, err) == (0, "")
    assert document["format"] == kind
    assert document["frames"] == 3
    assert document["findings"] == []
    assert document["written"][0] == out
    assert all((folder / name).exists() for name in document["written"])
    status, _, err = call(capsys, out, "back.zarr", "--quiet")
    assert (status, err) == (0, "")

    for one in (dc.open(out), dc.open("back.zarr")):
        assert one.radar == recording.radar
        assert one.cube.values.tobytes() == recording.cube.values.tobytes()
        assert one.contents.scale == recording.contents.scale
        xr.testing.assert_identical(one.cube.drop_attrs(), recording.cube.drop_attrs())
        assert set(one.tables) == set(recording.tables)
        for name, table in recording.tables.items():
            xr.testing.assert_identical(one.tables[name], table)


@pytest.mark.parametrize("kind", SAMPLES)
def test_a_simulated_scene_feeds_other_tools_with_its_truth(folder, capsys, kind):
    out = f"out{WRITERS[kind].suffixes[0]}"
    status, _, err = call(capsys, "scene.yaml", out, "--frames", "2")
    assert (status, err) == (0, "")

    scenario = dc.load("scene.yaml", ["n_frames=2"])
    result = dc.run(scenario)
    opened = dc.open(out)
    xr.testing.assert_identical(opened.tables["truth"], result.truth)
    assert opened.radar == result.radar
    if kind in EXACT:
        assert opened.cube.values.tobytes() == result.cube.values.tobytes()
    found = dc.detect(opened.cube, opened.radar)
    assert found.sizes == result.detections.sizes
    assert np.allclose(found.range, result.detections.range, atol=1e-3)


@pytest.mark.parametrize("kind", [*SAMPLES, *CLOUDS])
def test_a_run_is_converted_with_its_detections(folder, capsys, kind):
    pytest.importorskip("mcap" if kind == "mcap" else "rosbags" if kind == "ros2-bag" else "numpy")
    with pytest.raises(SystemExit):
        main(["run", "scene.yaml", "--out", "run", "--quiet"])
    run = dc.open("run")
    assert {"detections", "truth"} <= set(run.tables)
    out = f"out{WRITERS[kind].suffixes[0]}"
    status, _, err = call(capsys, "run", out)
    assert (status, err) == (0, "")
    opened = dc.open(out)
    tables = {**opened.tables, **({} if opened.points is None else {"detections": opened.points})}
    for name in ("detections", "truth"):
        for column, variable in run.tables[name].variables.items():
            np.testing.assert_array_equal(tables[name][column], variable, f"{name}.{column}")


@pytest.mark.parametrize("kind", CLOUDS)
def test_a_scene_becomes_clouds_of_what_a_run_of_it_detects(folder, capsys, kind):
    pytest.importorskip("mcap" if kind == "mcap" else "rosbags")
    out = f"out{WRITERS[kind].suffixes[0]}"
    status, _, err = call(capsys, "scene.yaml", out)
    assert (status, err) == (0, "")
    opened, result = dc.open(out), dc.run(dc.load("scene.yaml"))
    assert opened.radar == result.radar
    assert opened.points.sizes["detection"] > 0
    xr.testing.assert_identical(opened.points, result.detections)
    xr.testing.assert_identical(opened.tables["truth"], result.truth)


@pytest.mark.parametrize("kind", CLOUDS)
def test_a_recording_without_detections_is_to_be_run_first(folder, capsys, kind):
    pytest.importorskip("mcap" if kind == "mcap" else "rosbags")
    dc.write(of_complex_codes(), "in.zarr")
    one = mistake(capsys, "in.zarr", f"out{WRITERS[kind].suffixes[0]}")
    assert one["fix"].count("dechirp ") == 2


def test_what_a_format_did_to_the_samples_is_said(folder, capsys):
    for ending, settings in (("bin", {"scale"}), ("npz", set())):
        _, out, _ = call(capsys, "scene.yaml", f"x.{ending}", "--json")
        said = {one["setting"] for one in json.loads(out)["findings"]}
        assert said & {"scale"} == settings
    _, out, _ = call(capsys, "x.bin", "y.npz", "--json")
    call(capsys, "y.npz", "z.bin")
    assert Path("z.bin").read_bytes() == Path("x.bin").read_bytes()


def test_a_part_of_a_recording_is_converted(folder, capsys):
    recording = of_tables()
    dc.write(recording, "in.zarr")
    status, out, _ = call(capsys, "in.zarr", "out.npz", "--frames", "1:3")
    assert status == 0
    assert out.splitlines()[0] == "Written: out.npz"
    assert np.array_equal(dc.open("out.npz").cube.values, recording.cube.values[1:])


def test_the_radar_that_is_told_wins(folder, capsys):
    dc.write(of_complex_codes(), "in.zarr")
    text = SCENARIO[SCENARIO.index("  frame:") : SCENARIO.index("scene:")].replace("\n  ", "\n")
    text = text.replace("n_samples: 128", "n_samples: 32").replace("n_chirps: 32", "n_chirps: 6")
    (folder / "radar.yaml").write_text(text.replace("period: 50 ms", "period: 80 ms").lstrip(" "))
    status, _, err = call(capsys, "in.zarr", "out.npz", "--radar", "radar.yaml")
    assert (status, err) == (0, "")
    assert dc.open("out.npz").radar.frame.period_s == 0.08


# --- Maps -----------------------------------------------------------------------------


def test_a_table_of_the_map_has_ranges_across_velocities_down_and_decibels(folder, capsys):
    status, out, _ = call(capsys, "scene.yaml", "map.csv", "--frames", "1")
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


def test_samples_that_are_not_calibrated_are_in_decibels_below_full_scale(folder, capsys):
    radar = small()
    cube = of_complex_codes().cube.isel(frame=slice(0, 1))
    cube = (cube / abs(cube).max()).assign_attrs(units="full scale")
    dc.write(dc.recording_from_cube(cube, radar), "in.npz")
    assert call(capsys, "in.npz", "map.csv")[0] == 0
    with Path("map.csv").open(newline="") as file:
        assert next(csv.reader(file))[0].startswith("power in dBFS:")


def test_several_frames_become_numbered_maps(folder, capsys):
    ending = ".csv"
    status, out, _ = call(capsys, "scene.yaml", f"map{ending}", "--json")
    names = [f"map_000{number}{ending}" for number in range(3)]
    assert status == 0
    assert json.loads(out)["written"] == names
    assert {file.name for file in folder.iterdir()} == {"scene.yaml", *names}
    assert len({(folder / name).read_bytes() for name in names}) == 3

    one = mistake(capsys, "scene.yaml", f"map{ending}")
    assert one["value"] == f"map_0000{ending} and 2 more, which already exist"


def test_maps_are_not_read_back(folder, capsys):
    for ending in MAPS:
        assert call(capsys, "scene.yaml", f"map.{ending}", "--frames", "1")[0] == 0
        with pytest.raises(RecordingError):
            dc.open(f"map.{ending}")


# --- What is wrong --------------------------------------------------------------------


def test_the_help_names_every_ending(capsys):
    _, out, _ = call(capsys, "--help")
    words = out.replace(",", " ").split()
    assert [ending for ending in ENDINGS if ending not in words] == []


def test_every_ending_is_of_one_format():
    assert len(set(ENDINGS)) == len(ENDINGS)
    for kind, made in WRITERS.items():
        for ending in made.suffixes:
            assert find_writer(Path(f"x{ending}")).kind() == kind


@pytest.mark.parametrize(
    ("out", "fix"),
    [
        ("x.hdf", "did you mean .hdf5?"),
        ("x.zar", "did you mean .zarr?"),
        ("x", "change its suffix, or give --to FORMAT"),
    ],
)
def test_an_ending_that_is_none_is_refused_with_the_nearest(folder, capsys, out, fix):
    one = mistake(capsys, "scene.yaml", out)
    assert (one["setting"], one["value"], one["fix"]) == ("OUT", out, fix)
    assert ".zarr (zarr)" in one["expected"]
    assert not (folder / out).exists()


def test_a_format_is_told_where_the_ending_does_not(folder, capsys):
    dc.write(of_complex_codes(), "in.zarr")
    assert call(capsys, "in.zarr", "x.data", "--to", "hdf5")[0] == 0
    assert dc.open("x.data").format == "hdf5"
    one = mistake(capsys, "in.zarr", "y.data", "--to", "hdf")
    assert (one["setting"], one["fix"]) == ("--to", "did you mean hdf5?")


def test_a_recording_that_is_not_there_is_named(folder, capsys):
    one = mistake(capsys, "nowhere.bin", "x.h5")
    assert one["file"] == "nowhere.bin"
    assert "no such file" in one["value"]
    assert not (folder / "x.h5").exists()


def test_frames_that_are_not_there_are_refused(folder, capsys):
    dc.write(of_complex_codes(), "in.zarr")
    assert (
        "of 3 frames, with frames" in mistake(capsys, "in.zarr", "x.h5", "--frames", "2:9")["value"]
    )
    assert mistake(capsys, "in.zarr", "x.h5", "--frames", "many")["setting"] == "--frames"
    assert not (folder / "x.h5").exists()


def test_what_is_there_is_replaced_only_when_that_is_said(folder, capsys):
    dc.write(of_complex_codes(), "in.zarr")
    (folder / "x.npz").write_text("mine")
    one = mistake(capsys, "in.zarr", "x.npz")
    assert one["value"] == "x.npz, which already exists"
    assert (folder / "x.npz").read_text() == "mine"
    assert call(capsys, "in.zarr", "x.npz", "--replace")[0] == 0
    assert dc.open("x.npz").n_frames == 3

    other = folder / "folder.zarr"
    other.mkdir()
    (other / "mine.txt").write_text("mine")
    one = mistake(capsys, "in.zarr", other, "--replace")
    assert one["setting"] == "OUT"
    assert "a folder with mine.txt" in one["value"]


def test_a_file_of_others_that_belongs_to_out_is_not_replaced_unsaid(folder, capsys):
    dc.write(of_complex_codes(), "in.zarr")
    (folder / "x.sigmf-data").write_text("mine")
    assert (
        "x.sigmf-data, which already exists" in mistake(capsys, "in.zarr", "x.sigmf-meta")["value"]
    )


@pytest.mark.parametrize("out", ["run.zarr", "./run.zarr", "run.zarr/x.h5", "link.zarr"])
def test_the_input_is_never_changed(folder, capsys, out):
    dc.write(of_complex_codes(), "run.zarr")
    (folder / "link.zarr").symlink_to("run.zarr")
    before = there(folder)
    one = mistake(capsys, "run.zarr", out, "--replace")
    assert one["setting"] == "OUT"
    assert one["expected"] == "a path outside IN, which must not change"
    assert there(folder) == before


def test_a_folder_around_the_input_is_not_replaced(folder, capsys):
    dc.write(of_complex_codes(), "all.zarr")
    (folder / "all.zarr" / "in.npz").write_bytes(b"")
    dc.write(of_complex_codes(), folder / "in.npz")
    shutil.copy(folder / "in.npz", folder / "all.zarr" / "in.npz")
    one = mistake(capsys, "all.zarr/in.npz", "all.zarr", "--replace")
    assert one["value"] == "all.zarr, around IN"


def test_a_place_that_cannot_be_written_is_said(folder, capsys):
    dc.write(of_complex_codes(), "in.zarr")
    (folder / "file").write_text("")
    for kind in EXACT:
        one = mistake(capsys, "in.zarr", f"file/x{WRITERS[kind].suffixes[0]}")
        assert one["setting"] == "OUT", kind
        assert "not writable" in one["value"], kind


@pytest.mark.parametrize("kind", [*EXACT, *MAPS])
def test_a_disk_that_fills_leaves_what_was_there(folder, capsys, kind):
    dc.write(of_tables(), "in.zarr")
    out = f"out{WRITERS[kind].suffixes[0]}"
    assert call(capsys, "in.zarr", out, "--frames", "1")[0] == 0
    before = there(folder)
    with room_for(300):
        one = mistake(capsys, "in.zarr", out, "--frames", "1:2", "--replace")
    assert (one["setting"], "not writable" in one["value"]) == ("OUT", True)
    assert there(folder) == before


@pytest.mark.parametrize("kind", [*SAMPLES, *MAPS])
def test_detections_without_samples_are_refused_where_samples_are_needed(folder, capsys, kind):
    (folder / "points.dat").write_bytes(b"".join(points_of_frame(n) for n in range(3)))
    one = mistake(capsys, "points.dat", f"out{WRITERS[kind].suffixes[0]}")
    assert "contains detections without samples" in one["value"]


def test_a_scene_that_cannot_be_simulated_is_named_by_its_line(folder, capsys):
    (folder / "scene.yaml").write_text(SCENARIO.replace("n_chirps: 32", "n_chirps: -1"))
    one = mistake(capsys, "scene.yaml", "x.zarr")
    assert (one["file"], one["line"]) == ("scene.yaml", 8)
    assert mistake_of_option(capsys)["setting"] == "--device"
    assert not (folder / "x.zarr").exists()


def mistake_of_option(capsys) -> dict:
    """Say of a scene what only recordings need to be told."""
    Path("good.yaml").write_text(SCENARIO)
    return mistake(capsys, "good.yaml", "x.zarr", "--device", "xwr1843")
