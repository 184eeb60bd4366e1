"""Recordings written as MATLAB files come back equal, and SciPy and Octave open them."""

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
from formats.any_bytes import damaged, gives_a_cube_or_says_why
from formats.containers import (
    must_be_equal,
    must_keep_a_real_recording,
    must_leave_what_was_there,
    of_complex_codes,
    of_complex_samples,
    of_lost_chirps,
    of_one_number_a_frame,
    of_tables,
    real,
    small,
)


def test_scipy_sees_axes_in_the_opposite_order_and_tables_as_structures(tmp_path):
    recording = of_tables()
    dc.write(recording, tmp_path / "x.mat")

    seen = scipy.io.loadmat(tmp_path / "x.mat", simplify_cells=True)
    assert seen["cube"].shape == (32, 2, 6, 3)
    assert np.array_equal(seen["cube"].transpose(), recording.cube.values)
    truth = recording.tables["truth"]
    assert np.array_equal(seen["truth"]["range"].transpose(), truth["range"].values)
    assert json.loads(seen["dechirp"])["units"] == "sqrt(W)"
    assert "gap" not in seen


def test_codes_and_lost_chirps_are_variables_of_their_own(tmp_path):
    coded, lost = of_complex_codes(), of_lost_chirps()
    dc.write(coded, tmp_path / "coded.mat")
    dc.write(lost, tmp_path / "lost.mat")

    seen = scipy.io.loadmat(tmp_path / "coded.mat")["cube"].transpose()
    assert np.array_equal(seen.real, extract_adc_codes(coded.cube).values[..., 0])
    assert np.array_equal(seen.imag, extract_adc_codes(coded.cube).values[..., 1])
    gap = scipy.io.loadmat(tmp_path / "lost.mat")["gap"]
    assert np.array_equal(gap.transpose(), lost.contents.gaps)


def octave(folder: Path, script: str) -> None:
    command = ["octave-cli", "--no-gui", "--eval", script]
    subprocess.run(command, cwd=folder, capture_output=True, check=False)


HAS_OCTAVE = pytest.mark.skipif(shutil.which("octave-cli") is None, reason="no Octave here")


@HAS_OCTAVE
@pytest.mark.parametrize("made", [of_tables, of_complex_codes])
def test_octave_loads_the_numbers_that_were_written(tmp_path, made):
    recording = made()
    dc.write(recording, tmp_path / "x.mat")
    script = (
        "load x.mat; r = double(real(cube)); i = double(imag(cube));"
        " s = size(cube); text = dechirp; range = 0; if exist('truth'), range = truth.range; end;"
        " save('-v6', 'y.mat', 'r', 'i', 's', 'text', 'range');"
    )
    octave(tmp_path, script)

    seen = scipy.io.loadmat(tmp_path / "y.mat", squeeze_me=True)
    assert seen["s"].tolist() == [32, 2, 6, 3]
    scale = json.loads(str(seen["text"]))["scale"] or 1
    values = recording.cube.values.transpose()
    assert np.array_equal(seen["r"].astype(np.float32) * np.float32(scale), values.real)
    assert np.array_equal(seen["i"].astype(np.float32) * np.float32(scale), values.imag)
    if "truth" in recording.tables:
        truth = recording.tables["truth"]["range"].values
        assert np.array_equal(seen["range"].transpose(), truth)


@pytest.mark.parametrize("made", [of_lost_chirps, of_one_number_a_frame])
@pytest.mark.parametrize("compressed", [False, True])
def test_what_another_program_saved_again_is_still_ours(tmp_path, made, compressed):
    recording = made()
    dc.write(recording, tmp_path / "x.mat")
    held = scipy.io.loadmat(tmp_path / "x.mat", struct_as_record=True)
    held = {name: one for name, one in held.items() if not name.startswith("__")}
    # As MATLAB: sizes of 1 at the end are not kept.
    while held["cube"].ndim > 2 and held["cube"].shape[-1] == 1:
        held["cube"] = held["cube"][..., 0]
    scipy.io.savemat(tmp_path / "y.mat", held, do_compression=compressed)
    must_be_equal(dc.open(tmp_path / "y.mat"), recording)


@HAS_OCTAVE
@pytest.mark.parametrize("version", ["-v6", "-v7"])
def test_what_octave_saved_again_is_still_ours(tmp_path, version):
    recording = of_tables()
    dc.write(recording, tmp_path / "x.mat")
    octave(tmp_path, f"load x.mat; save('{version}', 'y.mat');")
    must_be_equal(dc.open(tmp_path / "y.mat"), recording)


def test_an_array_that_is_named_is_read_as_of_any_workspace(tmp_path):
    recording = of_complex_samples()
    dc.write(recording, tmp_path / "x.mat")
    told = {"radar": small(), "axes": "sample,rx,chirp,frame", "encoding": "full-scale"}
    opened = dc.open(tmp_path / "x.mat" / "cube", **told)
    assert opened.cube.attrs["units"] == "full scale"
    assert np.array_equal(opened.cube.values, recording.cube.values)


def test_a_full_disk_leaves_what_was_there(tmp_path):
    must_leave_what_was_there(tmp_path / "x.mat")


# --- What cannot be written -----------------------------------------------------------


def test_more_than_two_gibibytes_are_refused_before_a_frame_is_read(tmp_path):
    recording = of_complex_samples()
    # 3072 bytes a frame: 2^20 frames are 3 GiB.
    contents = replace(recording.contents, n_frames=2**20, decode=lambda number, out: 1 / 0)
    long = replace(recording, contents=contents, frame_numbers=range(2**20))
    with pytest.raises(DechirpError, match="h5read"):
        dc.write(long, tmp_path / "x.mat")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("name", "table", "said"),
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
def test_tables_that_no_structure_holds_are_refused_in_words(tmp_path, name, table, said):
    radar = small()
    recording = dc.recording_from_cube(of_complex_samples().cube, radar, tables={name: table})
    with pytest.raises(DechirpError, match=said):
        dc.write(recording, tmp_path / "x.mat")
    assert not list(tmp_path.iterdir())


# --- What was damaged -----------------------------------------------------------------


def described(old: str, new: str):
    def change(content: bytes) -> bytes:
        assert len(old) == len(new)
        assert old.encode() in content
        return content.replace(old.encode(), new.encode())

    return change


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (described('"dechirp_exchange": 1', '"dechirp_exchange": 7'), "version 7"),
        (described("sqrt(W)", "squrt W"), "squrt W"),
        (described("n_samples", "n_sampels"), "unreadable radar"),
        (described('"scale": null', '"scale": 0.50'), "scale of 0.5"),
        (described('"target", "frame"', '"frame", "target"'), "truth"),
        (lambda content: content[:-100], "EOFError"),
        (lambda content: content.replace(b"truth\0\0\0", b"trust\0\0\0"), "truth"),
    ],
)
def test_a_file_of_ours_that_was_changed_says_what_is_wrong(tmp_path, change, said):
    path = tmp_path / "x.mat"
    dc.write(of_tables(), path)
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(RecordingError, match=said):
        dc.open(path)


def test_a_compressed_structure_that_unpacks_without_end_is_refused(tmp_path):
    path = tmp_path / "x.mat"
    dc.write(of_tables(), path)
    held = scipy.io.loadmat(path)
    held = {name: one for name, one in held.items() if not name.startswith("__")}
    del held["empty"]
    held["truth"] = {"range": np.zeros(2**25)}  # 256 MiB in 256 KiB
    scipy.io.savemat(path, held, do_compression=True)
    assert path.stat().st_size < 2**20
    with pytest.raises(RecordingError, match="'truth' of more than"):
        dc.open(path)


@settings(max_examples=60)
@given(data=st.data())
def test_any_damage_gives_a_cube_or_says_why(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("damaged") / "x.mat"
    dc.write(of_lost_chirps(), path)
    path.write_bytes(data.draw(damaged(path.read_bytes())))
    gives_a_cube_or_says_why(path)


@settings(max_examples=60)
@given(data=st.data())
def test_any_damage_to_tables_gives_a_cube_or_says_why(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("damaged") / "x.mat"
    dc.write(of_tables(), path)
    content = path.read_bytes()
    start = content.index(b"truth") - 60
    path.write_bytes(content[:start] + data.draw(damaged(content[start:])))
    gives_a_cube_or_says_why(path)


@pytest.mark.skipif("DECHIRP_REAL_DATA" not in os.environ, reason="no recordings named")
def test_a_real_recording_comes_back_equal(tmp_path):
    recording = real(Path(os.environ["DECHIRP_REAL_DATA"]))
    must_keep_a_real_recording(recording, tmp_path / "x.mat")
