"""Conversion between recording formats: kept metadata, and content that no format accepts."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.core.errors import DechirpError, InvalidSetting, RecordingError
from formats.native_recordings import (
    EVERY_RECORDING,
    assert_recordings_equal,
    make_complex_recording,
    make_radar,
    make_table_recording,
    make_tdm_recording,
    simulate_cube,
)
from nightly import nightly_except

CONTAINER_NAMES = ("x.h5", "x.nc", "x.mat", "x.npz", "x.sigmf-meta")


@EVERY_RECORDING
@pytest.mark.parametrize(
    ("name", "kind"), nightly_except(1, [("x.mat", "matlab"), ("x.npz", "npz")])
)
def test_round_trip_is_bit_exact(tmp_path, name, kind, make_recording):
    recording = make_recording()
    assert dc.write(recording, tmp_path / name) == (tmp_path / name,)
    copy = dc.open(tmp_path / name)
    assert copy.format == kind
    assert_recordings_equal(copy, recording)


@pytest.mark.parametrize("name", ["x.mat", "x.npz", "x.sigmf-meta"])
def test_selected_frames_are_written_as_recording(tmp_path, name):
    recording = make_tdm_recording()
    dc.write(recording.select_frames(1, 3), tmp_path / name)
    copy = dc.open(tmp_path / name)
    assert np.array_equal(copy.cube.values, recording.cube.values[1:])
    # Intervals alternate between 35 and 38 us: the first selected frame has the second one.
    assert np.allclose(copy.cube.chirp_time, recording.cube.chirp_time[1:], rtol=1e-12)


@pytest.mark.parametrize("name", [*CONTAINER_NAMES, "x.zarr"])
def test_given_radar_takes_precedence_over_file(tmp_path, name):
    dc.write(make_complex_recording(), tmp_path / name)
    given_radar = replace(make_radar(), array=dc.Array(rx_m=[(0, 0, 0), (0, 2.1e-3, 0)]))
    assert dc.open(tmp_path / name, radar=given_radar).radar == given_radar
    with pytest.raises(RecordingError, match="6 along chirp"):
        dc.open(tmp_path / name, radar=make_radar(n_chirps=8))


@pytest.mark.parametrize("name", nightly_except(5, [*CONTAINER_NAMES, "x.zarr", "x.bin"]))
@pytest.mark.parametrize("options", [{"iq": "iq"}, {"device": "xwr1843"}], ids=["iq", "device"])
def test_native_file_rejects_contradictory_options(tmp_path, name, options):
    radar = make_radar()
    base = dc.recording_from_cube(simulate_cube(radar, bits=16), radar)
    recording = replace(base, contents=replace(base.contents, device="xwr1443", iq="qi"))
    dc.write(recording, tmp_path / name)
    ((option, value),) = options.items()
    with pytest.raises(RecordingError) as error:
        dc.open(tmp_path / name, **options)
    (mistake,) = error.value.mistakes
    assert mistake.value == f"written by dechirp, with --{option} {value}"
    assert f"--{option} is for raw samples" in mistake.expected
    copy = dc.open(tmp_path / name, iq="qi", device="xwr1443")
    assert copy.cube.values.tobytes() == recording.cube.values.tobytes()


@pytest.mark.parametrize("name", ["x.mcap", "x.ros2"])
def test_native_clouds_keep_device(tmp_path, name):
    pytest.importorskip("rosbags")
    pytest.importorskip("mcap")
    base = make_table_recording()
    recording = replace(base, contents=replace(base.contents, device="xwr1443"))
    dc.write(recording, tmp_path / name)
    assert dc.open(tmp_path / name, device="xwr1443").contents.device == "xwr1443"
    with pytest.raises(RecordingError, match="--device is for raw samples"):
        dc.open(tmp_path / name, device="xwr1843")


@pytest.mark.parametrize(
    "name", nightly_except(3, [*CONTAINER_NAMES, "x.zarr", "x.bin", "x.mcap", "x.ros2"])
)
def test_byte_swapped_columns_are_written_in_native_order(tmp_path, name):
    pytest.importorskip("rosbags")
    pytest.importorskip("mcap")
    native = xr.Dataset(
        {
            "frame": ("detection", np.array([0, 1])),
            "range": ("detection", np.array([1.5, 2.0])),
            "velocity": ("detection", np.array([1.5, -0.1], np.float32)),
            "large": ("detection", np.array([1, 2**60])),
            "gain": ("detection", np.array([1 + 2j, 3], np.complex64)),
            "letter": ("detection", np.array(["a", "b"])),  # one byte each
            "step": ("other", np.array([1, 2.5])),
        }
    )
    swapped = native.map(lambda column: column.astype(column.dtype.newbyteorder()))
    radar = make_radar()
    recording = dc.recording_from_cube(
        simulate_cube(radar, bits=16), radar, tables={"detections": swapped}
    )
    dc.write(recording, tmp_path / name)
    copy = dc.open(tmp_path / name).tables["detections"]
    xr.testing.assert_identical(copy, native)
    assert {n: column.dtype for n, column in copy.items()} == {
        n: column.dtype for n, column in native.items()
    }


@pytest.mark.parametrize("name", [*CONTAINER_NAMES, "x.zarr", "x.bin"])
@pytest.mark.parametrize(
    "table",
    [
        xr.Dataset({"word": ("row", np.array(["a\0"], object))}),
        xr.Dataset({"range": ("row", [1.0])}, {"row": np.array(["a\0"], object)}),
        xr.Dataset({"a\0b": ("row", [1.0])}),
    ],
    ids=["text", "label", "name"],
)
def test_rejects_texts_with_nul(tmp_path, name, table):
    radar = make_radar()
    recording = dc.recording_from_cube(simulate_cube(radar), radar, tables={"odd": table})
    with pytest.raises(DechirpError, match="NUL"):
        dc.write(recording, tmp_path / name)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", [*CONTAINER_NAMES, "x.zarr", "x.bin"])
def test_rejects_extended_precision_columns(tmp_path, name):
    radar = make_radar()
    table = xr.Dataset({"long": ("row", np.zeros(2, np.longdouble))})
    recording = dc.recording_from_cube(simulate_cube(radar), radar, tables={"odd": table})
    with pytest.raises(DechirpError, match=r"column long of (float128|longdouble)"):
        dc.write(recording, tmp_path / name)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", nightly_except(2, [*CONTAINER_NAMES, "x.zarr"]))
def test_capture_bytes_survive_conversion_through_container(tmp_path, name):
    radar = make_radar()
    base = dc.recording_from_cube(simulate_cube(radar, bits=16), radar)
    recording = replace(base, contents=replace(base.contents, device="xwr1443", iq="qi"))
    dc.write(recording, tmp_path / "first.bin")
    dc.write(dc.open(tmp_path / "first.bin"), tmp_path / name)
    dc.write(dc.open(tmp_path / name), tmp_path / "again.bin")
    assert dc.open(tmp_path / name).contents.device == "xwr1443"
    assert (tmp_path / "again.bin").read_bytes() == (tmp_path / "first.bin").read_bytes()


@pytest.mark.parametrize("name", [*CONTAINER_NAMES, "x.sigmf-data"])
def test_container_with_name_of_capture_opens_as_itself(tmp_path, name):
    radar = make_radar()
    recording = dc.recording_from_cube(simulate_cube(radar, bits=16), radar)
    dc.write(recording, tmp_path / "x.bin")
    dc.write(recording, tmp_path / name.replace("-data", "-meta"))
    copy = dc.open(tmp_path / name)
    assert copy.format != "dca1000"
    assert copy.cube.values.tobytes() == recording.cube.values.tobytes()


@pytest.mark.parametrize("name", [*CONTAINER_NAMES, "x.zarr", "x.bin"])
def test_table_of_single_frame_is_in_every_selection(tmp_path, name):
    radar = make_radar()
    table = xr.Dataset({"frame": ((), 1), "range": ("target", [1.0, 2.0])})
    recording = dc.recording_from_cube(simulate_cube(radar), radar, tables={"one": table})
    dc.write(recording, tmp_path / name)
    copy = dc.open(tmp_path / name)
    xr.testing.assert_identical(copy.tables["one"], table)
    xr.testing.assert_identical(copy.select_frames(1, 3).tables["one"], table)


@pytest.mark.parametrize("name", [*CONTAINER_NAMES, "x.zarr", "x.bin"])
@pytest.mark.parametrize(
    "table",
    [xr.Dataset({5: ("row", [1.0])}), xr.Dataset({"thing": ("row", np.array([{}], object))})],
    ids=["name", "value"],
)
def test_rejects_non_text_names_and_objects(tmp_path, name, table):
    radar = make_radar()
    recording = dc.recording_from_cube(simulate_cube(radar), radar, tables={"odd": table})
    with pytest.raises(DechirpError, match="texts"):
        dc.write(recording, tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_unwritable_path_error_names_argument_path(tmp_path):
    radar = make_radar()
    recording = dc.recording_from_cube(simulate_cube(radar), radar)
    (tmp_path / "x.csv").mkdir()
    for out in (tmp_path / "no" / "x.h5", tmp_path / "x.csv"):
        part = recording.select_frames(0, 1)
        with pytest.raises(DechirpError, match=r"^path: .*(not writable|a folder)"):
            dc.write(part, out)
    assert [file.name for file in tmp_path.iterdir()] == ["x.csv"]


@pytest.mark.parametrize(
    ("name", "second_name"), [("x.sigmf-meta", "x.sigmf-data"), ("x.bin", "x.dechirp.json")]
)
def test_file_pairs_never_mix_two_recordings(tmp_path, monkeypatch, name, second_name):
    radar, rename, pairs = make_radar(), Path.rename, []

    def read_pair() -> tuple[bytes | None, ...]:
        paths = (tmp_path / name, tmp_path / second_name)
        return tuple(file.read_bytes() if file.exists() else None for file in paths)

    def rename_and_record(self, target):
        new_path = rename(self, target)
        pairs.append(read_pair())
        return new_path

    dc.write(dc.recording_from_cube(simulate_cube(radar, bits=12), radar), tmp_path / name)
    first_pair = read_pair()
    monkeypatch.setattr(Path, "rename", rename_and_record)
    dc.write(dc.recording_from_cube(simulate_cube(radar, bits=16), radar), tmp_path / name)
    last_pair = read_pair()
    assert None not in (*first_pair, *last_pair)
    assert len(pairs) > 3
    # The second file is not read without the first.
    assert {pair for pair in pairs if pair[0] is not None} == {last_pair}


@pytest.mark.parametrize(
    ("change", "value"),
    [
        (lambda cube: cube.values, "an ndarray; expected DataArray"),
        (lambda cube: cube.isel(frame=0), "a DataArray over chirp, rx, sample"),
        (lambda cube: cube.expand_dims("trial"), "over chirp, frame, rx, sample, trial"),
        (lambda cube: cube.isel(frame=slice(0)), "0 frames of"),
        (lambda cube: cube.assign_coords(gap=cube.frame > 0), "a cube whose gap is over frame"),
    ],
)
def test_rejects_invalid_cube(change, value):
    recording = make_complex_recording()

    with pytest.raises(InvalidSetting, match=value):
        dc.recording_from_cube(
            change(recording.cube.drop_vars("gap", errors="ignore")), recording.radar
        )
