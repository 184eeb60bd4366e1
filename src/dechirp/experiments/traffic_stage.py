"""Radar in traffic: frames simulated one at a time, and detections compared with the objects."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
import xarray as xr

from dechirp.core.findings import Finding
from dechirp.evaluation.association import nearest_target_indices
from dechirp.evaluation.body_echoes import BodyEcho, find_body_echo
from dechirp.experiments.scenario import Scenario
from dechirp.radar.budget import noise_power_w
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.scene.truth import echo_powers_w, truth
from dechirp.simulation.frame_by_frame import FrameSimulator
from dechirp.simulation.impairments.interference import Interference
from dechirp.tracking.poses import RadarPose
from dechirp.traffic.frame_scenes import FrameScenes
from dechirp.traffic.outlines import (
    QUARTER_TURN,
    distances_from_outlines_m,
    nearest_point_m,
    rectangle_corners_m,
    rotation,
)
from dechirp.traffic.road_bodies import Size
from dechirp.traffic.true_objects import ObjectState, TrueObjects

STRUCTURE_DISTANCE_M = 2.0
"""Largest distance of a track on a structure from its outline: errors of a track, and several parts
of a structure in one cluster."""


class TrafficFrames:
    """Frames of the radar of a scenario with traffic, simulated on demand.

    Each frame has a scene of its own, with the objects in view. Random numbers depend on the seed
    and the number of the frame.
    """

    def __init__(self, scenario: Scenario) -> None:
        assert scenario.traffic is not None and scenario.radar is not None
        self._scenario, self.radar = scenario, scenario.radar
        self.scenes = scenario.traffic.open_scenes(self.radar)
        self.n_frames = self.scenes.n_frames

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Return findings on the traffic, also in the frames simulated so far."""
        return self.scenes.findings

    def simulate_frame(
        self, number: int, scene: Scene, rng: np.random.Generator | None = None
    ) -> xr.DataArray:
        """Simulate the scene of one frame, (frame, chirp, rx, sample) with a single frame."""
        # Time zero of a scene is the start of its frame; that of interferers is frame 0.
        start_s = self.radar.frame.frame_start_s(number)
        simulator = FrameSimulator(
            scene,
            self.radar.for_frame(number),
            impairments=[
                stage.delayed(-start_s) if isinstance(stage, Interference) else stage
                for stage in self._scenario.impairments
            ],
            engine=self._scenario.engine,
        )
        return simulator.simulate_frame(0, rng or self._frame_rng(number)).assign_coords(
            frame=[start_s]
        )

    def cubes(
        self, rng: np.random.Generator | None, progress: Callable[[int, int], None]
    ) -> Iterator[xr.DataArray]:
        """Yield the samples of all frames, of which one at a time is in memory."""
        for number in range(self.n_frames):
            yield self.simulate_frame(number, self.scenes.scene(number), rng)
            progress(number + 1, self.n_frames)

    def mid_frame_s(self, number: int) -> float:
        """Return the middle of a frame since the start of the first one, as `detect` has it."""
        return (
            self.radar.frame.frame_start_s(number) + self.radar.for_frame(number).frame.mid_frame_s
        )

    def draw_detections(
        self,
        rng: np.random.Generator | None,
        progress: Callable[[int, int], None],
        comparison: "ObjectComparison",
    ) -> dict[str, np.ndarray]:
        """Draw the detections of all frames from their distribution, and compare them.

        Raises
        ------
        InvalidSetting
            If the statistical sensor does not model the radar.
        """
        from dechirp.experiments.statistical.sensor import StatisticalSensor

        sensor = StatisticalSensor(
            replace(self._scenario, traffic=None, scene=Scene(), tracker=None, n_frames=1)
        )
        frames = []
        for number in range(self.n_frames):
            scene = self.scenes.scene(number)
            columns = sensor.draw_frame_detections(scene, rng or self._frame_rng(number))
            n_rows = columns["range"].size
            columns["frame"] = np.full(n_rows, number)
            columns["time"] = np.full(n_rows, self.mid_frame_s(number))
            frames.append(columns)
            comparison.add_frame(number, scene, columns)
            progress(number + 1, self.n_frames)
        return {name: np.concatenate([frame[name] for frame in frames]) for name in frames[0]}

    def _frame_rng(self, number: int) -> np.random.Generator:
        """Return the random generator of a frame, which depends on the seed and its number."""
        key = (number,) if number else ()
        return np.random.default_rng(np.random.SeedSequence(self._scenario.seed, spawn_key=key))

    def pose(self, number: int) -> RadarPose:
        """Return the pose of the radar over the ground at mid-frame."""
        motion = self.scenes.radar_motion(number)
        return RadarPose(
            position_m=tuple(motion.position_m[:2]),
            yaw_rad=motion.yaw_rad,
            velocity_m_per_s=tuple(motion.velocity_m_per_s),
        )

    def truth(self, number: int, scene: Scene, radar: Radar | None = None) -> xr.Dataset:
        """Return the truth about the origins of the objects of a frame, (target, frame).

        Times are those of the scene, which count from the start of the frame.
        """
        radar = (radar or self.radar).for_frame(number)
        return truth(scene, radar).assign_coords(frame=[number])


def mark_tracks_on_structures(
    tracks: xr.Dataset, scenes: FrameScenes, poses: Sequence[RadarPose] | None = None
) -> xr.Dataset:
    """Add the column `on_structure`, (track, frame): True within 2 m of the outline of a structure.

    `poses` are those of the coordinates of the tracks in each frame, over the ground; None: the
    tracks are over the ground.
    """
    tracks = tracks.transpose("track", "frame", ...)
    positions_m = np.stack([tracks["x"].values, tracks["y"].values], axis=-1)
    if poses is not None:
        turns = np.array([rotation(pose.yaw_rad) for pose in poses]).reshape(-1, 2, 2)
        places_m = np.array([pose.position_m for pose in poses]).reshape(-1, 2)
        positions_m = np.einsum("fij,tfj->tfi", turns, positions_m) + places_m
    distances_m = distances_from_outlines_m(positions_m, scenes.structure_outlines_m())
    return tracks.assign(on_structure=(("track", "frame"), distances_m <= STRUCTURE_DISTANCE_M))


class ObjectComparison:
    """Comparison of detections with the objects of traffic, frame by frame."""

    def __init__(self, traffic: TrafficFrames) -> None:
        self._traffic = traffic
        self._objects = TrueObjects(traffic.scenes)
        self._columns: list[dict[str, tuple[float, float, float]]] = []

    def add_frame(self, number: int, scene: Scene, columns: Mapping[str, np.ndarray]) -> None:
        """Compare the detections of the next frame with the objects of its scene."""
        states = self._objects.add_frame(number)
        radar = self._traffic.radar.for_frame(number)
        owners = nearest_target_indices(columns, scene, radar)
        mean_snr = _mean_snr_of_targets(scene, radar)
        comparisons = {}
        for target, name in enumerate(scene.names):
            if name not in states:  # a structure
                continue
            rows = {key: column[owners == target] for key, column in columns.items()}
            echo = find_body_echo(rows, mean_snr[target])
            errors = (
                (np.nan, np.nan) if echo is None else _errors_of_body(echo, rows, *states[name])
            )
            comparisons[name] = (float(rows["snr"].size), *errors)
        self._columns.append(comparisons)

    def add_all_frames(self, columns: Mapping[str, np.ndarray]) -> None:
        """Compare the detections of all frames, in the order of their frames."""
        n_frames = self._traffic.n_frames
        first_rows = np.searchsorted(columns["frame"], np.arange(n_frames + 1))
        for number in range(n_frames):
            rows = slice(*first_rows[number : number + 2])
            of_frame = {name: column[rows] for name, column in columns.items()}
            self.add_frame(number, self._traffic.scenes.scene(number), of_frame)

    def to_dataset(self) -> xr.Dataset:
        """Return the true objects of all frames with their detections.

        Adds to `find_true_objects`, over (target, frame): `n_detections`, those within two cells of
        a visible scatterer of the object, with aliasing and unknown directions as for other scenes;
        of the echo of the body, see `evaluation.body_echoes`, `position_error` (m), its distance
        from the outline, and `velocity_error` (m/s), its velocity minus the range rate of that
        point of the outline.
        """
        objects = self._objects.to_dataset()
        row_of_name = {name: row for row, name in enumerate(objects["target"].values.tolist())}
        values = np.full((3, len(row_of_name), len(self._columns)), np.nan)
        for frame, comparisons in enumerate(self._columns):
            for name, comparison in comparisons.items():
                values[:, row_of_name[name], frame] = comparison
        units = {"n_detections": "1", "position_error": "m", "velocity_error": "m/s"}
        return objects.assign(
            {
                name: (("target", "frame"), column, {"units": unit})
                for (name, unit), column in zip(units.items(), values, strict=True)
            }
        )


def _mean_snr_of_targets(scene: Scene, radar: Radar) -> np.ndarray:
    """Return the mean SNR of the echoes of each target, (n,), NaN for a radar without hardware."""
    if radar.hardware is None:
        return np.full(len(scene.targets), np.nan)
    (power_w,) = echo_powers_w(scene, radar, [radar.frame.mid_frame_s])
    return np.asarray(power_w / noise_power_w(radar) * radar.integration_gain)


def _errors_of_body(
    echo: BodyEcho, columns: Mapping[str, np.ndarray], state: ObjectState, size: Size
) -> tuple[float, float]:
    """Return position and velocity error of the echo of a body; NaN for an unknown velocity."""
    range_m, azimuth_rad = columns["range"][echo.row], columns["azimuth"][echo.row]
    detection_m = range_m * np.array([np.cos(azimuth_rad), np.sin(azimuth_rad)])
    centre_m = np.array([state.centre_x, state.centre_y])
    point_m = nearest_point_m(
        rectangle_corners_m(centre_m - detection_m, state.heading, size.length_m, size.width_m)
    )
    error_m, point_m = float(np.linalg.norm(point_m)), point_m + detection_m
    velocity = np.array([state.vx, state.vy])
    velocity += state.turn_rate * QUARTER_TURN @ (point_m - [state.x, state.y])
    range_rate = float(point_m @ velocity) / float(np.linalg.norm(point_m))
    return error_m, echo.velocity_m_per_s - range_rate
