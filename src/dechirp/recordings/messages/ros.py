"""Messages of ROS 2, independent of the file format.

Types are those of the distribution Humble; other distributions define the types read here equally.
Definitions in a file are ignored, because they could contain code.

References
----------
OMG, DDS Extensible and Dynamic Topic Types 1.3, 7.4 (CDR); ros2/common_interfaces,
sensor_msgs/msg/PointCloud2.msg and std_msgs/msg/Float64MultiArray.msg; ros-perception/radar_msgs,
whose velocities are negative towards the sensor (issue 11).
"""

import math
from functools import cache
from typing import Any

import numpy as np

from dechirp.core.mcap_messages import Message
from dechirp.core.optional_imports import import_from_extra

CLOUD = "sensor_msgs/msg/PointCloud2"
SCAN = "radar_msgs/msg/RadarScan"
TRACKS = "radar_msgs/msg/RadarTracks"
POINT_TYPES = (CLOUD, SCAN, TRACKS)
"""Types of which each message has the points of one frame."""
TEXT = "std_msgs/msg/String"
NUMBERS = {"i": "Int", "u": "UInt", "f": "Float"}
"""Part of the name of an array type, by the kind of its numbers."""

FIELD_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""Types of numbers in a cloud, by their code."""

_MAX_FIELDS = 64
_RADAR_TYPES = {
    "radar_msgs/msg/RadarReturn": """\
float32 range
float32 azimuth
float32 elevation
float32 doppler_velocity
float32 amplitude
""",
    SCAN: "std_msgs/Header header\nradar_msgs/RadarReturn[] returns\n",
    "radar_msgs/msg/RadarTrack": """\
unique_identifier_msgs/UUID uuid
geometry_msgs/Point position
geometry_msgs/Vector3 velocity
geometry_msgs/Vector3 acceleration
geometry_msgs/Vector3 size
uint16 classification
float32[6] position_covariance
float32[6] velocity_covariance
float32[6] acceleration_covariance
float32[6] size_covariance
""",
    TRACKS: "std_msgs/Header header\nradar_msgs/RadarTrack[] tracks\n",
}
"""Definitions of radar_msgs, which are not part of a distribution; m, m/s, rad and dB."""
NANO = 10**9


@cache
def ros2_message_type_store() -> Any:
    """Return the store of message types, which serialises messages."""
    stores = import_from_extra("io", "rosbags.typesys", setting="recording")
    store = stores.get_typestore(stores.Stores.ROS2_HUMBLE)
    for name, definition in _RADAR_TYPES.items():
        store.register(stores.get_types_from_msg(definition, name))
    return store


def create_message(type_name: str, **fields: object) -> Any:
    """Create a message of a type, or a part of one."""
    return ros2_message_type_store().types[type_name](**fields)


def encode_message(message: Any) -> bytes:
    """Serialise a message to CDR."""
    return bytes(ros2_message_type_store().serialize_cdr(message, message.__msgtype__))


def decode_message(message: Message) -> Any:
    """Deserialise a message; raises any error of rosbags or NumPy if it is damaged."""
    return ros2_message_type_store().deserialize_cdr(bytes(message.data), message.type)


def is_number_array_type(type_name: str) -> bool:
    """Return whether a type is an array of numbers, such as `std_msgs/msg/Float64MultiArray`."""
    return type_name.startswith("std_msgs/msg/") and type_name.endswith("MultiArray")


def parse_cloud_points(cloud: Any) -> np.ndarray:
    """Return the points of a decoded cloud, (n,), with its fields; `ValueError` if damaged."""
    if len(cloud.fields) > _MAX_FIELDS:
        raise ValueError(f"{len(cloud.fields)} fields in a point")
    order = ">" if cloud.is_bigendian else "<"
    formats = [
        (order + FIELD_TYPES[field.datatype], (field.count,) if field.count > 1 else ())
        for field in cloud.fields
    ]
    names = [field.name for field in cloud.fields]
    if not (cloud.width and cloud.height):  # drivers leave the size of a point at 0
        return np.empty(0, np.dtype({"names": names, "formats": formats}))
    # NumPy's own check overflows at offsets of 2 GiB, and reading the field ends the process.
    for field, number_format in zip(cloud.fields, formats, strict=True):
        if field.offset + np.dtype([("", *number_format)]).itemsize > cloud.point_step:
            raise ValueError(f"a field {field.name} beyond the {cloud.point_step} bytes of a point")
    kind = np.dtype(
        {
            "names": names,
            "formats": formats,
            "offsets": [field.offset for field in cloud.fields],
            "itemsize": cloud.point_step,
        }
    )
    row_bytes = cloud.width * cloud.point_step
    row_step = cloud.row_step if cloud.height > 1 else row_bytes
    if row_step < row_bytes or (cloud.height - 1) * row_step + row_bytes > len(cloud.data):
        raise ValueError(f"{len(cloud.data)} bytes for {cloud.width} x {cloud.height} points")
    strides = (row_step, cloud.point_step)
    rows = np.ndarray((cloud.height, cloud.width), kind, cloud.data, strides=strides)
    return rows.reshape(-1).copy()


_SCAN_FIELDS = ("x", "y", "z", "doppler_velocity", "amplitude")
_TRACK_FIELDS = ("x", "y", "z", "vx", "vy", "vz", "length", "width", "height", "classification")


def parse_scan_points(scan: Any) -> np.ndarray:
    """Return the returns of a decoded RadarScan, (n,); an unknown elevation counts as 0.

    Returns with a negative or infinite range, or without azimuth, have NaN positions.
    """
    rows = np.array(
        [
            (item.range, item.azimuth, item.elevation, item.doppler_velocity, item.amplitude)
            for item in scan.returns
        ],
        float,
    ).reshape(-1, 5)
    range_m, azimuth, elevation, velocity, amplitude = rows.T
    is_valid = (range_m >= 0) & np.isfinite(rows[:, :2]).all(axis=1)
    range_m, azimuth = (np.where(is_valid, column, np.nan) for column in (range_m, azimuth))
    elevation = np.where(np.isfinite(elevation), elevation, 0.0)
    ground_m = range_m * np.cos(elevation)
    columns = (
        ground_m * np.cos(azimuth),
        ground_m * np.sin(azimuth),
        range_m * np.sin(elevation),
        velocity,
        amplitude,
    )
    return _to_structured_rows(_SCAN_FIELDS, columns)


def parse_track_points(tracks: Any) -> np.ndarray:
    """Return the tracks of decoded RadarTracks, (n,): positions, velocities and sizes."""
    rows = np.array(
        [
            (
                *(item.position.x, item.position.y, item.position.z),
                *(item.velocity.x, item.velocity.y, item.velocity.z),
                *(item.size.x, item.size.y, item.size.z),
                item.classification,
            )
            for item in tracks.tracks
        ],
        float,
    ).reshape(-1, len(_TRACK_FIELDS))
    return _to_structured_rows(_TRACK_FIELDS, tuple(rows.T))


def _to_structured_rows(names: tuple[str, ...], columns: tuple[np.ndarray, ...]) -> np.ndarray:
    points = np.empty(len(columns[0]), [(name, "f8") for name in names])
    for name, column in zip(names, columns, strict=True):
        points[name] = column
    return points


def parse_number_array(message: Any) -> np.ndarray:
    """Return the array of a decoded message in its declared shape; `ValueError` if damaged."""
    shape = [dimension.size for dimension in message.layout.dim]
    values = np.asarray(message.data)
    if math.prod(shape) != values.size:
        raise ValueError(f"{values.size} numbers for an array of shape {shape}")
    return values.reshape(shape).copy()
