"""Traces of ASAM OSI messages `SensorView` or `GroundTruth`: each after its length, or in MCAP."""

import math
import struct
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

from dechirp.core.errors import DechirpError, RecordingError
from dechirp.core.findings import Finding
from dechirp.core.mcap_messages import iter_mcap_messages
from dechirp.core.optional_imports import import_from_extra
from dechirp.traffic.base import CutTrafficError, ObjectKind, ObjectState, TrafficFormat

OSI_VERSION = 3
"""Major version of ASAM OSI."""
_LENGTH_PREFIX = struct.Struct("<I")
_MAX_MESSAGE_BYTES = 2**28
_MCAP_TYPES = ("protobuf/osi3.SensorView", "protobuf/osi3.GroundTruth")
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


class OsiTrace(TrafficFormat):
    """Moving and stationary objects of each message, and the host; requires the extra io."""

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """Return True for .mcap with such messages, and for .osi but for `SensorData`, _sd_."""
        if path.suffix.lower() == ".mcap":
            return _find_mcap_type(path) is not None
        return path.suffix.lower() == ".osi" and "_sd_" not in path.name

    def read_states(self, path: Path) -> Iterator[ObjectState]:
        """Yield the moving objects of all messages, and stationary ones that are new or changed."""
        last_s = -math.inf
        last_contents: dict[int, bytes] = {}
        for index, truth in enumerate(_iter_ground_truths(path)):
            time_s = truth.timestamp.seconds + truth.timestamp.nanos / 1e9
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
        """Return a note if the first message states no version of OSI."""
        for view, truth in _iter_views_and_truths(path):
            if not any(item.version.HasField("version_major") for item in (view, truth)):
                return (
                    Finding(
                        level="note",
                        setting="traffic.version",
                        value="the first message states no version of OSI",
                        expected=f"version {OSI_VERSION}",
                        fix=f"nothing to do: it is read as version {OSI_VERSION}",
                    ),
                )
            break
        return ()

    def read_host(self, path: Path) -> int | None:
        """Return the host vehicle of the first message."""
        for truth in _iter_ground_truths(path):
            return int(truth.host_vehicle_id.value) if truth.HasField("host_vehicle_id") else None
        return None


def foreign_osi_version(*messages: Any) -> str | None:
    """Return the version of OSI that a message states if it is not one that is read, else None."""
    for version in (message.version for message in messages):
        if version.HasField("version_major") and version.version_major != OSI_VERSION:
            return f"{version.version_major}.{version.version_minor}"
    return None


def _iter_ground_truths(path: Path) -> Iterator[Any]:
    """Yield the ground truth of each message, of a `SensorView` that inside it."""
    return (truth for _, truth in _iter_views_and_truths(path))


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
    is_view = None
    for index, content in enumerate(_iter_contents(path)):
        try:
            view = views.SensorView.FromString(content)
            if is_view is None:
                is_view = view.HasField("global_ground_truth")
            truth = view.global_ground_truth if is_view else truths.GroundTruth.FromString(content)
        except decode_error as error:
            raise _damaged_trace_error(path, index, error) from None
        outer = view if is_view else truth
        if (version := foreign_osi_version(outer, truth)) is not None:
            time_s = truth.timestamp.seconds + truth.timestamp.nanos / 1e9
            raise RecordingError(
                path,
                value=f"message {index}{first_object_text(truth)} at {time_s:g} s: OSI version"
                f" {version}",
                expected=f"version {OSI_VERSION}",
                fix=f"convert the trace to ASAM OSI {OSI_VERSION}",
            )
        yield outer, truth


def first_object_text(truth: Any) -> str:
    """Return words that name the first moving object of a ground truth; empty without one."""
    return f", with object {truth.moving_object[0].id.value}," if truth.moving_object else ""


def _iter_contents(path: Path) -> Iterator[bytes]:
    """Yield the bytes of each message."""
    if path.suffix.lower() == ".mcap":
        yield from _iter_mcap_contents(path)
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
    """Yield the messages of the first type of OSI in an MCAP file."""
    wanted = _find_mcap_type(path)
    index = 0
    try:
        for message in iter_mcap_messages(path):
            if message.type == wanted:
                yield bytes(message.data)
                index += 1
    except DechirpError:
        raise
    except Exception as error:  # the library raises any error for damaged bytes
        # Most recordings that were not closed end within a message.
        raise _damaged_trace_error(path, index, error, CutTrafficError) from None


def _find_mcap_type(path: Path) -> str | None:
    """Return the first type of OSI among the messages of an MCAP file, None without any."""
    try:
        messages = islice(iter_mcap_messages(path), _MAX_SEARCHED_MESSAGES)
        return next((message.type for message in messages if message.type in _MCAP_TYPES), None)
    except Exception:  # damaged, or without the extra io: for the reader of recordings to state
        return None


def _damaged_trace_error(
    path: Path, index: int, error: Exception, kind: type[RecordingError] = RecordingError
) -> RecordingError:
    return kind(
        path,
        value=f"message {index}: {type(error).__name__}: {error}",
        expected="a trace of SensorView or GroundTruth, each message after its length, or in MCAP",
        fix="record it again, or cut the file before this message",
    )


def state_of_moving_object(path: object, moving: Any, time_s: float) -> ObjectState:
    """Return the state in an `osi3` message of type `MovingObject`; `path` is for the error."""
    return _state_of_base(path, moving, time_s, _kind_of_object(moving))._replace(
        vx_m_per_s=_known_number(moving.base.velocity, "x"),
        vy_m_per_s=_known_number(moving.base.velocity, "y"),
    )


def state_of_stationary_object(path: object, stationary: Any, time_s: float) -> ObjectState:
    """Return the state in an `osi3` message of type `StationaryObject`; `path` is for the error.

    Barriers of metal are guard rails, along their longer side; structures of other types are walls.
    """
    classification = stationary.classification
    type_name = _enum_name(classification, "type")
    kind = _STRUCTURE_KINDS.get(type_name, "wall")
    if type_name == "TYPE_BARRIER" and _enum_name(classification, "material") == "MATERIAL_METAL":
        kind = "guard-rail"
    state = _state_of_base(path, stationary, time_s, kind)._replace(
        vx_m_per_s=0.0, vy_m_per_s=0.0, is_stationary=True
    )
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
        length_m=_known_number(base.dimension, "length"),
        width_m=_known_number(base.dimension, "width"),
        height_m=_known_number(base.dimension, "height"),
    )


def _known_number(message: Any, field: str) -> float:
    return float(getattr(message, field)) if message.HasField(field) else math.nan


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
