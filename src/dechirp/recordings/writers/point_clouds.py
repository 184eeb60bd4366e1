"""ROS 2 messages of detections and tables, one point cloud for each frame.

| topic | type | content |
|---|---|---|
| `/radar/description` | String | radar and names of all columns: `recordings.description` |
| `/radar/detections` | PointCloud2 | one for each frame, also where it is empty |
| `/radar/truth` and others | PointCloud2 | likewise for tables with ranges in frames |
| `/radar/truth/target` and others | MultiArray | other columns |
| `/radar/radar_scan` | radar_msgs/RadarScan | the detections, for programs that read these |
| `/radar/radar_tracks` | radar_msgs/RadarTracks | the tracks, if there are any |

Points have x, y, z (float32, m; x forward, y left, z up: REP 103) and the columns of the table
under their own names, in SI units, radians and ratios; `velocity` is along the line of sight,
receding positive. `intensity` is the signal-to-noise ratio in dB, which viewers display. Points
without a direction have no position: x, y and z are NaN. If only one angle is known, the other
counts as 0.

Time zero of the recording is that of ROS, since the time of recording is unknown.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import xarray as xr

from dechirp.core.errors import DechirpError, Mistake
from dechirp.core.mcap_messages import Message
from dechirp.core.units import to_decibels
from dechirp.recordings.arrays.json_columns import NUMBERS
from dechirp.recordings.messages.message_arrays import DESCRIPTION, ROOT
from dechirp.recordings.messages.native_tables import DETECTIONS
from dechirp.recordings.messages.ros import NANO
from dechirp.recordings.recording import Recording
from dechirp.recordings.writers.base import Progress
from dechirp.recordings.writers.description_text import (
    check_column_types,
    recording_description_and_columns,
)
from dechirp.recordings.writers.ros_messages import (
    FIELD_CODES,
    build_array_message,
    build_cloud_message,
    build_scan_message,
    build_text_message,
    build_tracks_message,
)

SUMMARY = "detections and tables, no samples"
_POSITION_FIELDS = ("x", "y", "z", "intensity")
_STATE = ("x", "y", "vx", "vy")
TRACKS_TABLE = "tracks"
SCAN_TOPIC, TRACKS_TOPIC = f"{ROOT}/radar_scan", f"{ROOT}/radar_tracks"
_MAX_EXACT_INTEGER = 2**53  # largest integer range of float64


def check_has_detections(recording: Recording) -> None:
    """Raise `DechirpError` unless there are detections in order of frames, and a radar."""
    recording.radar  # noqa: B018  times of empty frames are the radar's; raises without one
    tables = tables_with_detections(recording)
    if DETECTIONS not in tables:
        raise _recording_error(
            recording,
            value="without detections",
            expected="a recording with detections, since point clouds contain no samples",
            fix="run it first: dechirp run IN --out FOLDER; then: dechirp convert FOLDER OUT",
        )
    detections = tables[DETECTIONS]
    has_rows = "range" in detections and detections["range"].dims == ("detection",)
    if not has_rows or _row_indices_by_frame(detections, recording.n_frames) is None:
        raise _recording_error(
            recording,
            value="detections that are not rows of one axis, or not in order of frames",
            expected="detections over `detection`, with `frame` ascending from 0",
            fix="sort them: detections.sortby('frame')",
        )
    check_column_types(NUMBERS, tables)
    recording_description_and_columns(recording, None, tables)


def tables_with_detections(recording: Recording) -> dict[str, xr.Dataset]:
    """Return all tables, including detections of the radar itself."""
    points = recording.points
    detections = {} if points is None else {DETECTIONS: points}
    return {**detections, **recording.tables}


def iter_ros2_messages(recording: Recording, progress: Progress | None = None) -> Iterator[Message]:
    """Yield all messages of a checked recording in order of time."""
    tables, n_frames = tables_with_detections(recording), recording.n_frames
    description, columns = recording_description_and_columns(recording, None, tables)
    structures = dict(description.tables)
    clouds: dict[str, list[np.ndarray]] = {}
    arrays: dict[str, np.ndarray] = {}
    for name, table in tables.items():
        frame_rows = _row_indices_by_frame(table, n_frames)
        fields = {} if frame_rows is None else _xyz_intensity_fields(table)
        for column, values in columns[name].items():
            structures[name]["variables"][column]["dtype"] = values.dtype.str
            field = (
                None if frame_rows is None else _cast_to_point_field_dtype(table, column, values)
            )
            if field is None:
                arrays[f"{ROOT}/{name}/{column}"] = values
            else:
                fields[column] = field
        if frame_rows is not None:
            points = _structured_points(fields, table["range"].shape)
            clouds[f"{ROOT}/{name}"] = [points[rows] for rows in frame_rows]
    yield build_text_message(DESCRIPTION, replace(description, tables=structures).json_text)
    for topic, values in arrays.items():
        yield build_array_message(topic, values)
    detections = tables[DETECTIONS]
    scan_rows = _row_indices_by_frame(detections, n_frames) or []
    scan = _scan_columns(detections)
    tracks = tables.get(TRACKS_TABLE)
    for frame, time_ns in enumerate(_frame_times_ns(recording, detections)):
        for topic, frame_points in clouds.items():
            yield build_cloud_message(topic, time_ns, frame_points[frame])
        frame_scan = {name: column[scan_rows[frame]] for name, column in scan.items()}
        yield build_scan_message(SCAN_TOPIC, time_ns, frame_scan)
        if tracks is not None and _has_track_states(tracks, n_frames):
            numbers, states, covariances = _tracks_of_frame(tracks, frame)
            yield build_tracks_message(TRACKS_TOPIC, time_ns, numbers, states, covariances)
        if progress is not None:
            progress(frame + 1, n_frames)


def _scan_columns(detections: xr.Dataset) -> dict[str, np.ndarray]:
    """Return range, azimuth, elevation, velocity and snr in dB of all detections."""
    size = detections["range"].size
    columns = {
        name: np.asarray(detections[name].values, float)
        if name in detections and detections[name].dims == ("detection",)
        else np.full(size, np.nan)
        for name in ("range", "azimuth", "elevation", "velocity", "snr")
    }
    with np.errstate(divide="ignore", invalid="ignore"):  # a ratio of 0 is minus infinity
        columns["snr"] = to_decibels(columns["snr"])
    return columns


def _has_track_states(tracks: xr.Dataset, n_frames: int) -> bool:
    """Return whether a table contains tracks over these frames, as of `track`."""
    return tracks.sizes.get("frame") == n_frames and all(
        name in tracks and set(tracks[name].dims) == {"track", "frame"}
        for name in (*_STATE, "status")
    )


def _tracks_of_frame(
    tracks: xr.Dataset, frame: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Return numbers, states and covariances of the tentative and confirmed tracks of a frame."""
    now = tracks.isel(frame=frame)
    is_alive = np.isin(now["status"].values, ("tentative", "confirmed"))
    numbers = now["track"].values if "track" in now.coords else np.arange(now.sizes["track"])
    if numbers.dtype.kind not in "iu" or (numbers < 0).any():
        numbers = np.arange(now.sizes["track"])
    states = np.stack([now[name].values[is_alive].astype(float) for name in _STATE], axis=1)
    covariances = None
    if "covariance" in now and "state" in now and now["covariance"].ndim == 3:
        order = [now["state"].values.tolist().index(name) for name in _STATE]
        matrices = np.moveaxis(now["covariance"].values, now["covariance"].dims.index("track"), 0)[
            is_alive
        ]
        covariances = matrices[:, order][:, :, order]
    return numbers[is_alive], states, covariances


def _row_indices_by_frame(table: xr.Dataset, n_frames: int) -> list[Any] | None:
    """Return the index of the rows of each frame; None for a table without ranges in these frames.

    A table with one number for each frame has no rows of points and is written as arrays.
    """
    if "range" not in table or "frame" not in table.variables:
        return None
    axes = table["range"].dims
    if "frame" in axes:
        full_slices = [slice(None)] * len(axes)
        frame_axis = axes.index("frame")
        if len(axes) == 1 or table.sizes["frame"] != n_frames:
            return None
        return [
            (*full_slices[:frame_axis], i, *full_slices[frame_axis + 1 :]) for i in range(n_frames)
        ]
    numbers = table["frame"].values
    if table["frame"].dims != axes or len(axes) != 1 or numbers.dtype.kind not in "iuf":
        return None
    ends = np.searchsorted(numbers, np.arange(n_frames + 1))
    if (np.diff(numbers) < 0).any() or ends[0] or ends[-1] != len(numbers):
        return None
    return [slice(*bounds) for bounds in pairwise(ends)]


def _cast_to_point_field_dtype(
    table: xr.Dataset, column: str, values: np.ndarray
) -> np.ndarray | None:
    """Convert a column to a type that point fields have; return None if impossible."""
    axes = table["range"].dims
    if table.variables[column].dims != axes or 0 in values.shape[len(axes) :]:
        return None
    if values.dtype.kind == "b":
        return values.astype("u1")
    if values.dtype.str[1:] in FIELD_CODES:
        return values
    if values.dtype.kind not in "iu":
        return None
    low, high = values.min(initial=0), values.max(initial=0)
    if low >= -(2**31) and high < 2**31:
        return values.astype("i4")
    return (
        values.astype("f8") if low >= -_MAX_EXACT_INTEGER and high <= _MAX_EXACT_INTEGER else None
    )


def _xyz_intensity_fields(table: xr.Dataset) -> dict[str, np.ndarray]:
    """Return the fields that viewers expect, in the shape of the ranges."""

    def column(name: str) -> np.ndarray:
        if name not in table:
            return np.full(table["range"].shape, np.nan)
        return np.asarray(table[name].transpose(*table["range"].dims).values, dtype=float)

    range_m, azimuth, elevation = map(column, ("range", "azimuth", "elevation"))
    # One angle defines a cone; the target is assumed to lie in the plane of the array.
    is_undirected = np.isnan(azimuth) & np.isnan(elevation)
    azimuth, elevation = np.nan_to_num(azimuth), np.nan_to_num(elevation)
    range_m = np.where(is_undirected, np.nan, range_m)
    ground_range = range_m * np.cos(elevation)
    with np.errstate(divide="ignore", invalid="ignore"):  # a ratio of 0 is minus infinity
        intensity = to_decibels(column("snr"))
    positions = (
        ground_range * np.cos(azimuth),
        ground_range * np.sin(azimuth),
        range_m * np.sin(elevation),
    )
    values = (*positions, intensity)
    return {
        name: column_values.astype("f4")
        for name, column_values in zip(_POSITION_FIELDS, values, strict=True)
    }


def _structured_points(fields: dict[str, np.ndarray], shape: tuple[int, ...]) -> np.ndarray:
    """Combine columns into structured points in the shape of the ranges.

    Texts have a further axis.
    """
    field_types = [
        (name, values.dtype.newbyteorder("<"), values.shape[len(shape) :])
        for name, values in fields.items()
    ]
    points = np.zeros(shape, np.dtype(field_types))
    for name, values in fields.items():
        points[name] = values
    return points


def _frame_times_ns(recording: Recording, detections: xr.Dataset) -> list[int]:
    """Return the time of each frame, ascending: of its detections, else its middle."""
    frame = recording.radar.frame
    numbers = range(recording.n_frames)
    times_s = np.array([frame.frame_start_s(i) + frame.for_frame(i).mid_frame_s for i in numbers])
    if "time" in detections:
        detection_times_s = detections["time"].values
        is_known = np.isfinite(detection_times_s)
        times_s[detections["frame"].values[is_known].astype(int)] = detection_times_s[is_known]
    ascending_s = np.maximum.accumulate(np.maximum(times_s, 0.0))
    return np.rint(ascending_s * NANO).astype(np.int64).tolist()


def _recording_error(recording: Recording, *, value: str, expected: str, fix: str) -> DechirpError:
    return DechirpError(
        Mistake(setting=str(recording.path), value=value, expected=expected, fix=fix)
    )
