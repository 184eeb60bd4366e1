"""Recordings keep what they are from one format to another, and what none takes is refused."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.core.errors import DechirpError
from formats.containers import simulated, small

CONTAINERS = ("x.h5", "x.nc", "x.mat", "x.npz", "x.sigmf-meta")


@pytest.mark.parametrize("name", [*CONTAINERS, "x.zarr"])
def test_a_capture_has_the_same_bytes_after_a_stay_in_a_container(tmp_path, name):
    radar = small()
    held = dc.recording_of(simulated(radar, bits=16), radar)
    made = replace(held, contents=replace(held.contents, device="xwr1443", iq="qi"))
    dc.write(made, tmp_path / "first.bin")
    dc.write(dc.open(tmp_path / "first.bin"), tmp_path / name)
    dc.write(dc.open(tmp_path / name), tmp_path / "again.bin")
    assert dc.open(tmp_path / name).contents.device == "xwr1443"
    assert (tmp_path / "again.bin").read_bytes() == (tmp_path / "first.bin").read_bytes()


@pytest.mark.parametrize("name", [*CONTAINERS, "x.sigmf-data"])
def test_other_files_beside_a_capture_of_the_same_name_are_what_they_are(tmp_path, name):
    radar = small()
    made = dc.recording_of(simulated(radar, bits=16), radar)
    dc.write(made, tmp_path / "x.bin")
    dc.write(made, tmp_path / name.replace("-data", "-meta"))
    opened = dc.open(tmp_path / name)
    assert opened.format != "dca1000"
    assert opened.cube.values.tobytes() == made.cube.values.tobytes()


@pytest.mark.parametrize("name", [*CONTAINERS, "x.zarr", "x.bin"])
def test_a_table_of_one_frame_alone_comes_back_in_every_part(tmp_path, name):
    radar = small()
    one = xr.Dataset({"frame": ((), 1), "range": ("target", [1.0, 2.0])})
    made = dc.recording_of(simulated(radar), radar, tables={"one": one})
    dc.write(made, tmp_path / name)
    opened = dc.open(tmp_path / name)
    xr.testing.assert_identical(opened.tables["one"], one)
    xr.testing.assert_identical(opened.part(1, 3).tables["one"], one)


@pytest.mark.parametrize("name", [*CONTAINERS, "x.zarr", "x.bin"])
@pytest.mark.parametrize(
    "table",
    [xr.Dataset({5: ("row", [1.0])}), xr.Dataset({"thing": ("row", np.array([{}], object))})],
    ids=["name", "value"],
)
def test_names_and_objects_that_are_no_texts_are_refused(tmp_path, name, table):
    radar = small()
    made = dc.recording_of(simulated(radar), radar, tables={"odd": table})
    with pytest.raises(DechirpError, match="texts"):
        dc.write(made, tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_a_place_that_cannot_be_written_is_called_path_in_python(tmp_path):
    radar = small()
    made = dc.recording_of(simulated(radar), radar)
    (tmp_path / "x.png").mkdir()
    for out in (tmp_path / "no" / "x.h5", tmp_path / "x.png"):
        part = made.part(0, 1)
        with pytest.raises(DechirpError, match=r"^path is .*(not writable|a folder)"):
            dc.write(part, out)
    assert [file.name for file in tmp_path.iterdir()] == ["x.png"]
