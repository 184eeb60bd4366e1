"""ROS 2 messages of points, arrays and texts."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from dechirp.core.mcap_messages import Message
from dechirp.core.optional_imports import import_from_extra
from dechirp.recordings.messages.ros import (
    CLOUD,
    FIELD_TYPES,
    NANO,
    NUMBERS,
    SCAN,
    TEXT,
    TRACKS,
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


def build_scan_message(topic: str, time_ns: int, columns: Mapping[str, np.ndarray]) -> Message:
    """Build a RadarScan of returns (n,): `range azimuth elevation velocity`, and `snr` in dB.

    Unknown elevations are 0, as of a radar without elevation; other unknown values are NaN.
    """
    rows = np.stack(
        [columns[name] for name in ("range", "azimuth", "elevation", "velocity", "snr")], axis=1
    )
    rows[:, 2] = np.nan_to_num(rows[:, 2])
    returns = [
        create_message(
            "radar_msgs/msg/RadarReturn",
            range=range_m,
            azimuth=azimuth,
            elevation=elevation,
            doppler_velocity=velocity,
            amplitude=amplitude,
        )
        for range_m, azimuth, elevation, velocity, amplitude in rows.tolist()
    ]
    scan = create_message(SCAN, header=_build_message_header(time_ns), returns=returns)
    return _serialise_to_message(topic, time_ns, scan)


def build_tracks_message(
    topic: str,
    time_ns: int,
    numbers: np.ndarray,
    states: np.ndarray,
    covariances: np.ndarray | None,
) -> Message:
    """Build RadarTracks of tracks (n,) with states (n, 4): x, y, vx, vy.

    The UUID is the number of the track. Unknown accelerations, sizes and covariances are 0.
    """
    tracks = []
    for index, (number, (x, y, vx, vy)) in enumerate(
        zip(numbers.tolist(), states.tolist(), strict=True)
    ):
        position, velocity = np.zeros((2, 6), np.float32)
        if covariances is not None:
            position[[0, 1, 3]] = covariances[index][[0, 0, 1], [0, 1, 1]]
            velocity[[0, 1, 3]] = covariances[index][[2, 2, 3], [2, 3, 3]]
        uuid = np.frombuffer(int(number).to_bytes(16, "big"), np.uint8)
        tracks.append(
            create_message(
                "radar_msgs/msg/RadarTrack",
                uuid=create_message("unique_identifier_msgs/msg/UUID", uuid=uuid),
                position=create_message("geometry_msgs/msg/Point", x=x, y=y, z=0.0),
                velocity=create_message("geometry_msgs/msg/Vector3", x=vx, y=vy, z=0.0),
                acceleration=create_message("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0),
                size=create_message("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0),
                classification=0,
                position_covariance=position,
                velocity_covariance=velocity,
                acceleration_covariance=np.zeros(6, np.float32),
                size_covariance=np.zeros(6, np.float32),
            )
        )
    message = create_message(TRACKS, header=_build_message_header(time_ns), tracks=tracks)
    return _serialise_to_message(topic, time_ns, message)


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
