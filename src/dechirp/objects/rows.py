"""The rows of an object list: their columns, and what makes them a list.

A dataset over `object`, any number of rows for a frame, with the columns of `COLUMNS`. x points
forward, y left, z up, velocities are relative to the radar, all in its coordinates; NaN where not
told. A frame may hold no object, so a second axis, `cycle`, says which frames were looked at:
`cycle_frame`, and `cycle_time` in s. Each becomes one list on a bus.
"""

from collections.abc import Mapping

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from dechirp.core.checks import numbers
from dechirp.core.errors import InvalidSetting

STATUSES = ("detection", "tentative", "confirmed")

COLUMNS = {
    "frame": "1",
    "time": "s",
    "number": "1",
    "status": "1",
    "x": "m",
    "y": "m",
    "z": "m",
    "vx": "m/s",
    "vy": "m/s",
    "x_std": "m",
    "y_std": "m",
    "vx_std": "m/s",
    "vy_std": "m/s",
    "snr": "1",
    "length": "m",
    "width": "m",
}
"""Unit of each column."""

MEASURED = tuple(name for name in COLUMNS if name not in ("frame", "time", "number", "status"))
"""Columns of numbers that may not be told."""

_NOT_NEGATIVE = ("x_std", "y_std", "vx_std", "vy_std", "snr", "length", "width")


def made(columns: Mapping[str, ArrayLike], frame: ArrayLike, time_s: ArrayLike) -> xr.Dataset:
    """Object list of columns by name, and the frames and times of all cycles."""
    rows = {
        name: ("object", np.asarray(columns[name]), {"units": units})
        for name, units in COLUMNS.items()
    }
    looked_at = {
        "cycle_frame": ("cycle", np.asarray(frame), {"units": "1"}),
        "cycle_time": ("cycle", np.asarray(time_s, float), {"units": "s"}),
    }
    return xr.Dataset({**rows, **looked_at})


def of_rows(columns: Mapping[str, np.ndarray]) -> xr.Dataset:
    """Object list of columns, where only frames with objects are known."""
    return must_be_objects(made(columns, *cycles(columns["frame"], columns["time"])))


def status_codes(objects: xr.Dataset) -> np.ndarray:
    """Place of each object's status in `STATUSES`: how much it is believed."""
    names = objects["status"].values
    return np.array([STATUSES.index(name) for name in names], int)


def must_be_objects(objects: object) -> xr.Dataset:
    """Keep an object list in order of frames, with cycles, or raise `InvalidSetting`."""
    if not isinstance(objects, xr.Dataset):
        raise _no_list(f"a {type(objects).__name__}")
    missing = [name for name in COLUMNS if name not in objects.variables]
    if missing:
        raise _no_list(f"a dataset without {', '.join(missing)}")
    axes = {**dict.fromkeys(COLUMNS, "object"), "cycle_frame": "cycle", "cycle_time": "cycle"}
    for name, axis in axes.items():
        if name in objects.variables and objects[name].dims != (axis,):
            got = ", ".join(map(str, objects[name].dims)) or "no axis"
            raise _no_list(f"{name} over {got}, not over {axis}")
    columns = {
        name: _not_negative(name, measured(f"objects.{name}", objects[name].values))
        for name in MEASURED
    }
    columns["frame"] = counts("objects.frame", objects["frame"].values)
    columns["number"] = counts("objects.number", objects["number"].values)
    columns["time"] = numbers("objects.time", objects["time"].values)
    columns["status"] = _known_statuses(objects["status"].values)
    if "cycle_frame" in objects.variables and "cycle_time" in objects.variables:
        frame = counts("objects.cycle_frame", objects["cycle_frame"].values)
        time_s = numbers("objects.cycle_time", objects["cycle_time"].values)
    else:
        frame, time_s = cycles(columns["frame"], columns["time"])
    _must_be_in_turn(frame, time_s)
    _must_be_of_cycles(columns["frame"], columns["time"], frame, time_s)
    order = np.argsort(columns["frame"], kind="stable")
    return made({name: column[order] for name, column in columns.items()}, frame, time_s)


def cycle_of(objects: xr.Dataset) -> np.ndarray:
    """Place of each object's frame among the cycles."""
    return np.searchsorted(objects["cycle_frame"].values, objects["frame"].values)


def cycles(frame: np.ndarray, time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frame and time of each cycle, where those of the rows are all."""
    cycle_frame, first = np.unique(frame, return_index=True)
    return cycle_frame, np.asarray(time_s, float)[first]


def _must_be_in_turn(frame: np.ndarray, time_s: np.ndarray) -> None:
    back = np.flatnonzero((np.diff(time_s) <= 0) | (np.diff(frame) <= 0))
    if back.size:
        at = back[0]
        raise InvalidSetting(
            "objects.time",
            got=f"{time_s[at + 1]:.9g} s in frame {frame[at + 1]}, after "
            f"{time_s[at]:.9g} s in frame {frame[at]}",
            need="later from frame to frame",
            fix="Sort them by time, and give each frame a time and a number of its own.",
        )


def _must_be_of_cycles(
    frame: np.ndarray, time_s: np.ndarray, cycle_frame: np.ndarray, cycle_time_s: np.ndarray
) -> None:
    """Raise `InvalidSetting` unless each row has the time of a cycle, to within a microsecond."""
    stranger = np.flatnonzero(~np.isin(frame, cycle_frame))
    if stranger.size:
        raise InvalidSetting(
            "objects.frame",
            got=f"{frame[stranger[0]]}",
            need="one of the frames that have a time",
            fix="Give the time of every frame.",
        )
    own_s = cycle_time_s[np.searchsorted(cycle_frame, frame)]
    other = np.flatnonzero(np.abs(time_s - own_s) > 1e-6)
    if other.size:
        at = other[0]
        raise InvalidSetting(
            "objects.time",
            got=f"{time_s[at]:.9g} s, in frame {frame[at]} at {own_s[at]:.9g} s",
            need="the time of its frame",
            fix="Give all objects of a frame the time of its middle.",
        )


def measured(where: str, values: np.ndarray) -> np.ndarray:
    """Keep numbers that may be NaN as floats, or raise `InvalidSetting` about `where`."""
    column = np.asarray(values)
    if column.dtype.kind not in "iuf":
        column = numbers(where, column)
    numbers(where, column[~np.isnan(column)])
    return column.astype(float)


def _not_negative(name: str, column: np.ndarray) -> np.ndarray:
    if name in _NOT_NEGATIVE and (column < 0).any():
        raise InvalidSetting(
            f"objects.{name}",
            got=np.nanmin(column),
            need="0 or more, or NaN",
            fix="Leave it NaN where not known.",
        )
    return column


def counts(where: str, values: np.ndarray) -> np.ndarray:
    """Keep whole numbers, 0 or more, as integers, or raise `InvalidSetting` about `where`."""
    column = np.atleast_1d(numbers(where, values))
    wrong = column[(column < 0) | (column != np.round(column)) | (column > 2**53)]
    if wrong.size:
        raise InvalidSetting(
            where, got=wrong[0], need="whole numbers, 0 or more", fix="Count them from 0."
        )
    return column.astype(np.int64)


def _known_statuses(values: np.ndarray) -> np.ndarray:
    names = np.asarray(values).astype(str)
    wrong = [name for name in names if name not in STATUSES]
    if wrong:
        raise InvalidSetting(
            "objects.status",
            got=wrong[0] or "empty",
            need=f"one of {', '.join(STATUSES)}",
            fix="Leave out tracks that are not there.",
        )
    return names.astype("U9")


def _no_list(got: str) -> InvalidSetting:
    return InvalidSetting(
        "objects",
        got=got,
        need=f"an object list, with {', '.join(COLUMNS)} over object",
        fix="Make one with object_list from tracks, clusters or detections.",
    )
