"""Radar in traffic: frames simulated one at a time, and detections compared with the objects."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import xarray as xr

from dechirp.core.findings import Finding
from dechirp.evaluation.association import Associator
from dechirp.evaluation.body_echoes import find_body_echo
from dechirp.experiments.scenario import Scenario
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.scene.truth import truth
from dechirp.simulation.frame_by_frame import FrameSimulator
from dechirp.simulation.impairments.interference import Interference
from dechirp.traffic.outlines import QUARTER_TURN, nearest_point_m, rectangle_corners_m
from dechirp.traffic.true_objects import find_true_objects


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
        self, rng: np.random.Generator | None, progress: Callable[[int, int], None]
    ) -> dict[str, np.ndarray]:
        """Draw the detections of all frames from their distribution, without samples.

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
            progress(number + 1, self.n_frames)
        return {name: np.concatenate([frame[name] for frame in frames]) for name in frames[0]}

    def _frame_rng(self, number: int) -> np.random.Generator:
        """Return the random generator of a frame, which depends on the seed and its number."""
        key = (number,) if number else ()
        return np.random.default_rng(np.random.SeedSequence(self._scenario.seed, spawn_key=key))

    def truth(self, number: int, scene: Scene, radar: Radar | None = None) -> xr.Dataset:
        """Return the truth about the origins of the objects of a frame, (target, frame).

        Times are those of the scene, which count from the start of the frame.
        """
        radar = (radar or self.radar).for_frame(number)
        return truth(scene, radar).assign_coords(frame=[number])

    def compare_with_objects(self, detections: xr.Dataset) -> xr.Dataset:
        """Return the true objects of all frames with their detections.

        Adds to `find_true_objects`, over (target, frame): `n_detections`, those within two cells of
        a visible scatterer of the object, with aliasing and unknown directions as for other scenes;
        of the echo of the body, see `evaluation.body_echoes`, `position_error` (m), its distance
        from the outline, and `velocity_error` (m/s), its velocity minus the range rate of that
        point of the outline.
        """
        objects = find_true_objects(self.scenes, range(self.n_frames))
        row_of_name = {name: row for row, name in enumerate(objects["target"].values.tolist())}
        shape = (len(row_of_name), self.n_frames)
        n_detections = np.where(np.isfinite(objects["range"].values), 0.0, np.nan)
        position_error_m, velocity_error = np.full(shape, np.nan), np.full(shape, np.nan)
        columns = {str(name): column.values for name, column in detections.items()}
        for number in range(self.n_frames):
            in_frame = np.flatnonzero(columns["frame"] == number)
            scene = self.scenes.scene(number)
            if not (in_frame.size and scene.targets):
                continue
            of_frame = {name: column[in_frame] for name, column in columns.items()}
            associator = Associator(self.truth(number, scene), self.radar.for_frame(number), scene)
            owners = associator.nearest_target_indices(of_frame)
            for target, name in enumerate(scene.names):
                row = row_of_name.get(name)
                if row is None:  # a structure
                    continue
                rows = {key: column[owners == target] for key, column in of_frame.items()}
                n_detections[row, number] = rows["snr"].size
                errors = _errors_of_body(rows, objects.isel(target=row, frame=number))
                position_error_m[row, number], velocity_error[row, number] = errors
        axes = ("target", "frame")
        return objects.assign(
            n_detections=(axes, n_detections, {"units": "1"}),
            position_error=(axes, position_error_m, {"units": "m"}),
            velocity_error=(axes, velocity_error, {"units": "m/s"}),
        )


def _errors_of_body(columns: dict[str, np.ndarray], item: xr.Dataset) -> tuple[float, float]:
    """Return position and velocity error of the echo of the body, NaN where it is unknown."""
    echo = find_body_echo(columns)
    if echo is None:
        return np.nan, np.nan
    range_m, azimuth_rad = columns["range"][echo.row], columns["azimuth"][echo.row]
    detection_m = range_m * np.array([np.cos(azimuth_rad), np.sin(azimuth_rad)])
    point_m = nearest_point_m(
        rectangle_corners_m(
            np.array([float(item["centre_x"]), float(item["centre_y"])]) - detection_m,
            float(item["heading"]),
            float(item["length"]),
            float(item["width"]),
        )
    )
    error_m, point_m = float(np.linalg.norm(point_m)), point_m + detection_m
    arm_m = point_m - [float(item["x"]), float(item["y"])]
    velocity = np.array([float(item["vx"]), float(item["vy"])])
    velocity += float(item["turn_rate"]) * QUARTER_TURN @ arm_m
    range_rate = float(point_m @ velocity) / float(np.linalg.norm(point_m))
    return error_m, echo.velocity_m_per_s - range_rate
