"""Labels that several arrays share: no edit of an array reaches the next one."""

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.core.conventions import (
    axis_coordinate,
    labelled_array,
    labelled_variable,
)
from dechirp.radar.cube import label_cube
from small_radars import CODES, small_radar

RADAR = small_radar(code=CODES[1])


def _empty_cube():
    frame, n_rx = RADAR.frame, RADAR.array.n_rx
    shape = (1, frame.n_chirps_total, n_rx, frame.chirp.n_samples)
    return label_cube(np.zeros(shape, np.complex64), RADAR, units="1")


def _empty_map():
    return dc.power_map(_empty_cube(), RADAR)


def _empty_azimuth_map():
    return dc.range_azimuth_map(_empty_cube(), RADAR)


MAKERS = [_empty_cube, _empty_map, _empty_azimuth_map]


@pytest.mark.parametrize("make_array", MAKERS)
def test_edited_labels_do_not_reach_the_next_array(make_array):
    expected, edited = make_array().copy(deep=True), make_array()
    for name, coordinate in edited.coords.items():
        edited[name].attrs["units"] = "furlong"
        coordinate.attrs["note"] = "mine"
        if name in edited.dims:
            with pytest.raises(ValueError, match="read-only"):
                coordinate.values[0] = 7
        else:
            coordinate.values[0] = 7
    edited.attrs["units"] = "furlong"
    edited.coords["extra"] = 1

    assert make_array().identical(expected)


def _along(array, axis):
    return array.isel(dict.fromkeys(set(array.dims) - {axis}, 0))


TAKE_INDEX = {
    "to_pandas": lambda array, axis: _along(array, axis).to_pandas().index,
    "to_dataframe": lambda array, axis: _along(array, axis).to_dataframe("value").index,
    "indexes": lambda array, axis: array.indexes[axis],
    "indexes of a slice": lambda array, axis: _along(array, axis).indexes[axis],
    "indexes of a coordinate": lambda array, axis: array[axis].indexes[axis],
    "get_index": lambda array, axis: array.get_index(axis),
}


@pytest.mark.parametrize("take_index", TAKE_INDEX.values(), ids=TAKE_INDEX)
@pytest.mark.parametrize("make_array", MAKERS)
def test_named_indexes_do_not_reach_the_next_array(make_array, take_index):
    edited = make_array()
    for axis in edited.indexes:
        take_index(edited, axis).name = f"{axis} (mine)"
    array = make_array()

    for axis, index in array.indexes.items():
        parts = [array.isel({axis: slice(2)}), array.isel({axis: slice(2, None)})]
        assert index.name == axis
        assert xr.concat(parts, axis).identical(array)
        assert array[axis].to_index().name == axis
    assert set((array - make_array()).coords) == set(array.coords)
    assert set((array - array.isel({array.dims[-1]: 0}, drop=True)).coords) == set(array.coords)


def test_labels_are_a_read_only_copy():
    values = np.arange(4.0)
    ranges = xr.Coordinates({"range": axis_coordinate("range", values)})
    array = labelled_array(labelled_variable(("range",), np.zeros(4), {}), ranges)
    for labels in (array.range.values, array.indexes["range"].values):
        with pytest.raises(ValueError, match="read-only"):
            labels[0] = 7
    values[:] = 7

    assert array.range.values.tolist() == [0, 1, 2, 3]


def test_arrays_refuse_labels_of_another_length():
    variable = labelled_variable(("range",), np.zeros(3), {})
    ranges = xr.Coordinates({"range": axis_coordinate("range", np.arange(4.0))})

    with pytest.raises(ValueError, match="range has the shape"):
        labelled_array(variable, ranges)
