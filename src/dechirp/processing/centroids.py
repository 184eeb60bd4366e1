"""Centroids of clusters: weighted means in one velocity span, standard errors, extents."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.detection_columns import TABLE, standard_error_column, zero_where_unknown
from dechirp.radar.radar import Radar
from dechirp.radar.resolution_cells import to_resolution_cells
from dechirp.radar.velocity_ambiguity import (
    UNAMBIGUOUS,
    n_spans_until_aliasing,
    range_shift_per_ambiguity_m,
    unambiguous_velocity_span_m_per_s,
)


class DetectionCells(NamedTuple):
    """Detections in resolution cells, and their velocity ambiguity; each by its own frame."""

    cells: np.ndarray
    """(n, 4), see `radar.resolution_cells`."""
    n_spans: np.ndarray
    """Unambiguous spans after which the velocity repeats, (n,)."""
    span_m_per_s: np.ndarray
    """Unambiguous velocity span, (n,)."""
    range_shift_m: np.ndarray
    """Decrease of the range for each span added to the velocity, (n,)."""


def detections_to_resolution_cells(
    columns: Mapping[str, np.ndarray], radar: Radar
) -> DetectionCells:
    """Convert detections to resolution cells, from their columns, (n,) each."""
    numbers = columns["frame"].astype(int)
    n = numbers.size
    placed = DetectionCells(np.empty((n, 4)), np.ones(n), np.ones(n), np.zeros(n))
    # Frames with the same interval are alike.
    intervals = numbers % radar.frame.n_intervals
    for interval in np.unique(intervals).tolist():
        in_interval, frame_radar = intervals == interval, radar.for_frame(interval)
        range_m, velocity, azimuth, elevation, ambiguity_number = (
            columns[name][in_interval]
            for name in ("range", "velocity", "azimuth", "elevation", "ambiguity_number")
        )
        placed.cells[in_interval] = to_resolution_cells(
            range_m, velocity, azimuth, elevation, frame_radar
        )
        placed.n_spans[in_interval] = n_spans_until_aliasing(
            ambiguity_number, radar.frame, interval
        )
        placed.span_m_per_s[in_interval] = unambiguous_velocity_span_m_per_s(
            range_m, frame_radar.frame
        )
        placed.range_shift_m[in_interval] = range_shift_per_ambiguity_m(frame_radar.frame)
    return placed


def cluster_centroids(
    columns: Mapping[str, np.ndarray],
    detection_cells: DetectionCells,
    label: np.ndarray,
    n_chirps: int,
) -> xr.Dataset:
    """Average the detections of each label except -1 by the rules of `core.detection_columns`.

    See `cluster` for the columns.
    """
    members = np.flatnonzero(label >= 0)
    members = members[np.argsort(label[members], kind="stable")]
    label, detection_cells = (
        label[members],
        DetectionCells(*(column[members] for column in detection_cells)),
    )
    member_columns = {name: column[members] for name, column in columns.items()}
    first = np.flatnonzero(np.diff(label, prepend=-1))  # each cluster is a run now
    weight = _snr_or_equal_cluster_weights(member_columns["snr"], label)
    strongest = _strongest_member_index_per_cluster(member_columns, weight, first)
    n_added = _velocity_spans_to_add(
        member_columns, detection_cells, weight, first, strongest, n_chirps
    )
    member_columns["range"] = member_columns["range"] - n_added * detection_cells.range_shift_m
    member_columns["velocity"] = member_columns["velocity"] + n_added * detection_cells.span_m_per_s
    averages: dict[str, tuple[np.ndarray, str]] = {}
    for column in TABLE:
        name, unit, std = column.name, column.unit, standard_error_column(column)
        if column.cluster == "first":
            averages[name] = member_columns[name][first], unit
        elif column.cluster == "mean":
            error = member_columns[name] * np.nan if std is None else member_columns[std.name]
            mean, mean_error = _weighted_mean_and_error(member_columns[name], error, weight, label)
            averages[name] = mean, unit
            if std is not None:
                averages[std.name] = mean_error, unit
        elif column.cluster == "sum":
            averages[name] = np.bincount(label, member_columns[name]), unit
    averages["frame"] = averages["frame"][0].astype(np.int64), "1"
    for column in TABLE:
        if column.has_extent:
            averages[f"{column.name}_extent"] = (
                _value_extent_per_cluster(member_columns[column.name], first),
                column.unit,
            )
    for column in TABLE:
        if column.cluster == "strongest":
            averages[column.name] = member_columns[column.name][strongest], column.unit
    averages["n_detections"] = np.bincount(label), "1"
    return xr.Dataset(
        {name: ("cluster", values, {"units": unit}) for name, (values, unit) in averages.items()}
    )


def _snr_or_equal_cluster_weights(snr: np.ndarray, label: np.ndarray) -> np.ndarray:
    """Return the power ratios; equal weights in a cluster with an unknown ratio or none above 0."""
    total = np.bincount(label, snr)[label]
    return np.where(total > 0, snr, 1.0)  # NaN is not above 0


def _strongest_member_index_per_cluster(
    member_columns: Mapping[str, np.ndarray], weight: np.ndarray, cluster_starts: np.ndarray
) -> np.ndarray:
    """Find the strongest detection of each cluster; one with known ambiguity number goes first."""
    sizes = np.diff(cluster_starts, append=weight.size)
    label = np.repeat(np.arange(cluster_starts.size), sizes)
    is_known = np.isfinite(member_columns["ambiguity_number"])
    return np.asarray(np.lexsort((weight, is_known, label))[np.cumsum(sizes) - 1])


def _velocity_spans_to_add(
    member_columns: Mapping[str, np.ndarray],
    detection_cells: DetectionCells,
    weight: np.ndarray,
    cluster_starts: np.ndarray,
    strongest: np.ndarray,
    n_chirps: int,
) -> np.ndarray:
    """Return the velocity spans to add to each detection, (n,).

    Every detection moves to the span nearest to the strongest one with a known ambiguity number.
    In clusters without any, the mean then moves into the span about zero.
    """
    sizes = np.diff(cluster_starts, append=weight.size)
    label = np.repeat(np.arange(cluster_starts.size), sizes)
    doppler = zero_where_unknown(detection_cells.cells[:, 1])
    is_known = np.isfinite(member_columns["ambiguity_number"])
    is_ambiguous = detection_cells.n_spans < UNAMBIGUOUS
    added = np.where(is_ambiguous, np.rint((doppler[strongest][label] - doppler) / n_chirps), 0.0)
    mean = np.bincount(label, weight * (doppler + n_chirps * added)) / np.bincount(label, weight)
    to_zero = is_ambiguous & ~is_known[strongest][label]
    return np.asarray(added - np.where(to_zero, np.rint(mean / n_chirps)[label], 0.0))


def _weighted_mean_and_error(
    values: np.ndarray, error: np.ndarray, weight: np.ndarray, label: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return weighted means of known values and their standard errors, (n_clusters,); else NaN."""
    weight = np.where(np.isnan(values), 0.0, weight)
    total = np.bincount(label, weight)
    total = np.where(total > 0, total, np.nan)
    mean = np.bincount(label, weight * zero_where_unknown(values)) / total
    variance = np.bincount(label, np.where(weight > 0, weight * error, 0.0) ** 2)
    return mean, np.sqrt(variance) / total


def _value_extent_per_cluster(values: np.ndarray, cluster_starts: np.ndarray) -> np.ndarray:
    """Return the largest less the smallest known value of each run; NaN where none is known."""
    if not cluster_starts.size:  # there are no runs to reduce
        return np.empty(0)
    return np.fmax.reduceat(values, cluster_starts) - np.fmin.reduceat(values, cluster_starts)
