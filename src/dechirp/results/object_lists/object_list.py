"""Conversion of tracks, clusters or detections to an object list."""

import warnings

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_finite_array, check_integer
from dechirp.core.detection_columns import TABLE
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding, PhysicsWarning
from dechirp.results.object_lists.list_columns import (
    MEASURED,
    build_object_list,
    check_non_negative_integers,
    check_numbers_or_nan,
    check_object_list,
    unique_cycles,
)
from dechirp.results.object_lists.priority import sort_by_priority

DETECTED = tuple(column.name for column in TABLE if column.in_object_lists)
"""Columns of detections and clusters that object lists keep."""


@check_argument_types
def object_list(
    dataset: xr.Dataset, times_s: ArrayLike | None = None, *, first: int = 0
) -> xr.Dataset:
    """Convert tracks, clusters or detections to an object list.

    Parameters
    ----------
    dataset : Dataset over (`track`, `frame`), `cluster` or `detection`
        Of tracks, the tentative and confirmed ones of each frame are listed.
    times_s : array (n_frames,), optional
        For clusters and detections, the middle of each frame; a frame without any becomes an empty
        list. If omitted, such a frame has no list. Tracks contain their frames.
    first : int
        Number of the first of those frames.

    Returns
    -------
    Dataset over `object` and `cycle`
        number
            Track number; for clusters and detections the index within their frame.
        status
            "tentative", "confirmed"; "detection" for clusters and detections.
        x, y, z : m
            For clusters and detections from range and angles. An unknown angle counts as 0, and the
            coordinate that depends on it alone is NaN; all three are NaN if both are unknown.
        vx, vy : m/s
            For tracks the velocity; for clusters and detections the radial velocity along the line
            of sight, without standard errors, since the tangential motion is unknown.
        x_std, y_std : m, vx_std, vy_std : m/s
            Standard errors; from those of range and angles to first order.
        snr
            Ratio, after integration.
        length, width : m
            For clusters, the extent along and across the line of sight; for tracks of extended
            objects, the axes of their ellipse.

    Raises
    ------
    InvalidSetting
        If it is none of these, lacks a column, or time decreases.

    Warns
    -----
    PhysicsWarning
        If detections have no direction, so their positions are unknown.
    """
    if not isinstance(dataset, xr.Dataset):
        raise _unsuitable_dataset_error(f"a {type(dataset).__name__}")
    check_integer("first", first, at_least=0)
    if {"track", "frame"} <= set(dataset.dims):
        columns, frame, time_s = _object_columns_from_tracks(dataset)
    elif "cluster" in dataset.dims or "detection" in dataset.dims:
        columns = _object_columns_from_points(
            dataset, "cluster" if "cluster" in dataset.dims else "detection"
        )
        if times_s is None:
            frame, time_s = unique_cycles(columns["frame"], columns["time"])
        else:
            time_s = np.ravel(check_finite_array("times_s", times_s, may_be_empty=True))
            frame = first + np.arange(len(time_s))
    else:
        raise _unsuitable_dataset_error(
            f"a dataset over {', '.join(map(str, dataset.dims)) or 'no axis'}"
        )
    return sort_by_priority(check_object_list(build_object_list(columns, frame, time_s)))


def _object_columns_from_tracks(
    tracks: xr.Dataset,
) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray]:
    """Return the columns of tracks, and frame and time of each cycle."""
    _check_required_columns(tracks, ("x", "y", "vx", "vy", "status", "time"))
    frame, number = (
        _axis_labels_or_indices(tracks, "frame"),
        _axis_labels_or_indices(tracks, "track"),
    )
    status = tracks["status"].transpose("frame", "track").values
    at_frame, of_track = np.nonzero((status == "tentative") | (status == "confirmed"))
    time_s = check_finite_array("tracks.time", tracks["time"].values, may_be_empty=True)

    def column(name: str) -> np.ndarray:
        if name not in tracks.variables:
            return np.full(len(of_track), np.nan)
        values = tracks[name].transpose("frame", "track").values[at_frame, of_track]
        return check_numbers_or_nan(f"tracks.{name}", values)

    columns = {name: column(name) for name in MEASURED}
    if "covariance" in tracks.variables:
        columns |= _state_standard_errors(tracks, at_frame, of_track)
    columns["frame"] = frame[at_frame]
    columns["time"] = time_s[at_frame]
    columns["number"] = number[of_track]
    columns["status"] = status[at_frame, of_track]
    return columns, frame, time_s


def _axis_labels_or_indices(tracks: xr.Dataset, dim: str) -> np.ndarray:
    """Return the integer labels of an axis, or indices if it has none."""
    has_numbers = dim in tracks.coords and tracks[dim].dtype.kind in "iu"
    return tracks[dim].values if has_numbers else np.arange(tracks.sizes[dim])


def _state_standard_errors(
    tracks: xr.Dataset, frame_indices: np.ndarray, track_indices: np.ndarray
) -> dict[str, np.ndarray]:
    """Return standard errors of selected states from their covariances."""
    _check_required_columns(tracks, ("state",))
    dims = tracks["covariance"].dims
    covariance = np.moveaxis(
        tracks["covariance"].values, [dims.index("frame"), dims.index("track")], [0, 1]
    )[frame_indices, track_indices]
    variances = dict(zip(tracks["state"].values, np.einsum("nii->in", covariance), strict=True))
    return {
        f"{name}_std": np.sqrt(np.maximum(variances[name], 0))  # rounding errors may go below
        for name in ("x", "y", "vx", "vy")
        if name in variances
    }


def _object_columns_from_points(dataset: xr.Dataset, dim: str) -> dict[str, np.ndarray]:
    """Return the columns of detections or clusters, which have the same names."""
    names = ("frame", "time", "range", "velocity", "azimuth", "elevation")
    _check_required_columns(dataset, (*names, "snr", "range_std", "azimuth_std", "elevation_std"))
    column = {
        name: check_numbers_or_nan(f"{dim}s.{name}", dataset[name].values) for name in names[1:]
    }
    std = {
        name: check_numbers_or_nan(f"{dim}s.{name}_std", dataset[f"{name}_std"].values)
        for name in ("range", "azimuth", "elevation")
    }
    range_m, is_undirected = (
        column["range"],
        np.isnan(column["azimuth"]) & np.isnan(column["elevation"]),
    )
    _warn_rows_without_direction(int(is_undirected.sum()), len(is_undirected), dim)
    azimuth = np.where(is_undirected, np.nan, np.nan_to_num(column["azimuth"]))
    elevation = np.where(is_undirected, np.nan, np.nan_to_num(column["elevation"]))
    direction_x, direction_y = (
        np.cos(elevation) * np.cos(azimuth),
        np.cos(elevation) * np.sin(azimuth),
    )
    no_azimuth, no_elevation = np.isnan(column["azimuth"]), np.isnan(column["elevation"])
    azimuth_m = range_m * np.cos(elevation) * np.where(no_azimuth, 0.0, std["azimuth"])
    elevation_m = range_m * np.sin(elevation) * np.where(no_elevation, 0.0, std["elevation"])
    extent = {
        name: check_numbers_or_nan(f"{dim}s.{name}_extent", dataset[f"{name}_extent"].values)
        if f"{name}_extent" in dataset.variables
        else np.full(len(range_m), np.nan)
        for name in ("range", "azimuth")
    }
    unknown = np.full(len(range_m), np.nan)
    frame = check_non_negative_integers(f"{dim}s.frame", dataset["frame"].values)
    return {
        "frame": frame,
        "time": column["time"],
        "number": _index_within_frame(frame),
        "status": np.full(len(range_m), "detection"),
        "x": range_m * direction_x,
        "y": np.where(no_azimuth, np.nan, range_m * direction_y),
        "z": np.where(no_elevation, np.nan, range_m * np.sin(elevation)),
        "vx": column["velocity"] * direction_x,
        "vy": np.where(no_azimuth, np.nan, column["velocity"] * direction_y),
        "x_std": _root_sum_square(
            direction_x * std["range"], np.sin(azimuth) * azimuth_m, np.cos(azimuth) * elevation_m
        ),
        "y_std": np.where(
            no_azimuth,
            np.nan,
            _root_sum_square(
                direction_y * std["range"],
                np.cos(azimuth) * azimuth_m,
                np.sin(azimuth) * elevation_m,
            ),
        ),
        "vx_std": unknown,
        "vy_std": unknown,
        **{
            name: check_numbers_or_nan(f"{dim}s.{name}", dataset[name].values)
            for name in DETECTED
            if name in dataset.variables
        },
        "length": extent["range"],
        "width": range_m * extent["azimuth"],
    }


def _root_sum_square(*terms: np.ndarray) -> np.ndarray:
    return np.sqrt(sum(term**2 for term in terms))


def _index_within_frame(frame: np.ndarray) -> np.ndarray:
    """Return the index of each row among those of its frame."""
    order = np.argsort(frame, kind="stable")
    sorted_frame = frame[order]
    indices = np.empty(len(frame), int)
    indices[order] = np.arange(len(frame)) - np.searchsorted(sorted_frame, sorted_frame)
    return indices


def _check_required_columns(dataset: xr.Dataset, required: tuple[str, ...]) -> None:
    missing = [name for name in required if name not in dataset.variables]
    if missing:
        raise _unsuitable_dataset_error(f"a dataset without {', '.join(missing)}")


def _warn_rows_without_direction(n_without_direction: int, n_rows: int, dim: str) -> None:
    if n_without_direction:
        finding = Finding(
            level="warning",
            setting="objects",
            value=f"{n_without_direction} of {n_rows} {dim}s without azimuth and elevation",
            expected="at least one angle, which their positions need",
            fix="use an array that resolves directions, or the detections; these positions are NaN",
        )
        warnings.warn(PhysicsWarning(finding), stacklevel=5)


def _unsuitable_dataset_error(value: str) -> InvalidSetting:
    return InvalidSetting(
        "dataset",
        value=value,
        expected="tracks over track and frame, clusters over cluster, or detections over"
        " detection, with their columns",
        fix="give the output of the chain or the tracker",
    )
