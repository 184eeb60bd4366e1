"""What is kept of the messages in a file: clouds of points, arrays, the description.

Ours lie below `/radar`, as `exchange.point_clouds` writes them. Of other topics, clouds are kept
that have a field of velocities: the others are those of lidars and cameras.
"""

from collections.abc import Iterable
from dataclasses import field
from pathlib import Path

import numpy as np

from dechirp.core.memory import SMALL_BYTES, must_fit
from dechirp.core.values import value
from dechirp.formats.messages.ros import (
    CLOUD,
    NANO,
    TEXT,
    Message,
    decoded,
    is_numbers,
    numbers,
    points,
)

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
"""Names of a field of radial velocities, in small letters."""


@value
class Cloud:
    """One cloud."""

    time_ns: int
    frame_id: str
    points: np.ndarray = field(repr=False)
    """(n,), with the fields of its points."""


@value
class Kept:
    """What was kept of a file."""

    description: str | None
    """Text of ours."""
    clouds: dict[str, list[Cloud]]
    """By topic."""
    arrays: dict[str, np.ndarray]
    """By topic, the last one of each."""
    others: dict[str, str]
    """Type of each topic that was not kept."""


def kept(path: Path, messages: Iterable[Message], inside: str | None) -> Kept:
    """Go through all messages; `inside` names a topic of clouds, without the first slash."""
    text: str | None = None
    clouds: dict[str, list[Cloud]] = {}
    arrays: dict[str, np.ndarray] = {}
    others: dict[str, str] = {}
    n_bytes = 0
    for message in messages:
        topic = message.topic
        ours = topic.startswith(f"{ROOT}/")
        if topic == DESCRIPTION and message.type == TEXT:
            text = str(decoded(message).data)
        elif ours and is_numbers(message.type):
            arrays[topic] = numbers(decoded(message))
        elif message.type == CLOUD and topic not in others:
            cloud = decoded(message)
            names = {one.name.lower() for one in cloud.fields}
            if not (ours or topic == f"/{inside}" or names.intersection(VELOCITIES)):
                others[topic] = message.type
                continue
            stamp = cloud.header.stamp
            time_ns = stamp.sec * NANO + stamp.nanosec or message.time_ns
            one = Cloud(time_ns=time_ns, frame_id=cloud.header.frame_id, points=points(cloud))
            clouds.setdefault(topic, []).append(one)
            before, n_bytes = n_bytes, n_bytes + one.points.nbytes
            if n_bytes // SMALL_BYTES > before // SMALL_BYTES:
                # As much again: clouds become columns.
                must_fit(
                    f"the points in {path.name}",
                    needed_bytes=n_bytes,
                    fix="Split the bag into shorter ones.",
                )
        else:
            others[topic] = message.type
    return Kept(description=text, clouds=clouds, arrays=arrays, others=others)
