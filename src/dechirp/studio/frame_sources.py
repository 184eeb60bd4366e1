"""Sources of frames: a simulated scene, traffic or a recording."""

from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

import numpy as np
import xarray as xr

from dechirp.core.findings import Finding, capture_warned_findings
from dechirp.experiments.recording_stage import (
    DetectedRecording,
    detect_in_recording,
    open_scenario_recording,
    prepare_recording,
)
from dechirp.experiments.scenario import Scenario
from dechirp.experiments.traffic_stage import TrafficFrames
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.scene.truth import truth
from dechirp.simulation.frame_by_frame import FrameSimulator
from dechirp.simulation.simulate import build_stages_with_warnings
from dechirp.studio.option_hints import translate_error_fixes_to_page
from dechirp.studio.scenario_edits import PageLimits, check_settings_within_limits

# Frames in which all detections are measured at opening: some seconds of computing.
_MAX_DETECTED_SAMPLES, _MIN_DETECTED_FRAMES = 2**26, 32


class FrameSource(Protocol):
    """Sequence of frames with random access."""

    @property
    def scenario(self) -> Scenario:
        """Scenario whose chain processes the frames: that of a recording fits its samples."""
        ...

    @property
    def radar(self) -> Radar:
        """Radar of all frames."""
        ...

    @property
    def n_frames(self) -> int:
        """Number of frames before the source repeats."""
        ...

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings on the source as a whole, and on the samples of the frames shown so far."""
        ...

    def frame_number(self, step: int) -> int:
        """Return the number of the frame at a step."""
        ...

    def cube(self, step: int) -> xr.DataArray:
        """Return the samples (frame, chirp, rx, sample) of one frame."""
        ...

    def truth(self, step: int) -> xr.Dataset | None:
        """Return the truth of that frame over `target` and `frame`; None if unknown.

        Its times are those of the scene of the frame.
        """
        ...

    def scene(self, step: int) -> Scene | None:
        """Return the scene of that frame; None if unknown."""
        ...


def open_frame_source(
    scenario: Scenario, limits: PageLimits, previous: FrameSource | None = None
) -> FrameSource:
    """Open the frames of a scenario; raise as `dc.run` does if a setting is invalid.

    `previous` is the source before a change of settings: findings that cannot differ are kept.
    """
    if scenario.recording is not None:
        return RecordingFrames(scenario, limits)
    if scenario.traffic is not None:
        return FramesInTraffic(scenario)
    return SceneFrames(scenario, previous if isinstance(previous, SceneFrames) else None)


class SceneFrames:
    """Frames of a scene, simulated on demand.

    Random numbers depend on the seed and the step, so a step is reproducible bit by bit; step 0 is
    the frame of `dechirp run` with n_frames=1.
    """

    def __init__(self, scenario: Scenario, previous: "SceneFrames | None" = None) -> None:
        assert scenario.scene is not None and scenario.radar is not None
        self.scenario, self.radar, self.n_frames = scenario, scenario.radar, scenario.n_frames
        self._scene, self._seed = scenario.scene, scenario.seed
        self.findings: tuple[Finding, ...]
        if previous is not None and _simulated_settings(scenario) == _simulated_settings(
            previous.scenario
        ):
            self.findings = previous.findings  # judged at 33 instants: 30 ms of a change of 200
        else:
            with capture_warned_findings() as findings:
                build_stages_with_warnings(
                    scenario.impairments, self._scene, self.radar, n_frames=self.n_frames
                )
            self.findings = tuple(findings)
        self._frames = FrameSimulator(
            self._scene,
            self.radar,
            impairments=scenario.impairments,
            n_frames=self.n_frames,
            engine=scenario.engine,
        )
        # Without hardware and shadows, as no view shows SNR and shadow loss: 1.5 ms of 2.
        self._truth_radar = replace(self.radar, hardware=None)
        self._truth_scene = replace(self._scene, shadowing=False)

    def frame_number(self, step: int) -> int:
        return step % self.n_frames

    def cube(self, step: int) -> xr.DataArray:
        seed = np.random.SeedSequence(self._seed, spawn_key=(step,) if step else ())
        return self._frames.simulate_frame(self.frame_number(step), np.random.default_rng(seed))

    def truth(self, step: int) -> xr.Dataset:
        frame_number = self.frame_number(step)
        return truth(self._truth_scene, self._truth_radar, first_frame=frame_number)

    def scene(self, step: int) -> Scene:
        return self._scene


def _simulated_settings(scenario: Scenario) -> tuple[object, ...]:
    """Return the settings on which the findings before a simulation depend."""
    return scenario.scene, scenario.radar, scenario.impairments, scenario.n_frames


class FramesInTraffic:
    """Frames of a radar in traffic, simulated on demand as by `dechirp run`."""

    def __init__(self, scenario: Scenario) -> None:
        self._frames = TrafficFrames(scenario)
        self.scenario, self.radar = scenario, self._frames.radar
        self.n_frames = self._frames.n_frames
        self._truth_radar = replace(self.radar, hardware=None)
        self._scene_of_frame: tuple[int, Scene] | None = None

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings on the traffic, and on objects around the radar in the frames so far."""
        return self._frames.findings

    def frame_number(self, step: int) -> int:
        return step % self.n_frames

    def cube(self, step: int) -> xr.DataArray:
        return self._frames.simulate_frame(self.frame_number(step), self.scene(step))

    def truth(self, step: int) -> xr.Dataset:
        return self._frames.truth(self.frame_number(step), self.scene(step), self._truth_radar)

    def scene(self, step: int) -> Scene:
        """Return the scene of the frame, kept until another one is asked for."""
        number = self.frame_number(step)
        if self._scene_of_frame is None or self._scene_of_frame[0] != number:
            self._scene_of_frame = number, self._frames.scenes.scene(number)
        return self._scene_of_frame[1]


class RecordingFrames:
    """Frames of a recording, decoded and repaired on demand, with the chain fitted as in `run`.

    Their size is known only from the file, so the limits are checked here.
    """

    def __init__(self, scenario: Scenario, limits: PageLimits) -> None:
        with translate_error_fixes_to_page():
            recording = open_scenario_recording(scenario)
        check_settings_within_limits({"radar": recording.radar, "chain": scenario.chain}, limits)
        prepared = prepare_recording(recording, scenario)
        self.scenario, self._frames = prepared.scenario, prepared.frames
        self.radar, self.n_frames = self._frames.radar, recording.n_frames
        self._recording, self._given_scenario = recording, scenario
        self._numbers = recording.frame_numbers
        self._choices = (*recording.findings, *prepared.findings)
        self._findings: tuple[Finding, ...] = ()
        self._n_judged = -1

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings on the recording, and on its frames read so far: after all, those of `run`."""
        n_read = self._frames.n_measured
        if must_judge_again(n_read, self._n_judged, self.n_frames):
            on_samples = self._frames.findings() if n_read else ()
            self._findings = (*self._choices, *on_samples)
            self._n_judged = n_read
        return self._findings

    def frame_number(self, step: int) -> int:
        return self._numbers[step % self.n_frames]

    def cube(self, step: int) -> xr.DataArray:
        return self._frames.read_frame(self.frame_number(step))

    def detect_in_frames(self, progress: Callable[[int, int], None]) -> DetectedRecording:
        """Detect in all frames as `run` does, in the first ones of a long recording."""
        n_samples = self.radar.n_samples_per_frame
        n_frames = min(self.n_frames, max(_MIN_DETECTED_FRAMES, _MAX_DETECTED_SAMPLES // n_samples))
        first = self._numbers.start
        recording = self._recording.select_frames(first, first + n_frames)
        detected = detect_in_recording(recording, self._given_scenario, progress=progress)
        if n_frames == self.n_frames:
            return detected
        return replace(detected, findings=(*detected.findings, _first_frames_note(n_frames)))

    def truth(self, step: int) -> None:
        """Return None: the truth of a recording is unknown."""

    def scene(self, step: int) -> None:
        """Return None: a recording has no scene."""


def must_judge_again(n_shown: int, n_judged: int, n_frames: int) -> bool:
    """Return whether frames are 10 % more than at the last judgement, or complete since then.

    A judgement takes 2 ms and more: not after each of many frames.
    """
    return n_shown > 1.1 * n_judged or n_shown == n_frames > n_judged


def _first_frames_note(n_frames: int) -> Finding:
    return Finding(
        level="note",
        setting="recording.frames",
        value=f"velocities resolved by ranges in the first {n_frames} frames of a long recording",
        expected="frames of the length that this page computes in some seconds",
        fix="select other frames with --frames, or run the recording with dechirp run",
    )
