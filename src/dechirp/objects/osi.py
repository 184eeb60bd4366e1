"""Object lists as ASAM OSI 3: a trace of `SensorData`, one message for each cycle.

Tracks are `DetectedMovingObject`s, in Cartesian coordinates of the radar, which are those of OSI:
x forward, y left, z up. Rows of status "detection" are told twice: as `RadarDetection`s, whose
spherical words receivers of radar data look for, and as `LogicalDetection`s, which keep x, y
and their errors as they are. In a `RadarDetection` the radial velocity grows towards the
sensor, and elevation downwards, as the rotation about y is right-handed: both the other way
round than here.

| | of a track | of a detection |
|---|---|---|
| number | `tracking_id` | its place: `object_id` would name a track |
| status | `existence_probability`, 1 confirmed, 0.5 tentative: OSI has no word | the message |
| snr | not told: OSI has no field | `snr`, dB |
| length, width | `dimension` | not told: OSI has no field |

OSI has standard errors and no covariances. What is not told is not set. The radar is mounted at
the origin of the vehicle's coordinates: where it really is, is not known here.

References
----------
ASAM OSI 3.8, osi_sensordata.proto, osi_detectedobject.proto, osi_featuredata.proto; trace files
(.osi): each message follows its length, four bytes, little-endian.
"""

import struct
from collections.abc import Iterator
from itertools import pairwise
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from dechirp.core.errors import RecordingError
from dechirp.core.extra import library
from dechirp.core.units import decibels, from_decibels
from dechirp.objects.priority import in_order
from dechirp.objects.rows import MEASURED, cycle_of, made, must_be_objects
from dechirp.objects.whole import named, whole_file

_EXISTENCE = {"confirmed": 1.0, "tentative": 0.5}
SUFFIXES = (".osi",)

_NANO = 10**9
_LENGTH = struct.Struct("<I")

_MOVING = {
    "x": "base.position.x",
    "y": "base.position.y",
    "z": "base.position.z",
    "vx": "base.velocity.x",
    "vy": "base.velocity.y",
    "x_std": "base_rmse.position.x",
    "y_std": "base_rmse.position.y",
    "vx_std": "base_rmse.velocity.x",
    "vy_std": "base_rmse.velocity.y",
    "length": "base.dimension.length",
    "width": "base.dimension.width",
}
_LOGICAL = {
    "x": "position.x",
    "y": "position.y",
    "z": "position.z",
    "vx": "velocity.x",
    "vy": "velocity.y",
    "x_std": "position_rmse.x",
    "y_std": "position_rmse.y",
    "vx_std": "velocity_rmse.x",
    "vy_std": "velocity_rmse.y",
}


def write_osi(objects: xr.Dataset, path: str | Path) -> None:
    """Write an object list as an OSI trace, whole or not at all.

    Raises
    ------
    InvalidSetting
        If it is no object list, the path cannot be written, or the extra `io` is missing.
    """
    place = named(path, SUFFIXES)
    traced = list(messages(objects))
    with whole_file(place) as made, made.open("wb") as trace:
        for message in traced:
            content = message.SerializeToString()
            trace.write(_LENGTH.pack(len(content)) + content)


def messages(objects: xr.Dataset) -> Iterator[Any]:
    """`osi3` messages of type `SensorData` of an object list, one for each cycle."""
    objects = must_be_objects(objects)
    sensor_data = library("osi3.osi_sensordata_pb2").SensorData
    ends = np.searchsorted(cycle_of(objects), np.arange(objects.sizes["cycle"] + 1))
    rows = _rows(objects)
    for cycle, (start, end) in enumerate(pairwise(ends)):
        frame = int(objects["cycle_frame"].values[cycle])
        message = sensor_data()
        _set_head(message, frame, float(objects["cycle_time"].values[cycle]))
        own = rows[start:end]
        for row in own:
            if row["status"] != "detection":
                _add_moving(message.moving_object.add(), row)
        # Their numbers are told by their order.
        for row in sorted(own, key=itemgetter("number")):
            if row["status"] == "detection":
                _add_detection(message, row)
        yield message


def read_osi(path: str | Path) -> xr.Dataset:
    """Read the object list in an OSI trace of `SensorData`, the most important objects first.

    Detections that are only told as `RadarDetection`s become rows without standard errors of x
    and y, whose velocity is the radial one along the line of sight.

    Raises
    ------
    RecordingError
        If it cannot be read, is cut off, or holds something else.
    InvalidSetting
        If time goes backwards, or the extra `io` is missing.
    """
    path = named(path, SUFFIXES)
    rows: list[dict[str, Any]] = []
    frames: list[int] = []
    times_s: list[float] = []
    for place, message in enumerate(_traced(path)):
        times_s.append(message.timestamp.seconds + message.timestamp.nanos / _NANO)
        head = message.moving_object_header
        frames.append(head.cycle_counter if head.HasField("cycle_counter") else place)
        own = [*_moving(message), *_detections(message)]
        rows += [{**row, "frame": frames[-1], "time": times_s[-1]} for row in own]
    columns = {
        name: np.array([row[name] for row in rows], float) for name in (*MEASURED, "frame", "time")
    }
    columns["number"] = np.array([row["number"] for row in rows], float)
    columns["status"] = np.array([row["status"] for row in rows], "U9")
    # Detections are told in the order of their numbers.
    return in_order(must_be_objects(made(columns, np.array(frames, float), np.array(times_s))))


def _set_head(message: Any, frame: int, time_s: float) -> None:
    version = library("osi3.osi_version_pb2")
    options = version.DESCRIPTOR.GetOptions()
    message.version.CopyFrom(options.Extensions[version.current_interface_version])
    message.sensor_id.value = 0
    for moment in (message.timestamp, message.last_measurement_time):
        moment.seconds, moment.nanos = divmod(round(time_s * _NANO), _NANO)
    radar = message.feature_data.radar_sensor.add()
    for mounting in (message.mounting_position, radar.header.mounting_position):
        for field in ("position.x", "position.y", "position.z"):
            _set(mounting, field, 0.0)
        for field in ("orientation.roll", "orientation.pitch", "orientation.yaw"):
            _set(mounting, field, 0.0)
    message.moving_object_header.cycle_counter = frame
    message.moving_object_header.measurement_time.CopyFrom(message.timestamp)
    radar.header.cycle_counter = frame
    radar.header.sensor_id.value = 0
    radar.header.measurement_time.CopyFrom(message.timestamp)
    message.logical_detection_data.version.CopyFrom(message.version)
    message.logical_detection_data.header.logical_detection_time.CopyFrom(message.timestamp)


def _rows(objects: xr.Dataset) -> list[dict[str, Any]]:
    columns = {name: objects[name].values.tolist() for name in (*MEASURED, "number", "status")}
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def _add_moving(one: Any, row: dict[str, Any]) -> None:
    one.header.tracking_id.value = row["number"]
    one.header.existence_probability = _EXISTENCE[row["status"]]
    one.header.sensor_id.add().value = 0
    for name, field in _MOVING.items():
        _set(one, field, row[name])


def _add_detection(message: Any, row: dict[str, Any]) -> None:
    logical = message.logical_detection_data.logical_detection.add()
    for name, field in _LOGICAL.items():
        _set(logical, field, row[name])
    with np.errstate(divide="ignore"):  # no signal at all is minus infinity
        snr_db = float(decibels(row["snr"]))
    _set(logical, "snr", snr_db)
    x, y, z = row["x"], row["y"], row["z"]
    height = 0.0 if np.isnan(z) else z
    aside = 0.0 if np.isnan(y) else y
    if np.isnan(x):
        return
    across = np.hypot(x, aside)
    range_m = float(np.hypot(across, height))
    radar = message.feature_data.radar_sensor[0].detection.add()
    _set(radar, "snr", snr_db)
    _set(radar, "position.distance", range_m)
    _set(radar, "position.azimuth", float(np.arctan2(y, x)))
    _set(radar, "position.elevation", -float(np.arctan2(z, across)))
    towards = (x * row["vx"] + aside * np.nan_to_num(row["vy"])) / max(across, 1e-9)
    # vx and vy are what the radial velocity leaves on the level.
    _set(radar, "radial_velocity", -towards * range_m / max(across, 1e-9))


def _moving(message: Any) -> Iterator[dict[str, Any]]:
    for one in message.moving_object:
        confirmed = one.header.existence_probability > _EXISTENCE["tentative"]
        yield {
            **dict.fromkeys(MEASURED, np.nan),
            **{name: _get(one, field) for name, field in _MOVING.items()},
            "number": one.header.tracking_id.value,
            "status": "confirmed" if confirmed else "tentative",
        }


def _detections(message: Any) -> Iterator[dict[str, Any]]:
    row = {**dict.fromkeys(MEASURED, np.nan), "status": "detection"}
    rows = [_of_logical(one) for one in message.logical_detection_data.logical_detection]
    if not rows:
        radars = message.feature_data.radar_sensor
        rows = [_of_spherical(one) for radar in radars for one in radar.detection]
    for place, own in enumerate(rows):
        yield {**row, **own, "number": place}


def _of_logical(one: Any) -> dict[str, float]:
    own = {name: _get(one, field) for name, field in _LOGICAL.items()}
    return {**own, "snr": float(from_decibels(_get(one, "snr")))}


def _of_spherical(one: Any) -> dict[str, float]:
    range_m, away = _get(one, "position.distance"), -_get(one, "radial_velocity")
    azimuth, elevation = _get(one, "position.azimuth"), -_get(one, "position.elevation")
    level = np.cos(np.nan_to_num(elevation))
    forward, left = level * np.cos(azimuth), level * np.sin(azimuth)
    return {
        "x": range_m * forward,
        "y": range_m * left,
        "z": range_m * np.sin(elevation),
        "vx": away * forward,
        "vy": away * left,
        "snr": float(from_decibels(_get(one, "snr"))),
    }


def _set(message: Any, field: str, number: float) -> None:
    """Set a field within fields, unless its value is not told."""
    *path, name = field.split(".")
    if not np.isnan(number):
        for step in path:
            message = getattr(message, step)
        setattr(message, name, number)


def _get(message: Any, field: str) -> float:
    """Value of a field within fields, NaN where it is not set."""
    *path, name = field.split(".")
    for step in path:
        message = getattr(message, step)
    return float(getattr(message, name)) if message.HasField(name) else float("nan")


def _traced(path: Path) -> Iterator[Any]:
    """Messages of a trace."""
    sensor_data = library("osi3.osi_sensordata_pb2").SensorData
    unparsable = library("google.protobuf.message").DecodeError
    need, fix = "a trace of SensorData, whole", "Write it again, or give the file that is one."
    try:
        content = path.read_bytes()
    except OSError as error:
        raise RecordingError(path, got=error.strerror or error, need=need, fix=fix) from None
    at = 0
    while at < len(content):
        start = at + _LENGTH.size
        end = start + (_LENGTH.unpack_from(content, at)[0] if start <= len(content) else 0)
        if not start <= end <= len(content):
            got = f"cut off: {len(content) - at} bytes at {at}, where a message begins"
            raise RecordingError(path, got=got, need=need, fix=fix)
        try:
            message = sensor_data.FromString(content[start:end])
        except unparsable:
            got = f"something else at byte {start}"
            raise RecordingError(path, got=got, need=need, fix=fix) from None
        yield message
        at = end
