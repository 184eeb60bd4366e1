"""Units of arrays in the syntax of pint; arrays and files with units of earlier versions."""

import numpy as np
import pint
import pytest
import xarray as xr

import dechirp as dc
from dechirp.core.units import current_units

SCENARIO = dc.reference()
RADAR = SCENARIO.radar


@pytest.fixture(scope="module")
def result():
    return dc.run(SCENARIO)


def iter_units(array):
    """Yield name and units of an array or the variables of a dataset, and of their coordinates."""
    variables = dict(array.coords)
    variables |= {"": array} if isinstance(array, xr.DataArray) else dict(array.data_vars)
    yield from ((n, v.attrs["units"]) for n, v in variables.items() if "units" in v.attrs)


def test_pint_parses_units_of_arrays_of_a_run(result):
    registry = pint.UnitRegistry()
    frame = result.cube.isel(frame=0)
    arrays = {
        "cube": result.cube,
        "power": result.power,
        "threshold": result.threshold,
        "level": result.power.dechirp.db(),
        "detections": result.detections,
        "truth": result.truth,
        "spectrogram": dc.spectrogram(result.cube, RADAR, range_m=(40, 60), n_window=64),
        "uncalibrated": dc.power_map(frame.assign_attrs(units="1"), RADAR, dc.Chain()),
    }
    arrays["relative level"] = arrays["uncalibrated"].dechirp.db()
    units = {key: dict(iter_units(array)) for key, array in arrays.items()}
    assert all(units.values())
    for array_units in units.values():
        for unit in array_units.values():
            registry.parse_units(unit)
    assert registry(units["cube"][""]) ** 2 == registry(units["power"][""])
    assert units["detections"]["range"] == "m"


def test_arrays_with_earlier_units_mean_the_same(result):
    frame = result.cube.isel(frame=0)
    for earlier, current in (("sqrt(W)", "W**0.5"), ("full scale", "1")):
        assert current_units(earlier) == current
        power, same = (
            dc.power_map(frame.assign_attrs(units=units), RADAR, dc.Chain())
            for units in (earlier, current)
        )
        xr.testing.assert_identical(power, same)
    earlier_map = same.assign_attrs(units="full scale squared")
    np.testing.assert_array_equal(earlier_map.dechirp.db(), same.dechirp.db())
    assert earlier_map.dechirp.db().attrs == same.dechirp.db().attrs


def test_files_with_earlier_units_still_read(result, tmp_path):
    path = tmp_path / "frame.npz"
    dc.write(dc.recording_from_cube(result.cube, RADAR), path)
    with np.load(path) as stored:
        arrays = dict(stored)
    arrays["dechirp"] = np.array(str(arrays["dechirp"]).replace("W**0.5", "sqrt(W)"))
    assert "sqrt(W)" in str(arrays["dechirp"])
    np.savez(path, **arrays)
    cube = dc.open(path).cube
    xr.testing.assert_equal(cube, result.cube)
    assert cube.attrs["units"] == result.cube.attrs["units"]


def test_cf_xarray_finds_axes_and_quantifies_units(result):
    cf_xarray = pytest.importorskip("cf_xarray")
    pytest.importorskip("cf_xarray.units")
    registry = cf_xarray.units.units
    for array in (result.cube, result.power, result.detections):
        for name, unit in iter_units(array):
            assert registry.parse_units(unit) is not None, name
    assert result.power.cf["range"].attrs["units"] == "m"
