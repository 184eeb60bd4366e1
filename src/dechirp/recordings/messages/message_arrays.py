"""Arrays of the messages in a file: point clouds, number arrays, and the native description.

Native topics lie below `/radar`, as `recordings.writers.point_clouds` writes them. Of other topics,
clouds with a velocity field are read, and the messages of radar_msgs; the others are those of
lidars and cameras.
"""

from collections.abc import Iterable
from dataclasses import field
from pathlib import Path

import numpy as np

from dechirp.core.mcap_messages import Message
from dechirp.core.memory import SMALL_BYTES, check_free_memory
from dechirp.core.values import frozen_dataclass
from dechirp.recordings.messages.ros import (
    CLOUD,
    NANO,
    SCAN,
    TEXT,
    TRACKS,
    decode_message,
    is_number_array_type,
    parse_cloud_points,
    parse_number_array,
    parse_scan_points,
    parse_track_points,
)

_POINT_PARSERS = {CLOUD: parse_cloud_points, SCAN: parse_scan_points, TRACKS: parse_track_points}
"""Functions that return the points of a message, by its type."""

ROOT = "/radar"
DESCRIPTION = f"{ROOT}/description"
VELOCITIES = (
    "velocity",
    "doppler",
    "doppler_velocity",
    "radial_velocity",
    "velocity_radial",
    "radial_speed",
    "range_rate",
    "vel",
    "v_radial",
    "v_r",
    "vr",
    "v",
)
"""Names of a field of radial velocities, in lower case."""


@frozen_dataclass
class PointCloud:
    """Point cloud of one message or file."""

    time_ns: int | None
    """None if unknown."""
    frame_id: str
    points: np.ndarray = field(repr=False)
    """(n,), with the fields of its points."""


@frozen_dataclass
class MessageArrays:
    """Arrays read from a file."""

    description: str | None
    """Native description."""
    clouds: dict[str, list[PointCloud]]
    """Clouds by topic."""
    arrays: dict[str, np.ndarray]
    """Number arrays by topic, the last one of each."""
    unread_topics: dict[str, str]
    """Type of each topic that was not read."""


def collect_message_arrays(
    path: Path, messages: Iterable[Message], cloud_topic_name: str | None
) -> MessageArrays:
    """Read the arrays of all messages.

    `cloud_topic_name` selects a topic of clouds, without its first slash.
    """
    text: str | None = None
    clouds: dict[str, list[PointCloud]] = {}
    arrays: dict[str, np.ndarray] = {}
    unread_topics: dict[str, str] = {}
    empty_clouds: dict[str, list[PointCloud]] = {}
    n_bytes = 0
    for message in messages:
        topic = message.topic
        is_native = topic.startswith(f"{ROOT}/")
        if topic == DESCRIPTION and message.type == TEXT:
            text = str(decode_message(message).data)
        elif is_native and is_number_array_type(message.type):
            arrays[topic] = parse_number_array(decode_message(message))
        elif is_native and text is not None and message.type in (SCAN, TRACKS):
            continue  # native files repeat their detections and tracks for other programs
        elif message.type in _POINT_PARSERS and topic not in unread_topics:
            cloud = decode_message(message)
            has_velocity = message.type != CLOUD or not set(VELOCITIES).isdisjoint(
                point_field.name.lower() for point_field in cloud.fields
            )
            is_radar = is_native or topic == f"/{cloud_topic_name}" or has_velocity
            is_empty = message.type == CLOUD and not (cloud.width and cloud.height)
            if not (is_radar or is_empty or topic in clouds):
                unread_topics[topic] = message.type
                continue
            stamp = cloud.header.stamp
            time_ns = stamp.sec * NANO + stamp.nanosec or message.time_ns
            point_cloud = PointCloud(
                time_ns=time_ns,
                frame_id=cloud.header.frame_id,
                points=_POINT_PARSERS[message.type](cloud),
            )
            if not is_radar and topic not in clouds:
                # Drivers without detections publish clouds without fields: the next ones decide.
                empty_clouds.setdefault(topic, []).append(point_cloud)
                continue
            clouds.setdefault(topic, empty_clouds.pop(topic, [])).append(point_cloud)
            earlier_bytes, n_bytes = n_bytes, n_bytes + point_cloud.points.nbytes
            if n_bytes // SMALL_BYTES > earlier_bytes // SMALL_BYTES:
                # Twice the memory: clouds become columns.
                check_free_memory(
                    f"the points in {path.name}",
                    needed_bytes=n_bytes,
                    fix="split the bag into shorter ones",
                )
        else:
            unread_topics[topic] = message.type
    unread_topics |= dict.fromkeys(empty_clouds, CLOUD)
    return MessageArrays(
        description=text, clouds=clouds, arrays=arrays, unread_topics=unread_topics
    )
