"""Recordings written as Zarr come back equal; xarray and zarr open them alone."""

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
from formats.containers import (
    EVERY_CASE,
    must_be_equal,
    must_keep_a_real_recording,
    of_complex_codes,
    of_complex_samples,
    of_lost_chirps,
    of_real_codes,
    of_tables,
    real,
    room_for,
)


@EVERY_CASE
def test_every_recording_comes_back_bit_by_bit(tmp_path, made):
    recording = made()
    assert dc.write(recording, tmp_path / "x.zarr") == (tmp_path / "x.zarr",)
    opened = dc.open(tmp_path / "x.zarr")
    assert opened.format == "zarr"
    must_be_equal(opened, recording)


def test_flags_as_older_xarray_wrote_them_are_flags(tmp_path):
    recording = of_tables()
    dc.write(recording, tmp_path / "x.zarr")
    (name, flags), *_ = (
        (f"{table}/{key}", column)
        for table, of in recording.tables.items()
        for key, column in of.variables.items()
        if column.dtype == bool
    )
    shutil.rmtree(tmp_path / "x.zarr" / name)
    zarr.open_group(tmp_path / "x.zarr").create_array(
        name,
        data=flags.values.astype(np.int8),
        dimension_names=flags.dims,
        attributes={**flags.attrs, "dtype": "bool"},
    )
    must_be_equal(dc.open(tmp_path / "x.zarr"), recording)


def test_xarray_alone_gives_codes_gaps_and_tables(tmp_path):
    coded, lost, tables = of_complex_codes(), of_lost_chirps(), of_tables()
    for name, one in (("coded", coded), ("lost", lost), ("tables", tables)):
        dc.write(one, tmp_path / f"{name}.zarr")

    with xr.open_zarr(tmp_path / "coded.zarr", consolidated=False) as read:
        assert read.cube.dtype == np.int16
        assert np.array_equal(read.cube, extract_adc_codes(coded.cube))
        parts = read.cube.values * np.float32(read.cube.attrs["scale"])
        assert np.array_equal(parts[..., 0], coded.cube.values.real)
    with xr.open_zarr(tmp_path / "lost.zarr", consolidated=False) as read:
        assert np.array_equal(read.cube.coords["gap"], lost.contents.gaps)
    with xr.open_zarr(tmp_path / "tables.zarr", group="truth", consolidated=False) as read:
        assert read.target.values.tolist() == ["car", "Fußgänger"]
        assert np.array_equal(read.range, tables.tables["truth"].range)


@pytest.mark.parametrize("made", [of_complex_codes, of_real_codes, of_complex_samples])
@pytest.mark.parametrize("chirps_at_once", [4, 100])
def test_frames_in_pieces_and_several_to_a_file_are_the_same_samples(
    tmp_path, monkeypatch, made, chirps_at_once
):
    recording = made()
    chirp_bytes = (
        recording.cube if made == of_complex_samples else extract_adc_codes(recording.cube)
    )[0, 0].nbytes
    monkeypatch.setattr(store_cube, "_CHUNK_BYTES", chirps_at_once * chirp_bytes)
    monkeypatch.setattr(store_cube, "_FILE_BYTES", 12 * chirp_bytes)  # two frames of 6 chirps
    dc.write(recording, tmp_path / "x.zarr")

    pieces = 2 if chirps_at_once == 4 else 1
    files = [file.name for file in (tmp_path / "x.zarr" / "cube").glob("c.*")]
    assert len(files) == (3 * pieces if pieces == 2 else 2)  # the last is not full
    must_be_equal(dc.open(tmp_path / "x.zarr"), recording)
    alone = next(dc.open(tmp_path / "x.zarr", frames=(2, 3)).frames())
    assert np.array_equal(alone.values[0], recording.cube.values[2])
    read = zarr.open_array(tmp_path / "x.zarr" / "cube", mode="r")
    assert read.shape[0] == 3 and np.isfinite(read[:]).all()


def test_codes_that_other_tools_compressed_are_the_same_samples(tmp_path):
    recording = of_complex_codes()
    dc.write(recording, tmp_path / "x.zarr")
    store = zarr.open_group(tmp_path / "x.zarr")
    numbers, said = store["cube"][:], dict(store["cube"].attrs)
    names = store["cube"].metadata.dimension_names
    del store["cube"]
    store.create_array("cube", data=numbers, dimension_names=names, attributes=said)

    must_be_equal(dc.open(tmp_path / "x.zarr"), recording)


def test_a_frame_that_was_never_sent_is_zero_and_no_gap(tmp_path):
    recording = of_complex_codes()
    recording.cube.values[1] = 0  # zarr itself leaves out chunks of zeros
    dark = dc.recording_from_cube(recording.cube, recording.radar)
    dc.write(dark, tmp_path / "x.zarr")

    opened = dc.open(tmp_path / "x.zarr")
    assert opened.contents.gaps is None
    assert np.array_equal(opened.cube.values, dark.cube.values)


def test_samples_that_turn_out_to_be_no_codes_are_kept_as_floats(tmp_path):
    recording = of_complex_codes()
    cube = recording.cube.copy()
    cube.values[0] = 0  # zeros are codes of any converter
    cube.values[2, 1, 0, 3] *= np.float32(1.01)
    mixed = dc.recording_from_cube(cube, recording.radar)
    dc.write(mixed, tmp_path / "x.zarr")

    opened = dc.open(tmp_path / "x.zarr")
    assert opened.contents.scale is None
    assert np.array_equal(opened.cube.values, cube.values)


def test_a_piece_that_is_lost_becomes_a_gap_and_one_cut_short_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(store_cube, "_FILE_BYTES", 1)  # a frame to a file
    recording = of_complex_codes()
    dc.write(recording, tmp_path / "x.zarr")
    piece = tmp_path / "x.zarr" / "cube" / "c.1.0.0.0.0"
    whole = piece.read_bytes()

    piece.write_bytes(whole[:-4])
    opened = dc.open(tmp_path / "x.zarr")
    assert np.array_equal(next(opened.frames()).values[0], recording.cube.values[0])
    with pytest.raises(RecordingError, match="has a wrong size"):
        _ = opened.cube
    piece.write_bytes(whole + bytes(4))
    with pytest.raises(RecordingError, match="has a wrong size"):
        _ = dc.open(tmp_path / "x.zarr").cube

    piece.unlink()
    opened = dc.open(tmp_path / "x.zarr")
    assert opened.contents.gaps.any(axis=1).tolist() == [False, True, False]
    assert not opened.cube.values[1].any()
    assert np.array_equal(opened.cube.values[2], recording.cube.values[2])


def test_a_radar_that_is_told_wins_over_the_one_in_the_store(tmp_path):
    recording = of_tables()
    dc.write(recording, tmp_path / "x.zarr")
    other = replace(recording.radar, hardware=None)
    opened = dc.open(tmp_path / "x.zarr", radar=other)
    assert opened.radar == other
    assert set(opened.tables) == set(recording.tables)


def test_a_part_is_written_with_its_part_of_the_tables(tmp_path):
    recording = of_tables()
    dc.write(recording.select_frames(1, 3), tmp_path / "x.zarr")
    opened = dc.open(tmp_path / "x.zarr")
    assert np.array_equal(opened.cube.values, recording.cube.values[1:])
    assert opened.tables["truth"].frame.values.tolist() == [0, 1]
    assert np.array_equal(opened.tables["truth"].range, recording.tables["truth"].range[:, 1:])


def test_a_full_disk_leaves_what_was_there(tmp_path):
    out = tmp_path / "x.zarr"
    dc.write(of_lost_chirps(), out)
    before = {file: file.read_bytes() for file in sorted(out.rglob("*")) if file.is_file()}
    for room in (0, 100, 1500, 4000):
        with room_for(room), pytest.raises(DechirpError, match="not writable"):
            dc.write(of_tables(), out)
        assert [one.name for one in tmp_path.iterdir()] == ["x.zarr"]
        now = {file: file.read_bytes() for file in sorted(out.rglob("*")) if file.is_file()}
        assert now == before


def test_only_a_store_is_replaced_as_a_whole(tmp_path):
    out = tmp_path / "x.zarr"
    dc.write(of_tables(), out)
    dc.write(of_complex_codes(), out)
    assert set(dc.open(out).tables) == set()

    (out / "notes.txt").write_text("mine")
    with pytest.raises(DechirpError, match=r"a folder with notes\.txt"):
        dc.write(of_tables(), out)
    shutil.rmtree(out)
    out.write_text("a file")
    with pytest.raises(DechirpError, match="a file"):
        dc.write(of_tables(), out)
    assert out.read_text() == "a file"


@pytest.mark.parametrize("name", ["cube", "gap", "calibration", "a/b", "..", ""])
def test_tables_whose_name_is_taken_or_leads_elsewhere_are_refused(tmp_path, name):
    recording = of_complex_samples()
    table = xr.Dataset({"x": ("row", [1.0])})
    named = dc.recording_from_cube(recording.cube, recording.radar, tables={name: table})
    with pytest.raises(DechirpError, match="name"):
        dc.write(named, tmp_path / "x.zarr")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "column",
    [
        ("row", np.array(["2026-01-01"], "datetime64[ns]")),
        ("row", [1.0], {"_FillValue": 7.0}),
        ("row", [1.0], {"coordinates": "x"}),
    ],
)
def test_columns_that_would_come_back_otherwise_are_refused(tmp_path, column):
    recording = of_complex_samples()
    tables = {"mine": xr.Dataset({"x": column})}
    with pytest.raises(DechirpError, match=r"column (mine\.)?x |without a JSON form"):
        dc.write(
            dc.recording_from_cube(recording.cube, recording.radar, tables=tables),
            tmp_path / "x.zarr",
        )
    assert list(tmp_path.iterdir()) == []


def test_a_table_from_a_file_with_an_encoding_of_its_own_comes_back(tmp_path):
    recording = of_complex_samples()
    table = xr.Dataset({"x": ("row", [1.25, 2.5])})
    table["x"].encoding = {"dtype": "int16", "scale_factor": 1.0, "chunksizes": (1,), "zlib": True}
    tabled = dc.recording_from_cube(recording.cube, recording.radar, tables={"mine": table})
    dc.write(tabled, tmp_path / "x.zarr")
    assert dc.open(tmp_path / "x.zarr").tables["mine"]["x"].values.tolist() == [1.25, 2.5]


def damaged_store(tmp_path) -> Path:
    dc.write(of_tables(), tmp_path / "x.zarr")
    return tmp_path / "x.zarr" / "truth"


def change(mark: Path, **said) -> None:
    mark.write_text(json.dumps({**json.loads(mark.read_text()), **said}))


@pytest.mark.parametrize("column", ["range", "target"])
def test_a_damaged_table_is_refused_and_the_samples_are_still_read(tmp_path, column):
    truth = damaged_store(tmp_path)
    for piece in [file for file in (truth / column / "c").rglob("*") if file.is_file()]:
        piece.write_bytes(piece.read_bytes()[:7])

    opened = dc.open(tmp_path / "x.zarr")
    assert np.array_equal(opened.cube.values, of_tables().cube.values)
    with pytest.raises(RecordingError, match="not readable"):
        _ = opened.tables


@pytest.mark.parametrize("column", ["range", "target"])
def test_a_table_that_claims_more_than_it_can_hold_is_refused(tmp_path, column):
    truth = damaged_store(tmp_path)
    mark = truth / column / "zarr.json"
    shape = [2**20] * len(json.loads(mark.read_text())["shape"])
    change(mark, shape=[2**36, *shape[1:]])
    with pytest.raises(RecordingError, match="at most twice the file"):
        ZarrTables(tmp_path / "x.zarr")["truth"]


@pytest.mark.parametrize("column", ["range", "target"])
def test_a_table_never_reads_files_elsewhere(tmp_path, column):
    truth = damaged_store(tmp_path)
    secret = tmp_path / "secret"
    (truth / column / "c").rename(secret)
    (truth / column / "c").symlink_to(secret)
    with pytest.raises(RecordingError, match="is a link"):
        ZarrTables(tmp_path / "x.zarr")["truth"]


def test_a_table_needs_no_codec_that_could_run_what_it_reads(tmp_path):
    truth = damaged_store(tmp_path)
    for column in ("range", "target"):
        mark = truth / column / "zarr.json"
        said = json.loads(mark.read_text())
        change(mark, codecs=[*said["codecs"], {"name": "numcodecs.pickle", "configuration": {}}])
        with pytest.raises(RecordingError, match="needs the codec pickle"):
            ZarrTables(tmp_path / "x.zarr")["truth"]


def test_gaps_of_another_recording_are_refused(tmp_path):
    dc.write(of_lost_chirps(), tmp_path / "x.zarr")
    change(tmp_path / "x.zarr" / "gap" / "zarr.json", shape=[2, 6])
    with pytest.raises(RecordingError, match="an array gap of 2 x 6"):
        dc.open(tmp_path / "x.zarr")


@pytest.mark.parametrize("scale", [0.0, -1.0, "NaN", 1e39])
def test_a_scale_that_is_none_is_refused(tmp_path, scale):
    dc.write(of_complex_codes(), tmp_path / "x.zarr")
    mark = tmp_path / "x.zarr" / "cube" / "zarr.json"
    said = json.loads(mark.read_text())["attributes"]
    change(mark, attributes={**said, "scale": scale})
    with pytest.raises(RecordingError, match="its scale is"):
        dc.open(tmp_path / "x.zarr")


def test_a_run_reads_back_with_its_tables(tmp_path):
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
    opened = dc.open(tmp_path / "run")
    assert set(opened.tables) == {"detections", "truth"}
    xr.testing.assert_identical(opened.tables["detections"], result.detections)
    xr.testing.assert_identical(opened.tables["truth"], result.truth)
    assert np.array_equal(opened.cube.values, result.cube.values)


@pytest.mark.skipif("DECHIRP_REAL_DATA" not in os.environ, reason="no recordings named")
def test_a_real_recording_comes_back_equal(tmp_path):
    recording = real(Path(os.environ["DECHIRP_REAL_DATA"]))
    must_keep_a_real_recording(recording, tmp_path / "x.zarr")
    assert zarr.open_array(tmp_path / "x.zarr" / "cube", mode="r").dtype == np.int16
