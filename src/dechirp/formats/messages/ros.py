"""What a message of ROS 2 is, whatever the file that it lies in.

Types are those of the distribution Humble; what others know of those that are read here is the
same. No definition in a file is ever used: it could stand for code.

References
----------
OMG, DDS Extensible and Dynamic Topic Types 1.3, 7.4 (CDR); ros2/common_interfaces,
sensor_msgs/msg/PointCloud2.msg and std_msgs/msg/Float64MultiArray.msg.
"""

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from dechirp.core.extra import library

CLOUD = "sensor_msgs/msg/PointCloud2"
TEXT = "std_msgs/msg/String"
NUMBERS = {"i": "Int", "u": "UInt", "f": "Float"}
"""In the name of a type of arrays, by the kind of its numbers."""

FIELD_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""Of numbers in a cloud, by their code."""

_MOST_FIELDS = 64
NANO = 10**9


class Message(NamedTuple):
    """One message, as it was sent."""

    topic: str
    type: str
    time_ns: int
    data: bytes | memoryview
    """In CDR."""


@cache
def types() -> Any:
    """All types of messages, which know how to be sent."""
    stores = library("rosbags.typesys", of="recording")
    return stores.get_typestore(stores.Stores.ROS2_HUMBLE)


def made(type_name: str, **fields: object) -> Any:
    """A message of a type, or a part of one."""
    return types().types[type_name](**fields)


def encoded(message: Any) -> bytes:
    """A message in CDR."""
    return bytes(types().serialize_cdr(message, message.__msgtype__))


def decoded(message: Message) -> Any:
    """A message with its fields; whatever rosbags or NumPy raise if it is damaged."""
    return types().deserialize_cdr(bytes(message.data), message.type)


def is_numbers(type_name: str) -> bool:
    """Whether a type is an array of numbers, as `std_msgs/msg/Float64MultiArray`."""
    return type_name.startswith("std_msgs/msg/") and type_name.endswith("MultiArray")


def points(cloud: Any) -> np.ndarray:
    """Points of a decoded cloud, (n,), with its fields; raises `ValueError` if damaged."""
    if len(cloud.fields) > _MOST_FIELDS:
        raise ValueError(f"{len(cloud.fields)} fields in a point")
    order = ">" if cloud.is_bigendian else "<"
    formats = [
        (order + FIELD_TYPES[field.datatype], (field.count,) if field.count > 1 else ())
        for field in cloud.fields
    ]
    kind = np.dtype(
        {
            "names": [field.name for field in cloud.fields],
            "formats": formats,
            "offsets": [field.offset for field in cloud.fields],
            "itemsize": cloud.point_step,
        }
    )
    if not (cloud.width and cloud.height):
        return np.empty(0, kind)
    row_bytes = cloud.width * cloud.point_step
    row_step = cloud.row_step if cloud.height > 1 else row_bytes
    if row_step < row_bytes or (cloud.height - 1) * row_step + row_bytes > len(cloud.data):
        raise ValueError(f"{len(cloud.data)} bytes for {cloud.width} x {cloud.height} points")
    strides = (row_step, cloud.point_step)
    rows = np.ndarray((cloud.height, cloud.width), kind, cloud.data, strides=strides)
    return rows.reshape(-1).copy()


def numbers(array: Any) -> np.ndarray:
    """Array of a decoded message, of the shape that it says; `ValueError` if damaged."""
    shape = [one.size for one in array.layout.dim]
    values = np.asarray(array.data)
    if math.prod(shape) != values.size:
        raise ValueError(f"{values.size} numbers for an array of shape {shape}")
    return values.reshape(shape).copy()
