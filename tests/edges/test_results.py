"""Results on disk: complete, readable by others, and never half of anything."""

import csv
import errno
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.config import loading
from dechirp.core.atomic_files import write_text_atomically
from dechirp.core.conventions import CUBE_AXES, axis_coordinate
from dechirp.core.errors import DechirpError
from dechirp.core.table_columns import COLUMNS, dataset_to_records
from dechirp.recordings import cube_store as cube_on_disk
from dechirp.results import results
from dechirp.results.results import FILES, check_output_folder, write_results
from dechirp.results.tables import csv_text, json_text

TEXTS = {"report.html": "<p>new</p>", "scenario.yaml": "name: new\n", "run.json": "{}\n"}


def found(n: int = 2) -> xr.Dataset:
    """Make detections, one a frame; nothing is known of the range error of the last."""
    std = np.full(n, 0.01)
    std[-1:] = np.nan
    columns = {
        "frame": np.arange(n),
        "range": np.linspace(10, 20, n),
        "azimuth": np.full(n, math.pi / 6),
        "snr": np.full(n, 100.0),
        "range_std": std,
    }
    return xr.Dataset({name: ("detection", values) for name, values in columns.items()})


def truth() -> xr.Dataset:
    return xr.Dataset(
        {"range": (("target", "frame"), np.array([[1.0, 2.0], [3.0, 4.0]]))},
        coords={"target": ["car", "lorry"], "frame": [0, 1], "time": ("frame", [0.0, 0.1])},
    )


def samples(radar: dc.Radar, n_frames: int) -> xr.DataArray:
    """Make numbers that tell every sample from every other."""
    chirp = radar.frame.chirp
    shape = (n_frames, radar.frame.n_chirps, radar.array.n_rx, chirp.n_samples)
    values = (np.arange(math.prod(shape)).reshape(shape) * (1 - 1j)).astype(np.complex64)
    coords = {
        name: axis_coordinate(name, np.arange(n) / 10)
        for name, n in zip(CUBE_AXES, shape, strict=True)
    }
    return xr.DataArray(values, dims=CUBE_AXES, coords=coords, attrs={"units": "sqrt(W)"})


def write(out, radar, cube=None, **changes):
    cube = samples(radar, 2) if cube is None else cube
    parts = {
        "frames": (cube.isel(frame=slice(i, i + 1)) for i in range(cube.sizes["frame"])),
        "n_frames": cube.sizes["frame"],
        "radar": radar,
        "detections": found(),
        "truth": truth(),
    }
    return write_results(out, TEXTS, **(parts | changes))


def test_the_folder_holds_every_file_and_nothing_else(tmp_path, radar):
    out = tmp_path / "deep" / "results"

    named = write(out, radar)

    assert set(named) == set(FILES) == {file.name for file in out.iterdir()}
    assert all(path == out / name and path.exists() for name, path in named.items())
    assert [file.name for file in out.parent.iterdir()] == ["results"]


def test_xarray_reads_the_cube_as_it_was(tmp_path, radar):
    cube = samples(radar, 3)

    write(tmp_path / "out", radar, cube)

    with xr.open_zarr(tmp_path / "out" / "cube.zarr", consolidated=False) as read:
        xr.testing.assert_equal(read.cube.load(), cube)
        assert read.cube.dtype == np.complex64
        assert read.cube.attrs["units"] == "sqrt(W)"
        assert read.sample.attrs["units"] == "s"
        assert read.attrs["format_version"] == 1


def test_the_cube_on_disk_says_which_transmitter_sent_each_chirp(tmp_path, radar):
    frame = replace(radar.frame, n_chirps=2, multiplexing=dc.multiplexing.Tdm(order=(1, 0)))
    array = replace(radar.array, tx_m=[(0, 0, 0), (0, 0.0078, 0)])
    radar = replace(radar, frame=frame, array=array)
    cube = dc.simulate(dc.Scene(), radar, n_frames=2)

    write(tmp_path / "out", radar, cube)

    with xr.open_zarr(tmp_path / "out" / "cube.zarr", consolidated=False) as read:
        xr.testing.assert_equal(read.cube.load(), cube)
        assert read.cube.transmitter.values.tolist() == [1, 0, 1, 0]
        assert read.transmitter.attrs == cube.transmitter.attrs


def test_a_frame_of_many_pieces_is_the_same_cube(tmp_path, radar, monkeypatch):
    cube = samples(radar, 2)
    # 50 of the 128 chirps to a piece, so that the last piece is not full.
    monkeypatch.setattr(cube_on_disk, "_CHUNK_BYTES", 50 * cube[0, 0].nbytes)

    write(tmp_path / "out", radar, cube)

    with xr.open_zarr(tmp_path / "out" / "cube.zarr", consolidated=False) as read:
        assert read.cube.encoding["chunks"][:2] == (1, 50)
        np.testing.assert_array_equal(read.cube.values, cube.values)


def test_the_radar_can_be_had_back_from_the_cube(tmp_path, radar):
    write(tmp_path / "out", radar)

    with xr.open_zarr(tmp_path / "out" / "cube.zarr", consolidated=False) as read:
        settings = json.dumps(read.attrs["radar"])  # JSON is YAML
    assert "77 GHz" in settings
    assert loading.parse_settings(settings, dc.Radar) == radar


def test_truth_and_detections_lie_beside_the_cube(tmp_path, radar):
    write(tmp_path / "out", radar)

    store = tmp_path / "out" / "cube.zarr"
    with xr.open_zarr(store, group="detections", consolidated=False) as read:
        xr.testing.assert_equal(read.load(), found())
    with xr.open_zarr(store, group="truth", consolidated=False) as read:
        assert read.target.values.tolist() == ["car", "lorry"]
        np.testing.assert_array_equal(read.range.values, truth().range.values)


def test_a_recording_without_truth_or_detections_is_written_too(tmp_path, radar):
    out = tmp_path / "out"

    write(out, radar, detections=found().isel(detection=[]), truth=None)

    assert (out / "detections.csv").read_text() == ",".join(COLUMNS) + "\n"
    assert json.loads((out / "detections.json").read_text()) == []
    assert not (out / "cube.zarr" / "truth").exists()


def test_rows_have_degrees_and_decibels_and_null_for_what_is_not_estimated():
    first, last = dataset_to_records(found())

    assert list(first) == list(COLUMNS)
    assert first["azimuth_deg"] == pytest.approx(30)
    assert first["snr_db"] == pytest.approx(20)
    assert first["range_m"] == 10
    assert first["frame"] == 0
    assert first["velocity_m_per_s"] is None
    assert first["range_std_m"] == 0.01
    assert last["range_std_m"] is None


def test_rows_of_truth_go_frame_by_frame_and_name_the_target():
    rows = [
        (row["frame"], row["target"], row["range_m"], row["time_s"])
        for row in dataset_to_records(truth())
    ]

    assert rows == [(0, "car", 1, 0), (0, "lorry", 3, 0), (1, "car", 2, 0.1), (1, "lorry", 4, 0.1)]


def test_csv_and_json_hold_the_same_rows():
    lines = list(csv.DictReader(csv_text(found()).splitlines()))

    for line, row in zip(lines, dataset_to_records(found()), strict=True):
        assert list(line) == list(row)
        for column, text in line.items():
            assert (None if text == "" else float(text)) == row[column]


def test_json_has_no_number_that_json_does_not_know():
    noiseless = found().assign(snr=("detection", [math.inf, 0.0]))  # infinite, and no decibels

    text = json_text({"rows": dataset_to_records(noiseless), "rest": [math.nan, (-math.inf, 1.5)]})

    read = json.loads(text, parse_constant=pytest.fail)
    assert [row["snr_db"] for row in read["rows"]] == [None, None]
    assert read["rest"] == [None, [None, 1.5]]


def test_earlier_results_are_replaced_as_a_whole(tmp_path, radar):
    out = tmp_path / "out"
    write(out, radar, samples(radar, 5))
    (out / ".DS_Store").write_text("what a file manager leaves")

    write(out, radar, samples(radar, 1))

    assert {file.name for file in out.iterdir()} == set(FILES)
    assert len(list((out / "cube.zarr" / "cube").glob("c.*"))) == 1
    assert [file.name for file in tmp_path.iterdir()] == ["out"]


def test_an_empty_folder_is_taken(tmp_path, radar):
    (tmp_path / "out").mkdir()

    write(tmp_path / "out", radar)

    assert (tmp_path / "out" / "run.json").exists()


def test_a_folder_that_is_linked_to_stays_where_it_is(tmp_path, radar):
    (tmp_path / "there").mkdir()
    (tmp_path / "out").symlink_to("there")

    write(tmp_path / "out", radar)

    assert (tmp_path / "out").is_symlink()
    assert (tmp_path / "there" / "run.json").exists()


@pytest.mark.parametrize("names", [["thesis.tex"], ["run.json", "thesis.tex"], ["report.html"]])
def test_what_somebody_else_keeps_in_a_folder_is_never_replaced(tmp_path, radar, names):
    out = tmp_path / "out"
    out.mkdir()
    for name in names:
        (out / name).write_text("mine")

    with pytest.raises(DechirpError, match=r"--out: .*out, a folder with .*name another"):
        write(out, radar)

    assert {file.name: file.read_text() for file in out.iterdir()} == dict.fromkeys(names, "mine")


def test_a_file_in_the_way_is_named(tmp_path):
    (tmp_path / "file").write_text("mine")

    with pytest.raises(DechirpError, match="a file; expected a new name"):
        check_output_folder(tmp_path / "file")
    with pytest.raises(DechirpError, match=r"not writable .*file cannot be written to"):
        check_output_folder(tmp_path / "file" / "out")


@pytest.mark.parametrize("place", ["/proc/out", "/proc/deep/out"])
@pytest.mark.skipif(not Path("/proc/self").exists(), reason="only Linux has /proc")
def test_a_place_that_only_says_that_it_is_writable_is_refused_before_the_work(place):
    with pytest.raises(DechirpError, match=rf"--out: {place}, not writable \(/proc cannot be"):
        check_output_folder(Path(place))


@pytest.mark.parametrize("link", ["to itself", "to nowhere"])
def test_a_place_behind_a_link_is_the_one_it_leads_to(tmp_path, link):
    (tmp_path / "link").symlink_to("link" if link == "to itself" else "new")

    if link == "to itself":
        with pytest.raises(DechirpError, match="link cannot be written to"):
            check_output_folder(tmp_path / "link" / "out")
    else:
        check_output_folder(tmp_path / "link" / "out")

    assert [left.name for left in tmp_path.iterdir()] == ["link"]


def test_a_name_too_long_to_write_beside_is_refused_before_the_work(tmp_path):
    with pytest.raises(DechirpError, match="File name too long"):
        check_output_folder(tmp_path / ("o" * 250))  # of 255 that a name may have


def test_asking_whether_a_place_can_be_written_leaves_nothing_there(tmp_path, radar):
    check_output_folder(tmp_path / "out")
    check_output_folder(tmp_path / "deep" / "out")
    assert list(tmp_path.iterdir()) == []

    write(tmp_path / "out", radar)
    check_output_folder(tmp_path / "out")

    assert [file.name for file in tmp_path.iterdir()] == ["out"]


def test_asking_that_is_interrupted_leaves_nothing_there(tmp_path, monkeypatch):
    mkdir = Path.mkdir

    def interrupted(path, *args, **kwargs):
        mkdir(path, *args, **kwargs)
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "mkdir", interrupted)
    with pytest.raises(KeyboardInterrupt):
        check_output_folder(tmp_path / "out")

    assert list(tmp_path.iterdir()) == []


def stop(error):
    """Give a `write_cube` that is stopped when half of it is written."""

    def half(path, frames, **_):
        path.mkdir()
        (path / "zarr.json").write_text("{")
        next(iter(frames))
        raise error

    return half


@pytest.mark.parametrize("error", [KeyboardInterrupt(), SystemExit(143), ValueError("a bug")])
def test_an_interrupted_run_leaves_the_old_result_and_no_litter(
    tmp_path, radar, monkeypatch, error
):
    out = tmp_path / "out"
    write(out, radar)
    (out / "report.html").write_text("old")
    monkeypatch.setattr(results, "write_cube", stop(error))

    with pytest.raises(type(error)):
        write(out, radar)

    assert (out / "report.html").read_text() == "old"
    assert {file.name for file in out.iterdir()} == set(FILES)
    assert [file.name for file in tmp_path.iterdir()] == ["out"]


def test_an_interrupted_first_run_leaves_nothing(tmp_path, radar, monkeypatch):
    monkeypatch.setattr(results, "write_cube", stop(KeyboardInterrupt()))

    with pytest.raises(KeyboardInterrupt):
        write(tmp_path / "out", radar)

    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_a_message(tmp_path, radar, monkeypatch):
    full = OSError(errno.ENOSPC, "No space left on device")
    monkeypatch.setattr(results, "write_cube", stop(full))

    with pytest.raises(DechirpError, match=r"not writable \(No space left on device\).*free space"):
        write(tmp_path / "out", radar)

    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_take_its_place_leaves_the_old_result(tmp_path, radar, monkeypatch):
    out = tmp_path / "out"
    write(out, radar)
    (out / "report.html").write_text("old")
    rename = type(out).rename

    def only_away(path, target):
        # The old result moves away; the new one does not come.
        if path.name != "out" and target.name == "out" and not path.name.endswith(".before"):
            raise OSError(errno.EIO, "Input/output error")
        return rename(path, target)

    monkeypatch.setattr(type(out), "rename", only_away)
    with pytest.raises(DechirpError, match="Input/output error"):
        write(out, radar)

    assert (out / "report.html").read_text() == "old"
    assert [file.name for file in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize("place", [".", "..", "../here"])
def test_the_folder_one_is_in_is_never_replaced(tmp_path, radar, monkeypatch, place):
    here = tmp_path / "here"
    write(here, radar)
    monkeypatch.chdir(here)

    with pytest.raises(DechirpError, match="the working folder, or one of its parents"):
        check_output_folder(Path(place))


@pytest.mark.parametrize("killed", ["between the renames", "before the old result was removed"])
def test_what_a_killed_run_left_behind_is_put_back_or_cleared_away(
    tmp_path, radar, monkeypatch, killed
):
    out = tmp_path / "out"
    write(out, radar)
    (out / "report.html").write_text("old")
    if killed == "between the renames":
        out.rename(tmp_path / ".out.0123abcd.before")
        (tmp_path / ".out.0123abcd").mkdir()
    else:
        (tmp_path / ".out.0123abcd.before").mkdir()
    (tmp_path / ".out.mine.before").mkdir()
    monkeypatch.setattr(results, "write_cube", stop(KeyboardInterrupt()))

    with pytest.raises(KeyboardInterrupt):
        write(out, radar)

    assert (out / "report.html").read_text() == "old"
    assert {left.name for left in tmp_path.iterdir()} == {"out", ".out.mine.before"}


def test_a_text_is_replaced_as_a_whole(tmp_path):
    file = tmp_path / "radar.yaml"
    write_text_atomically(file, "old")
    write_text_atomically(file, "new")
    assert file.read_text() == "new"
    assert [left.name for left in tmp_path.iterdir()] == ["radar.yaml"]

    with pytest.raises(DechirpError, match="--out: .*not writable"):
        write_text_atomically(tmp_path / "nowhere" / "radar.yaml", "new")
    (tmp_path / "folder").mkdir()
    with pytest.raises(DechirpError, match="not writable"):
        write_text_atomically(tmp_path / "folder", "new")
    assert {left.name for left in tmp_path.iterdir()} == {"radar.yaml", "folder"}
