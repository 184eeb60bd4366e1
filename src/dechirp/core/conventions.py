"""Names, units and signs of the axes of labelled arrays.

Fast time runs along `sample`, slow time along `chirp`. A transform renames the axis that it
consumes: sample -> range, chirp -> velocity. With time-division multiplexing `chirp` contains all
chirps in order of transmission, and the coordinate `transmitter` along it holds the transmitter
of each; when several transmit at once, the coordinate is absent. If intervals differ from frame
to frame, `chirp` is an index, and the coordinate `chirp_time` over `frame` and `chirp` holds the
start times.

Range and velocity grow away from the radar: a receding target has positive velocity. The
beat signal is Tx x conj(Rx), so an up-chirp gives positive beat frequencies. x points
forward (boresight), y left, z up; azimuth grows to the left, elevation up.
"""

from collections.abc import Hashable, Sequence
from typing import cast

import numpy as np
import pandas as pd  # type: ignore[import-untyped]
import xarray as xr
from xarray.indexes import PandasIndex

import dechirp.core.accessor  # noqa: F401  # registers the accessor `.dechirp`

AXES = {
    "frame": ("s", "start of the frame"),
    "chirp": ("s", "slow time: start of the chirp, since the start of its frame"),
    "rx": ("1", "receiver"),
    "sample": ("s", "fast time since the start of the ramp"),
    "range": ("m", "distance from the radar"),
    "velocity": ("m/s", "rate of change of range, receding positive"),
    "azimuth": ("rad", "angle to the left of boresight"),
    "elevation": ("rad", "angle above the horizontal"),
}

CUBE_AXES = ("frame", "chirp", "rx", "sample")


def labelled_variable(
    dims: tuple[str, ...], values: np.ndarray, attributes: dict[str, str]
) -> xr.Variable:
    """Return a plain array with its axes and attributes.

    Without `fastpath` xarray imports Dask, if it is installed, to compare types: 0.35 s.
    """
    return xr.Variable(dims, values, attributes, fastpath=True)


def transmitter_coordinate(cycle_transmitters: Sequence[int], n_chirps: int) -> xr.Variable:
    """Return the coordinate along `chirp` with the transmitter of each, an index into `Array.tx_m`.

    `cycle_transmitters` are the transmitters of one multiplexing cycle.
    """
    numbers = np.resize(np.array(cycle_transmitters), n_chirps)
    attributes = {"units": "1", "long_name": "transmitter of the chirp"}
    return labelled_variable(("chirp",), numbers, attributes)


def chirp_time_coordinate(times_s: np.ndarray) -> xr.Variable:
    """Return the coordinate of chirp start times over `frame` and `chirp`."""
    units, long_name = AXES["chirp"]
    attributes = {"units": units, "long_name": long_name}
    return labelled_variable(("frame", "chirp"), times_s, attributes)


def axis_coordinate(name: str, values: np.ndarray) -> xr.Variable:
    """Return the coordinate of an axis, with the unit and long name of `AXES`.

    Its labels are a read-only copy of the values, with pandas 2 as with pandas 3, so that arrays
    can share them; the given array stays as it is.
    """
    units, long_name = AXES[name]
    labels = np.array(values)
    labels.flags.writeable = False
    # xarray would import pint, 0.05 s, to convert another array to the index that it needs.
    index = pd.Index(labels, copy=False)
    attributes = {"units": units, "long_name": long_name}
    return cast(xr.Variable, xr.IndexVariable(name, index, attributes))  # type: ignore[no-untyped-call]


def labelled_array(
    variable: xr.Variable, *coordinates: xr.Coordinates, name: str | None = None
) -> xr.DataArray:
    """Return an array with coordinates that other arrays may have, too.

    Arrays share only the labels of axes, which `axis_coordinate` makes read-only. Each has its own
    indexes, whose names can be edited, and copies of attributes and of the other coordinates.
    Without `fastpath` xarray compares and copies all labels: 0.7 ms for a cube instead of 0.1.

    Raises
    ------
    ValueError
        If there are more or fewer labels than elements along an axis.
    """
    sizes = variable.sizes
    variables: dict[Hashable, xr.Variable] = {}
    indexes: dict[Hashable, xr.Index] = {}
    for part in coordinates:
        shared_indexes = part.xindexes
        for key, coordinate in part.variables.items():
            if any(sizes[axis] != size for axis, size in coordinate.sizes.items()):
                raise ValueError(f"{key} has the shape {coordinate.shape} in an array of {sizes}")
            if key not in shared_indexes:
                variables[key] = coordinate.copy()
                continue
            index = cast(PandasIndex, shared_indexes[key].copy(deep=False))
            index.index = index.index.view()  # a new index of the same labels
            indexes[key] = index
            variables |= index.create_variables({key: coordinate})
    return xr.DataArray(variable, variables, name=name, indexes=indexes, fastpath=True)
