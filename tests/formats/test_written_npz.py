"""Recordings written as NumPy archives come back equal, and NumPy opens them alone."""

import io
import json
import os
import zipfile
from pathlib import Path

import numpy as np
import pytest
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
    of_tables,
    real,
    small,
)


def test_numpy_alone_gives_cube_and_tables(tmp_path):
    recording = of_tables()
    dc.write(recording, tmp_path / "x.npz")

    with np.load(tmp_path / "x.npz", allow_pickle=False) as file:
        assert np.array_equal(file["cube"], recording.cube.values)
        assert np.array_equal(file["truth.range"], recording.tables["truth"]["range"].values)
        assert json.loads(str(file["dechirp"]))["units"] == "sqrt(W)"
        assert "gap" not in file.files


def test_codes_and_lost_chirps_are_arrays_of_their_own(tmp_path):
    coded, lost = of_complex_codes(), of_lost_chirps()
    dc.write(coded, tmp_path / "coded.npz")
    dc.write(lost, tmp_path / "lost.npz")

    with np.load(tmp_path / "coded.npz") as file:
        assert file["cube"].dtype == np.int16
        assert np.array_equal(file["cube"], extract_adc_codes(coded.cube).values)
        scale = json.loads(str(file["dechirp"]))["scale"]
        assert np.array_equal(file["cube"][..., 0] * np.float32(scale), coded.cube.values.real)
    with np.load(tmp_path / "lost.npz") as file:
        assert np.array_equal(file["gap"], lost.contents.gaps)


def test_the_same_recording_gives_the_same_bytes(tmp_path):
    for name in ("a.npz", "b.npz"):
        dc.write(of_tables(), tmp_path / name)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_an_array_that_is_named_is_read_as_of_any_archive(tmp_path):
    recording = of_complex_codes()
    dc.write(recording, tmp_path / "x.npz")
    axes = "frame,chirp,rx,sample,iq"
    opened = dc.open(tmp_path / "x.npz" / "cube", radar=small(), axes=axes)
    assert opened.cube.attrs["units"] == "full scale"
    assert (
        opened.cube.values.real.max()
        == extract_adc_codes(recording.cube).values[..., 0].max() / 32768
    )


def test_what_numpy_compressed_again_is_still_ours(tmp_path):
    recording = of_tables()
    dc.write(recording, tmp_path / "x.npz")
    with np.load(tmp_path / "x.npz") as file:
        np.savez_compressed(tmp_path / "y.npz", **file)
    must_be_equal(dc.open(tmp_path / "y.npz"), recording)


def test_a_file_can_be_written_over_the_one_it_is_read_from(tmp_path):
    recording = of_complex_samples()
    dc.write(recording, tmp_path / "x.npz")
    dc.write(dc.open(tmp_path / "x.npz").select_frames(1, 3), tmp_path / "x.npz")
    assert np.array_equal(dc.open(tmp_path / "x.npz").cube.values, recording.cube.values[1:])


def test_progress_counts_the_frames(tmp_path):
    seen = []
    dc.write(of_complex_samples(), tmp_path / "x.npz", progress=lambda *done: seen.append(done))
    assert seen == [(1, 3), (2, 3), (3, 3)]


def test_a_full_disk_leaves_what_was_there(tmp_path):
    must_leave_what_was_there(tmp_path / "x.npz")


def test_attributes_that_are_no_text_are_refused_in_words(tmp_path):
    recording = of_tables()
    recording.contents.tables["truth"].attrs["of"] = np.zeros(3)
    with pytest.raises(DechirpError, match="attributes or texts without a JSON form"):
        dc.write(recording, tmp_path / "x.npz")
    assert not list(tmp_path.iterdir())


def changed(path: Path, **arrays) -> None:
    """The same archive with other arrays, as bytes of .npy files; None leaves one out."""
    with zipfile.ZipFile(path) as archive:
        held = {info.filename: archive.read(info) for info in archive.infolist()}
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in (held | {f"{key}.npy": made for key, made in arrays.items()}).items():
            if content is not None:
                archive.writestr(name, content)


def npy(array, claims=None) -> bytes:
    file = io.BytesIO()
    said = np.lib.format.header_data_from_array_1_0(array)
    np.lib.format.write_array_header_1_0(file, said | ({"shape": claims} if claims else {}))
    return file.getvalue() + array.tobytes()


def text(path: Path, old: str, new: str) -> dict[str, bytes]:
    with np.load(path) as file:
        said = str(file["dechirp"])
    assert old in said
    return {"dechirp": npy(np.array(said.replace(old, new)))}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda path: text(path, '"dechirp_exchange": 1', '"dechirp_exchange": 7'), "version 7"),
        (lambda path: text(path, "sqrt(W)", "volt"), "volt"),
        (lambda path: text(path, "n_samples", "n_sampels"), "unreadable radar"),
        (lambda path: text(path, '"scale": null', '"scale": 0.5'), "scale of 0.5"),
        (lambda path: text(path, '"scale": null', f'"scale": 1{"0" * 400}'), "scale of inf"),
        (lambda path: text(path, '["target", "frame"]', '["target"]'), "truth"),
        (lambda path: {"cube": None}, "cube"),
        (lambda path: {"cube": npy(np.zeros((3, 6, 2, 32), np.int16))}, "int16 and a scale"),
        (lambda path: {"cube": npy(np.zeros((3, 6, 2, 31), np.complex64))}, "31 along sample"),
        (lambda path: {"cube": npy(np.zeros(4, np.complex64), (2**40, 6, 2, 32))}, "bytes"),
        (lambda path: {"truth.range": None}, "truth"),
        (lambda path: {"truth.range": npy(np.zeros(1), (2**50,))}, "truth"),
        (lambda path: {"gap": npy(np.zeros((3, 5), np.uint8))}, "gap of 3 x 5"),
    ],
)
def test_a_file_of_ours_that_was_changed_says_what_is_wrong(tmp_path, change, said):
    path = tmp_path / "x.npz"
    dc.write(of_tables(), path)
    changed(path, **change(path))
    with pytest.raises(RecordingError, match=said):
        dc.open(path)


def test_pickled_objects_are_never_opened(tmp_path):
    path = tmp_path / "x.npz"
    dc.write(of_tables(), path)
    file = io.BytesIO()
    np.save(file, np.array([{"a": 1}], object), allow_pickle=True)
    changed(path, **{"truth.range": file.getvalue()})
    with pytest.raises(RecordingError, match="truth"):
        dc.open(path)


@settings(max_examples=60)
@given(data=st.data())
def test_any_damage_gives_a_cube_or_says_why(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("damaged") / "x.npz"
    dc.write(of_lost_chirps(), path)
    path.write_bytes(data.draw(damaged(path.read_bytes())))
    gives_a_cube_or_says_why(path)


@pytest.mark.skipif("DECHIRP_REAL_DATA" not in os.environ, reason="no recordings named")
def test_a_real_recording_comes_back_equal(tmp_path):
    recording = real(Path(os.environ["DECHIRP_REAL_DATA"]))
    must_keep_a_real_recording(recording, tmp_path / "x.npz")
