"""Writer of NumPy archives: round trips, reading with NumPy only, and damaged files."""

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
from formats.corruption import assert_cube_or_error, corrupted_bytes
from formats.native_recordings import (
    assert_full_disk_keeps_files,
    assert_recordings_equal,
    assert_write_preserves_recording,
    make_complex_code_recording,
    make_complex_recording,
    make_gap_recording,
    make_radar,
    make_table_recording,
    open_real_capture,
)
from nightly import n_examples


def test_numpy_reads_cube_and_tables(tmp_path):
    recording = make_table_recording()
    dc.write(recording, tmp_path / "x.npz")

    with np.load(tmp_path / "x.npz", allow_pickle=False) as file:
        assert np.array_equal(file["cube"], recording.cube.values)
        assert np.array_equal(file["truth.range"], recording.tables["truth"]["range"].values)
        assert json.loads(str(file["dechirp"]))["units"] == "W**0.5"
        assert "gap" not in file.files


def test_codes_and_gaps_are_separate_arrays(tmp_path):
    code_recording, gap_recording = make_complex_code_recording(), make_gap_recording()
    dc.write(code_recording, tmp_path / "coded.npz")
    dc.write(gap_recording, tmp_path / "lost.npz")

    with np.load(tmp_path / "coded.npz") as file:
        assert file["cube"].dtype == np.int16
        assert np.array_equal(file["cube"], extract_adc_codes(code_recording.cube).values)
        scale = json.loads(str(file["dechirp"]))["scale"]
        assert np.array_equal(
            file["cube"][..., 0] * np.float32(scale), code_recording.cube.values.real
        )
    with np.load(tmp_path / "lost.npz") as file:
        assert np.array_equal(file["gap"], gap_recording.contents.gaps)


def test_equal_recordings_give_equal_bytes(tmp_path):
    for name in ("a.npz", "b.npz"):
        dc.write(make_table_recording(), tmp_path / name)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_named_array_is_read_as_foreign_archive(tmp_path):
    recording = make_complex_code_recording()
    dc.write(recording, tmp_path / "x.npz")
    axes = "frame,chirp,rx,sample,iq"
    array_recording = dc.open(tmp_path / "x.npz" / "cube", radar=make_radar(), axes=axes)
    assert array_recording.cube.attrs["units"] == "1"
    assert (
        array_recording.cube.values.real.max()
        == extract_adc_codes(recording.cube).values[..., 0].max() / 32768
    )


def test_archive_recompressed_by_numpy_is_native(tmp_path):
    recording = make_table_recording()
    dc.write(recording, tmp_path / "x.npz")
    with np.load(tmp_path / "x.npz") as file:
        np.savez_compressed(tmp_path / "y.npz", **file)
    assert_recordings_equal(dc.open(tmp_path / "y.npz"), recording)


def test_file_can_be_overwritten_while_it_is_read(tmp_path):
    recording = make_complex_recording()
    dc.write(recording, tmp_path / "x.npz")
    dc.write(dc.open(tmp_path / "x.npz").select_frames(1, 3), tmp_path / "x.npz")
    assert np.array_equal(dc.open(tmp_path / "x.npz").cube.values, recording.cube.values[1:])


def test_progress_counts_frames(tmp_path):
    progress = []
    dc.write(
        make_complex_recording(),
        tmp_path / "x.npz",
        progress=lambda *counts: progress.append(counts),
    )
    assert progress == [(1, 3), (2, 3), (3, 3)]


def test_full_disk_keeps_existing_file(tmp_path):
    assert_full_disk_keeps_files(tmp_path / "x.npz")


def test_rejects_attributes_without_json_form(tmp_path):
    recording = make_table_recording()
    recording.contents.tables["truth"].attrs["of"] = np.zeros(3)
    with pytest.raises(DechirpError, match="attributes or texts without a JSON form"):
        dc.write(recording, tmp_path / "x.npz")
    assert not list(tmp_path.iterdir())


def replace_arrays(path: Path, **arrays) -> None:
    """Replace arrays of an archive by bytes of .npy files; None removes an array."""
    with zipfile.ZipFile(path) as archive:
        members = {info.filename: archive.read(info) for info in archive.infolist()}
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in (
            members | {f"{key}.npy": member for key, member in arrays.items()}
        ).items():
            if content is not None:
                archive.writestr(name, content)


def encode_npy(array, claimed_shape=None) -> bytes:
    file = io.BytesIO()
    header = np.lib.format.header_data_from_array_1_0(array)
    np.lib.format.write_array_header_1_0(
        file, header | ({"shape": claimed_shape} if claimed_shape else {})
    )
    return file.getvalue() + array.tobytes()


def edit_description(path: Path, old: str, new: str) -> dict[str, bytes]:
    with np.load(path) as file:
        description = str(file["dechirp"])
    assert old in description
    return {"dechirp": encode_npy(np.array(description.replace(old, new)))}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda path: edit_description(path, '"dechirp_exchange": 1', '"dechirp_exchange": 7'),
            "version 7",
        ),
        (lambda path: edit_description(path, "W**0.5", "volt"), "volt"),
        (lambda path: edit_description(path, "n_samples", "n_sampels"), "unreadable radar"),
        (lambda path: edit_description(path, '"scale": null', '"scale": 0.5'), "scale of 0.5"),
        (
            lambda path: edit_description(path, '"scale": null', f'"scale": 1{"0" * 400}'),
            "scale of inf",
        ),
        (lambda path: edit_description(path, '["target", "frame"]', '["target"]'), "truth"),
        (lambda path: {"cube": None}, "cube"),
        (lambda path: {"cube": encode_npy(np.zeros((3, 6, 2, 32), np.int16))}, "int16 and a scale"),
        (
            lambda path: {"cube": encode_npy(np.zeros((3, 6, 2, 31), np.complex64))},
            "31 along sample",
        ),
        (lambda path: {"cube": encode_npy(np.zeros(4, np.complex64), (2**40, 6, 2, 32))}, "bytes"),
        (lambda path: {"truth.range": None}, "truth"),
        (lambda path: {"truth.range": encode_npy(np.zeros(1), (2**50,))}, "truth"),
        (lambda path: {"gap": encode_npy(np.zeros((3, 5), np.uint8))}, "gap of 3 x 5"),
    ],
)
def test_altered_native_file_error_names_mistake(tmp_path, change, message):
    path = tmp_path / "x.npz"
    dc.write(make_table_recording(), path)
    replace_arrays(path, **change(path))
    with pytest.raises(RecordingError, match=message):
        dc.open(path)


def test_never_unpickles_objects(tmp_path):
    path = tmp_path / "x.npz"
    dc.write(make_table_recording(), path)
    file = io.BytesIO()
    np.save(file, np.array([{"a": 1}], object), allow_pickle=True)
    replace_arrays(path, **{"truth.range": file.getvalue()})
    with pytest.raises(RecordingError, match="truth"):
        dc.open(path)


@settings(max_examples=n_examples(60))
@given(data=st.data())
def test_corrupted_file_gives_cube_or_error(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("damaged") / "x.npz"
    dc.write(make_gap_recording(), path)
    path.write_bytes(data.draw(corrupted_bytes(path.read_bytes())))
    assert_cube_or_error(path)


@pytest.mark.skipif(
    "DECHIRP_REAL_DATA" not in os.environ,
    reason="no recordings: set DECHIRP_REAL_DATA to their folder",
)
def test_real_recording_round_trip_is_exact(tmp_path):
    recording = open_real_capture(Path(os.environ["DECHIRP_REAL_DATA"]))
    assert_write_preserves_recording(recording, tmp_path / "x.npz")
