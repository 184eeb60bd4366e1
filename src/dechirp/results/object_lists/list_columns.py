"""Columns of an object list, their checks, and warnings about lost or clipped values.

An object list is a dataset over `object`, any number of rows for a frame, with the columns of
`COLUMNS`. x points forward, y left, z up, velocities are relative to the radar, all in its
coordinates; NaN where unknown. A frame may contain no object, so a second axis, `cycle`, lists
the processed frames: `cycle_frame`, and `cycle_time` in s. Each cycle becomes one list on a bus.
"""

import warnings
from collections.abc import Mapping

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from dechirp.core.checks import check_finite_array
from dechirp.core.detection_columns import TABLE
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding, PhysicsWarning
from dechirp.core.text import format_si

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
    **{column.name: column.unit for column in TABLE if column.in_object_lists},
    "length": "m",
    "width": "m",
}
"""Unit of each column."""

MEASURED = tuple(name for name in COLUMNS if name not in ("frame", "time", "number", "status"))
"""Numeric columns whose values may be unknown (NaN)."""

_NOT_NEGATIVE = ("x_std", "y_std", "vx_std", "vy_std", "snr", "length", "width")


def build_object_list(
    columns: Mapping[str, ArrayLike], frame: ArrayLike, time_s: ArrayLike
) -> xr.Dataset:
    """Build an object list from columns by name, and the frames and times of all cycles."""
    unknown = np.full(len(np.asarray(columns["frame"])), np.nan)
    rows = {
        name: ("object", np.asarray(columns.get(name, unknown)), {"units": units})
        for name, units in COLUMNS.items()
    }
    cycles = {
        "cycle_frame": ("cycle", np.asarray(frame), {"units": "1"}),
        "cycle_time": ("cycle", np.asarray(time_s, float), {"units": "s"}),
    }
    return xr.Dataset({**rows, **cycles})


def object_list_from_rows(columns: Mapping[str, np.ndarray]) -> xr.Dataset:
    """Build an object list from columns, where only frames with objects are known."""
    return check_object_list(
        build_object_list(columns, *unique_cycles(columns["frame"], columns["time"]))
    )


def status_codes(objects: xr.Dataset) -> np.ndarray:
    """Return the index of each status in `STATUSES`, in order of confidence."""
    names = objects["status"].values
    return np.array([STATUSES.index(name) for name in names], int)


def check_object_list(objects: object) -> xr.Dataset:
    """Return an object list in order of frames, with cycles, or raise `InvalidSetting`."""
    if not isinstance(objects, xr.Dataset):
        raise _object_list_error(f"a {type(objects).__name__}")
    missing = [name for name in COLUMNS if name not in objects.variables]
    if missing:
        raise _object_list_error(f"a dataset without {', '.join(missing)}")
    axes = {**dict.fromkeys(COLUMNS, "object"), "cycle_frame": "cycle", "cycle_time": "cycle"}
    for name, axis in axes.items():
        if name in objects.variables and objects[name].dims != (axis,):
            actual = ", ".join(map(str, objects[name].dims)) or "no axis"
            raise _object_list_error(f"{name} over {actual}, not over {axis}")
    columns = check_measured_columns({name: objects[name].values for name in MEASURED})
    columns["frame"] = check_non_negative_integers("objects.frame", objects["frame"].values)
    columns["number"] = check_non_negative_integers("objects.number", objects["number"].values)
    columns["time"] = check_finite_array("objects.time", objects["time"].values, may_be_empty=True)
    columns["status"] = _check_statuses(objects["status"].values)
    if "cycle_frame" in objects.variables and "cycle_time" in objects.variables:
        frame = check_non_negative_integers("objects.cycle_frame", objects["cycle_frame"].values)
        time_s = check_finite_array(
            "objects.cycle_time", objects["cycle_time"].values, may_be_empty=True
        )
    else:
        frame, time_s = unique_cycles(columns["frame"], columns["time"])
    _check_cycles_ascend(frame, time_s)
    _check_rows_match_cycles(columns["frame"], columns["time"], frame, time_s)
    order = np.argsort(columns["frame"], kind="stable")
    return build_object_list(
        {name: column[order] for name, column in columns.items()}, frame, time_s
    )


def check_measured_columns(columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the measured columns as floats, or raise `InvalidSetting`."""
    return {
        name: _check_not_negative(name, check_numbers_or_nan(f"objects.{name}", columns[name]))
        for name in MEASURED
    }


def cycle_indices(objects: xr.Dataset) -> np.ndarray:
    """Return the cycle index of each object."""
    return np.searchsorted(objects["cycle_frame"].values, objects["frame"].values)


def unique_cycles(frame: np.ndarray, time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return frame and time of each cycle, assuming that every cycle has an object."""
    cycle_frame, first = np.unique(frame, return_index=True)
    return cycle_frame, np.asarray(time_s, float)[first]


def _check_cycles_ascend(frame: np.ndarray, time_s: np.ndarray) -> None:
    descending = np.flatnonzero((np.diff(time_s) <= 0) | (np.diff(frame) <= 0))
    if descending.size:
        index = descending[0]
        raise InvalidSetting(
            "objects.time",
            value=f"{format_si(time_s[index + 1], 's', 9)} in frame {frame[index + 1]}, after "
            f"{format_si(time_s[index], 's', 9)} in frame {frame[index]}",
            expected="times that increase from frame to frame",
            fix="sort them by time, and give each frame a unique time and number",
        )


def _check_rows_match_cycles(
    frame: np.ndarray, time_s: np.ndarray, cycle_frame: np.ndarray, cycle_time_s: np.ndarray
) -> None:
    """Raise `InvalidSetting` unless each row has the time of its cycle, within 1 us."""
    unknown = np.flatnonzero(~np.isin(frame, cycle_frame))
    if unknown.size:
        raise InvalidSetting(
            "objects.frame",
            value=f"{frame[unknown[0]]}",
            expected="a frame with a time",
            fix="give the time of every frame",
        )
    expected_s = cycle_time_s[np.searchsorted(cycle_frame, frame)]
    mismatched = np.flatnonzero(np.abs(time_s - expected_s) > 1e-6)
    if mismatched.size:
        index = mismatched[0]
        raise InvalidSetting(
            "objects.time",
            value=f"{format_si(time_s[index], 's', 9)}, in frame {frame[index]} at"
            f" {format_si(expected_s[index], 's', 9)}",
            expected="the time of its frame",
            fix="give all objects of a frame the time of its middle",
        )


def check_numbers_or_nan(setting: str, values: np.ndarray) -> np.ndarray:
    """Return numbers, which may be NaN, as floats, or raise `InvalidSetting` for `setting`."""
    column = np.asarray(values)
    if column.dtype.kind not in "iuf":
        column = check_finite_array(setting, column, may_be_empty=True)
    finite = column[~np.isnan(column)]
    check_finite_array(setting, finite, largest=np.finfo(float).max, may_be_empty=True)
    return column.astype(float)


def _check_not_negative(name: str, column: np.ndarray) -> np.ndarray:
    if name in _NOT_NEGATIVE and (column < 0).any():
        raise InvalidSetting(
            f"objects.{name}",
            value=np.nanmin(column),
            expected="0 or more, or NaN",
            fix="use NaN for unknown values",
        )
    return column


def check_non_negative_integers(setting: str, values: np.ndarray) -> np.ndarray:
    """Return non-negative integers, or raise `InvalidSetting` for `setting`."""
    column = np.atleast_1d(check_finite_array(setting, values, may_be_empty=True))
    invalid = column[(column < 0) | (column != np.round(column)) | (column > 2**53)]
    if invalid.size:
        raise InvalidSetting(
            setting, value=invalid[0], expected="whole numbers, 0 or more", fix="count them from 0"
        )
    return column.astype(np.int64)


def _check_statuses(values: np.ndarray) -> np.ndarray:
    statuses = np.asarray(values).astype(str)
    unknown = [name for name in statuses if name not in STATUSES]
    if unknown:
        raise InvalidSetting(
            "objects.status",
            value=unknown[0] or "empty",
            expected=f"one of {', '.join(STATUSES)}",
            fix="leave out deleted tracks",
        )
    return statuses.astype("U9")


def _object_list_error(value: str) -> InvalidSetting:
    return InvalidSetting(
        "objects",
        value=value,
        expected=f"an object list, with {', '.join(COLUMNS)} over object",
        fix="make one with object_list from tracks, clusters or detections",
    )


def warn_clipped_values(where: str, n_clipped: Mapping[str, int]) -> None:
    """Warn about values that were clipped to the range of their signal or field.

    Parameters
    ----------
    where : str
        The format that limits the values, such as "the DBC".
    n_clipped : mapping
        Number of clipped values for each signal, by its name and range.
    """
    counts = {name: n for name, n in n_clipped.items() if n}
    if counts:
        finding = Finding(
            level="warning",
            setting="objects",
            value=f"{sum(counts.values())} values clipped to the range of {where}: "
            + ", ".join(f"{n} of {name}" for name, n in counts.items()),
            expected="values within those ranges",
            fix="leave such objects out, or use a wider signal",
        )
        warnings.warn(PhysicsWarning(finding), stacklevel=3)


def warn_lost_messages(
    counts: Mapping[str, int], *, remaining: str, expected: str, fix: str, stacklevel: int = 4
) -> None:
    """Warn about messages that were lost or damaged on a bus or network.

    Parameters
    ----------
    counts : mapping
        Number of losses of each type; types without a loss are not reported.
    remaining : str
        Number of complete lists, as text.
    expected, fix : str
        Parts of the finding.
    stacklevel : int
        Calls from here to the line of the user.
    """
    losses = [f"{n} {kind}" for kind, n in counts.items() if n]
    if losses:
        finding = Finding(
            level="warning",
            setting="objects",
            value=f"{', '.join(losses)}; {remaining}",
            expected=expected,
            fix=fix,
        )
        warnings.warn(PhysicsWarning(finding), stacklevel=stacklevel)
