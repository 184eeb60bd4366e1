"""Detections and the tables beside them as messages of ROS 2, a cloud of points for each frame.

| topic | type | what |
|---|---|---|
| `/radar/description` | String | radar and names of all columns: `formats.description` |
| `/radar/detections` | PointCloud2 | one for each frame, also where it is empty |
| `/radar/truth` and others | PointCloud2 | the same, of tables that have ranges in frames |
| `/radar/truth/target` and others | MultiArray | what is no column of points |

Points have x, y, z (float32, m; x forward, y left, z up: REP 103) and the columns of the table
under their own names, in SI units, radians and ratios; `velocity` is along the line of sight,
receding positive. `intensity` is the signal-to-noise ratio in dB, which viewers look for. Points
without a direction have no place: x, y and z are NaN. Where one angle is known alone, the other
is taken as 0.

Time zero of the recording is that of ROS: when it was recorded is not known.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import xarray as xr

from dechirp.core.errors import DechirpError, Mistake
from dechirp.core.units import decibels
from dechirp.exchange.ros_messages import (
    FIELD_CODES,
    array_message,
    cloud_message,
    text_message,
)
from dechirp.exchange.said import must_be_of, said_of
from dechirp.exchange.writers.base import Progress
from dechirp.formats.arrays.json_columns import NUMBERS
from dechirp.formats.messages.kept import DESCRIPTION, ROOT
from dechirp.formats.messages.ours import DETECTIONS
from dechirp.formats.messages.ros import NANO, Message
from dechirp.formats.recording import Recording

KEEPS = "detections and tables, no samples"
_PLACES = ("x", "y", "z", "intensity")
_LARGEST = 2**53  # whole numbers up to this are float64s


def must_have_detections(recording: Recording) -> None:
    """Raise `DechirpError` unless there are detections in order of frames, and a radar."""
    recording.radar  # noqa: B018  times of empty frames are the radar's; raises without one
    tables = tables_of(recording)
    if DETECTIONS not in tables:
        raise _refused(
            recording,
            got="without detections",
            need="a recording with detections: clouds of points hold no samples",
            fix="Run it first: dechirp run IN --out FOLDER; then: dechirp convert FOLDER OUT.",
        )
    detections = tables[DETECTIONS]
    in_rows = "range" in detections and detections["range"].dims == ("detection",)
    if not in_rows or _parts(detections, recording.n_frames) is None:
        raise _refused(
            recording,
            got="with detections that are no rows of one axis, or out of the order of its frames",
            need="with detections over `detection`, their `frame` ascending from 0",
            fix="Sort them: detections.sortby('frame').",
        )
    must_be_of(NUMBERS, tables)
    said_of(recording, None, tables)


def tables_of(recording: Recording) -> dict[str, xr.Dataset]:
    """All tables; detections that the radar made itself are among them."""
    points = recording.points
    own = {} if points is None else {DETECTIONS: points}
    return {**own, **recording.tables}


def messages(recording: Recording, progress: Progress | None = None) -> Iterator[Message]:
    """All messages of a recording that was checked, in the order of their times."""
    tables, n_frames = tables_of(recording), recording.n_frames
    description, columns = said_of(recording, None, tables)
    said = dict(description.tables)
    clouds: dict[str, list[np.ndarray]] = {}
    arrays: dict[str, np.ndarray] = {}
    for name, table in tables.items():
        parts = _parts(table, n_frames)
        fields = {} if parts is None else _places(table)
        for column, values in columns[name].items():
            said[name]["variables"][column]["dtype"] = values.dtype.str
            field = None if parts is None else _field(table, column, values)
            if field is None:
                arrays[f"{ROOT}/{name}/{column}"] = values
            else:
                fields[column] = field
        if parts is not None:
            points = _points(fields, table["range"].shape)
            clouds[f"{ROOT}/{name}"] = [points[part] for part in parts]
    yield text_message(DESCRIPTION, replace(description, tables=said).text)
    for topic, values in arrays.items():
        yield array_message(topic, values)
    for frame, time_ns in enumerate(_times_ns(recording, tables[DETECTIONS])):
        for topic, of_frames in clouds.items():
            yield cloud_message(topic, time_ns, of_frames[frame])
        if progress is not None:
            progress(frame + 1, n_frames)


def _parts(table: xr.Dataset, n_frames: int) -> list[Any] | None:
    """Where the rows of each frame lie; None for a table without ranges in these frames.

    One number a frame is no row of points: such a table is kept as arrays.
    """
    if "range" not in table or "frame" not in table.variables:
        return None
    over = table["range"].dims
    if "frame" in over:
        whole = [slice(None)] * len(over)
        place = over.index("frame")
        if len(over) == 1 or table.sizes["frame"] != n_frames:
            return None
        return [(*whole[:place], i, *whole[place + 1 :]) for i in range(n_frames)]
    numbers = table["frame"].values
    if table["frame"].dims != over or len(over) != 1 or numbers.dtype.kind not in "iuf":
        return None
    ends = np.searchsorted(numbers, np.arange(n_frames + 1))
    if (np.diff(numbers) < 0).any() or ends[0] or ends[-1] != len(numbers):
        return None
    return [slice(*part) for part in pairwise(ends)]


def _field(table: xr.Dataset, column: str, values: np.ndarray) -> np.ndarray | None:
    """A column as numbers of a type that points have; None where it is none of theirs."""
    over = table["range"].dims
    if table.variables[column].dims != over or 0 in values.shape[len(over) :]:
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
    return values.astype("f8") if low >= -_LARGEST and high <= _LARGEST else None


def _places(table: xr.Dataset) -> dict[str, np.ndarray]:
    """Fields that viewers look for, of the shape of the ranges."""

    def column(name: str) -> np.ndarray:
        if name not in table:
            return np.full(table["range"].shape, np.nan)
        return np.asarray(table[name].transpose(*table["range"].dims).values, dtype=float)

    range_m, azimuth, elevation = map(column, ("range", "azimuth", "elevation"))
    # One angle alone tells a cone; the target is taken to lie on the level of the line.
    nowhere = np.isnan(azimuth) & np.isnan(elevation)
    azimuth, elevation = np.nan_to_num(azimuth), np.nan_to_num(elevation)
    range_m = np.where(nowhere, np.nan, range_m)
    ground = range_m * np.cos(elevation)
    with np.errstate(divide="ignore", invalid="ignore"):  # no signal at all is minus infinity
        intensity = decibels(column("snr"))
    places = (ground * np.cos(azimuth), ground * np.sin(azimuth), range_m * np.sin(elevation))
    values = (*places, intensity)
    return {name: one.astype("f4") for name, one in zip(_PLACES, values, strict=True)}


def _points(fields: dict[str, np.ndarray], shape: tuple[int, ...]) -> np.ndarray:
    """Columns as the fields of points, of the shape of the ranges; texts have one more axis."""
    kinds = [
        (name, values.dtype.newbyteorder("<"), values.shape[len(shape) :])
        for name, values in fields.items()
    ]
    points = np.zeros(shape, np.dtype(kinds))
    for name, values in fields.items():
        points[name] = values
    return points


def _times_ns(recording: Recording, detections: xr.Dataset) -> list[int]:
    """Time of each frame: of its detections, else the middle of the frame; never going back."""
    frame = recording.radar.frame
    numbers = range(recording.n_frames)
    times_s = np.array([frame.start_s(i) + frame.at(i).mid_frame_s for i in numbers])
    if "time" in detections:
        told = detections["time"].values
        known = np.isfinite(told)
        times_s[detections["frame"].values[known].astype(int)] = told[known]
    ascending_s = np.maximum.accumulate(np.maximum(times_s, 0.0))
    return np.rint(ascending_s * NANO).astype(np.int64).tolist()


def _refused(recording: Recording, *, got: str, need: str, fix: str) -> DechirpError:
    return DechirpError(Mistake(setting=str(recording.path), got=got, need=need, fix=fix))
