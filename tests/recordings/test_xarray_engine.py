"""Engine of xarray: lazy recordings and data sets, in chunks of one frame."""

import importlib
import io
import tomllib
import warnings
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
import zarr

import dechirp as dc
from dechirp.recordings.lazy_frames import LazyFrames
from dechirp.recordings.recording import Recording
from dechirp.results.xarray_engine import DechirpBackend

RADAR = dc.Radar(
    frame=dc.Frame(
        chirp=dc.Chirp(
            start_frequency_hz=77e9,
            slope_hz_per_s=20e12,
            ramp_duration_s=15e-6,
            sample_rate_hz=5e6,
            n_samples=16,
            sampling="complex",
        ),
        n_chirps=8,
        interval_s=20e-6,
        period_s=20e-3,
    ),
    array=dc.Array(rx_m=[(0, 0, 0), (0, 1.9e-3, 0)]),
    hardware=dc.Hardware(transmit_power_w=0.01, antenna_gain=10.0, noise_factor=15.0),
)
SCENE = dc.Scene(targets=[dc.Target(position_m=(5, 1, 0), rcs_m2=10)])


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    """Write a recording of five frames."""
    noise = [dc.impairments.ThermalNoise()]
    cube = dc.simulate(SCENE, RADAR, n_frames=5, impairments=noise, seed=1)
    path = tmp_path_factory.mktemp("capture") / "capture.h5"
    dc.write(dc.recording_from_cube(cube, RADAR), path)
    return path


@pytest.fixture
def decoded_frames(monkeypatch):
    """List the numbers of the frames that are decoded."""
    numbers, decode = [], Recording._decode_frame

    def list_and_decode(self, number, out):
        numbers.append(number)
        decode(self, number, out)

    monkeypatch.setattr(Recording, "_decode_frame", list_and_decode)
    return numbers


def open_lazily(path, **options):
    return xr.open_dataset(path, engine=DechirpBackend, **options)


def test_entry_point_names_the_engine():
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())
    entry = project["project"]["entry-points"]["xarray.backends"]["dechirp"]
    module, _, name = entry.partition(":")
    assert getattr(importlib.import_module(module), name) is DechirpBackend


@pytest.mark.parametrize(
    "part",
    [
        {"frame": 2},
        {"frame": slice(1, 4), "rx": 1},
        {"frame": [0, 3], "sample": [1, 5, 9], "chirp": slice(None, None, 3)},
        {"frame": slice(0, 0)},
        {"frame": -1, "chirp": 3, "rx": 0, "sample": 7},
        {},
    ],
)
def test_parts_equal_those_of_the_cube(capture, part):
    lazy = open_lazily(capture).cube
    xr.testing.assert_identical(lazy.isel(part).load(), dc.open(capture).cube.isel(part))


def test_only_loaded_frames_are_decoded(capture, decoded_frames):
    dataset = open_lazily(capture)
    assert dataset.cube.sizes == {"frame": 5, "chirp": 8, "rx": 2, "sample": 16}
    assert decoded_frames == []
    dataset.cube.isel(frame=[1, 3], rx=0).load()
    assert decoded_frames == [1, 3]


def test_chunks_are_frames(capture):
    pytest.importorskip("dask")
    cube = open_lazily(capture, chunks={}).cube
    assert cube.chunks == ((1,) * 5, (8,), (2,), (16,))
    reference = dc.open(capture).cube
    np.testing.assert_allclose(cube.mean().values, reference.values.mean(), rtol=1e-5)
    detections = dc.detect(cube.isel(frame=[1]), RADAR)
    xr.testing.assert_identical(detections, dc.detect(reference.isel(frame=[1]), RADAR))


def test_options_of_open_apply(capture, tmp_path):
    assert open_lazily(capture, frames=(1, 3)).sizes["frame"] == 2
    np.save(tmp_path / "codes.npy", np.ones((3, 8, 2, 16), np.int16))
    options = {"axes": "frame chirp rx sample", "encoding": "int16", "radar": RADAR}
    with pytest.raises(dc.RecordingError, match="real"):  # the radar takes complex samples
        open_lazily(tmp_path / "codes.npy", **options)
    with pytest.raises(dc.InvalidSetting, match="group: truth"):
        open_lazily(capture, group="truth")


def test_store_of_a_recording_is_opened_as_dc_open_does(capture, tmp_path):
    path = tmp_path / "capture.zarr"
    dc.write(dc.open(capture), path)
    expected = dc.open(path).cube

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        cube = open_lazily(path).cube
        assert open_lazily(path, frames=(1, 3)).sizes["frame"] == 2

    xr.testing.assert_identical(cube.load(), expected)
    with pytest.raises(dc.DechirpError, match="iq"):
        open_lazily(path, iq="zz")


def test_foreign_store_is_no_data_set(tmp_path):
    zarr.save_array(tmp_path / "x.zarr", np.zeros((3, 2)))
    with pytest.raises(dc.DechirpError, match="axes"):
        open_lazily(tmp_path / "x.zarr")


def test_variables_can_be_dropped(capture):
    assert list(open_lazily(capture, drop_variables="cube").data_vars) == []


def test_integer_keys_remove_axes():
    def decode(number, out):
        out[...] = number + np.arange(out.size).reshape(out.shape)

    frames = LazyFrames(decode, range(2, 5), (2, 3, 4), np.dtype(float))
    whole = np.stack([n + np.arange(24.0).reshape(2, 3, 4) for n in range(2, 5)])
    np.testing.assert_array_equal(
        frames._decode_part((1, 0, slice(None), [0, 2])), whole[1, 0][:, [0, 2]]
    )


@pytest.mark.parametrize("wrong", [3, None, b"recording.npy", np.zeros(3), io.BytesIO()])
def test_anything_but_a_path_is_refused(wrong):
    with pytest.raises(dc.InvalidSetting, match=r"^filename_or_obj: a \w+; expected a path; "):
        DechirpBackend().open_dataset(wrong)
