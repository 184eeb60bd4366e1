"""ADC codes in the cube store: written as int16, and read back as the same samples."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.recordings.cube_store import write_cube_store
from dechirp.simulation.adc_codes import extract_adc_codes
from dechirp.simulation.impairments.noise import ThermalNoise
from dechirp.simulation.impairments.quantisation import Quantisation


def simulate_quantised_cube(radar, sampling="complex", **changes):
    chirp = replace(radar.frame.chirp, sampling=sampling)
    radar = replace(radar, frame=replace(radar.frame, chirp=chirp, n_chirps=8, **changes))
    noise_w = ThermalNoise().noise_power_w(dc.Scene(), radar)
    converter = Quantisation(bits=12, full_scale_w=1000 * noise_w)
    cube = dc.simulate(dc.Scene(), radar, impairments=[ThermalNoise(), converter], n_frames=3)
    return radar, cube


def write_frames(path, cube, radar):
    write_cube_store(
        path,
        (cube.isel(frame=slice(i, i + 1)) for i in range(cube.sizes["frame"])),
        n_frames=cube.sizes["frame"],
        radar=radar,
        groups={"detections": xr.Dataset()},
    )


@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_adc_codes_are_stored_as_int16_and_read_back_as_samples(tmp_path, radar, sampling):
    radar, cube = simulate_quantised_cube(radar, sampling)
    write_frames(tmp_path / "cube.zarr", cube, radar)

    with xr.open_zarr(tmp_path / "cube.zarr", consolidated=False) as store:
        assert store.cube.dtype == np.int16
        xr.testing.assert_equal(store.cube.load(), extract_adc_codes(cube))
        assert store.cube.attrs["scale"] == cube.attrs["scale"]
        assert store.cube.attrs["bits"] == 12
    samples = dc.open(tmp_path / "cube.zarr").cube
    np.testing.assert_array_equal(samples.values, cube.values)
    assert samples.attrs["units"] == "W**0.5"


def test_scaled_samples_are_stored_as_complex64(tmp_path, radar):
    radar, cube = simulate_quantised_cube(radar)
    scaled_cube = cube.copy(data=cube.values * np.float32(0.3))
    write_frames(tmp_path / "cube.zarr", scaled_cube, radar)

    with xr.open_zarr(tmp_path / "cube.zarr", consolidated=False) as store:
        assert store.cube.dtype == np.complex64
        assert "scale" not in store.cube.attrs
    samples = dc.open(tmp_path / "cube.zarr").cube
    np.testing.assert_array_equal(samples.values, scaled_cube.values)
