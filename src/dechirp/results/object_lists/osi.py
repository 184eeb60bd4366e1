"""Object lists as ASAM OSI 3 messages: one `SensorData` for each cycle, in traces or datagrams.

Tracks are `DetectedMovingObject`s, in Cartesian coordinates of the radar, which are those of OSI: x
forward, y left, z up. Rows of status "detection" are written twice: as `RadarDetection`s, in the
spherical coordinates that radar receivers expect, and as `LogicalDetection`s, which contain x, y
and their errors. In a `RadarDetection` the radial velocity grows towards the sensor, and elevation
downwards, since the rotation about y is right-handed: both signs are opposite to those here.

| | of a track | of a detection |
|---|---|---|
| number | `tracking_id` | its index: `object_id` identifies tracks |
| status | `existence_probability`, 1 confirmed, 0.5 tentative: OSI has no field | the message |
| snr | not written: OSI has no field | `snr`, dB |
| length, width | `dimension` | not written: OSI has no field |

OSI has standard errors and no covariances. Unknown values are not set. The mounting position is
the origin of the vehicle, since the real one is unknown.

References
----------
ASAM OSI 3.8, osi_sensordata.proto, osi_detectedobject.proto, osi_featuredata.proto; trace files
(.osi): each message follows its length, four bytes, little-endian.
"""

import struct
from collections.abc import Iterator, Sequence
from itertools import pairwise
from operator import itemgetter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.atomic_files import atomic_output_file, check_file_suffix
from dechirp.core.display import format_count_with_noun
from dechirp.core.errors import RecordingError
from dechirp.core.optional_imports import import_from_extra
from dechirp.core.units import from_decibels, to_decibels
from dechirp.results.object_lists.list_columns import (
    MEASURED,
    build_object_list,
    check_object_list,
    cycle_indices,
    warn_lost_messages,
)
from dechirp.results.object_lists.priority import sort_by_priority

_EXISTENCE_PROBABILITY = {"confirmed": 1.0, "tentative": 0.5}
SUFFIXES = (".osi",)

_NANO = 10**9
_LENGTH_PREFIX = struct.Struct("<I")

_MOVING_OBJECT_FIELDS = {
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
_LOGICAL_DETECTION_FIELDS = {
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

_EMPTY_COLUMNS: dict[str, np.ndarray] = {
    **{name: np.array([], float) for name in (*MEASURED, "number")},
    "status": np.array([], "U9"),
}
_OBJECT_FIELDS = {"moving_object", "moving_object_header", "logical_detection_data"}
NO_OBJECT_LIST = "without moving objects or radar detections"
SECOND_OF_CYCLE = "without objects at the time of another message"


def write_osi(objects: xr.Dataset, path: str | Path) -> None:
    """Write an object list as an OSI trace, atomically.

    Raises
    ------
    InvalidSetting
        If it is not an object list, the path cannot be written, or the extra `io` is missing.
    """
    trace_path = check_file_suffix(path, SUFFIXES)
    osi_trace_messages = list(osi_messages(objects))
    with atomic_output_file(trace_path) as temporary, temporary.open("wb") as trace:
        for message in osi_trace_messages:
            content = message.SerializeToString()
            trace.write(_LENGTH_PREFIX.pack(len(content)) + content)


def osi_messages(objects: xr.Dataset, sensor_id: int = 0) -> Iterator[Any]:
    """Yield an `osi3` message of type `SensorData` for each cycle of an object list."""
    objects = check_object_list(objects)
    sensor_data = import_from_extra("io", "osi3.osi_sensordata_pb2").SensorData
    ends = np.searchsorted(cycle_indices(objects), np.arange(objects.sizes["cycle"] + 1))
    rows = _objects_as_rows(objects)
    for cycle, (start, end) in enumerate(pairwise(ends)):
        frame = int(objects["cycle_frame"].values[cycle])
        message = sensor_data()
        time_s = float(objects["cycle_time"].values[cycle])
        _set_sensor_data_header(message, frame, time_s, sensor_id)
        cycle_rows = rows[start:end]
        for row in cycle_rows:
            if row["status"] != "detection":
                _add_moving_object(message.moving_object.add(), row, sensor_id)
        # The order of detections encodes their numbers.
        for row in sorted(cycle_rows, key=itemgetter("number")):
            if row["status"] == "detection":
                _add_detection(message, row)
        yield message


def read_osi(path: str | Path) -> xr.Dataset:
    """Read the object list in an OSI trace of `SensorData`, the most important objects first.

    Detections that are only given as `RadarDetection`s become rows without standard errors of x and
    y, whose velocity is the radial one along the line of sight.

    Raises
    ------
    RecordingError
        If it cannot be read, is truncated, or contains other messages or several sensors.
    InvalidSetting
        If time decreases, or the extra `io` is missing.

    Warns
    -----
    PhysicsWarning
        If messages are of sensors without object lists, such as lidars, or a cycle has several.
    """
    trace_path = check_file_suffix(path, SUFFIXES)
    messages = [decode_message(message) for message in _iter_trace_messages(trace_path)]
    senders, n_without_list = find_list_senders(messages)
    sensor_ids = sorted(senders or {decoded.sensor_id for decoded in messages})
    if len(sensor_ids) > 1:
        without_list = f" {NO_OBJECT_LIST}" if not senders else ""
        raise RecordingError(
            trace_path,
            value=f"{format_count_with_noun(len(messages), 'message')}{without_list} of sensors"
            f" {', '.join(map(str, sensor_ids))}",
            expected="object lists of one sensor_id in a trace",
            fix="write a trace for each sensor",
        )
    of_sender = [decoded for decoded in messages if decoded.sensor_id in senders]
    lists: list[DecodedMessage] = []
    for decoded in unset_constant_counters(of_sender):
        if lists and (merged := merge_cycle_messages(lists[-1], decoded)):
            lists[-1] = merged
        else:
            lists.append(decoded)
    warn_lost_messages(
        {NO_OBJECT_LIST: n_without_list, SECOND_OF_CYCLE: len(of_sender) - len(lists)},
        remaining=f"{format_count_with_noun(len(lists), 'list')} read",
        expected="object lists of a radar",
        fix="ignore this where the road was free, or the trace contains other sensors or features",
        stacklevel=5,
    )
    return build_decoded_lists(lists)


class DecodedMessage(NamedTuple):
    """Object list of one `SensorData` message."""

    sensor_id: int
    has_list: bool
    """Whether it has the fields of an object list, which may be empty."""
    time_s: float
    frame: int | None
    """Its `cycle_counter`; None if it is not set."""
    columns: dict[str, np.ndarray]
    """Measured columns, number and status of its objects."""


def decode_message(message: Any) -> DecodedMessage:
    """Decode the object list of a `SensorData` message."""
    rows = [*_read_moving_objects(message), *_read_detections(message)]
    header = message.moving_object_header
    return DecodedMessage(
        int(message.sensor_id.value),
        _has_object_list(message),
        (message.timestamp.seconds * _NANO + message.timestamp.nanos) / _NANO,
        int(header.cycle_counter) if header.HasField("cycle_counter") else None,
        {
            **{name: np.array([row[name] for row in rows], float) for name in MEASURED},
            "number": np.array([row["number"] for row in rows], float),
            "status": np.array([row["status"] for row in rows], "U9"),
        },
    )


def unset_constant_counters(lists: Sequence[DecodedMessage]) -> list[DecodedMessage]:
    """Return the lists of a sensor, without frames if all are equal although times differ."""
    frames = {decoded.frame for decoded in lists} - {None}
    is_constant = len(frames) == 1 and len({decoded.time_s for decoded in lists}) > 1
    return [decoded._replace(frame=None) if is_constant else decoded for decoded in lists]


def merge_cycle_messages(first: DecodedMessage, second: DecodedMessage) -> DecodedMessage | None:
    """Merge two messages of a cycle, of which one has no objects; return None for separate lists.

    Messages of a cycle have the same time, and the same frame if both have one.
    """
    empty, merged = sorted((first, second), key=lambda decoded: decoded.columns["number"].size)
    frames = {first.frame, second.frame} - {None}
    if empty.columns["number"].size or first.time_s != second.time_s or len(frames) > 1:
        return None
    return merged._replace(frame=next(iter(frames), None))


def build_decoded_lists(lists: Sequence[DecodedMessage]) -> xr.Dataset:
    """Build one object list, sorted by priority; frames are counted from 0 if one is unknown.

    Raises
    ------
    InvalidSetting
        If time decreases, or values are outside the ranges of an object list.
    """
    counters = [decoded.frame for decoded in lists if decoded.frame is not None]
    frames = np.array(counters if len(counters) == len(lists) else range(len(lists)), float)
    times_s = np.array([decoded.time_s for decoded in lists], float)
    n_rows = [decoded.columns["number"].size for decoded in lists]
    columns = {
        name: np.concatenate([empty, *(decoded.columns[name] for decoded in lists)])
        for name, empty in _EMPTY_COLUMNS.items()
    }
    columns |= {"frame": np.repeat(frames, n_rows), "time": np.repeat(times_s, n_rows)}
    # Detections are in the order of their numbers.
    return sort_by_priority(check_object_list(build_object_list(columns, frames, times_s)))


def _has_object_list(message: Any) -> bool:
    names = {field.name for field, _ in message.ListFields()}
    return bool(names & _OBJECT_FIELDS or message.feature_data.radar_sensor)


def find_list_senders(messages: Sequence[DecodedMessage]) -> tuple[list[int], int]:
    """Return the sensors that send object lists, by first list, and count messages of the others.

    Without any list, a single sensor is returned, since its road may be free, and is counted too.
    """
    senders = list(dict.fromkeys(decoded.sensor_id for decoded in messages if decoded.has_list))
    n_others = sum(decoded.sensor_id not in senders for decoded in messages)
    sensor_ids = {decoded.sensor_id for decoded in messages}
    return senders or (list(sensor_ids) if len(sensor_ids) == 1 else []), n_others


def parse_sensor_data(content: bytes) -> Any | None:
    """Return the `SensorData` message in these bytes, None if they are not a valid message.

    Messages of other types, such as `SensorView`, may parse too, but most of their bytes are
    fields that `SensorData` does not have.
    """
    sensor_data = import_from_extra("io", "osi3.osi_sensordata_pb2").SensorData
    parse_error = import_from_extra("io", "google.protobuf.message").DecodeError
    try:
        message = sensor_data.FromString(content)
    except parse_error:
        return None
    message.DiscardUnknownFields()
    return message if message.ByteSize() > len(content) / 2 else None


def osi_version() -> str:
    """Return the version of the installed OSI messages, such as 3.7.0."""
    version = _interface_version()
    return f"{version.version_major}.{version.version_minor}.{version.version_patch}"


def _interface_version() -> Any:
    version = import_from_extra("io", "osi3.osi_version_pb2")
    return version.DESCRIPTOR.GetOptions().Extensions[version.current_interface_version]


def _set_sensor_data_header(message: Any, frame: int, time_s: float, sensor_id: int) -> None:
    message.version.CopyFrom(_interface_version())
    message.sensor_id.value = sensor_id
    for timestamp in (message.timestamp, message.last_measurement_time):
        timestamp.seconds, timestamp.nanos = divmod(round(time_s * _NANO), _NANO)
    radar = message.feature_data.radar_sensor.add()
    for mounting in (message.mounting_position, radar.header.mounting_position):
        for field in ("position.x", "position.y", "position.z"):
            _set_field_unless_nan(mounting, field, 0.0)
        for field in ("orientation.roll", "orientation.pitch", "orientation.yaw"):
            _set_field_unless_nan(mounting, field, 0.0)
    message.moving_object_header.cycle_counter = frame
    message.moving_object_header.measurement_time.CopyFrom(message.timestamp)
    radar.header.cycle_counter = frame
    radar.header.sensor_id.value = sensor_id
    radar.header.measurement_time.CopyFrom(message.timestamp)
    message.logical_detection_data.version.CopyFrom(message.version)
    message.logical_detection_data.header.logical_detection_time.CopyFrom(message.timestamp)


def _objects_as_rows(objects: xr.Dataset) -> list[dict[str, Any]]:
    columns = {name: objects[name].values.tolist() for name in (*MEASURED, "number", "status")}
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def _add_moving_object(moving_object: Any, row: dict[str, Any], sensor_id: int) -> None:
    moving_object.header.tracking_id.value = row["number"]
    moving_object.header.existence_probability = _EXISTENCE_PROBABILITY[row["status"]]
    moving_object.header.sensor_id.add().value = sensor_id
    for name, field in _MOVING_OBJECT_FIELDS.items():
        _set_field_unless_nan(moving_object, field, row[name])


def _add_detection(message: Any, row: dict[str, Any]) -> None:
    logical = message.logical_detection_data.logical_detection.add()
    for name, field in _LOGICAL_DETECTION_FIELDS.items():
        _set_field_unless_nan(logical, field, row[name])
    with np.errstate(divide="ignore"):  # no signal at all is minus infinity
        snr_db = float(to_decibels(row["snr"]))
    _set_field_unless_nan(logical, "snr", snr_db)
    x, y, z = row["x"], row["y"], row["z"]
    height = 0.0 if np.isnan(z) else z
    lateral = 0.0 if np.isnan(y) else y
    if np.isnan(x):
        return
    ground_range = np.hypot(x, lateral)
    range_m = float(np.hypot(ground_range, height))
    radar = message.feature_data.radar_sensor[0].detection.add()
    _set_field_unless_nan(radar, "snr", snr_db)
    _set_field_unless_nan(radar, "position.distance", range_m)
    _set_field_unless_nan(radar, "position.azimuth", float(np.arctan2(y, x)))
    _set_field_unless_nan(radar, "position.elevation", -float(np.arctan2(z, ground_range)))
    radial_velocity = (x * row["vx"] + lateral * np.nan_to_num(row["vy"])) / max(ground_range, 1e-9)
    # vx and vy are the horizontal components of the radial velocity.
    _set_field_unless_nan(
        radar, "radial_velocity", -radial_velocity * range_m / max(ground_range, 1e-9)
    )


def _read_moving_objects(message: Any) -> Iterator[dict[str, Any]]:
    for moving_object in message.moving_object:
        confirmed = moving_object.header.existence_probability > _EXISTENCE_PROBABILITY["tentative"]
        yield {
            **dict.fromkeys(MEASURED, np.nan),
            **{
                name: _field_or_nan(moving_object, field)
                for name, field in _MOVING_OBJECT_FIELDS.items()
            },
            "number": moving_object.header.tracking_id.value,
            "status": "confirmed" if confirmed else "tentative",
        }


def _read_detections(message: Any) -> Iterator[dict[str, Any]]:
    row = {**dict.fromkeys(MEASURED, np.nan), "status": "detection"}
    rows = [
        _logical_detection_row(detection)
        for detection in message.logical_detection_data.logical_detection
    ]
    if not rows:
        radars = message.feature_data.radar_sensor
        rows = [
            _radar_detection_row(detection) for radar in radars for detection in radar.detection
        ]
    for index, known in enumerate(rows):
        yield {**row, **known, "number": index}


def _logical_detection_row(detection: Any) -> dict[str, float]:
    row = {
        name: _field_or_nan(detection, field) for name, field in _LOGICAL_DETECTION_FIELDS.items()
    }
    return {**row, "snr": float(from_decibels(_field_or_nan(detection, "snr")))}


def _radar_detection_row(detection: Any) -> dict[str, float]:
    range_m, radial_velocity = (
        _field_or_nan(detection, "position.distance"),
        -_field_or_nan(detection, "radial_velocity"),
    )
    azimuth, elevation = (
        _field_or_nan(detection, "position.azimuth"),
        -_field_or_nan(detection, "position.elevation"),
    )
    cos_elevation = np.cos(np.nan_to_num(elevation))
    forward, lateral = cos_elevation * np.cos(azimuth), cos_elevation * np.sin(azimuth)
    return {
        "x": range_m * forward,
        "y": range_m * lateral,
        "z": range_m * np.sin(elevation),
        "vx": radial_velocity * forward,
        "vy": radial_velocity * lateral,
        "snr": float(from_decibels(_field_or_nan(detection, "snr"))),
    }


def _set_field_unless_nan(message: Any, field: str, number: float) -> None:
    """Set a nested field, unless its value is NaN."""
    *path, name = field.split(".")
    if not np.isnan(number):
        for step in path:
            message = getattr(message, step)
        setattr(message, name, number)


def _field_or_nan(message: Any, field: str) -> float:
    """Return the value of a nested field, NaN if it is not set."""
    *path, name = field.split(".")
    for step in path:
        message = getattr(message, step)
    return float(getattr(message, name)) if message.HasField(name) else float("nan")


def _iter_trace_messages(path: Path) -> Iterator[Any]:
    """Yield the messages of a trace."""
    expected, fix = "a complete trace of SensorData", "write it again, or give a valid file"
    try:
        content = path.read_bytes()
    except OSError as error:
        raise RecordingError(
            path, value=error.strerror or error, expected=expected, fix=fix
        ) from None
    offset = 0
    while offset < len(content):
        start = offset + _LENGTH_PREFIX.size
        end = start + (
            _LENGTH_PREFIX.unpack_from(content, offset)[0] if start <= len(content) else 0
        )
        if not start <= end <= len(content):
            actual = f"truncated: {len(content) - offset} bytes at {offset}, where a message begins"
            raise RecordingError(path, value=actual, expected=expected, fix=fix)
        message = parse_sensor_data(content[start:end])
        if message is None:
            actual = f"a damaged message, or one of another type, at byte {start}"
            raise RecordingError(path, value=actual, expected=expected, fix=fix)
        yield message
        offset = end
