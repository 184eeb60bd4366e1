"""Run of several radars on one vehicle: results of each, and fused tracks over the ground."""

from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from time import perf_counter
from typing import Literal

import numpy as np
import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding, capture_warned_findings
from dechirp.core.values import frozen_dataclass
from dechirp.evaluation.traffic_scores import MAX_AZIMUTH_RAD, demanded_object_mask
from dechirp.experiments.object_stage import drop_static_rows_and_unresolved_velocities
from dechirp.experiments.run import Result, run
from dechirp.experiments.scenario import Scenario, prefix_setting_of_errors
from dechirp.experiments.single_radars import SingleRadar, split_radars
from dechirp.experiments.study.executors import local_workers, workers_from_executor
from dechirp.experiments.traffic_stage import TrafficFrames, mark_tracks_on_structures
from dechirp.tracking.fusion import RadarDetections, fuse_detections
from dechirp.tracking.poses import RadarPose
from dechirp.traffic.mounting import Mounting
from dechirp.traffic.outlines import QUARTER_TURN, rotation

Kind = Literal["samples", "statistical"]


@frozen_dataclass
class RadarsResult:
    """Results of several radars on one vehicle."""

    scenario: Scenario
    radars: Mapping[str, Result]
    """Result of each radar by its name, in its own coordinates and times, without tracks."""
    mountings: Mapping[str, Mounting]
    """Pose of each radar on the vehicle."""
    poses: Mapping[str, tuple[RadarPose, ...]]
    """Pose of each radar over the ground, in each of its frames."""
    tracks: xr.Dataset | None
    """Fused tracks over the ground, see `fuse_detections`: in the axes of the traffic file, or of
    the scene. Times count from the start of the run. None without a tracker."""
    objects: xr.Dataset | None
    """True objects in traffic over (target, frame), the frames of `tracks`, over the ground: `x y
    vx vy` of the point of the outline nearest to the radar, `centre_x centre_y heading`, and
    `in_view`: True if an object is in the view of any radar and at most half hidden."""
    findings: tuple[Finding, ...]
    timing_s: dict[str, float]


@check_argument_types
def run_radars(
    scenario: Scenario,
    *,
    kind: Kind = "samples",
    executor: Executor | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> RadarsResult:
    """Simulate and process several radars on one vehicle, and fuse their detections.

    Parameters
    ----------
    scenario : Scenario
        Its `radars` are simulated in its scene or traffic, each with its pose and clock, and with
        the interference by the chirps of the others on the direct path.
    kind : "samples" or "statistical"
        As for `run`.
    executor : Executor, optional
        Executor of `concurrent.futures` that runs the radars; default: one process per core. Equal
        results with each.
    progress : callable, optional
        Called with the number of finished radars and of all.

    Raises
    ------
    DechirpError
        If the scenario has no list of radars, or as `run`.

    Notes
    -----
    Poses of the radars are exact, as from an ideal navigation system. Targets are in the field of
    view of a radar within 60 degrees of its boresight and its largest range.
    """
    if not scenario.radars:
        raise InvalidSetting(
            "scenario.radars",
            value="empty",
            expected="a list of radars, each with its mount",
            fix="add radars, or call dechirp.run for a single one",
        )
    if scenario.group_tracker is not None:
        raise InvalidSetting(
            "group_tracker",
            value="given for several radars: it estimates the extent of an object from the points"
            " of one frame, and radars at different places receive different parts of the object",
            expected="tracker, which fuses the clusters or detections of all radars",
            fix="set group_tracker to null, and tracker for fused tracks; or run one radar at a"
            " time with group_tracker",
        )
    start_s = perf_counter()
    singles, findings = split_radars(scenario)
    workers = local_workers() if executor is None else workers_from_executor(executor)
    with workers as pool:
        futures = {
            name: pool.executor.submit(run, single.scenario, kind=kind)
            for name, single in singles.items()
        }
        results = {}
        for name, future in futures.items():
            with prefix_setting_of_errors(f"radars.{name}: "):
                results[name] = future.result()
            if progress is not None:
                progress(len(results), len(singles))
    radars_s = perf_counter()
    poses = {name: _poses(single, results[name]) for name, single in singles.items()}
    tracks, warned = None, []
    if scenario.tracker is not None:
        with (
            capture_warned_findings() as warned,
            prefix_setting_of_errors("tracker", instead_of="Tracker"),
        ):
            tracks = fuse_detections(
                [_detections(name, singles[name], results[name], poses[name]) for name in singles],
                scenario.tracker,
            )
        if scenario.traffic is not None:
            scenes = TrafficFrames(next(iter(singles.values())).scenario).scenes
            tracks = mark_tracks_on_structures(tracks, scenes)
    return RadarsResult(
        scenario=scenario,
        radars=results,
        mountings={name: single.mounting for name, single in singles.items()},
        poses=poses,
        tracks=tracks,
        objects=_objects_over_ground(singles, results, poses, tracks),
        findings=(*findings, *warned),
        timing_s={"radars": radars_s - start_s, "fusion": perf_counter() - radars_s},
    )


def _detections(
    name: str, single: SingleRadar, result: Result, poses: tuple[RadarPose, ...]
) -> RadarDetections:
    """Return the detections of a radar for fusion: clusters if there are any, moving ones alone."""
    rows = result.detections if result.clusters is None else result.clusters
    frame = result.radar.frame
    field_of_view_rad = result.scenario.chain.field_of_view.azimuth_rad
    return RadarDetections(
        name=name,
        detections=drop_static_rows_and_unresolved_velocities(rows, result.radar),
        times_s=_times_s(single, result),
        poses=poses,
        half_angle_rad=min(field_of_view_rad, MAX_AZIMUTH_RAD),
        max_range_m=frame.chirp.max_range_m,
        velocity_span_m_per_s=2 * frame.for_frame(0).max_velocity_m_per_s,
    )


def _times_s(single: SingleRadar, result: Result) -> tuple[float, ...]:
    """Return the middle of each frame since the start of the run."""
    return tuple(single.start_offset_s + time_s for time_s in result.times_s)


def _poses(single: SingleRadar, result: Result) -> tuple[RadarPose, ...]:
    """Return the pose of a radar over the ground in each frame."""
    scenario, times_s = single.scenario, np.array(result.times_s)
    if scenario.traffic is not None:
        traffic = TrafficFrames(scenario)
        return tuple(traffic.pose(number) for number in range(result.n_frames))
    assert scenario.scene is not None
    ego = scenario.scene.ego
    positions_m = np.array(ego.position_m) + ego.displacements_m(times_s)
    velocities = ego.velocities_m_per_s(times_s)
    return tuple(
        RadarPose(
            position_m=tuple(position_m[:2]),
            yaw_rad=ego.yaw_rad + ego.turn_rate_rad_per_s * time_s,
            velocity_m_per_s=tuple(velocity[:2]),
        )
        for position_m, velocity, time_s in zip(positions_m, velocities, times_s, strict=True)
    )


def _objects_over_ground(
    singles: Mapping[str, SingleRadar],
    results: Mapping[str, Result],
    poses: Mapping[str, tuple[RadarPose, ...]],
    tracks: xr.Dataset | None,
) -> xr.Dataset | None:
    """Return the true objects of all radars at the times of the tracks."""
    own_tables = {
        name: result.traffic for name, result in results.items() if result.traffic is not None
    }
    if tracks is None or len(own_tables) < len(results):
        return None
    tables = [
        _own_objects_over_ground(table, poses[name], _times_s(singles[name], results[name]))
        for name, table in own_tables.items()
    ]
    names = sorted({name for table in tables for name in table["target"].values.tolist()})
    times_s = tracks["time"].values
    merged: dict[str, np.ndarray] = {}
    for table in tables:
        # Frames of radars are at most a period apart: positions move on at their velocities.
        nearest = np.abs(table["time"].values[:, None] - times_s).argmin(axis=0)
        own = table.reindex(target=names).isel(frame=nearest)
        passed_s = times_s - table["time"].values[nearest]
        values = {str(name): column.values for name, column in own.items()}
        for axis in "xy":
            for name in (axis, f"centre_{axis}"):
                values[name] = values[name] + values[f"v{axis}"] * passed_s
        values["in_view"] = np.nan_to_num(values["in_view"])
        if not merged:
            merged = values
            continue
        is_better = values["in_view"] > merged["in_view"]
        is_better |= np.isnan(merged["x"]) & np.isfinite(values["x"])
        merged = {name: np.where(is_better, values[name], merged[name]) for name in merged}
    sizes = {
        size: np.nanmax(
            [table.reindex(target=names)[size].values for table in own_tables.values()], axis=0
        )
        for size in ("length", "width")
    }
    merged["in_view"] = merged["in_view"] > 0
    return xr.Dataset(
        {name: (("target", "frame"), values) for name, values in merged.items()}
        | {name: ("target", values, {"units": "m"}) for name, values in sizes.items()},
        coords={
            "target": np.array(names, dtype=str),
            "frame": tracks["frame"].values,
            "time": ("frame", times_s, {"units": "s"}),
        },
    )


def _own_objects_over_ground(
    objects: xr.Dataset, poses: tuple[RadarPose, ...], times_s: tuple[float, ...]
) -> xr.Dataset:
    """Return the objects of one radar in the axes of the ground, (target, frame)."""
    objects = objects.transpose("target", "frame")
    yaw_rad = np.array([pose.yaw_rad for pose in poses])
    turns = np.array([rotation(angle) for angle in yaw_rad])
    place_m = np.array([pose.position_m for pose in poses])
    own_velocity = np.array([pose.velocity_m_per_s for pose in poses])
    turn_rate = np.gradient(np.unwrap(yaw_rad), times_s) if len(times_s) > 1 else np.zeros(1)

    def to_ground(x: str, y: str) -> np.ndarray:
        vectors = np.stack([objects[x].values, objects[y].values], axis=-1)
        return np.einsum("fij,tfj->tfi", turns, vectors)

    arm_m, centre_m = to_ground("x", "y"), to_ground("centre_x", "centre_y")
    # Velocities of objects are those in axes that turn with the radar.
    velocity = to_ground("vx", "vy") + own_velocity
    velocity += turn_rate[:, None] * (arm_m @ QUARTER_TURN.T)
    columns = {
        "x": arm_m[..., 0] + place_m[:, 0],
        "y": arm_m[..., 1] + place_m[:, 1],
        "vx": velocity[..., 0],
        "vy": velocity[..., 1],
        "centre_x": centre_m[..., 0] + place_m[:, 0],
        "centre_y": centre_m[..., 1] + place_m[:, 1],
        "heading": objects["heading"].values + yaw_rad,
        "in_view": demanded_object_mask(objects).astype(float),
    }
    return xr.Dataset(
        {name: (("target", "frame"), column) for name, column in columns.items()},
        coords={"target": objects["target"].values, "time": ("frame", list(times_s))},
    )
