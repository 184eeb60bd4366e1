"""OSI views for tests: few vehicles on a plane."""

from typing import Any


def make_view(time_s: float, *objects: dict[str, Any]) -> Any:
    """Return a `SensorView` whose host is the first object, or the one that its `host` names.

    Objects have an id, x and y in m; optionally yaw, yaw_rate, vx, vy, length (None: no dimension),
    and rear, the vector from the centre of the box to the rear axle.
    """
    from osi3.osi_groundtruth_pb2 import GroundTruth
    from osi3.osi_sensorview_pb2 import SensorView

    view = SensorView()
    view.version.version_major, view.version.version_minor = 3, 7
    view.timestamp.seconds = int(time_s)
    view.timestamp.nanos = round((time_s - int(time_s)) * 1e9)
    truth: GroundTruth = view.global_ground_truth
    truth.timestamp.CopyFrom(view.timestamp)
    view.host_vehicle_id.value = truth.host_vehicle_id.value = objects[0].get(
        "host", objects[0]["id"]
    )
    for item in objects:
        moving = truth.moving_object.add()
        moving.id.value = item["id"]
        moving.type = moving.TYPE_VEHICLE
        moving.vehicle_classification.type = moving.VehicleClassification.TYPE_MEDIUM_CAR
        base = moving.base
        base.position.x, base.position.y, base.position.z = (
            item.get("x", 0.0),
            item.get("y", 0.0),
            0.75,
        )
        base.orientation.yaw = item.get("yaw", 0.0)
        if item.get("length", 4.5) is not None:
            base.dimension.length = item.get("length", 4.5)
            base.dimension.width, base.dimension.height = 1.8, 1.5
        for name, field in (("vx", "x"), ("vy", "y")):
            if name in item:
                setattr(base.velocity, field, item[name])
        if "yaw_rate" in item:
            base.orientation_rate.yaw = item["yaw_rate"]
        if "rear" in item:
            rear = moving.vehicle_attributes.bbcenter_to_rear
            rear.x, rear.y, rear.z = item["rear"]
    return view
