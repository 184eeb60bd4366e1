"""Traces of ASAM OSI messages `SensorView` or `GroundTruth`: after their lengths, MCAP, text."""

import math
import struct
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any

from dechirp.core.errors import DechirpError, RecordingError
from dechirp.core.findings import Finding
from dechirp.core.mcap_messages import iter_mcap_messages
from dechirp.core.optional_imports import import_from_extra
from dechirp.core.text import join_names
from dechirp.traffic.base import CutTrafficError, ObjectKind, ObjectState, TrafficFormat

OSI_VERSION = 3
"""Major version of ASAM OSI."""
_LENGTH_PREFIX = struct.Struct("<I")
_MAX_MESSAGE_BYTES = 2**28
_MCAP_TYPES = ("protobuf/osi3.SensorView", "protobuf/osi3.GroundTruth")
_FLAT_HEIGHT_M = 0.01  # reflects and shadows next to nothing
_MAX_SEARCHED_MESSAGES = 1000  # before a recording counts as one without OSI
_STRUCTURE_KINDS: dict[str, ObjectKind] = {
    "TYPE_BUILDING": "building",
    "TYPE_POLE": "pole",
    "TYPE_PYLON": "pole",
    "TYPE_DELINEATOR": "pole",
    "TYPE_VERTICAL_STRUCTURE": "pole",
    "TYPE_TREE": "tree",
    "TYPE_VEGETATION": "hedge",
    "TYPE_BRIDGE": "overhead",
    "TYPE_OVERHEAD_STRUCTURE": "overhead",
}
_VEHICLE_KINDS: dict[str, ObjectKind] = {
    "TYPE_DELIVERY_VAN": "van",
    "TYPE_HEAVY_TRUCK": "truck",
    "TYPE_SEMITRACTOR": "truck",
    "TYPE_SEMITRAILER": "truck",
    "TYPE_TRAILER": "truck",
    "TYPE_BUS": "bus",
    "TYPE_MOTORBIKE": "motorcycle",
    "TYPE_BICYCLE": "bicyclist",
    "TYPE_TRAM": "other",
    "TYPE_TRAIN": "other",
    "TYPE_WHEELCHAIR": "other",
    "TYPE_STANDUP_SCOOTER": "other",
}
STRUCTURE_TYPES: dict[str, str] = {kind: name for name, kind in reversed(_STRUCTURE_KINDS.items())}
"""First type of stationary objects of each kind of structure; others are walls."""
VEHICLE_TYPES: dict[str, str] = {
    "car": "TYPE_MEDIUM_CAR",
    **{kind: name for name, kind in reversed(_VEHICLE_KINDS.items())},
}
"""First type of vehicles of each kind."""


class OsiTrace(TrafficFormat):
    """Moving and stationary objects of each message, and the host; requires the extra io."""

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """Return True for .mcap with such messages, .osi and .txth but for `SensorData`, _sd_."""
        if path.suffix.lower() == ".mcap":
            return bool(_find_mcap_channels(path))
        return path.suffix.lower() in (".osi", ".txth") and "_sd_" not in path.name

    def read_states(self, path: Path) -> Iterator[ObjectState]:
        """Yield the moving objects of all messages, and stationary ones that are new or changed."""
        last_s = -math.inf
        last_contents: dict[int, bytes] = {}
        for index, (outer, truth) in enumerate(_iter_views_and_truths(path)):
            time_s = _read_time_s(outer, truth)
            if time_s < last_s:
                raise RecordingError(
                    path,
                    value=f"message {index}{first_object_text(truth)} at {time_s:g} s after one at"
                    f" {last_s:g} s",
                    expected="times that ascend",
                    fix="sort the messages by time",
                )
            last_s = time_s
            for moving in truth.moving_object:
                yield state_of_moving_object(path, moving, time_s)
            for stationary in truth.stationary_object:
                content = stationary.SerializeToString()
                if last_contents.get(stationary.id.value) != content:
                    last_contents[stationary.id.value] = content
                    yield state_of_stationary_object(path, stationary, time_s)

    def read_findings(self, path: Path) -> tuple[Finding, ...]:
        """Return notes on a missing version of OSI, and on channels of MCAP that are not read."""
        findings = []
        channels = _find_mcap_channels(path) if path.suffix.lower() == ".mcap" else []
        if len(channels) > 1:
            findings.append(
                Finding(
                    level="note",
                    setting="traffic.path",
                    value=f"{len(channels)} channels of OSI, of which {channels[0][0]} is read:"
                    f" {join_names([topic for topic, _ in channels], at_most=4)}",
                    expected="one channel of SensorView or GroundTruth",
                    fix="nothing to do if all contain the same world; else filter the file",
                )
            )
        for view, truth in _iter_views_and_truths(path):
            if not any(item.version.HasField("version_major") for item in (view, truth)):
                findings.append(
                    Finding(
                        level="note",
                        setting="traffic.version",
                        value="the first message states no version of OSI",
                        expected=f"version {OSI_VERSION}",
                        fix=f"nothing to do: it is read as version {OSI_VERSION}",
                    )
                )
            break
        return tuple(findings)

    def read_host(self, path: Path) -> int | None:
        """Return the host vehicle of the first message."""
        for messages in _iter_views_and_truths(path):
            for message in messages:
                if message.HasField("host_vehicle_id"):
                    return int(message.host_vehicle_id.value)
            break
        return None


def foreign_osi_version(*messages: Any) -> str | None:
    """Return the version of OSI that a message states if it is not one that is read, else None."""
    for version in (message.version for message in messages):
        if version.HasField("version_major") and version.version_major != OSI_VERSION:
            return f"{version.version_major}.{version.version_minor}"
    return None


def _iter_views_and_truths(path: Path) -> Iterator[tuple[Any, Any]]:
    """Yield the outer message, and its ground truth, which is the same in traces of `GroundTruth`.

    Raises
    ------
    RecordingError
        If a message is damaged, or of another version, with its number, time and first object.
    """
    views = import_from_extra("io", "osi3.osi_sensorview_pb2", setting="traffic")
    truths = import_from_extra("io", "osi3.osi_groundtruth_pb2", setting="traffic")
    decode_error = import_from_extra("io", "google.protobuf.message", setting="traffic").DecodeError
    for index, content in enumerate(_iter_contents(path)):
        try:
            view = _parse_view(content, views.SensorView, decode_error)
            truth = (
                truths.GroundTruth.FromString(content) if view is None else view.global_ground_truth
            )
        except decode_error as error:
            raise _damaged_trace_error(path, index, error) from None
        outer = truth if view is None else view
        if (version := foreign_osi_version(outer, truth)) is not None:
            time_s = _read_time_s(outer, truth)
            raise RecordingError(
                path,
                value=f"message {index}{first_object_text(truth)} at {time_s:g} s: OSI version"
                f" {version}",
                expected=f"version {OSI_VERSION}",
                fix=f"convert the trace to ASAM OSI {OSI_VERSION}",
            )
        yield outer, truth


def _parse_view(content: bytes, view_type: Any, decode_error: type[Exception]) -> Any | None:
    """Return the `SensorView` in the bytes of a message, None if they are a `GroundTruth`.

    Both types decode most bytes of the other: traffic lights, field 7 of `GroundTruth`, are the
    ground truth of a `SensorView`. Only in the right type have its time or its objects values.
    """
    try:
        view = view_type.FromString(content)
    except decode_error:
        return None
    truth = view.global_ground_truth
    objects = (*truth.moving_object, *truth.stationary_object)
    is_view = _has_time(truth) or any(item.base.HasField("position") for item in objects)
    return view if is_view else None


def _has_time(message: Any) -> bool:
    return any(message.timestamp.HasField(field) for field in ("seconds", "nanos"))


def _read_time_s(outer: Any, truth: Any) -> float:
    """Return the time of the ground truth, or of the view around it if only that has one."""
    timestamp = (truth if _has_time(truth) else outer).timestamp
    return float(timestamp.seconds + timestamp.nanos / 1e9)


def first_object_text(truth: Any) -> str:
    """Return words that name the first moving object of a ground truth; empty without one."""
    return f", with object {truth.moving_object[0].id.value}," if truth.moving_object else ""


def _iter_contents(path: Path) -> Iterator[bytes]:
    """Yield the bytes of each message."""
    if path.suffix.lower() == ".mcap":
        yield from _iter_mcap_contents(path)
        return
    if path.suffix.lower() == ".txth":
        yield from _iter_text_contents(path)
        return
    index = 0
    with path.open("rb") as trace:
        while prefix := trace.read(_LENGTH_PREFIX.size):
            try:
                (n_bytes,) = _LENGTH_PREFIX.unpack(prefix)
            except struct.error as error:
                raise _damaged_trace_error(path, index, error, CutTrafficError) from None
            if n_bytes > _MAX_MESSAGE_BYTES:
                too_long = ValueError(f"a length of {n_bytes} bytes")
                raise _damaged_trace_error(path, index, too_long)
            content = trace.read(n_bytes)
            if len(content) < n_bytes:
                cut = ValueError(f"{len(content)} of {n_bytes} bytes")
                raise _damaged_trace_error(path, index, cut, CutTrafficError)
            yield content
            index += 1


def _iter_mcap_contents(path: Path) -> Iterator[bytes]:
    """Yield the messages of the first channel of OSI in an MCAP file.

    Others contain the same ground truth once more: the views of other sensors, or `GroundTruth`.
    """
    wanted = next(iter(_find_mcap_channels(path)), None)
    index = 0
    try:
        for message in iter_mcap_messages(path):
            if (message.topic, message.type) == wanted:
                yield bytes(message.data)
                index += 1
    except DechirpError:
        raise
    except Exception as error:  # the library raises any error for damaged bytes
        # Most recordings that were not closed end within a message.
        raise _damaged_trace_error(path, index, error, CutTrafficError) from None


def _iter_text_contents(path: Path) -> Iterator[bytes]:
    """Yield the bytes of each message of a text in the format of protocol buffers.

    A message begins at each line that equals the first one, mostly `version {`.
    """
    views = import_from_extra("io", "osi3.osi_sensorview_pb2", setting="traffic")
    truths = import_from_extra("io", "osi3.osi_groundtruth_pb2", setting="traffic")
    text_format = import_from_extra("io", "google.protobuf.text_format", setting="traffic")
    with path.open(encoding="utf-8", errors="replace") as file:
        for index, (text, is_last) in enumerate(_split_at_first_line(file)):
            is_view = "global_ground_truth" in text
            message = views.SensorView() if is_view else truths.GroundTruth()
            try:
                # Newer versions of OSI have fields that the installed one does not know.
                text_format.Parse(text, message, allow_unknown_field=True)
            except text_format.ParseError as error:
                kind = CutTrafficError if is_last and index else RecordingError
                raise _damaged_trace_error(path, index, error, kind) from None
            yield message.SerializeToString()


def _split_at_first_line(lines: Iterable[str]) -> Iterator[tuple[str, bool]]:
    """Yield the parts of a text, each from a line that equals the first one, and if it is last."""
    part: list[str] = []
    for line in lines:
        if part and line == part[0]:
            yield "".join(part), False
            part = []
        if part or line.strip():
            part.append(line)
    if part:
        yield "".join(part), True


def _find_mcap_channels(path: Path) -> list[tuple[str, str]]:
    """Return topic and type of the channels of OSI at the start of an MCAP file, in its order."""
    channels: dict[tuple[str, str], None] = {}
    try:
        for message in islice(iter_mcap_messages(path), _MAX_SEARCHED_MESSAGES):
            if message.type in _MCAP_TYPES:
                channels[message.topic, message.type] = None
    except Exception:  # damaged, or without the extra io: for the reader of recordings to state
        pass
    return list(channels)


def _damaged_trace_error(
    path: Path, index: int, error: Exception, kind: type[RecordingError] = RecordingError
) -> RecordingError:
    return kind(
        path,
        value=f"message {index}: {type(error).__name__}: {error}",
        expected="a trace of SensorView or GroundTruth: each message after its length, in MCAP,"
        " or as text (.txth)",
        fix="record it again, or cut the file before this message",
    )


def state_of_moving_object(path: object, moving: Any, time_s: float) -> ObjectState:
    """Return the state in an `osi3` message of type `MovingObject`; `path` is for the error."""
    velocity = moving.base.velocity
    state = _state_of_base(path, moving, time_s, _kind_of_object(moving))
    if not (velocity.HasField("x") or velocity.HasField("y")):
        return state._replace(vx_m_per_s=math.nan, vy_m_per_s=math.nan)
    return state._replace(vx_m_per_s=velocity.x, vy_m_per_s=velocity.y)  # 0 where it is not set


def state_of_stationary_object(path: object, stationary: Any, time_s: float) -> ObjectState:
    """Return the state in an `osi3` message of type `StationaryObject`; `path` is for the error.

    Barriers of metal are guard rails, along their longer side; structures of other types are walls,
    1 cm high if they state a height of 0, as crosswalks and parking spaces do.
    """
    classification = stationary.classification
    type_name = _enum_name(classification, "type")
    kind = _STRUCTURE_KINDS.get(type_name, "wall")
    if type_name == "TYPE_BARRIER" and _enum_name(classification, "material") == "MATERIAL_METAL":
        kind = "guard-rail"
    state = _state_of_base(path, stationary, time_s, kind)._replace(
        vx_m_per_s=0.0, vy_m_per_s=0.0, is_stationary=True
    )
    dimension = stationary.base.dimension
    is_flat = dimension.HasField("height") and dimension.height == 0
    if kind == "wall" and is_flat and (state.length_m > 0 or state.width_m > 0):
        return state._replace(height_m=_FLAT_HEIGHT_M)
    if kind == "guard-rail" and state.width_m > state.length_m:
        return state._replace(
            length_m=state.width_m,
            width_m=state.length_m,
            heading_rad=state.heading_rad + math.pi / 2,
        )
    return state


def _state_of_base(path: object, item: Any, time_s: float, kind: ObjectKind) -> ObjectState:
    base = item.base
    if not base.HasField("position"):
        raise RecordingError(
            path,
            value=f"object {item.id.value} at {time_s:g} s without a position",
            expected="base.position of every object",
            fix="record the trace with positions; if it is the object list of a sensor, read it"
            " with dechirp.object_lists.read_objects",
        )
    return ObjectState(
        time_s=time_s,
        id=int(item.id.value),
        kind=kind,
        x_m=base.position.x,
        y_m=base.position.y,
        z_m=base.position.z,
        heading_rad=_known_number(base.orientation, "yaw"),
        length_m=_known_size_m(base.dimension, "length"),
        width_m=_known_size_m(base.dimension, "width"),
        height_m=_known_size_m(base.dimension, "height"),
    )


def _known_number(message: Any, field: str) -> float:
    return float(getattr(message, field)) if message.HasField(field) else math.nan


def _known_size_m(dimension: Any, field: str) -> float:
    """Return a size, NaN of 0, which simulators write for a size that they do not know."""
    return _known_number(dimension, field) or math.nan


def _enum_name(message: Any, field: str) -> str:
    """Return the name of an enumeration value; empty if the installed OSI version has none."""
    enum = message.DESCRIPTOR.fields_by_name[field].enum_type
    value = enum.values_by_number.get(getattr(message, field))
    return "" if value is None else str(value.name)


def _kind_of_object(moving: Any) -> ObjectKind:
    kind = _enum_name(moving, "type")
    if kind == "TYPE_PEDESTRIAN":
        return "pedestrian"
    if kind != "TYPE_VEHICLE":
        return "other"
    return _VEHICLE_KINDS.get(_enum_name(moving.vehicle_classification, "type"), "car")
