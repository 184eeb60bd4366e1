"""Writer of Zarr stores: round trips, reading with xarray and zarr only, and damaged stores."""

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
import zarr

import dechirp as dc
from dechirp.core.errors import DechirpError, RecordingError
from dechirp.recordings import cube_store as store_cube
from dechirp.recordings.arrays.zarr_tables import ZarrTables
from dechirp.simulation.adc_codes import extract_adc_codes
from formats.native_recordings import (
    EVERY_RECORDING,
    assert_recordings_equal,
    assert_write_preserves_recording,
    limit_file_size,
    make_complex_code_recording,
    make_complex_recording,
    make_gap_recording,
    make_real_code_recording,
    make_table_recording,
    open_real_capture,
)
from nightly import nightly, nightly_except


@EVERY_RECORDING
def test_round_trip_is_bit_exact(tmp_path, make_recording):
    recording = make_recording()
    assert dc.write(recording, tmp_path / "x.zarr") == (tmp_path / "x.zarr",)
    copy = dc.open(tmp_path / "x.zarr")
    assert copy.format == "zarr"
    assert_recordings_equal(copy, recording)


def test_reads_boolean_columns_of_older_xarray(tmp_path):
    recording = make_table_recording()
    dc.write(recording, tmp_path / "x.zarr")
    (name, flags), *_ = (
        (f"{table}/{key}", column)
        for table, dataset in recording.tables.items()
        for key, column in dataset.variables.items()
        if column.dtype == bool
    )
    shutil.rmtree(tmp_path / "x.zarr" / name)
    zarr.open_group(tmp_path / "x.zarr").create_array(
        name,
        data=flags.values.astype(np.int8),
        dimension_names=flags.dims,
        attributes={**flags.attrs, "dtype": "bool"},
    )
    assert_recordings_equal(dc.open(tmp_path / "x.zarr"), recording)


def test_xarray_reads_codes_gaps_and_tables(tmp_path):
    code_recording, gap_recording, table_recording = (
        make_complex_code_recording(),
        make_gap_recording(),
        make_table_recording(),
    )
    for name, recording in (
        ("coded", code_recording),
        ("lost", gap_recording),
        ("tables", table_recording),
    ):
        dc.write(recording, tmp_path / f"{name}.zarr")

    with xr.open_zarr(tmp_path / "coded.zarr", consolidated=False) as dataset:
        assert dataset.cube.dtype == np.int16
        assert np.array_equal(dataset.cube, extract_adc_codes(code_recording.cube))
        parts = dataset.cube.values * np.float32(dataset.cube.attrs["scale"])
        assert np.array_equal(parts[..., 0], code_recording.cube.values.real)
    with xr.open_zarr(tmp_path / "lost.zarr", consolidated=False) as dataset:
        assert np.array_equal(dataset.cube.coords["gap"], gap_recording.contents.gaps)
    with xr.open_zarr(tmp_path / "tables.zarr", group="truth", consolidated=False) as dataset:
        assert dataset.target.values.tolist() == ["car", "Fußgänger"]
        assert np.array_equal(dataset.range, table_recording.tables["truth"].range)


@pytest.mark.parametrize(
    "make_recording",
    nightly_except(
        2, [make_complex_code_recording, make_real_code_recording, make_complex_recording]
    ),
)
@pytest.mark.parametrize("chirps_at_once", [4, 100])
def test_chunk_and_file_sizes_do_not_change_samples(
    tmp_path, monkeypatch, make_recording, chirps_at_once
):
    recording = make_recording()
    chirp_bytes = (
        recording.cube
        if make_recording == make_complex_recording
        else extract_adc_codes(recording.cube)
    )[0, 0].nbytes
    monkeypatch.setattr(store_cube, "_CHUNK_BYTES", chirps_at_once * chirp_bytes)
    monkeypatch.setattr(store_cube, "_FILE_BYTES", 12 * chirp_bytes)  # two frames of 6 chirps
    dc.write(recording, tmp_path / "x.zarr")

    n_chunks_per_frame = 2 if chirps_at_once == 4 else 1
    files = [file.name for file in (tmp_path / "x.zarr" / "cube").glob("c.*")]
    # The last file holds fewer frames.
    assert len(files) == (3 * n_chunks_per_frame if n_chunks_per_frame == 2 else 2)
    assert_recordings_equal(dc.open(tmp_path / "x.zarr"), recording)
    last_frame = next(dc.open(tmp_path / "x.zarr", frames=(2, 3)).frames())
    assert np.array_equal(last_frame.values[0], recording.cube.values[2])
    array = zarr.open_array(tmp_path / "x.zarr" / "cube", mode="r")
    assert array.shape[0] == 3 and np.isfinite(array[:]).all()


def test_recompressed_codes_give_equal_samples(tmp_path):
    recording = make_complex_code_recording()
    dc.write(recording, tmp_path / "x.zarr")
    store = zarr.open_group(tmp_path / "x.zarr")
    numbers, attributes = store["cube"][:], dict(store["cube"].attrs)
    names = store["cube"].metadata.dimension_names
    del store["cube"]
    store.create_array("cube", data=numbers, dimension_names=names, attributes=attributes)

    assert_recordings_equal(dc.open(tmp_path / "x.zarr"), recording)


def test_all_zero_frame_is_not_gap(tmp_path):
    recording = make_complex_code_recording()
    recording.cube.values[1] = 0  # zarr does not write chunks of zeros
    zero_recording = dc.recording_from_cube(recording.cube, recording.radar)
    dc.write(zero_recording, tmp_path / "x.zarr")

    copy = dc.open(tmp_path / "x.zarr")
    assert copy.contents.gaps is None
    assert np.array_equal(copy.cube.values, zero_recording.cube.values)


def test_samples_off_code_grid_are_stored_as_floats(tmp_path):
    recording = make_complex_code_recording()
    cube = recording.cube.copy()
    cube.values[0] = 0  # zeros fit every code grid
    cube.values[2, 1, 0, 3] *= np.float32(1.01)
    mixed_recording = dc.recording_from_cube(cube, recording.radar)
    dc.write(mixed_recording, tmp_path / "x.zarr")

    copy = dc.open(tmp_path / "x.zarr")
    assert copy.contents.scale is None
    assert np.array_equal(copy.cube.values, cube.values)


def test_missing_chunk_is_gap_and_truncated_chunk_is_rejected(tmp_path, monkeypatch):
    monkeypatch.setattr(store_cube, "_FILE_BYTES", 1)  # one frame per file
    recording = make_complex_code_recording()
    dc.write(recording, tmp_path / "x.zarr")
    chunk = tmp_path / "x.zarr" / "cube" / "c.1.0.0.0.0"
    content = chunk.read_bytes()

    chunk.write_bytes(content[:-4])
    copy = dc.open(tmp_path / "x.zarr")
    assert np.array_equal(next(copy.frames()).values[0], recording.cube.values[0])
    with pytest.raises(RecordingError, match="has a wrong size"):
        _ = copy.cube
    chunk.write_bytes(content + bytes(4))
    with pytest.raises(RecordingError, match="has a wrong size"):
        _ = dc.open(tmp_path / "x.zarr").cube

    chunk.unlink()
    copy = dc.open(tmp_path / "x.zarr")
    assert copy.contents.gaps.any(axis=1).tolist() == [False, True, False]
    assert not copy.cube.values[1].any()
    assert np.array_equal(copy.cube.values[2], recording.cube.values[2])


def test_truncated_chunk_is_rejected_when_unscaled(tmp_path):
    # Floats are read without scaling; the error of the chunk's size was a bare ValueError.
    dc.write(make_complex_recording(), tmp_path / "x.zarr")
    (file,) = (tmp_path / "x.zarr" / "cube").glob("c*")
    os.truncate(file, file.stat().st_size - 1)
    with pytest.raises(RecordingError, match=r"x\.zarr: .* has a wrong size.*copy the file again"):
        list(dc.open(tmp_path / "x.zarr").frames())


@pytest.mark.parametrize(
    "array", nightly_except(1, ["cube", "frame", "detections/range", "truth/target"])
)
def test_wrong_shape_of_absent_chunks_is_rejected_before_reading(tmp_path, array):
    # Each absent chunk takes the Zarr library 0.2 ms: a million of them were minutes.
    recording = make_table_recording()
    dc.write(recording, tmp_path / "x.zarr")
    file = tmp_path / "x.zarr" / array / "zarr.json"
    metadata = json.loads(file.read_text())
    metadata["shape"][0] = 6_000
    metadata["chunk_grid"]["configuration"]["chunk_shape"][0] = 1
    file.write_text(json.dumps(metadata))
    with pytest.raises(RecordingError, match=r"x\.zarr.* without \d+ of its 6000 chunks"):
        dict(dc.open(tmp_path / "x.zarr").tables)


def test_given_radar_takes_precedence_over_stored_radar(tmp_path):
    recording = make_table_recording()
    dc.write(recording, tmp_path / "x.zarr")
    given_radar = replace(recording.radar, hardware=None)
    copy = dc.open(tmp_path / "x.zarr", radar=given_radar)
    assert copy.radar == given_radar
    assert set(copy.tables) == set(recording.tables)


@nightly
def test_selected_frames_are_written_with_their_table_rows(tmp_path):
    recording = make_table_recording()
    dc.write(recording.select_frames(1, 3), tmp_path / "x.zarr")
    copy = dc.open(tmp_path / "x.zarr")
    assert np.array_equal(copy.cube.values, recording.cube.values[1:])
    assert copy.tables["truth"].frame.values.tolist() == [0, 1]
    assert np.array_equal(copy.tables["truth"].range, recording.tables["truth"].range[:, 1:])


@nightly
def test_full_disk_keeps_existing_store(tmp_path):
    out = tmp_path / "x.zarr"
    dc.write(make_gap_recording(), out)
    contents = {file: file.read_bytes() for file in sorted(out.rglob("*")) if file.is_file()}
    for limit in (0, 100, 1500, 4000):
        with limit_file_size(limit), pytest.raises(DechirpError, match="not writable"):
            dc.write(make_table_recording(), out)
        assert [entry.name for entry in tmp_path.iterdir()] == ["x.zarr"]
        current_contents = {
            file: file.read_bytes() for file in sorted(out.rglob("*")) if file.is_file()
        }
        assert current_contents == contents


def test_replaces_native_store_only(tmp_path):
    out = tmp_path / "x.zarr"
    dc.write(make_table_recording(), out)
    dc.write(make_complex_code_recording(), out)
    assert set(dc.open(out).tables) == set()

    (out / "notes.txt").write_text("mine")
    with pytest.raises(DechirpError, match=r"a folder with notes\.txt"):
        dc.write(make_table_recording(), out)
    shutil.rmtree(out)
    out.write_text("a file")
    with pytest.raises(DechirpError, match="a file"):
        dc.write(make_table_recording(), out)
    assert out.read_text() == "a file"


@pytest.mark.parametrize("name", ["cube", "gap", "calibration", "a/b", "..", ""])
def test_rejects_reserved_or_invalid_table_names(tmp_path, name):
    recording = make_complex_recording()
    table = xr.Dataset({"x": ("row", [1.0])})
    table_recording = dc.recording_from_cube(recording.cube, recording.radar, tables={name: table})
    with pytest.raises(DechirpError, match="name"):
        dc.write(table_recording, tmp_path / "x.zarr")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "column",
    [
        ("row", np.array(["2026-01-01"], "datetime64[ns]")),
        ("row", [1.0], {"_FillValue": 7.0}),
        ("row", [1.0], {"coordinates": "x"}),
    ],
)
def test_rejects_columns_that_would_change_on_reading(tmp_path, column):
    recording = make_complex_recording()
    tables = {"mine": xr.Dataset({"x": column})}
    with pytest.raises(DechirpError, match=r"column (mine\.)?x |without a JSON form"):
        dc.write(
            dc.recording_from_cube(recording.cube, recording.radar, tables=tables),
            tmp_path / "x.zarr",
        )
    assert list(tmp_path.iterdir()) == []


def test_table_with_xarray_encoding_keeps_values(tmp_path):
    recording = make_complex_recording()
    table = xr.Dataset({"x": ("row", [1.25, 2.5])})
    table["x"].encoding = {"dtype": "int16", "scale_factor": 1.0, "chunksizes": (1,), "zlib": True}
    table_recording = dc.recording_from_cube(
        recording.cube, recording.radar, tables={"mine": table}
    )
    dc.write(table_recording, tmp_path / "x.zarr")
    assert dc.open(tmp_path / "x.zarr").tables["mine"]["x"].values.tolist() == [1.25, 2.5]


def write_store(tmp_path) -> Path:
    dc.write(make_table_recording(), tmp_path / "x.zarr")
    return tmp_path / "x.zarr" / "truth"


def change_metadata(metadata_file: Path, **fields) -> None:
    metadata_file.write_text(json.dumps({**json.loads(metadata_file.read_text()), **fields}))


@nightly
@pytest.mark.parametrize("column", ["range", "target"])
def test_rejects_damaged_table_but_reads_samples(tmp_path, column):
    truth = write_store(tmp_path)
    for chunk in [file for file in (truth / column / "c").rglob("*") if file.is_file()]:
        chunk.write_bytes(chunk.read_bytes()[:7])

    copy = dc.open(tmp_path / "x.zarr")
    assert np.array_equal(copy.cube.values, make_table_recording().cube.values)
    with pytest.raises(RecordingError, match="not readable"):
        _ = copy.tables


@pytest.mark.parametrize("column", nightly_except(1, ["range", "target"]))
def test_rejects_table_with_oversized_shape(tmp_path, column):
    truth = write_store(tmp_path)
    metadata_file = truth / column / "zarr.json"
    shape = [2**20] * len(json.loads(metadata_file.read_text())["shape"])
    change_metadata(metadata_file, shape=[2**36, *shape[1:]])
    with pytest.raises(RecordingError, match="at most twice the file"):
        ZarrTables(tmp_path / "x.zarr")["truth"]


@pytest.mark.parametrize("column", nightly_except(1, ["range", "target"]))
def test_rejects_table_behind_link(tmp_path, column):
    truth = write_store(tmp_path)
    secret = tmp_path / "secret"
    (truth / column / "c").rename(secret)
    (truth / column / "c").symlink_to(secret)
    with pytest.raises(RecordingError, match="is a link"):
        ZarrTables(tmp_path / "x.zarr")["truth"]


def test_rejects_table_codec_that_unpickles(tmp_path):
    truth = write_store(tmp_path)
    for column in ("range", "target"):
        metadata_file = truth / column / "zarr.json"
        metadata = json.loads(metadata_file.read_text())
        change_metadata(
            metadata_file,
            codecs=[*metadata["codecs"], {"name": "numcodecs.pickle", "configuration": {}}],
        )
        with pytest.raises(RecordingError, match="needs the codec pickle"):
            ZarrTables(tmp_path / "x.zarr")["truth"]


def test_rejects_gaps_of_wrong_shape(tmp_path):
    dc.write(make_gap_recording(), tmp_path / "x.zarr")
    change_metadata(tmp_path / "x.zarr" / "gap" / "zarr.json", shape=[2, 6])
    with pytest.raises(RecordingError, match="an array gap of 2 x 6"):
        dc.open(tmp_path / "x.zarr")


@pytest.mark.parametrize("scale", [0.0, -1.0, "NaN", 1e39])
def test_rejects_invalid_scale(tmp_path, scale):
    dc.write(make_complex_code_recording(), tmp_path / "x.zarr")
    metadata_file = tmp_path / "x.zarr" / "cube" / "zarr.json"
    attributes = json.loads(metadata_file.read_text())["attributes"]
    change_metadata(metadata_file, attributes={**attributes, "scale": scale})
    with pytest.raises(RecordingError, match="its scale is"):
        dc.open(tmp_path / "x.zarr")


def test_run_folder_opens_with_tables(tmp_path):
    result = dc.run(dc.reference(["n_frames=2", "radar.frame.chirp.n_samples=256"]))
    from dechirp.results.results import write_results

    write_results(
        tmp_path / "run",
        dict.fromkeys(("report.html", "scenario.yaml", "run.json"), ""),
        frames=result.frames(),
        n_frames=2,
        radar=result.radar,
        detections=result.detections,
        truth=result.truth,
    )
    copy = dc.open(tmp_path / "run")
    assert set(copy.tables) == {"detections", "truth"}
    xr.testing.assert_identical(copy.tables["detections"], result.detections)
    xr.testing.assert_identical(copy.tables["truth"], result.truth)
    assert np.array_equal(copy.cube.values, result.cube.values)


@pytest.mark.skipif(
    "DECHIRP_REAL_DATA" not in os.environ,
    reason="no recordings: set DECHIRP_REAL_DATA to their folder",
)
def test_real_recording_round_trip_is_exact(tmp_path):
    recording = open_real_capture(Path(os.environ["DECHIRP_REAL_DATA"]))
    assert_write_preserves_recording(recording, tmp_path / "x.zarr")
    assert zarr.open_array(tmp_path / "x.zarr" / "cube", mode="r").dtype == np.int16
