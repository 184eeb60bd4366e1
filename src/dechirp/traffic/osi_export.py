"""Traffic files as ASAM OSI messages: a `SensorView` for each step, as a simulator sends them."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.errors import InvalidSetting
from dechirp.core.optional_imports import import_from_extra
from dechirp.core.text import join_names
from dechirp.traffic.base import STRUCTURE_KINDS, ObjectKind
from dechirp.traffic.osi_trace import OSI_VERSION, STRUCTURE_TYPES, VEHICLE_TYPES
from dechirp.traffic.traffic import Traffic, open_traffic


@check_argument_types
def sensor_views(traffic: Traffic | str | Path, *, ego: int | None = None) -> Iterator[Any]:
    """Yield a `SensorView` of ASAM OSI for each step of a traffic file.

    Parameters
    ----------
    traffic : Traffic, str or Path
        What `open_traffic` returns, or the name of its file.
    ego : int, optional
        Id of the host vehicle; default: that of the file.

    Yields
    ------
    osi3.SensorView
        Ground truth of the objects present: pose, velocity, sizes as far as known, and class.
        Times count from the first step, so that Unix times fit as well. Steps without the host are
        left out.

    Raises
    ------
    InvalidSetting
        If the file contains no such vehicle.
    RecordingError
        As `open_traffic`.

    References
    ----------
    ASAM OSI 3.8, osi_sensorview.proto.
    """
    if not isinstance(traffic, Traffic):
        traffic = open_traffic(traffic)
    host = traffic.host if ego is None else ego
    numbers = traffic.objects["id"].values.tolist()
    if host not in numbers:
        raise InvalidSetting(
            "sensor_views.ego",
            value=host,
            expected=f"an object of the file: {join_names(list(map(str, numbers)), at_most=8)}",
            fix="choose the vehicle with the radar",
        )
    return _iter_views(traffic.objects, numbers.index(host))


def _iter_views(objects: xr.Dataset, host: int) -> Iterator[Any]:
    views = import_from_extra("io", "osi3.osi_sensorview_pb2", setting="traffic")
    columns = {str(name): column.values for name, column in objects.data_vars.items()}
    is_present = np.isfinite(columns["x"])
    kinds, numbers = objects["kind"].values.tolist(), objects["id"].values.tolist()
    times_s = objects["time"].values
    for step in np.flatnonzero(is_present[host]).tolist():
        view = views.SensorView()
        truth = view.global_ground_truth
        for message in (view, truth):
            message.version.version_major = OSI_VERSION
            nanos = round((times_s[step] - times_s[0]) * 1e9)
            message.timestamp.seconds, message.timestamp.nanos = divmod(nanos, 10**9)
            message.host_vehicle_id.value = numbers[host]
        for index in np.flatnonzero(is_present[:, step]).tolist():
            row = {
                name: float(column[index] if column.ndim == 1 else column[index, step])
                for name, column in columns.items()
                if column.dtype.kind == "f"
            }
            _add_object(truth, kinds[index], row).id.value = numbers[index]
        yield view


def _add_object(truth: Any, kind: ObjectKind, row: dict[str, float]) -> Any:
    """Add an object to a ground truth; return its message."""
    if kind in STRUCTURE_KINDS:
        item = truth.stationary_object.add()
        classification = item.classification
        if kind == "guard-rail":
            classification.type = classification.TYPE_BARRIER
            classification.material = classification.MATERIAL_METAL
        else:
            classification.type = getattr(classification, STRUCTURE_TYPES.get(kind, "TYPE_WALL"))
    else:
        item = truth.moving_object.add()
        item.base.velocity.x, item.base.velocity.y = row["vx"], row["vy"]
        if kind == "pedestrian":
            item.type = item.TYPE_PEDESTRIAN
        elif kind == "other":
            item.type = item.TYPE_OTHER
        else:
            item.type = item.TYPE_VEHICLE
            vehicle = item.vehicle_classification
            vehicle.type = getattr(vehicle, VEHICLE_TYPES[kind])
    base = item.base
    base.position.x, base.position.y = row["x"], row["y"]
    for message, field, name in (
        (base.position, "z", "z"),
        (base.orientation, "yaw", "heading"),
        *((base.dimension, name, name) for name in ("length", "width", "height")),
    ):
        if math.isfinite(row[name]):
            setattr(message, field, row[name])
    return item
