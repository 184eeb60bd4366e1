"""Traces of ASAM OSI messages `SensorView` or `GroundTruth`: each after its length, or in MCAP."""

import math
import struct
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

from dechirp.core.errors import DechirpError, RecordingError
from dechirp.core.mcap_messages import iter_mcap_messages
from dechirp.core.optional_imports import import_from_extra
from dechirp.traffic.base import CutTrafficError, ObjectKind, ObjectState, TrafficFormat

_LENGTH_PREFIX = struct.Struct("<I")
_MAX_MESSAGE_BYTES = 2**28
_MCAP_TYPES = ("protobuf/osi3.SensorView", "protobuf/osi3.GroundTruth")
_MAX_SEARCHED_MESSAGES = 1000  # before a recording counts as one without OSI
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
    """Moving objects of each message, with the host vehicle; requires the extra io."""

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """Return True for .mcap with such messages, and for .osi but for `SensorData`, _sd_."""
        if path.suffix.lower() == ".mcap":
            return _find_mcap_type(path) is not None
        return path.suffix.lower() == ".osi" and "_sd_" not in path.name

    def read_states(self, path: Path) -> Iterator[ObjectState]:
        """Yield the moving objects of all messages."""
        last_s = -math.inf
        for index, truth in enumerate(_iter_ground_truths(path)):
            time_s = truth.timestamp.seconds + truth.timestamp.nanos / 1e9
            if time_s < last_s:
                raise RecordingError(
                    path,
                    value=f"message {index}"
                    + (
                        f", with object {truth.moving_object[0].id.value},"
                        if truth.moving_object
                        else ""
                    )
                    + f" at {time_s:g} s after one at {last_s:g} s",
                    expected="times that ascend",
                    fix="sort the messages by time",
                )
            last_s = time_s
            for moving in truth.moving_object:
                yield state_of_moving_object(path, moving, time_s)

    def read_host(self, path: Path) -> int | None:
        """Return the host vehicle of the first message."""
        for truth in _iter_ground_truths(path):
            return int(truth.host_vehicle_id.value) if truth.HasField("host_vehicle_id") else None
        return None


def _iter_ground_truths(path: Path) -> Iterator[Any]:
    """Yield the ground truth of each message, of a `SensorView` that inside it."""
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
        yield truth


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
    base = moving.base
    if not base.HasField("position"):
        raise RecordingError(
            path,
            value=f"object {moving.id.value} at {time_s:g} s without a position",
            expected="base.position of every moving object",
            fix="record the trace with positions; if it is the object list of a sensor, read it"
            " with dechirp.object_lists.read_objects",
        )

    def known(message: Any, field: str) -> float:
        return getattr(message, field) if message.HasField(field) else math.nan

    return ObjectState(
        time_s=time_s,
        id=int(moving.id.value),
        kind=_kind_of_object(moving),
        x_m=base.position.x,
        y_m=base.position.y,
        z_m=base.position.z,
        heading_rad=known(base.orientation, "yaw"),
        vx_m_per_s=known(base.velocity, "x"),
        vy_m_per_s=known(base.velocity, "y"),
        length_m=known(base.dimension, "length"),
        width_m=known(base.dimension, "width"),
        height_m=known(base.dimension, "height"),
    )


def _kind_of_object(moving: Any) -> ObjectKind:
    kind = moving.DESCRIPTOR.enum_types_by_name["Type"].values_by_number[moving.type].name
    if kind == "TYPE_PEDESTRIAN":
        return "pedestrian"
    if kind != "TYPE_VEHICLE":
        return "other"
    classification = moving.vehicle_classification
    enum = classification.DESCRIPTOR.enum_types_by_name["Type"]
    return _VEHICLE_KINDS.get(enum.values_by_number[classification.type].name, "car")
