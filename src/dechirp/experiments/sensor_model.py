"""Sensor model for co-simulation: ASAM OSI `SensorView` in, `SensorData` out, step by step."""

import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Literal

import numpy as np
import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_integer
from dechirp.core.detection_columns import detections_from_columns
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding, PhysicsWarning, capture_warned_findings
from dechirp.core.text import format_number
from dechirp.core.values import frozen_dataclass
from dechirp.experiments.object_stage import (
    estimate_ego_motion_and_clusters,
    start_live_tracker,
)
from dechirp.experiments.scenario import Scenario, check_single_radar
from dechirp.experiments.statistical.sensor import StatisticalSensor
from dechirp.processing.chain import Chain
from dechirp.processing.cluster import Dbscan, Reach
from dechirp.processing.detect import process_cubes
from dechirp.radar.radar import Radar
from dechirp.results.object_lists.list_columns import COLUMNS, MEASURED, build_object_list
from dechirp.results.object_lists.object_list import object_list
from dechirp.results.object_lists.osi import osi_messages
from dechirp.scene.bodies.base import Body
from dechirp.scene.scene import Scene
from dechirp.simulation.simulate import simulate
from dechirp.tracking.groups import GroupTrack
from dechirp.tracking.online import Track
from dechirp.tracking.tracker import Tracker
from dechirp.traffic.base import STRUCTURE_KINDS
from dechirp.traffic.mounting import Mounting, mounting_on_vehicle
from dechirp.traffic.osi_views import OsiViews, View, ViewedObject
from dechirp.traffic.outlines import contains_origin, nearest_point_m, rotation
from dechirp.traffic.radar_scene import (
    MovingBody,
    RadarMotion,
    build_scene_around_radar,
    cut_to_range,
    is_below_body,
    motion_of_mounted_radar,
    outline_around_radar_m,
)
from dechirp.traffic.road_bodies import body_of_object

Kind = Literal["samples", "statistical"]

# Spread of the echo's position on a vehicle, and the acceleration of traffic. For 50 tracks, filter
# and association take 19 ms a frame, the default ones 90.
_TRAFFIC_TRACKER = Tracker(
    filter="extended", association="nearest", target_size_m=2.0, process_noise_m2_per_s3=4.0
)
_TRAFFIC_CLUSTERS = Dbscan(reach=Reach(range=8.0, velocity=4.0))


@frozen_dataclass
class SensorStep:
    """Results of one step of a sensor model."""

    time_s: float
    detections: xr.Dataset
    """Over `detection`, in the coordinates of the radar, as `detect` returns them."""
    tracks: tuple[Track, ...]
    """Tentative and confirmed tracks, relative to the radar; none without a tracker."""
    objects: xr.Dataset
    """Object list of tracks and detections, see `object_list`."""
    scene: Scene
    """Scene that the radar observed."""


class SensorModel:
    """Radar on the host vehicle of another simulator's world.

    Each view is the middle of one frame. Tracks, times and random numbers go on from step to step:
    the same views and seed yield the same data.

    Parameters
    ----------
    settings : Scenario or Radar
        Of a scenario radar, impairments, chain, ego motion, trackers and engine are used. A radar
        alone has the default chain with clusters, and a tracker if it measures azimuths.
    mount : str or Mounting, optional
        Place on the outline of the host, such as front or rear-left, or a pose. Default: that of
        the scenario's traffic, else the mounting position of the view, else the front.
    kind : "samples" or "statistical"
        Simulate and process samples, or draw detections from their distribution, which takes a
        fraction of the time; see `StatisticalSensor` for its approximations.
    seed : int, optional
        Seed of all random numbers; default: that of the scenario.
    sensor_id : int
        Id of the sensor in the data.

    Raises
    ------
    InvalidSetting
        If the scenario has no radar, there is no mounting of that name, or an extra is missing.
    """

    @check_argument_types
    def __init__(
        self,
        settings: Scenario | Radar,
        *,
        mount: str | Mounting | None = None,
        kind: Kind = "samples",
        seed: int | None = None,
        sensor_id: int = 0,
    ) -> None:
        scenario = _scenario_of_radar(settings) if isinstance(settings, Radar) else settings
        check_single_radar(scenario)
        if scenario.radar is None:
            raise InvalidSetting(
                "SensorModel.settings",
                value="a scenario without a radar",
                expected="a scenario whose radar observes the views",
                fix="add radar: its settings, or the name of their file",
            )
        if kind not in ("samples", "statistical"):
            raise InvalidSetting(
                "SensorModel.kind",
                value=repr(kind),
                expected="samples or statistical",
                fix="choose one of them",
            )
        if isinstance(mount, str):
            mounting_on_vehicle(mount, 1.0, 1.0)  # raises for an unknown name
        self.radar: Radar = scenario.radar
        self.findings: tuple[Finding, ...] = ()
        """Findings of all steps so far, each once; notes are here alone."""
        self._scenario, self._mount = scenario, mount or mount_of_traffic(scenario)
        self._seed = scenario.seed if seed is None else seed
        check_integer("SensorModel.seed", self._seed, at_least=0, at_most=2**63 - 1)
        check_integer("SensorModel.sensor_id", sensor_id, at_least=0, at_most=2**63 - 1)
        self._sensor_id = sensor_id
        self._chain = scenario.chain.fit_to_radar(self.radar)
        self._views, self._n_steps = OsiViews(), 0
        self._turns: dict[int, float] = {}
        self._objects_around_radar: set[int] = set()
        self._tracker = start_live_tracker(scenario, self.radar)
        self._statistical = None
        if kind == "statistical":
            self._statistical = StatisticalSensor(
                replace(
                    settings_without_scene(scenario),
                    tracker=None,
                    group_tracker=None,
                    n_frames=1,
                )
            )

    def step(self, view: Any) -> Any:
        """Return the `osi3.SensorData` of a view.

        Detections are `RadarDetection`s and `LogicalDetection`s, tracks `DetectedMovingObject`s, in
        the coordinates of the radar: x forward, y left, z up. In a `RadarDetection` the radial
        velocity is positive towards the sensor and the elevation downwards, as OSI defines them.

        Parameters
        ----------
        view : osi3.SensorView or bytes
            Ground truth at one time, later than the view before.

        Raises
        ------
        InvalidSetting
            If the view is damaged, time does not ascend, the host is missing, or an object has
            impossible numbers; the message contains its id and time, and the next view continues.

        Warns
        -----
        PhysicsWarning
            Of warnings among the findings on the views and the scene, each once.
        """
        read = self._views.read(view)
        mounting = self._mounting(read)
        result = self._measure(read, mounting)
        (message,) = osi_messages(result.objects)
        _set_sensor(message, self._sensor_id, mounting, read)
        return message

    def measure(self, view: Any) -> SensorStep:
        """Return detections, tracks and scene of a view, in place of the message of `step`."""
        read = self._views.read(view)
        return self._measure(read, self._mounting(read))

    def _mounting(self, view: View) -> Mounting:
        mount = self._mount or view.mounting or "front"
        if isinstance(mount, str):
            return mounting_on_vehicle(mount, view.host.size.length_m, view.host.size.width_m)
        return mount

    def _measure(self, view: View, mounting: Mounting) -> SensorStep:
        number = self._n_steps
        with capture_warned_findings() as warned:
            scene = self._build_scene(view, mounting, warned)
            self._views.accept()
            rng = np.random.default_rng([self._seed, number])
            columns = self._detect(scene, number, rng)
            n_rows = len(columns["range"])
            columns["frame"] = np.full(n_rows, number)
            columns["time"] = np.full(n_rows, view.time_s)
            detections = detections_from_columns(columns)
            tracks = self._track(detections, view.time_s)
            listed = object_list(detections, [view.time_s], first=number)
        self._n_steps += 1
        self._add_findings([*view.findings, *warned])
        return SensorStep(
            time_s=view.time_s,
            detections=detections,
            tracks=tracks,
            objects=_add_tracks(listed, tracks),
            scene=scene,
        )

    def _build_scene(self, view: View, mounting: Mounting, findings: list[Finding]) -> Scene:
        """Build the scene of objects within the largest range and in front of the antennas."""
        radar = motion_of_mounted_radar(view.host.motion, mounting)
        max_range_m = self.radar.frame.for_frame(self._n_steps).chirp.max_range_m
        bodies = []
        for viewed in (_cut_structure(item, radar, max_range_m) for item in view.objects):
            corners_m = outline_around_radar_m(viewed.motion, viewed.size, radar)
            body = self._body(viewed, view.time_s)
            if contains_origin(corners_m) and not is_below_body(body, viewed.motion, radar):
                if viewed.id not in self._objects_around_radar:
                    self._objects_around_radar.add(viewed.id)
                    findings.append(_radar_inside_finding(viewed, view.time_s))
                continue
            is_near = np.linalg.norm(nearest_point_m(corners_m)) < max_range_m
            if corners_m[:, 0].max() > 0 and is_near:
                bodies.append(MovingBody(viewed.name, viewed.motion, body))
        mid_s = self.radar.frame.for_frame(self._n_steps).mid_frame_s
        return build_scene_around_radar(radar, mounting, bodies, mid_s)

    def _body(self, viewed: ViewedObject, time_s: float) -> Body:
        """Return the body of an object, whose legs or pedals have moved on since the last view."""
        speed_m_per_s = float(
            rotation(viewed.motion.heading_rad)[:, 0] @ viewed.motion.velocity_m_per_s
        )

        def integrate_over_speed(rate_of_speed: Callable[[float], float]) -> float:
            turned = rate_of_speed(abs(speed_m_per_s)) * viewed.interval_s
            self._turns[viewed.id] = (self._turns.get(viewed.id, 0.0) + turned) % 1.0
            return self._turns[viewed.id]

        try:
            return body_of_object(viewed.kind, viewed.size, speed_m_per_s, integrate_over_speed)
        except InvalidSetting as error:
            (mistake,) = error.mistakes
            raise InvalidSetting(
                "SensorModel.view",
                value=f"object {viewed.id} at {time_s:g} s: {mistake.setting} {mistake.value}",
                expected=mistake.expected,
                fix="correct the size or the type of the object",
            ) from None

    def _detect(self, scene: Scene, number: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
        if self._statistical is not None:
            return self._statistical.draw_frame_detections(scene, rng)
        radar = self.radar.for_frame(number)
        cube = simulate(
            scene,
            radar,
            impairments=self._scenario.impairments,
            seed=rng,
            engine=self._scenario.engine,
        )
        (frame,) = process_cubes([cube], radar, self._chain)
        return dict(frame.detections)

    def _track(self, detections: xr.Dataset, time_s: float) -> tuple[Track, ...]:
        if self._tracker is None:
            return ()
        grouped = estimate_ego_motion_and_clusters(detections, self._scenario, self.radar)
        return self._tracker.step(grouped.rows_to_track(self._scenario, self.radar), time_s)

    def _add_findings(self, findings: list[Finding]) -> None:
        """Keep the findings that no step before has given; issue warnings among them."""
        reported = {(finding.setting, finding.expected) for finding in self.findings}
        for finding in findings:
            # Views give each finding once for an object, scenes again in every step.
            is_of_view = finding.setting.startswith("view.")
            if is_of_view or (finding.setting, finding.expected) not in reported:
                reported.add((finding.setting, finding.expected))
                self.findings += (finding,)
                if finding.level != "note":
                    warnings.warn(PhysicsWarning(finding), stacklevel=4)


def _cut_structure(viewed: ViewedObject, radar: RadarMotion, max_range_m: float) -> ViewedObject:
    if viewed.kind not in STRUCTURE_KINDS:
        return viewed
    motion, size = cut_to_range(viewed.motion, viewed.size, radar, max_range_m)
    return viewed._replace(motion=motion, size=size)


def _scenario_of_radar(radar: Radar) -> Scenario:
    has_azimuth = Chain().fit_to_radar(radar).angle is not None
    return Scenario(
        radar=radar,
        scene=Scene(),
        chain=Chain(cluster=_TRAFFIC_CLUSTERS),
        tracker=_TRAFFIC_TRACKER if has_azimuth else None,
    )


def mount_of_traffic(scenario: Scenario) -> str | Mounting | None:
    """Return place or pose of the radar in a scenario's traffic, None without traffic."""
    traffic = scenario.traffic
    return None if traffic is None else traffic.pose or traffic.mount


def settings_without_scene(scenario: Scenario) -> Scenario:
    """Return the settings of a scenario that a sensor model uses, with an empty scene."""
    return Scenario(
        name=scenario.name,
        seed=scenario.seed,
        radar=scenario.radar,
        scene=Scene(),
        engine=scenario.engine,
        impairments=scenario.impairments,
        chain=scenario.chain,
        ego_motion=scenario.ego_motion,
        tracker=scenario.tracker,
        group_tracker=scenario.group_tracker,
    )


def _radar_inside_finding(viewed: ViewedObject, time_s: float) -> Finding:
    return Finding(
        level="warning",
        setting="view.mounting_position",
        value=f"the radar is inside object {viewed.id} from {format_number(time_s)} s on",
        expected="a radar outside of all other objects",
        fix="move the radar, or remove what belongs to its vehicle; the object is left out",
    )


def _add_tracks(listed: xr.Dataset, tracks: tuple[Track, ...]) -> xr.Dataset:
    """Return the object list of one frame with its tracks first."""
    rows = {name: np.full(len(tracks), np.nan) for name in MEASURED}
    for index, track in enumerate(tracks):
        variances = np.maximum(np.diagonal(track.covariance), 0)  # rounding may go below
        for axis, name in enumerate(("x", "vx", "y", "vy")):
            rows[name][index] = track.state[axis]
            rows[f"{name}_std"][index] = np.sqrt(variances[axis])
        if isinstance(track, GroupTrack):
            rows["length"][index], rows["width"][index] = track.length_m, track.width_m
    frame, time_s = listed["cycle_frame"].values, listed["cycle_time"].values
    columns = {
        **rows,
        "frame": np.full(len(tracks), frame[0]),
        "time": np.full(len(tracks), time_s[0]),
        "number": np.array([track.number for track in tracks], int),
        "status": np.array([track.status for track in tracks], "U9"),
    }
    return build_object_list(
        {name: np.concatenate([columns[name], listed[name].values]) for name in COLUMNS},
        frame,
        time_s,
    )


def _set_sensor(message: Any, sensor_id: int, mounting: Mounting, view: View) -> None:
    """Set id and pose of the radar, from the rear axle of the host as OSI defines it."""
    x, y, z = np.array(mounting.position_m) - view.rear_axle_m
    z -= view.host.size.height_m / 2
    (radar,) = message.feature_data.radar_sensor
    message.sensor_id.value = radar.header.sensor_id.value = sensor_id
    for moving_object in message.moving_object:
        moving_object.header.sensor_id[0].value = sensor_id
    for pose in (message.mounting_position, radar.header.mounting_position):
        pose.position.x, pose.position.y, pose.position.z = x, y, z
        pose.orientation.yaw = mounting.yaw_rad
        pose.orientation.pitch = -mounting.pitch_rad  # that of OSI lowers the nose
        pose.orientation.roll = mounting.roll_rad
