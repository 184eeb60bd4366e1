"""From tracks, clusters or detections to the object list; its columns are in `rows`."""

import warnings

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from dechirp.core.checks import numbers, whole
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding, PhysicsWarning
from dechirp.objects.priority import in_order
from dechirp.objects.rows import MEASURED, counts, cycles, made, measured, must_be_objects


def object_list(
    found: xr.Dataset, times_s: ArrayLike | None = None, *, first: int = 0
) -> xr.Dataset:
    """Object list of tracks, clusters or detections.

    Parameters
    ----------
    found : Dataset over (`track`, `frame`), `cluster` or `detection`
        Of tracks, the tentative and confirmed ones of each frame.
    times_s : array (n_frames,), optional
        Of clusters and detections, the middle of each frame: one without any is an empty list.
        Without it, and there, a frame without any is no list at all. Tracks know their frames.
    first : int
        Number of the first of those frames.

    Returns
    -------
    Dataset over `object` and `cycle`
        number
            Of the track; of a cluster or detection its place among those of its frame.
        status
            "tentative", "confirmed"; "detection" for clusters and detections.
        x, y, z : m
            Of clusters and detections from range and angles. Where one angle is not told it
            counts as 0, and the coordinate that only it would tell is NaN; all three are where
            neither is told.
        vx, vy : m/s
            Of tracks; of clusters and detections the radial velocity alone, along the line of
            sight, and no standard error, as nothing is known of the motion across it.
        x_std, y_std : m, vx_std, vy_std : m/s
            Standard errors; from those of range and angles to first order.
        snr
            Ratio, after integration.
        length, width : m
            Of clusters, the extent along and across the line of sight.

    Raises
    ------
    InvalidSetting
        If it is none of these, lacks a column, or time goes backwards.

    Warns
    -----
    PhysicsWarning
        If detections have no direction, so that nobody can tell where they are.
    """
    if not isinstance(found, xr.Dataset):
        raise _not_understood(f"a {type(found).__name__}")
    whole("first", first, at_least=0)
    if {"track", "frame"} <= set(found.dims):
        columns, frame, time_s = _of_tracks(found)
    elif "cluster" in found.dims or "detection" in found.dims:
        columns = _of_points(found, "cluster" if "cluster" in found.dims else "detection")
        if times_s is None:
            frame, time_s = cycles(columns["frame"], columns["time"])
        else:
            time_s = np.ravel(numbers("times_s", times_s))
            frame = first + np.arange(len(time_s))
    else:
        raise _not_understood(f"a dataset over {', '.join(map(str, found.dims)) or 'no axis'}")
    return in_order(must_be_objects(made(columns, frame, time_s)))


def _of_tracks(tracks: xr.Dataset) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray]:
    """Columns, and frame and time of each cycle."""
    _must_have(tracks, ("x", "y", "vx", "vy", "status", "time"))
    frame, number = _named(tracks, "frame"), _named(tracks, "track")
    status = tracks["status"].transpose("frame", "track").values
    at_frame, of_track = np.nonzero((status == "tentative") | (status == "confirmed"))
    time_s = numbers("tracks.time", tracks["time"].values)

    def column(name: str) -> np.ndarray:
        if name not in tracks.variables:
            return np.full(len(of_track), np.nan)
        values = tracks[name].transpose("frame", "track").values[at_frame, of_track]
        return measured(f"tracks.{name}", values)

    columns = {name: column(name) for name in MEASURED}
    if "covariance" in tracks.variables:
        columns |= _errors(tracks, at_frame, of_track)
    columns["frame"] = frame[at_frame]
    columns["time"] = time_s[at_frame]
    columns["number"] = number[of_track]
    columns["status"] = status[at_frame, of_track]
    return columns, frame, time_s


def _named(tracks: xr.Dataset, dim: str) -> np.ndarray:
    """Numbers along an axis, or places where it has no whole ones."""
    has_numbers = dim in tracks.coords and tracks[dim].dtype.kind in "iu"
    return tracks[dim].values if has_numbers else np.arange(tracks.sizes[dim])


def _errors(
    tracks: xr.Dataset, at_frame: np.ndarray, of_track: np.ndarray
) -> dict[str, np.ndarray]:
    """Standard errors of chosen states from their covariances."""
    _must_have(tracks, ("state",))
    dims = tracks["covariance"].dims
    covariance = np.moveaxis(
        tracks["covariance"].values, [dims.index("frame"), dims.index("track")], [0, 1]
    )[at_frame, of_track]
    variances = dict(zip(tracks["state"].values, np.einsum("nii->in", covariance), strict=True))
    return {
        f"{name}_std": np.sqrt(np.maximum(variances[name], 0))  # rounding errors may go below
        for name in ("x", "y", "vx", "vy")
        if name in variances
    }


def _of_points(found: xr.Dataset, dim: str) -> dict[str, np.ndarray]:
    """Columns of detections or clusters, whose words are the same."""
    wanted = ("frame", "time", "range", "velocity", "azimuth", "elevation", "snr")
    _must_have(found, (*wanted, "range_std", "azimuth_std", "elevation_std"))
    column = {name: measured(f"{dim}s.{name}", found[name].values) for name in wanted[1:]}
    std = {
        name: measured(f"{dim}s.{name}_std", found[f"{name}_std"].values)
        for name in ("range", "azimuth", "elevation")
    }
    range_m, untold = column["range"], np.isnan(column["azimuth"]) & np.isnan(column["elevation"])
    _say_untold(int(untold.sum()), len(untold), dim)
    azimuth = np.where(untold, np.nan, np.nan_to_num(column["azimuth"]))
    elevation = np.where(untold, np.nan, np.nan_to_num(column["elevation"]))
    towards_x, towards_y = np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth)
    no_azimuth, no_elevation = np.isnan(column["azimuth"]), np.isnan(column["elevation"])
    azimuth_m = range_m * np.cos(elevation) * np.where(no_azimuth, 0.0, std["azimuth"])
    elevation_m = range_m * np.sin(elevation) * np.where(no_elevation, 0.0, std["elevation"])
    extent = {
        name: measured(f"{dim}s.{name}_extent", found[f"{name}_extent"].values)
        if f"{name}_extent" in found.variables
        else np.full(len(range_m), np.nan)
        for name in ("range", "azimuth")
    }
    not_told = np.full(len(range_m), np.nan)
    frame = counts(f"{dim}s.frame", found["frame"].values)
    return {
        "frame": frame,
        "time": column["time"],
        "number": _places(frame),
        "status": np.full(len(range_m), "detection"),
        "x": range_m * towards_x,
        "y": np.where(no_azimuth, np.nan, range_m * towards_y),
        "z": np.where(no_elevation, np.nan, range_m * np.sin(elevation)),
        "vx": column["velocity"] * towards_x,
        "vy": np.where(no_azimuth, np.nan, column["velocity"] * towards_y),
        "x_std": _root_sum(
            towards_x * std["range"], np.sin(azimuth) * azimuth_m, np.cos(azimuth) * elevation_m
        ),
        "y_std": np.where(
            no_azimuth,
            np.nan,
            _root_sum(
                towards_y * std["range"], np.cos(azimuth) * azimuth_m, np.sin(azimuth) * elevation_m
            ),
        ),
        "vx_std": not_told,
        "vy_std": not_told,
        "snr": column["snr"],
        "length": extent["range"],
        "width": range_m * extent["azimuth"],
    }


def _root_sum(*terms: np.ndarray) -> np.ndarray:
    return np.sqrt(sum(term**2 for term in terms))


def _places(frame: np.ndarray) -> np.ndarray:
    """Place of each row among those of its frame."""
    order = np.argsort(frame, kind="stable")
    sorted_frame = frame[order]
    places = np.empty(len(frame), int)
    places[order] = np.arange(len(frame)) - np.searchsorted(sorted_frame, sorted_frame)
    return places


def _must_have(found: xr.Dataset, names: tuple[str, ...]) -> None:
    missing = [name for name in names if name not in found.variables]
    if missing:
        raise _not_understood(f"a dataset without {', '.join(missing)}")


def _say_untold(n_untold: int, n_rows: int, dim: str) -> None:
    if n_untold:
        finding = Finding(
            level="warning",
            setting="objects",
            got=f"{n_untold} of {n_rows} {dim}s without azimuth and elevation",
            need="one of them, to tell where they are",
            fix="Their places are NaN. Use an array that tells directions, or the detections.",
        )
        warnings.warn(PhysicsWarning(finding), stacklevel=4)


def _not_understood(got: str) -> InvalidSetting:
    return InvalidSetting(
        "found",
        got=got,
        need="tracks over track and frame, clusters over cluster, or detections over detection, "
        "with their columns",
        fix="Give what the chain or the tracker returned.",
    )
