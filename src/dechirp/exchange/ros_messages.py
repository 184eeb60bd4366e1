"""Points, arrays and texts as messages of ROS 2."""

from typing import Any

import numpy as np

from dechirp.core.extra import library
from dechirp.formats.messages.ros import (
    CLOUD,
    FIELD_TYPES,
    NANO,
    NUMBERS,
    TEXT,
    Message,
    encoded,
    made,
)

FRAME_ID = "radar"
FIELD_CODES = {name: code for code, name in FIELD_TYPES.items()}
"""Of numbers in a cloud, by their type in NumPy without the order of bytes."""


def text_message(topic: str, text: str) -> Message:
    """A text, sent at the start."""
    return _message(topic, 0, made(TEXT, data=text))


def cloud_message(topic: str, time_ns: int, points: np.ndarray) -> Message:
    """Points (n,) with named fields; those without a place have NaN for x, y and z."""
    kind = points.dtype
    fields = []
    for name, (base, offset, *_) in (kind.fields or {}).items():
        numbers, shape = base.subdtype or (base, (1,))
        code = FIELD_CODES[numbers.str[1:]]
        field = {"name": name, "offset": offset, "datatype": code, "count": shape[0]}
        fields.append(made("sensor_msgs/msg/PointField", **field))
    cloud = made(
        CLOUD,
        header=_header(time_ns),
        height=1,
        width=len(points),
        fields=fields,
        is_bigendian=False,
        point_step=kind.itemsize,
        row_step=points.nbytes,
        data=np.frombuffer(points.tobytes(), np.uint8),
        is_dense=bool(np.isfinite(points["x"]).all()),
    )
    return _message(topic, time_ns, cloud)


def _header(time_ns: int) -> Any:
    seconds, nanoseconds = divmod(time_ns, NANO)
    stamp = made("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
    return made("std_msgs/msg/Header", stamp=stamp, frame_id=FRAME_ID)


def array_message(topic: str, values: np.ndarray) -> Message:
    """Numbers of any shape, sent at the start.

    Complex ones get a last axis of their two parts; truth values become bytes.
    """
    if values.dtype.kind == "c":
        parts = values.dtype.type(0).real.dtype
        values = np.ascontiguousarray(values)[..., None].view(parts)
    if values.dtype.kind == "b":
        values = values.astype(np.uint8)
    sizes = values.shape
    dimensions = [
        made(
            "std_msgs/msg/MultiArrayDimension",
            label=f"axis {place}",
            size=size,
            stride=int(np.prod(sizes[place:])),
        )
        for place, size in enumerate(sizes)
    ]
    array = made(
        f"std_msgs/msg/{NUMBERS[values.dtype.kind]}{values.dtype.itemsize * 8}MultiArray",
        layout=made("std_msgs/msg/MultiArrayLayout", dim=dimensions, data_offset=0),
        data=np.ascontiguousarray(values).reshape(-1),
    )
    return _message(topic, 0, array)


def _message(topic: str, time_ns: int, content: Any) -> Message:
    return Message(topic, content.__msgtype__, time_ns, encoded(content))


def keeps_for_late_listeners() -> Any:
    """Quality of service of what is sent once: whoever listens later gets it, too."""
    of = library("rosbags.interfaces", of="recording")
    never = of.QosTime(0, 0)
    return of.Qos(
        of.QosHistory.KEEP_LAST,
        1,
        of.QosReliability.RELIABLE,
        of.QosDurability.TRANSIENT_LOCAL,
        never,
        never,
        of.QosLiveliness.SYSTEM_DEFAULT,
        never,
        False,
    )
