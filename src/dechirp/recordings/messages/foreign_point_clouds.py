"""Point clouds, scans and tracks of other radars' drivers, as detections.

x points forward, y left, z up (REP 103); a velocity is taken as radial, receding positive. Other
fields keep their names, because their meaning depends on the driver.

References
----------
ROS Enhancement Proposal 103, Standard Units of Measure and Coordinate Conventions.
"""

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import xarray as xr

from dechirp.core.detection_columns import UNITS
from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.units import from_decibels
from dechirp.radar.radar import Radar
from dechirp.recordings.messages.message_arrays import VELOCITIES, MessageArrays, PointCloud
from dechirp.recordings.messages.ros import NANO
from dechirp.recordings.readers.base import Contents

_SNRS = ("snr", "snr_db")
_XYZ = ("x", "y", "z")
_COMPUTED = ("frame", "time", "range", "velocity", "azimuth", "elevation", "snr")


def read_foreign_detections(
    path: Path, arrays: MessageArrays, radar: Radar | None, topic_name: str | None
) -> Contents:
    """Return the detections of the named topic, or of the first with velocities.

    Raises
    ------
    RecordingError
        If there is none, or its points have no coordinates.
    """
    topic = f"/{topic_name}" if topic_name else min(arrays.clouds, default="")
    if topic not in arrays.clouds:
        topics = {**arrays.unread_topics, **dict.fromkeys(arrays.clouds, "points")}
        raise RecordingError(
            path,
            value=f"no point cloud {f'on {topic}' if topic_name else 'of a radar'}:"
            f" {_format_topics_with_types(topics)}",
            expected="a topic of sensor_msgs/msg/PointCloud2, with velocities unless it is named,"
            " or of radar_msgs",
            fix="append the topic to the recording, as in bag.mcap/front/radar",
        )
    unread_topics = {
        **arrays.unread_topics,
        **{other_topic: "points" for other_topic in arrays.clouds if other_topic != topic},
    }
    return convert_clouds_to_contents(
        path, arrays.clouds[topic], radar, source=topic, findings=_unread_topics_note(unread_topics)
    )


def convert_clouds_to_contents(
    path: Path,
    clouds: Sequence[PointCloud],
    radar: Radar | None,
    *,
    source: str,
    findings: Sequence[Finding] = (),
) -> Contents:
    """Return clouds as detections, a frame for each; `source` names them in messages.

    Raises
    ------
    RecordingError
        If the points have no coordinates, or lack fields of those before.
    """
    # Empty clouds may lack fields.
    first = next((cloud for cloud in clouds if len(cloud.points)), clouds[0])
    fields = first.points.dtype.names or ()
    names: dict[str, str] = {}
    for name in fields:  # of names that differ only in case, the lower-case one, else the first
        if name == name.lower() or name.lower() not in names:
            names[name.lower()] = name
    if not names.keys() >= {"x", "y"}:
        raise RecordingError(
            path,
            value=f"points with fields {', '.join(fields[:20]) or '(none)'} on {source}",
            expected="points with fields x and y, and z if the radar measures heights",
            fix="give other points: of a bag, append the topic, as in bag.mcap/front/radar",
        )
    for frame, cloud in enumerate(clouds):
        present = {*(cloud.points.dtype.names or ())}
        missing = [name for name in fields if name[:1] != "_" and name not in present]
        if len(cloud.points) and missing:
            raise RecordingError(
                path,
                value=f"frame {frame} with points without {', '.join(missing[:20])} on {source}",
                expected=f"points with the fields of the first ones: {', '.join(fields[:20])}",
                fix="select the frames of one kind, or put the others on another topic",
            )
    _check_field_sizes(path, clouds, names, source)
    with np.errstate(all="ignore"):  # foreign numbers: overflow gives no valid position
        points = _clouds_to_detections(clouds, names)
    return Contents(
        radar=radar,
        n_frames=len(clouds),
        points=points,
        findings=(
            *_used_fields_findings(source, clouds, names),
            *_case_findings(source, fields, names),
            *_time_findings(source, clouds),
            *findings,
        ),
    )


def _check_field_sizes(
    path: Path, clouds: Sequence[PointCloud], field_names: dict[str, str], source: str
) -> None:
    """Raise `RecordingError` for fields of several numbers that are used, or copied elsewhere."""
    used_names = {*_XYZ, *_find_velocity_fields(field_names), _find_first(_SNRS, field_names)}
    for key, name in field_names.items():
        shapes = {cloud.points.dtype[name].shape for cloud in clouds if len(cloud.points)}
        if shapes - {()} and (key in used_names or () in shapes):
            raise RecordingError(
                path,
                value=f"{max(map(math.prod, shapes))} values of {name} in a point on {source}",
                expected="one number in each field of a point",
                fix="write its numbers as fields with names of their own, as in vx, vy and vz",
            )


def _find_velocity_fields(field_names: dict[str, str]) -> tuple[str, ...]:
    """Return the fields of the velocity: the radial one, components, or none."""
    radial_velocity = _find_first(VELOCITIES, field_names)
    if radial_velocity is not None:
        return (radial_velocity,)
    if not {"vx", "vy"} <= field_names.keys():
        return ()
    return tuple(name for name in ("vx", "vy", "vz") if name in field_names)


def _find_first(names: Iterable[str], field_names: dict[str, str]) -> str | None:
    return next((name for name in names if name in field_names), None)


def _case_findings(
    source: str, fields: Sequence[str], field_names: dict[str, str]
) -> tuple[Finding, ...]:
    """Warn about fields that are not read, because their names differ from others only in case."""
    unread_fields = [name for name in fields if name not in field_names.values()]
    if not unread_fields:
        return ()
    verb = "is" if len(unread_fields) == 1 else "are"
    return (
        Finding(
            level="warning",
            setting="points",
            value=f"fields of {source} that differ only in case; {', '.join(unread_fields[:20])}"
            f" {verb} not read",
            expected="names of fields that differ in any case",
            fix="rename the fields, if others are meant",
        ),
    )


def _time_findings(source: str, clouds: Sequence[PointCloud]) -> tuple[Finding, ...]:
    """Warn about times that decrease from one frame to the next."""
    times_ns = [cloud.time_ns for cloud in clouds]
    steps_s = [
        0.0 if before is None or after is None else (after - before) / NANO
        for before, after in pairwise(times_ns)
    ]
    backward_frames = [frame for frame, step_s in enumerate(steps_s, 1) if step_s < 0]
    if not backward_frames:
        return ()
    first = backward_frames[0]
    count = "once" if len(backward_frames) == 1 else f"{len(backward_frames)} times"
    return (
        Finding(
            level="warning",
            setting="points",
            value=f"times of {source} that go backwards {count}, first at frame {first}, by"
            f" {-steps_s[first - 1]:.6g} s",
            expected="times that increase from frame to frame",
            fix="select frames of one source, or sort them: trackers need frames in order",
        ),
    )


def _clouds_to_detections(clouds: Sequence[PointCloud], field_names: dict[str, str]) -> xr.Dataset:
    """Convert clouds to detections; `field_names` maps lower-case field names to their spelling."""
    counts = [len(cloud.points) for cloud in clouds]
    frame = np.repeat(np.arange(len(clouds)), counts)
    known = [cloud.time_ns for cloud in clouds if cloud.time_ns is not None]
    times_s = (
        np.array([time_ns - known[0] for time_ns in known]) / NANO
        if len(known) == len(clouds)
        else np.full(len(clouds), np.nan)
    )

    filled = [cloud for cloud in clouds if len(cloud.points)]

    def column(name: str) -> np.ndarray:
        parts = [cloud.points[field_names[name]] for cloud in filled]
        return np.concatenate(parts or [np.empty(0)]).astype(float)

    x, y = column("x"), column("y")
    radial_velocity_field = _find_first(VELOCITIES, field_names)
    snr = _find_first(_SNRS, field_names)
    ground = np.hypot(x, y)
    unknown = np.full(len(x), np.nan)
    z = column("z") if "z" in field_names else unknown
    if radial_velocity_field is not None:
        radial_velocity = column(radial_velocity_field)
    elif {"vx", "vy"} <= field_names.keys():  # components of the radial velocity, as in nuScenes
        ground_rate = column("vx") * x + column("vy") * y
        height_rate = column("vz") * z if "vz" in field_names else unknown
        radial_velocity = np.where(
            np.isnan(height_rate),
            ground_rate / ground,
            (ground_rate + height_rate) / np.hypot(ground, z),
        )
    else:
        radial_velocity = unknown
    columns = {
        "frame": frame,
        "time": np.repeat(times_s, counts),
        "range": np.hypot(ground, np.where(np.isnan(z), 0.0, z)),  # in the plane if z is unknown
        "velocity": radial_velocity,
        "azimuth": np.arctan2(y, x),
        "elevation": np.arctan2(z, ground),
        "snr": unknown if snr is None else from_decibels(column(snr)),
    }
    point_dtype = (filled or clouds)[0].points.dtype
    used_names = {*columns, *_XYZ, radial_velocity_field, snr}
    for name in field_names:  # in file order: the order of a set changes from run to run
        if name[:1] != "_" and name not in used_names and not point_dtype[field_names[name]].shape:
            columns[name] = column(name)
    has_position = np.isfinite(columns["range"])  # the others pad an organised cloud
    if not has_position.all():  # copies take as long as all else
        columns = {name: values[has_position] for name, values in columns.items()}
    return xr.Dataset(
        {
            name: (
                "detection",
                values,
                {"units": UNITS[name]} if name in _COMPUTED else {},
            )
            for name, values in columns.items()
        }
    )


def _used_fields_findings(
    source: str, clouds: Sequence[PointCloud], fields: dict[str, str]
) -> tuple[Finding, ...]:
    """Report the fields that were used, and the coordinate frames."""
    used_fields = []
    velocity_fields = _find_velocity_fields(fields)
    for quantity, candidates in (("velocity", velocity_fields), ("snr in dB", _SNRS)):
        field = next((fields[key] for key in candidates if key in fields), None)
        used_fields.append(f"no {quantity}" if field is None else f"{quantity} from {field}")
    if used_fields[0].endswith(" vx"):
        used_fields[0] += " and vy, along the line of sight"
    frame_ids = sorted({cloud.frame_id for cloud in clouds if cloud.frame_id})
    ids_text = ", ".join(map(repr, frame_ids[:12]))
    frame_text = f" (frame_id {ids_text})" if frame_ids else ""
    return (
        Finding(
            level="warning" if used_fields[0] == "no velocity" or len(frame_ids) > 1 else "note",
            setting="points",
            value=f"points of {source}{frame_text}, fields {', '.join(list(fields.values())[:30])};"
            f" {', '.join(used_fields)}",
            expected="one coordinate frame, x forward, y left, z up, and velocities along the line"
            " of sight, receding positive",
            fix="convert them if the driver of the radar uses other conventions",
        ),
    )


def _unread_topics_note(unread_topics: dict[str, str]) -> tuple[Finding, ...]:
    """Return a note on topics that were not read."""
    if not unread_topics:
        return ()
    return (
        Finding(
            level="note",
            setting="recording",
            value=f"other topics, not read: {_format_topics_with_types(unread_topics)}",
            expected="one topic of points",
            fix="append another topic to the recording, as in bag.mcap/front/radar",
        ),
    )


def _format_topics_with_types(topics: dict[str, str]) -> str:
    """Format topics with their types."""
    descriptions = [f"{topic} ({kind})" for topic, kind in sorted(topics.items())]
    more = f" and {len(descriptions) - 12} more" if len(descriptions) > 12 else ""
    return f"{', '.join(descriptions[:12]) or 'no messages'}{more}"
