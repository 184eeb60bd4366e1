"""ROS 2 messages of points, arrays and texts."""

from typing import Any

import numpy as np

from dechirp.core.optional_imports import import_from_extra
from dechirp.recordings.messages.ros import (
    CLOUD,
    FIELD_TYPES,
    NANO,
    NUMBERS,
    TEXT,
    Message,
    create_message,
    encode_message,
)

FRAME_ID = "radar"
FIELD_CODES = {name: code for code, name in FIELD_TYPES.items()}
"""Codes of the number types in a point cloud, by NumPy type without byte order."""


def build_text_message(topic: str, text: str) -> Message:
    """Build a text message at time 0."""
    return _serialise_to_message(topic, 0, create_message(TEXT, data=text))


def build_cloud_message(topic: str, time_ns: int, points: np.ndarray) -> Message:
    """Build a cloud of points (n,) with named fields.

    Points without a position have NaN x, y and z.
    """
    kind = points.dtype
    fields = []
    for name, (base, offset, *_) in (kind.fields or {}).items():
        numbers, shape = base.subdtype or (base, (1,))
        code = FIELD_CODES[numbers.str[1:]]
        field = {"name": name, "offset": offset, "datatype": code, "count": shape[0]}
        fields.append(create_message("sensor_msgs/msg/PointField", **field))
    cloud = create_message(
        CLOUD,
        header=_build_message_header(time_ns),
        height=1,
        width=len(points),
        fields=fields,
        is_bigendian=False,
        point_step=kind.itemsize,
        row_step=points.nbytes,
        data=np.frombuffer(points.tobytes(), np.uint8),
        is_dense=bool(np.isfinite(points["x"]).all()),
    )
    return _serialise_to_message(topic, time_ns, cloud)


def _build_message_header(time_ns: int) -> Any:
    seconds, nanoseconds = divmod(time_ns, NANO)
    stamp = create_message("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
    return create_message("std_msgs/msg/Header", stamp=stamp, frame_id=FRAME_ID)


def build_array_message(topic: str, values: np.ndarray) -> Message:
    """Build a message of an array of any shape at time 0.

    Complex numbers get a last axis of their two parts; flags become bytes.
    """
    if values.dtype.kind == "c":
        parts = values.dtype.type(0).real.dtype
        values = np.ascontiguousarray(values)[..., None].view(parts)
    if values.dtype.kind == "b":
        values = values.astype(np.uint8)
    sizes = values.shape
    dimensions = [
        create_message(
            "std_msgs/msg/MultiArrayDimension",
            label=f"axis {axis}",
            size=size,
            stride=int(np.prod(sizes[axis:])),
        )
        for axis, size in enumerate(sizes)
    ]
    array = create_message(
        f"std_msgs/msg/{NUMBERS[values.dtype.kind]}{values.dtype.itemsize * 8}MultiArray",
        layout=create_message("std_msgs/msg/MultiArrayLayout", dim=dimensions, data_offset=0),
        data=np.ascontiguousarray(values).reshape(-1),
    )
    return _serialise_to_message(topic, 0, array)


def _serialise_to_message(topic: str, time_ns: int, content: Any) -> Message:
    return Message(topic, content.__msgtype__, time_ns, encode_message(content))


def transient_local_qos() -> Any:
    """Return the quality of service that delivers a message to late subscribers, too."""
    interfaces = import_from_extra("io", "rosbags.interfaces", setting="recording")
    no_limit = interfaces.QosTime(0, 0)
    return interfaces.Qos(
        interfaces.QosHistory.KEEP_LAST,
        1,
        interfaces.QosReliability.RELIABLE,
        interfaces.QosDurability.TRANSIENT_LOCAL,
        no_limit,
        no_limit,
        interfaces.QosLiveliness.SYSTEM_DEFAULT,
        no_limit,
        False,
    )
