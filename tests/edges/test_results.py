"""Result folders: files, cube store, tables, and replacement after interruption."""

import csv
import errno
import json
import math
import os
import shutil
import sys
import threading
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.config import loading
from dechirp.core import atomic_files
from dechirp.core.atomic_files import atomic_folder, completed_outputs, write_text_atomically
from dechirp.core.conventions import CUBE_AXES, axis_coordinate
from dechirp.core.errors import DechirpError
from dechirp.core.table_columns import COLUMNS, dataset_to_records
from dechirp.recordings import cube_store
from dechirp.results import results
from dechirp.results.results import FILES, check_results_folder_replaceable, write_results
from dechirp.results.text_files import dataset_to_csv, to_json_text
from nightly import nightly, nightly_except

TEXTS = {"report.html": "<p>new</p>", "scenario.yaml": "name: new\n", "run.json": "{}\n"}


def make_detections(n: int = 2) -> xr.Dataset:
    """Make detections, one per frame; the range error of the last one is unknown."""
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


def make_truth() -> xr.Dataset:
    return xr.Dataset(
        {"range": (("target", "frame"), np.array([[1.0, 2.0], [3.0, 4.0]]))},
        coords={"target": ["car", "lorry"], "frame": [0, 1], "time": ("frame", [0.0, 0.1])},
    )


def make_cube(radar: dc.Radar, n_frames: int) -> xr.DataArray:
    """Make a cube in which every sample has a different value."""
    chirp = radar.frame.chirp
    shape = (n_frames, radar.frame.n_chirps, radar.array.n_rx, chirp.n_samples)
    values = (np.arange(math.prod(shape)).reshape(shape) * (1 - 1j)).astype(np.complex64)
    coords = {
        name: axis_coordinate(name, np.arange(n) / 10)
        for name, n in zip(CUBE_AXES, shape, strict=True)
    }
    return xr.DataArray(values, dims=CUBE_AXES, coords=coords, attrs={"units": "W**0.5"})


def write_result_folder(out, radar, cube=None, **changes):
    cube = make_cube(radar, 2) if cube is None else cube
    parts = {
        "frames": (cube.isel(frame=slice(i, i + 1)) for i in range(cube.sizes["frame"])),
        "n_frames": cube.sizes["frame"],
        "radar": radar,
        "detections": make_detections(),
        "truth": make_truth(),
    }
    return write_results(out, TEXTS, **(parts | changes))


def test_result_folder_contains_exactly_known_files(tmp_path, radar):
    out = tmp_path / "deep" / "results"

    paths = write_result_folder(out, radar)

    assert set(paths) == set(FILES) == {file.name for file in out.iterdir()}
    assert all(path == out / name and path.exists() for name, path in paths.items())
    assert [file.name for file in out.parent.iterdir()] == ["results"]


def test_xarray_reads_cube_unchanged(tmp_path, radar):
    cube = make_cube(radar, 3)

    write_result_folder(tmp_path / "out", radar, cube)

    with xr.open_zarr(tmp_path / "out" / "cube.zarr", consolidated=False) as store:
        xr.testing.assert_equal(store.cube.load(), cube)
        assert store.cube.dtype == np.complex64
        assert store.cube.attrs["units"] == "W**0.5"
        assert store.sample.attrs["units"] == "s"
        assert store.attrs["format_version"] == 1


def test_stored_cube_has_transmitter_of_each_chirp(tmp_path, radar):
    frame = replace(radar.frame, n_chirps=2, multiplexing=dc.multiplexing.Tdm(order=(1, 0)))
    array = replace(radar.array, tx_m=[(0, 0, 0), (0, 0.0078, 0)])
    radar = replace(radar, frame=frame, array=array)
    cube = dc.simulate(dc.Scene(), radar, n_frames=2)

    write_result_folder(tmp_path / "out", radar, cube)

    with xr.open_zarr(tmp_path / "out" / "cube.zarr", consolidated=False) as store:
        xr.testing.assert_equal(store.cube.load(), cube)
        assert store.cube.transmitter.values.tolist() == [1, 0, 1, 0]
        assert store.transmitter.attrs == cube.transmitter.attrs


def test_frame_in_several_chunks_reads_back_equal(tmp_path, radar, monkeypatch):
    cube = make_cube(radar, 2)
    # 50 of the 128 chirps per chunk, so that the last chunk is not full.
    monkeypatch.setattr(cube_store, "_CHUNK_BYTES", 50 * cube[0, 0].nbytes)

    write_result_folder(tmp_path / "out", radar, cube)

    with xr.open_zarr(tmp_path / "out" / "cube.zarr", consolidated=False) as store:
        assert store.cube.encoding["chunks"][:2] == (1, 50)
        np.testing.assert_array_equal(store.cube.values, cube.values)


def test_radar_reads_back_from_cube_attributes(tmp_path, radar):
    write_result_folder(tmp_path / "out", radar)

    with xr.open_zarr(tmp_path / "out" / "cube.zarr", consolidated=False) as store:
        settings = json.dumps(store.attrs["radar"])  # JSON is YAML
    assert "77 GHz" in settings
    assert loading.parse_settings(settings, dc.Radar) == radar


def test_cube_store_contains_truth_and_detections(tmp_path, radar):
    write_result_folder(tmp_path / "out", radar)

    store = tmp_path / "out" / "cube.zarr"
    with xr.open_zarr(store, group="detections", consolidated=False) as group:
        xr.testing.assert_equal(group.load(), make_detections())
    with xr.open_zarr(store, group="truth", consolidated=False) as group:
        assert group.target.values.tolist() == ["car", "lorry"]
        np.testing.assert_array_equal(group.range.values, make_truth().range.values)


def test_result_without_truth_or_detections_is_written(tmp_path, radar):
    out = tmp_path / "out"

    write_result_folder(out, radar, detections=make_detections().isel(detection=[]), truth=None)

    assert (out / "detections.csv").read_text() == ",".join(COLUMNS) + "\n"
    assert json.loads((out / "detections.json").read_text()) == []
    assert not (out / "cube.zarr" / "truth").exists()


def test_records_have_degrees_decibels_and_null_for_unknown_values():
    first_row, last_row = dataset_to_records(make_detections())

    assert list(first_row) == list(COLUMNS)
    assert first_row["azimuth_deg"] == pytest.approx(30)
    assert first_row["snr_db"] == pytest.approx(20)
    assert first_row["range_m"] == 10
    assert first_row["frame"] == 0
    assert first_row["velocity_m_per_s"] is None
    assert first_row["range_std_m"] == 0.01
    assert last_row["range_std_m"] is None


def test_truth_records_are_ordered_by_frame_and_name_target():
    rows = [
        (row["frame"], row["target"], row["range_m"], row["time_s"])
        for row in dataset_to_records(make_truth())
    ]

    assert rows == [(0, "car", 1, 0), (0, "lorry", 3, 0), (1, "car", 2, 0.1), (1, "lorry", 4, 0.1)]


def test_csv_and_json_contain_same_rows():
    lines = list(csv.DictReader(dataset_to_csv(make_detections()).splitlines()))

    for line, row in zip(lines, dataset_to_records(make_detections()), strict=True):
        assert list(line) == list(row)
        for column, text in line.items():
            assert (None if text == "" else float(text)) == row[column]


def test_json_contains_no_nan_or_infinity():
    # Infinite, and no decibels.
    noiseless = make_detections().assign(snr=("detection", [math.inf, 0.0]))

    text = to_json_text(
        {"rows": dataset_to_records(noiseless), "rest": [math.nan, (-math.inf, 1.5)]}
    )

    document = json.loads(text, parse_constant=pytest.fail)
    assert [row["snr_db"] for row in document["rows"]] == [None, None]
    assert document["rest"] == [None, [None, 1.5]]


def test_earlier_results_are_replaced_completely(tmp_path, radar):
    out = tmp_path / "out"
    write_result_folder(out, radar, make_cube(radar, 5))
    (out / ".DS_Store").write_text("what a file manager leaves")

    write_result_folder(out, radar, make_cube(radar, 1))

    assert {file.name for file in out.iterdir()} == set(FILES)
    assert len(list((out / "cube.zarr" / "cube").glob("c.*"))) == 1
    assert [file.name for file in tmp_path.iterdir()] == ["out"]


def test_empty_folder_is_used(tmp_path, radar):
    (tmp_path / "out").mkdir()

    write_result_folder(tmp_path / "out", radar)

    assert (tmp_path / "out" / "run.json").exists()


def test_symbolic_link_to_folder_is_kept(tmp_path, radar):
    (tmp_path / "there").mkdir()
    (tmp_path / "out").symlink_to("there")

    write_result_folder(tmp_path / "out", radar)

    assert (tmp_path / "out").is_symlink()
    assert (tmp_path / "there" / "run.json").exists()


@pytest.mark.parametrize("names", [["thesis.tex"], ["run.json", "thesis.tex"], ["report.html"]])
def test_foreign_files_in_folder_are_never_replaced(tmp_path, radar, names):
    out = tmp_path / "out"
    out.mkdir()
    for name in names:
        (out / name).write_text("mine")

    with pytest.raises(DechirpError, match=r"--out: .*out, a folder with .*name another"):
        write_result_folder(out, radar)

    assert {file.name: file.read_text() for file in out.iterdir()} == dict.fromkeys(names, "mine")


def test_rejects_output_path_blocked_by_file(tmp_path):
    (tmp_path / "file").write_text("mine")

    with pytest.raises(DechirpError, match="a file; expected a new name"):
        check_results_folder_replaceable(tmp_path / "file")
    with pytest.raises(DechirpError, match=r"not writable .*file cannot be written to"):
        check_results_folder_replaceable(tmp_path / "file" / "out")


@pytest.mark.parametrize("path", ["/proc/out", "/proc/deep/out"])
@pytest.mark.skipif(not Path("/proc/self").exists(), reason="only Linux has /proc")
def test_rejects_output_in_proc_before_run(path):
    with pytest.raises(DechirpError, match=rf"--out: {path}, not writable \(/proc cannot be"):
        check_results_folder_replaceable(Path(path))


@pytest.mark.parametrize("link", ["to itself", "to nowhere"])
def test_symbolic_links_in_output_path_are_resolved(tmp_path, link):
    (tmp_path / "link").symlink_to("link" if link == "to itself" else "new")

    if link == "to itself":
        with pytest.raises(DechirpError, match="link cannot be written to"):
            check_results_folder_replaceable(tmp_path / "link" / "out")
    else:
        check_results_folder_replaceable(tmp_path / "link" / "out")

    assert [path.name for path in tmp_path.iterdir()] == ["link"]


def test_rejects_name_too_long_for_temporary_folder_before_run(tmp_path):
    with pytest.raises(DechirpError, match="File name too long"):
        # Names have at most 255 characters.
        check_results_folder_replaceable(tmp_path / ("o" * 250))


def test_output_check_leaves_no_files(tmp_path, radar):
    check_results_folder_replaceable(tmp_path / "out")
    check_results_folder_replaceable(tmp_path / "deep" / "out")
    assert list(tmp_path.iterdir()) == []

    write_result_folder(tmp_path / "out", radar)
    check_results_folder_replaceable(tmp_path / "out")

    assert [file.name for file in tmp_path.iterdir()] == ["out"]


def test_interrupted_output_check_leaves_no_files(tmp_path, monkeypatch):
    mkdir = Path.mkdir

    def make_and_interrupt(path, *args, **kwargs):
        mkdir(path, *args, **kwargs)
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "mkdir", make_and_interrupt)
    with pytest.raises(KeyboardInterrupt):
        check_results_folder_replaceable(tmp_path / "out")

    assert list(tmp_path.iterdir()) == []


def make_failing_writer(error):
    """Return a `write_cube_store` that raises an error after half of the data."""

    def write_half(path, frames, **_):
        path.mkdir()
        (path / "zarr.json").write_text("{")
        next(iter(frames))
        raise error

    return write_half


@pytest.mark.parametrize(
    "error", nightly_except(1, [KeyboardInterrupt(), SystemExit(143), ValueError("a bug")])
)
def test_interrupted_write_keeps_old_result_and_no_temporary_files(
    tmp_path, radar, monkeypatch, error
):
    out = tmp_path / "out"
    write_result_folder(out, radar)
    (out / "report.html").write_text("old")
    monkeypatch.setattr(results, "write_cube_store", make_failing_writer(error))

    with pytest.raises(type(error)):
        write_result_folder(out, radar)

    assert (out / "report.html").read_text() == "old"
    assert {file.name for file in out.iterdir()} == set(FILES)
    assert [file.name for file in tmp_path.iterdir()] == ["out"]


def test_interrupted_first_write_leaves_nothing(tmp_path, radar, monkeypatch):
    monkeypatch.setattr(results, "write_cube_store", make_failing_writer(KeyboardInterrupt()))

    with pytest.raises(KeyboardInterrupt):
        write_result_folder(tmp_path / "out", radar)

    assert list(tmp_path.iterdir()) == []


def test_full_disk_gives_message(tmp_path, radar, monkeypatch):
    error = OSError(errno.ENOSPC, "No space left on device")
    monkeypatch.setattr(results, "write_cube_store", make_failing_writer(error))

    with pytest.raises(DechirpError, match=r"not writable \(No space left on device\).*free space"):
        write_result_folder(tmp_path / "out", radar)

    assert list(tmp_path.iterdir()) == []


def test_failed_rename_keeps_old_result(tmp_path, radar, monkeypatch):
    out = tmp_path / "out"
    write_result_folder(out, radar)
    (out / "report.html").write_text("old")
    rename = type(out).rename

    def fail_on_new_result(path, target):
        # The old result is moved away, but the new one is not moved in.
        if path.name != "out" and target.name == "out" and not path.name.endswith(".before"):
            raise OSError(errno.EIO, "Input/output error")
        return rename(path, target)

    monkeypatch.setattr(type(out), "rename", fail_on_new_result)
    monkeypatch.setattr(atomic_files, "_exchange_paths", lambda first, second: False)
    with pytest.raises(DechirpError, match="Input/output error"):
        write_result_folder(out, radar)

    assert (out / "report.html").read_text() == "old"
    assert [file.name for file in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize("path", [".", "..", "../here"])
def test_working_folder_and_its_parents_are_never_replaced(tmp_path, radar, monkeypatch, path):
    folder = tmp_path / "here"
    write_result_folder(folder, radar)
    monkeypatch.chdir(folder)

    with pytest.raises(DechirpError, match="the working folder, or one of its parents"):
        check_results_folder_replaceable(Path(path))


@pytest.mark.parametrize("moment", ["between the renames", "before the old result was removed"])
def test_leftovers_of_killed_run_are_restored_or_removed(tmp_path, radar, monkeypatch, moment):
    out = tmp_path / "out"
    write_result_folder(out, radar)
    (out / "report.html").write_text("old")
    if moment == "between the renames":
        out.rename(tmp_path / ".out.0123abcd.before")
        (tmp_path / ".out.0123abcd.new").mkdir()
    else:
        (tmp_path / ".out.0123abcd.before").mkdir()
    (tmp_path / ".out.0123abcd.trying").mkdir()  # of a process that was killed at its first check
    (tmp_path / ".out.mine.before").mkdir()
    monkeypatch.setattr(results, "write_cube_store", make_failing_writer(KeyboardInterrupt()))

    with pytest.raises(KeyboardInterrupt):
        write_result_folder(out, radar)

    assert (out / "report.html").read_text() == "old"
    assert {path.name for path in tmp_path.iterdir()} == {"out", ".out.mine.before"}


@pytest.mark.skipif(sys.platform == "win32", reason="no locks of folders")
def test_next_write_removes_folders_of_killed_runs_only(tmp_path, radar):
    import fcntl

    names = (".out.0123abcd.new", ".out.89abcdef.new", ".out.0123abcd")
    killed, running, other = (tmp_path / name for name in names)
    for folder in (killed, running, other):
        folder.mkdir()
        (folder / "run.json").write_text("{")
    descriptor = os.open(running, os.O_RDONLY)
    fcntl.flock(descriptor, fcntl.LOCK_EX)
    try:
        write_result_folder(tmp_path / "out", radar)
    finally:
        os.close(descriptor)

    assert {path.name for path in tmp_path.iterdir()} == {"out", running.name, other.name}
    assert (running / "run.json").read_text() == "{"


@pytest.mark.skipif(sys.platform not in ("linux", "darwin"), reason="no exchange of folders")
def test_folder_is_visible_at_every_moment_of_its_replacement(tmp_path, monkeypatch):
    out = tmp_path / "out"
    with atomic_folder(out) as made:
        (made / "file").write_text("old")
    for name in ("rename", "replace"):
        monkeypatch.delattr(Path, name)  # the exchange is the only operation

    with atomic_folder(out) as made:
        (made / "file").write_text("new")

    assert (out / "file").read_text() == "new"
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_folder_is_replaced_where_systems_cannot_exchange(tmp_path, monkeypatch):
    monkeypatch.setattr(atomic_files, "_exchange_paths", lambda first, second: False)
    for text in ("old", "new"):
        with atomic_folder(tmp_path / "out") as made:
            (made / "file").write_text(text)

    assert (tmp_path / "out" / "file").read_text() == "new"
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize("exchange", [atomic_files._exchange_paths, lambda first, second: False])
def test_interrupt_after_replacement_leaves_new_folder_and_names_it(
    tmp_path, monkeypatch, exchange
):
    out = tmp_path / "out"
    monkeypatch.setattr(atomic_files, "_completed", [])
    monkeypatch.setattr(atomic_files, "_exchange_paths", exchange)
    with atomic_folder(out) as made:
        (made / "file").write_text("old")
    remove_tree = shutil.rmtree

    def interrupt(*arguments, **options):
        monkeypatch.setattr(shutil, "rmtree", remove_tree)
        raise KeyboardInterrupt

    monkeypatch.setattr(shutil, "rmtree", interrupt)
    with pytest.raises(KeyboardInterrupt), atomic_folder(out) as made:
        (made / "file").write_text("new")

    assert (out / "file").read_text() == "new"
    assert completed_outputs() == (out, out)


@nightly
def test_interrupted_folder_is_removed_while_threads_write_into_it(tmp_path):
    def write(folder):
        for number in range(30):  # 0.3 s
            (folder / "cube.zarr").mkdir(parents=True, exist_ok=True)
            with suppress(OSError):
                (folder / "cube.zarr" / f"{number}").touch()
            time.sleep(0.01)

    with pytest.raises(KeyboardInterrupt), atomic_folder(tmp_path / "out") as made:
        writer = threading.Thread(target=write, args=(made,))
        writer.start()
        raise KeyboardInterrupt
    writer.join()

    assert list(tmp_path.iterdir()) == []


def test_interrupted_replacement_is_not_complete(tmp_path, monkeypatch):
    monkeypatch.setattr(atomic_files, "_completed", [])
    with pytest.raises(KeyboardInterrupt), atomic_folder(tmp_path / "out"):
        raise KeyboardInterrupt

    assert completed_outputs() == ()


def test_text_file_is_replaced_atomically(tmp_path):
    file = tmp_path / "radar.yaml"
    write_text_atomically(file, "old")
    write_text_atomically(file, "new")
    assert file.read_text() == "new"
    assert [path.name for path in tmp_path.iterdir()] == ["radar.yaml"]

    with pytest.raises(DechirpError, match="--out: .*not writable"):
        write_text_atomically(tmp_path / "nowhere" / "radar.yaml", "new")
    (tmp_path / "folder").mkdir()
    with pytest.raises(DechirpError, match="not writable"):
        write_text_atomically(tmp_path / "folder", "new")
    assert {path.name for path in tmp_path.iterdir()} == {"radar.yaml", "folder"}
