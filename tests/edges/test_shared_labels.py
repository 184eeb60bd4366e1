"""Labels that several arrays share: no edit of an array reaches the next one."""

import numpy as np
import pytest

import dechirp as dc
from dechirp.core.conventions import (
    axis_coordinate,
    labelled_array,
    labelled_variable,
    shared_coordinates,
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


@pytest.mark.parametrize("make_array", [_empty_cube, _empty_map])
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


def test_arrays_refuse_labels_of_another_length():
    variable = labelled_variable(("range",), np.zeros(3), {})
    ranges = shared_coordinates({"range": axis_coordinate("range", np.arange(4.0))})

    with pytest.raises(ValueError, match="range has the shape"):
        labelled_array(variable, ranges)
