"""Recordings keep what they are from one format to another, and what none takes is refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.core.errors import DechirpError, InvalidSetting, RecordingError
from formats.containers import (
    EVERY_CASE,
    must_be_equal,
    of_complex_samples,
    of_tables,
    of_transmitters_in_turns,
    simulated,
    small,
)

CONTAINERS = ("x.h5", "x.nc", "x.mat", "x.npz", "x.sigmf-meta")


@EVERY_CASE
@pytest.mark.parametrize(("name", "kind"), [("x.mat", "matlab"), ("x.npz", "npz")])
def test_every_recording_comes_back_bit_by_bit_from_a_file(tmp_path, name, kind, made):
    recording = made()
    assert dc.write(recording, tmp_path / name) == (tmp_path / name,)
    opened = dc.open(tmp_path / name)
    assert opened.format == kind
    must_be_equal(opened, recording)


@pytest.mark.parametrize("name", ["x.mat", "x.npz", "x.sigmf-meta"])
def test_a_part_is_written_as_a_recording_of_its_own(tmp_path, name):
    recording = of_transmitters_in_turns()
    dc.write(recording.select_frames(1, 3), tmp_path / name)
    opened = dc.open(tmp_path / name)
    assert np.array_equal(opened.cube.values, recording.cube.values[1:])
    # Intervals of 35 and 38 us take turns: the first frame that is there has the second.
    assert np.allclose(opened.cube.chirp_time, recording.cube.chirp_time[1:], rtol=1e-12)


@pytest.mark.parametrize("name", [*CONTAINERS, "x.zarr"])
def test_the_radar_that_the_user_gives_comes_first(tmp_path, name):
    dc.write(of_complex_samples(), tmp_path / name)
    other = replace(small(), array=dc.Array(rx_m=[(0, 0, 0), (0, 2.1e-3, 0)]))
    assert dc.open(tmp_path / name, radar=other).radar == other
    with pytest.raises(RecordingError, match="6 along chirp"):
        dc.open(tmp_path / name, radar=small(n_chirps=8))


@pytest.mark.parametrize("name", [*CONTAINERS, "x.zarr", "x.bin"])
@pytest.mark.parametrize("told", [{"iq": "iq"}, {"device": "xwr1843"}], ids=["iq", "device"])
def test_a_file_of_ours_knows_its_own_order_and_device(tmp_path, name, told):
    radar = small()
    held = dc.recording_from_cube(simulated(radar, bits=16), radar)
    made = replace(held, contents=replace(held.contents, device="xwr1443", iq="qi"))
    dc.write(made, tmp_path / name)
    ((option, given),) = told.items()
    with pytest.raises(RecordingError) as wrong:
        dc.open(tmp_path / name, **told)
    (mistake,) = wrong.value.mistakes
    assert mistake.value == f"written by dechirp, with --{option} {given}"
    assert f"--{option} is for raw samples" in mistake.expected
    agreed = dc.open(tmp_path / name, iq="qi", device="xwr1443")
    assert agreed.cube.values.tobytes() == made.cube.values.tobytes()


@pytest.mark.parametrize("name", ["x.mcap", "x.ros2"])
def test_clouds_of_ours_know_their_own_device(tmp_path, name):
    pytest.importorskip("rosbags")
    pytest.importorskip("mcap")
    held = of_tables()
    made = replace(held, contents=replace(held.contents, device="xwr1443"))
    dc.write(made, tmp_path / name)
    assert dc.open(tmp_path / name, device="xwr1443").contents.device == "xwr1443"
    with pytest.raises(RecordingError, match="--device is for raw samples"):
        dc.open(tmp_path / name, device="xwr1843")


@pytest.mark.parametrize("name", [*CONTAINERS, "x.zarr", "x.bin", "x.mcap", "x.ros2"])
def test_columns_of_the_other_order_of_bytes_have_the_same_numbers_in_ours(tmp_path, name):
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
    swapped = native.map(lambda one: one.astype(one.dtype.newbyteorder()))
    radar = small()
    made = dc.recording_from_cube(simulated(radar, bits=16), radar, tables={"detections": swapped})
    dc.write(made, tmp_path / name)
    opened = dc.open(tmp_path / name).tables["detections"]
    xr.testing.assert_identical(opened, native)
    assert {n: one.dtype for n, one in opened.items()} == {
        n: one.dtype for n, one in native.items()
    }


@pytest.mark.parametrize("name", [*CONTAINERS, "x.zarr", "x.bin"])
@pytest.mark.parametrize(
    "table",
    [
        xr.Dataset({"word": ("row", np.array(["a\0"], object))}),
        xr.Dataset({"range": ("row", [1.0])}, {"row": np.array(["a\0"], object)}),
        xr.Dataset({"a\0b": ("row", [1.0])}),
    ],
    ids=["text", "label", "name"],
)
def test_texts_whose_nul_would_be_lost_are_refused(tmp_path, name, table):
    radar = small()
    made = dc.recording_from_cube(simulated(radar), radar, tables={"odd": table})
    with pytest.raises(DechirpError, match="NUL"):
        dc.write(made, tmp_path / name)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", [*CONTAINERS, "x.zarr", "x.bin"])
def test_numbers_that_no_other_program_has_are_refused_by_their_type(tmp_path, name):
    radar = small()
    table = xr.Dataset({"long": ("row", np.zeros(2, np.longdouble))})
    made = dc.recording_from_cube(simulated(radar), radar, tables={"odd": table})
    with pytest.raises(DechirpError, match=r"column long of (float128|longdouble)"):
        dc.write(made, tmp_path / name)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", [*CONTAINERS, "x.zarr"])
def test_a_capture_has_the_same_bytes_after_a_stay_in_a_container(tmp_path, name):
    radar = small()
    held = dc.recording_from_cube(simulated(radar, bits=16), radar)
    made = replace(held, contents=replace(held.contents, device="xwr1443", iq="qi"))
    dc.write(made, tmp_path / "first.bin")
    dc.write(dc.open(tmp_path / "first.bin"), tmp_path / name)
    dc.write(dc.open(tmp_path / name), tmp_path / "again.bin")
    assert dc.open(tmp_path / name).contents.device == "xwr1443"
    assert (tmp_path / "again.bin").read_bytes() == (tmp_path / "first.bin").read_bytes()


@pytest.mark.parametrize("name", [*CONTAINERS, "x.sigmf-data"])
def test_other_files_beside_a_capture_of_the_same_name_are_what_they_are(tmp_path, name):
    radar = small()
    made = dc.recording_from_cube(simulated(radar, bits=16), radar)
    dc.write(made, tmp_path / "x.bin")
    dc.write(made, tmp_path / name.replace("-data", "-meta"))
    opened = dc.open(tmp_path / name)
    assert opened.format != "dca1000"
    assert opened.cube.values.tobytes() == made.cube.values.tobytes()


@pytest.mark.parametrize("name", [*CONTAINERS, "x.zarr", "x.bin"])
def test_a_table_of_one_frame_alone_comes_back_in_every_part(tmp_path, name):
    radar = small()
    one = xr.Dataset({"frame": ((), 1), "range": ("target", [1.0, 2.0])})
    made = dc.recording_from_cube(simulated(radar), radar, tables={"one": one})
    dc.write(made, tmp_path / name)
    opened = dc.open(tmp_path / name)
    xr.testing.assert_identical(opened.tables["one"], one)
    xr.testing.assert_identical(opened.select_frames(1, 3).tables["one"], one)


@pytest.mark.parametrize("name", [*CONTAINERS, "x.zarr", "x.bin"])
@pytest.mark.parametrize(
    "table",
    [xr.Dataset({5: ("row", [1.0])}), xr.Dataset({"thing": ("row", np.array([{}], object))})],
    ids=["name", "value"],
)
def test_names_and_objects_that_are_no_texts_are_refused(tmp_path, name, table):
    radar = small()
    made = dc.recording_from_cube(simulated(radar), radar, tables={"odd": table})
    with pytest.raises(DechirpError, match="texts"):
        dc.write(made, tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_a_place_that_cannot_be_written_is_called_path_in_python(tmp_path):
    radar = small()
    made = dc.recording_from_cube(simulated(radar), radar)
    (tmp_path / "x.csv").mkdir()
    for out in (tmp_path / "no" / "x.h5", tmp_path / "x.csv"):
        part = made.select_frames(0, 1)
        with pytest.raises(DechirpError, match=r"^path: .*(not writable|a folder)"):
            dc.write(part, out)
    assert [file.name for file in tmp_path.iterdir()] == ["x.csv"]


@pytest.mark.parametrize(
    ("name", "beside"), [("x.sigmf-meta", "x.sigmf-data"), ("x.bin", "x.dechirp.json")]
)
def test_files_of_two_recordings_never_lie_together(tmp_path, monkeypatch, name, beside):
    radar, move, seen = small(), Path.rename, []

    def lying() -> tuple[bytes | None, ...]:
        both = (tmp_path / name, tmp_path / beside)
        return tuple(file.read_bytes() if file.exists() else None for file in both)

    def watched(self, target):
        made = move(self, target)
        seen.append(lying())
        return made

    dc.write(dc.recording_from_cube(simulated(radar, bits=12), radar), tmp_path / name)
    before = lying()
    monkeypatch.setattr(Path, "rename", watched)
    dc.write(dc.recording_from_cube(simulated(radar, bits=16), radar), tmp_path / name)
    after = lying()
    assert None not in (*before, *after)
    assert len(seen) > 3
    # Without the first of them nobody reads the other.
    assert {pair for pair in seen if pair[0] is not None} == {after}


@pytest.mark.parametrize(
    ("change", "value"),
    [
        (lambda cube: cube.values, "a ndarray over no named axes"),
        (lambda cube: cube.isel(frame=0), "a DataArray over chirp, rx, sample"),
        (lambda cube: cube.expand_dims("trial"), "over chirp, frame, rx, sample, trial"),
        (lambda cube: cube.isel(frame=slice(0)), "0 frames of"),
        (lambda cube: cube.assign_coords(gap=cube.frame > 0), "a cube whose gap is over frame"),
    ],
)
def test_what_is_no_cube_is_no_recording(change, value):
    recording = of_complex_samples()

    with pytest.raises(InvalidSetting, match=value):
        dc.recording_from_cube(
            change(recording.cube.drop_vars("gap", errors="ignore")), recording.radar
        )
