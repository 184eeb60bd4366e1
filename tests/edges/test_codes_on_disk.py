"""Codes of a simulated converter: written as such, and read back as the samples they are."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.recordings.cube_store import write_cube
from dechirp.simulation.adc_codes import extract_adc_codes
from dechirp.simulation.impairments.quantisation import Quantisation
from dechirp.simulation.impairments.thermal_noise import ThermalNoise


def simulated(radar, sampling="complex", **changes):
    chirp = replace(radar.frame.chirp, sampling=sampling)
    radar = replace(radar, frame=replace(radar.frame, chirp=chirp, n_chirps=8, **changes))
    noise_w = ThermalNoise().noise_power_w(dc.Scene(), radar)
    converter = Quantisation(bits=12, full_scale_w=1000 * noise_w)
    cube = dc.simulate(dc.Scene(), radar, impairments=[ThermalNoise(), converter], n_frames=3)
    return radar, cube


def write(path, cube, radar):
    write_cube(
        path,
        (cube.isel(frame=slice(i, i + 1)) for i in range(cube.sizes["frame"])),
        n_frames=cube.sizes["frame"],
        radar=radar,
        groups={"detections": xr.Dataset()},
    )


@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_codes_are_written_as_int16_and_read_back_as_the_samples(tmp_path, radar, sampling):
    radar, cube = simulated(radar, sampling)
    write(tmp_path / "cube.zarr", cube, radar)

    with xr.open_zarr(tmp_path / "cube.zarr", consolidated=False) as stored:
        assert stored.cube.dtype == np.int16
        xr.testing.assert_equal(stored.cube.load(), extract_adc_codes(cube))
        assert stored.cube.attrs["scale"] == cube.attrs["scale"]
        assert stored.cube.attrs["bits"] == 12
    opened = dc.open(tmp_path / "cube.zarr").cube
    np.testing.assert_array_equal(opened.values, cube.values)
    assert opened.attrs["units"] == "sqrt(W)"


def test_samples_that_are_no_codes_any_more_are_written_as_they_are(tmp_path, radar):
    radar, cube = simulated(radar)
    halved = cube.copy(data=cube.values * np.float32(0.3))
    write(tmp_path / "cube.zarr", halved, radar)

    with xr.open_zarr(tmp_path / "cube.zarr", consolidated=False) as stored:
        assert stored.cube.dtype == np.complex64
        assert "scale" not in stored.cube.attrs
    opened = dc.open(tmp_path / "cube.zarr").cube
    np.testing.assert_array_equal(opened.values, halved.values)
