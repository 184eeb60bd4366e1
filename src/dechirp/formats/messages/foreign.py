"""Clouds of points from other radars' drivers, as detections.

x points forward, y left, z up (REP 103); a velocity is taken as that along the line of sight,
receding positive. What a driver means by the other fields is not known: they keep their names.

References
----------
ROS Enhancement Proposal 103, Standard Units of Measure and Coordinate Conventions.
"""

from pathlib import Path

import numpy as np
import xarray as xr

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.units import from_decibels
from dechirp.formats.base import Contents
from dechirp.formats.messages.kept import VELOCITIES, Cloud, Kept
from dechirp.formats.messages.ros import NANO
from dechirp.radar.radar import Radar

_SNRS = ("snr", "snr_db")
_XYZ = ("x", "y", "z")
_UNITS = {
    "frame": "1",
    "time": "s",
    "range": "m",
    "velocity": "m/s",
    "azimuth": "rad",
    "elevation": "rad",
    "snr": "1",
}


def contents(path: Path, held: Kept, radar: Radar | None, inside: str | None) -> Contents:
    """Detections of the topic that is meant, or of the first that can be a radar's.

    Raises
    ------
    RecordingError
        If there is none, or its points have no places.
    """
    topic = f"/{inside}" if inside else min(held.clouds, default="")
    if topic not in held.clouds:
        raise RecordingError(
            path,
            got=f"without a cloud of points {f'on {topic}' if inside else 'of a radar'}:"
            f" {_listed({**held.others, **dict.fromkeys(held.clouds, 'points')})}",
            need="a topic of sensor_msgs/msg/PointCloud2, with velocities unless it is named",
            fix="Name its topic below the recording, as bag.mcap/front/radar.",
        )
    clouds = held.clouds[topic]
    fields = clouds[0].points.dtype.names or ()
    names = {name.lower(): name for name in fields}
    if not names.keys() >= set(_XYZ):
        raise RecordingError(
            path,
            got=f"with points of {', '.join(fields) or 'no fields'} on {topic}",
            need="points with fields x, y and z",
            fix="Name another topic below the recording, as bag.mcap/front/radar.",
        )
    with np.errstate(all="ignore"):  # anybody's numbers: what becomes of the largest is no place
        points = _detections(clouds, names)
    others = {**held.others, **{one: "points" for one in held.clouds if one != topic}}
    return Contents(
        radar=radar,
        n_frames=len(clouds),
        points=points,
        findings=_findings(topic, clouds[0].frame_id, names, others),
    )


def _detections(clouds: list[Cloud], names: dict[str, str]) -> xr.Dataset:
    counts = [len(cloud.points) for cloud in clouds]
    frame = np.repeat(np.arange(len(clouds)), counts)
    times_s = np.array([cloud.time_ns - clouds[0].time_ns for cloud in clouds]) / NANO

    def column(name: str) -> np.ndarray:
        return np.concatenate([cloud.points[names[name]] for cloud in clouds]).astype(float)

    x, y, z = map(column, _XYZ)
    velocity = next((name for name in VELOCITIES if name in names), None)
    snr = next((name for name in _SNRS if name in names), None)
    ground = np.hypot(x, y)
    unknown = np.full(len(x), np.nan)
    columns = {
        "frame": frame,
        "time": np.repeat(times_s, counts),
        "range": np.hypot(ground, z),
        "velocity": unknown if velocity is None else column(velocity),
        "azimuth": np.arctan2(y, x),
        "elevation": np.arctan2(z, ground),
        "snr": unknown if snr is None else from_decibels(column(snr)),
    }
    kinds = clouds[0].points.dtype
    taken = {*columns, *_XYZ, velocity, snr}
    for name in names:  # in their order: that of a set changes from run to run
        if name not in taken and not kinds[names[name]].shape:
            columns[name] = column(name)
    placed = np.isfinite(columns["range"])  # the others fill up a picture of depths
    return xr.Dataset(
        {
            name: ("detection", values[placed], {"units": _UNITS[name]} if name in _UNITS else {})
            for name, values in columns.items()
        }
    )


def _findings(
    topic: str, frame_id: str, names: dict[str, str], others: dict[str, str]
) -> tuple[Finding, ...]:
    taken = [
        f"{word} from {next((names[one] for one in known if one in names), 'nothing')}"
        for word, known in (("velocity", VELOCITIES), ("snr in dB", _SNRS))
    ]
    found = [
        Finding(
            level="warning" if "nothing" in taken[0] else "note",
            setting="points",
            got=f"those of {topic} (frame_id {frame_id!r}), of {', '.join(names.values())};"
            f" {', '.join(taken)}",
            need="x forward, y left, z up, and velocities along the line of sight, receding"
            " positive",
            fix="Turn them if the driver of the radar means something else.",
        )
    ]
    if others:
        found.append(
            Finding(
                level="note",
                setting="recording",
                got=f"other topics, not read: {_listed(others)}",
                need="one topic of points",
                fix="Name another below the recording, as bag.mcap/front/radar.",
            )
        )
    return tuple(found)


def _listed(topics: dict[str, str]) -> str:
    named = [f"{topic} ({kind})" for topic, kind in sorted(topics.items())]
    more = f" and {len(named) - 12} more" if len(named) > 12 else ""
    return f"{', '.join(named[:12]) or 'no topics'}{more}"
