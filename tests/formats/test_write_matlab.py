"""Writer of MATLAB files: round trips, SciPy, Octave, rejected tables and damaged files."""

import json
import os
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

import dechirp as dc
from dechirp.core.errors import DechirpError, RecordingError
from dechirp.simulation.adc_codes import extract_adc_codes
from formats.corruption import assert_cube_or_error, corrupted_bytes
from formats.native_recordings import (
    assert_full_disk_keeps_files,
    assert_recordings_equal,
    assert_write_preserves_recording,
    make_complex_code_recording,
    make_complex_recording,
    make_gap_recording,
    make_one_sample_recording,
    make_radar,
    make_table_recording,
    open_real_capture,
)
from nightly import n_examples, nightly


def test_scipy_reads_reversed_axes_and_table_structures(tmp_path):
    recording = make_table_recording()
    dc.write(recording, tmp_path / "x.mat")

    loaded = scipy.io.loadmat(tmp_path / "x.mat", simplify_cells=True)
    assert loaded["cube"].shape == (32, 2, 6, 3)
    assert np.array_equal(loaded["cube"].transpose(), recording.cube.values)
    truth = recording.tables["truth"]
    assert np.array_equal(loaded["truth"]["range"].transpose(), truth["range"].values)
    assert json.loads(loaded["dechirp"])["units"] == "W**0.5"
    assert "gap" not in loaded


def test_codes_and_gaps_are_separate_variables(tmp_path):
    code_recording, gap_recording = make_complex_code_recording(), make_gap_recording()
    dc.write(code_recording, tmp_path / "coded.mat")
    dc.write(gap_recording, tmp_path / "lost.mat")

    loaded = scipy.io.loadmat(tmp_path / "coded.mat")["cube"].transpose()
    assert np.array_equal(loaded.real, extract_adc_codes(code_recording.cube).values[..., 0])
    assert np.array_equal(loaded.imag, extract_adc_codes(code_recording.cube).values[..., 1])
    gap = scipy.io.loadmat(tmp_path / "lost.mat")["gap"]
    assert np.array_equal(gap.transpose(), gap_recording.contents.gaps)


def run_octave(folder: Path, script: str) -> None:
    command = ["octave-cli", "--no-gui", "--eval", script]
    subprocess.run(command, cwd=folder, capture_output=True, check=False)


NEEDS_OCTAVE = pytest.mark.skipif(
    shutil.which("octave-cli") is None, reason="octave-cli not found: install Octave"
)


@NEEDS_OCTAVE
@pytest.mark.parametrize("make_recording", [make_table_recording, make_complex_code_recording])
def test_octave_loads_equal_numbers(tmp_path, make_recording):
    recording = make_recording()
    dc.write(recording, tmp_path / "x.mat")
    script = (
        "load x.mat; r = double(real(cube)); i = double(imag(cube));"
        " s = size(cube); text = dechirp; range = 0; if exist('truth'), range = truth.range; end;"
        " save('-v6', 'y.mat', 'r', 'i', 's', 'text', 'range');"
    )
    run_octave(tmp_path, script)

    loaded = scipy.io.loadmat(tmp_path / "y.mat", squeeze_me=True)
    assert loaded["s"].tolist() == [32, 2, 6, 3]
    scale = json.loads(str(loaded["text"]))["scale"] or 1
    values = recording.cube.values.transpose()
    assert np.array_equal(loaded["r"].astype(np.float32) * np.float32(scale), values.real)
    assert np.array_equal(loaded["i"].astype(np.float32) * np.float32(scale), values.imag)
    if "truth" in recording.tables:
        truth = recording.tables["truth"]["range"].values
        assert np.array_equal(loaded["range"].transpose(), truth)


@pytest.mark.parametrize("make_recording", [make_gap_recording, make_one_sample_recording])
@pytest.mark.parametrize("compressed", [False, True])
def test_file_resaved_by_scipy_is_native(tmp_path, make_recording, compressed):
    recording = make_recording()
    dc.write(recording, tmp_path / "x.mat")
    variables = scipy.io.loadmat(tmp_path / "x.mat", struct_as_record=True)
    variables = {name: value for name, value in variables.items() if not name.startswith("__")}
    # MATLAB drops trailing axes of size 1.
    while variables["cube"].ndim > 2 and variables["cube"].shape[-1] == 1:
        variables["cube"] = variables["cube"][..., 0]
    scipy.io.savemat(tmp_path / "y.mat", variables, do_compression=compressed)
    assert_recordings_equal(dc.open(tmp_path / "y.mat"), recording)


@NEEDS_OCTAVE
@pytest.mark.parametrize("version", ["-v6", "-v7"])
def test_file_resaved_by_octave_is_native(tmp_path, version):
    recording = make_table_recording()
    dc.write(recording, tmp_path / "x.mat")
    run_octave(tmp_path, f"load x.mat; save('{version}', 'y.mat');")
    assert_recordings_equal(dc.open(tmp_path / "y.mat"), recording)


def test_named_array_is_read_as_foreign_workspace(tmp_path):
    recording = make_complex_recording()
    dc.write(recording, tmp_path / "x.mat")
    options = {"radar": make_radar(), "axes": "sample,rx,chirp,frame", "encoding": "full-scale"}
    array_recording = dc.open(tmp_path / "x.mat" / "cube", **options)
    assert array_recording.cube.attrs["units"] == "1"
    assert np.array_equal(array_recording.cube.values, recording.cube.values)


def test_full_disk_keeps_existing_file(tmp_path):
    assert_full_disk_keeps_files(tmp_path / "x.mat")


# --- Rejected content -----------------------------------------------------------------


def test_rejects_cube_above_2_gib_before_reading(tmp_path):
    recording = make_complex_recording()
    # 3072 bytes per frame: 2^20 frames are 3 GiB.
    contents = replace(recording.contents, n_frames=2**20, decode=lambda number, out: 1 / 0)
    long_recording = replace(recording, contents=contents, frame_numbers=range(2**20))
    with pytest.raises(DechirpError, match="h5read"):
        dc.write(long_recording, tmp_path / "x.mat")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("name", "table", "message"),
    [
        ("cube", xr.Dataset(), "a table named 'cube'"),
        ("my table", xr.Dataset(), "a table named 'my table'"),
        ("_truth", xr.Dataset(), "a table named '_truth'"),
        ("t", xr.Dataset({"2d": ("n", [1.0])}), "a column named '2d'"),
        ("t", xr.Dataset({"a" * 64: ("n", [1.0])}), "at most 63"),
        ("t", xr.Dataset({"v": ("n", np.zeros(1, np.float16))}), "a column v of float16"),
        ("t", xr.Dataset({"v": ("n", np.zeros(1, "M8[ns]"))}), "datetime64"),
        ("t", xr.Dataset(attrs={"a": np.zeros(2)}), "attributes"),
    ],
)
def test_rejects_tables_without_structure_form(tmp_path, name, table, message):
    radar = make_radar()
    recording = dc.recording_from_cube(make_complex_recording().cube, radar, tables={name: table})
    with pytest.raises(DechirpError, match=message):
        dc.write(recording, tmp_path / "x.mat")
    assert not list(tmp_path.iterdir())


# --- Damaged files --------------------------------------------------------------------


def replace_text(old: str, new: str):
    def change(content: bytes) -> bytes:
        assert len(old) == len(new)
        assert old.encode() in content
        return content.replace(old.encode(), new.encode())

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (replace_text('"dechirp_exchange": 1', '"dechirp_exchange": 7'), "version 7"),
        (replace_text("W**0.5", "V^0.50"), "units of .V.0.50"),
        (replace_text("n_samples", "n_sampels"), "unreadable radar"),
        (replace_text('"scale": null', '"scale": 0.50'), "scale of 0.5"),
        (replace_text('"target", "frame"', '"frame", "target"'), "truth"),
        (lambda content: content[:-100], "a variable of"),
        (lambda content: content.replace(b"truth\0\0\0", b"trust\0\0\0"), "truth"),
    ],
)
def test_altered_native_file_error_names_mistake(tmp_path, change, message):
    path = tmp_path / "x.mat"
    dc.write(make_table_recording(), path)
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(RecordingError, match=message):
        dc.open(path)


@nightly
def test_rejects_structure_that_decompresses_beyond_limit(tmp_path):
    path = tmp_path / "x.mat"
    dc.write(make_table_recording(), path)
    variables = scipy.io.loadmat(path)
    variables = {name: value for name, value in variables.items() if not name.startswith("__")}
    del variables["empty"]
    variables["truth"] = {"range": np.zeros(2**25)}  # 256 MiB in 256 KiB
    scipy.io.savemat(path, variables, do_compression=True)
    assert path.stat().st_size < 2**20
    with pytest.raises(RecordingError, match="'truth' of more than"):
        dc.open(path)


@settings(max_examples=n_examples(60))
@given(data=st.data())
def test_corrupted_file_gives_cube_or_error(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("damaged") / "x.mat"
    dc.write(make_gap_recording(), path)
    path.write_bytes(data.draw(corrupted_bytes(path.read_bytes())))
    assert_cube_or_error(path)


@settings(max_examples=n_examples(60))
@given(data=st.data())
def test_corrupted_tables_give_cube_or_error(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("damaged") / "x.mat"
    dc.write(make_table_recording(), path)
    content = path.read_bytes()
    start = content.index(b"truth") - 60
    path.write_bytes(content[:start] + data.draw(corrupted_bytes(content[start:])))
    assert_cube_or_error(path)


@pytest.mark.skipif(
    "DECHIRP_REAL_DATA" not in os.environ,
    reason="no recordings: set DECHIRP_REAL_DATA to their folder",
)
def test_real_recording_round_trip_is_exact(tmp_path):
    recording = open_real_capture(Path(os.environ["DECHIRP_REAL_DATA"]))
    assert_write_preserves_recording(recording, tmp_path / "x.mat")
