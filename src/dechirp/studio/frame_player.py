"""Frame states of a scenario, step by step, computed on the worker."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from dechirp.core.checks import check_integer
from dechirp.core.detection_columns import detections_from_columns
from dechirp.core.findings import Finding
from dechirp.core.threads import limit_threads
from dechirp.experiments.frame_totals import FrameTotals
from dechirp.experiments.object_stage import (
    estimate_ego_motion_and_clusters,
)
from dechirp.experiments.recording_stage import DetectedRecording
from dechirp.experiments.run import (
    DetectionRun,
    detection_findings,
    fitted_chain_findings,
    label_frame_power_map,
)
from dechirp.experiments.scenario import Scenario
from dechirp.processing.chain import Chain
from dechirp.processing.detect import process_cubes
from dechirp.processing.direction_finding import can_resolve_directions, checked_direction_aperture
from dechirp.processing.frame import FrameResult
from dechirp.processing.hidden_echoes import hidden_echo_findings, unsearched_echo_findings
from dechirp.processing.range_doppler_map import threshold_map
from dechirp.radar.radar import Radar
from dechirp.studio.cursor import Cursor, cursor_at_followed_detection
from dechirp.studio.frame_sources import (
    FrameSource,
    RecordingFrames,
    must_judge_again,
    open_frame_source,
)
from dechirp.studio.frame_state import FrameState
from dechirp.studio.history import FrameHistory, HistoryEntry
from dechirp.studio.option_hints import translate_finding_to_page
from dechirp.studio.scenario_edits import PageLimits
from dechirp.tracking.online import Track

_LIMITS = PageLimits()
_MAX_SMALL_FRAME_SAMPLES = 2**19
"""Samples of a frame up to which one thread computes it. On two cores a second one makes a frame of
393,216 samples 15 % faster alone, but takes 10 % more CPU time, which sending and drawing need:
17.4 maps/s with two threads, 18.8 with one."""


class FramePlayer:
    """Processed frames of a scenario.

    Step s shows frame s mod n of a scene or recording of n frames; the noise of a scene depends on
    the seed and s. Preparation is done at the first call. Tracks and micro-Doppler continue from
    step to step; they restart after a rewind or a jump, and at the end of the source.

    Frames of a recording have the velocities that `run` gives them from the ranges of targets in
    all frames, once `detect_in_all_frames` has measured these on another thread. `previous` is the
    player before a change of settings: ramps of a triangle that it chose are chosen here, too, and
    its findings on the scene are kept if all settings of the simulation are the same.
    """

    def __init__(
        self,
        scenario: Scenario,
        limits: PageLimits = _LIMITS,
        *,
        previous: "FramePlayer | None" = None,
    ) -> None:
        self._scenario, self._limits = scenario, limits
        self._chosen_ramps: _ChosenRamps | None = None
        if previous is not None and previous._scenario.recording == scenario.recording:
            self._chosen_ramps = previous._chosen_ramps
        self._previous_frames: FrameSource | None = None
        """Source of the previous player, until the own one is open."""
        if previous is not None:
            self._previous_frames = previous._frames or previous._previous_frames
        self._frames: FrameSource | None = None
        self._new_detections: DetectedRecording | None = None
        """Detections in all frames, until the next frame takes them over."""
        self._prepared: _PreparedScenario | None = None
        self._recent_steps: list[_ProcessedStep] = []

    def open_source(self) -> FrameSource:
        """Open the source of the frames, or return the open one.

        Raises
        ------
        DechirpError
            If it cannot be opened.
        """
        if self._frames is None:
            scenario = self._scenario
            if self._chosen_ramps is not None:
                scenario = self._chosen_ramps.apply_to_scenario(scenario)
            self._frames = open_frame_source(scenario, self._limits, self._previous_frames)
            self._previous_frames = None
        return self._frames

    def detect_in_all_frames(self, progress: Callable[[int, int], None]) -> None:
        """Measure the velocities and findings that all frames of a recording give together.

        For another thread, after `open_source`; scenes have nothing to measure. `progress` is
        called with the number of finished frames and of all.

        Raises
        ------
        DechirpError
            If a frame cannot be read.
        """
        source = self.open_source()
        if isinstance(source, RecordingFrames):
            self._new_detections = source.detect_in_frames(progress)

    def _take_over_new_detections(self) -> None:
        """Take over detections in all frames, with the ramps that were chosen for them."""
        detected, self._new_detections = self._new_detections, None
        if detected is None:
            return
        source = self.open_source()
        assert detected.scenario.recording is not None and source.scenario.recording is not None
        encoding = detected.scenario.recording.encoding
        if encoding is not None and encoding != source.scenario.recording.encoding:
            notes = tuple(entry for entry in detected.findings if entry.setting == "encoding")
            self._chosen_ramps = _ChosenRamps(encoding, notes)
            self._frames = self._prepared = None
        elif self._chosen_ramps is not None:
            detected = replace(
                detected, findings=(*self._chosen_ramps.findings, *detected.findings)
            )
        self._recent_steps = []
        if self._prepared is None:
            self._prepared = _PreparedScenario(self.open_source())
        self._prepared.detected = detected

    def process_frame_at_step(self, step: int, cursor: Cursor | None) -> FrameState:
        """Return the processed frame of a step.

        Raises
        ------
        DechirpError
            If a setting cannot work, or a frame cannot be read.
        """
        check_integer("step", step, at_least=0)
        if self.open_source().radar.n_samples_per_frame <= _MAX_SMALL_FRAME_SAMPLES:
            with limit_threads(1):
                return self._process_frame(step, cursor)
        frame_state = self._process_frame(step, cursor)
        _ = frame_state.azimuth_power  # takes too long for the thread that serves all pages
        return frame_state

    def _process_frame(self, step: int, cursor: Cursor | None) -> FrameState:
        self._take_over_new_detections()
        is_first = self._prepared is None
        if self._prepared is None:
            self._prepared = _PreparedScenario(self.open_source())
        prepared = self._prepared
        processed = next((recent for recent in self._recent_steps if recent.step == step), None)
        if processed is None:
            # No history continues after a failure.
            previous, self._recent_steps = (
                self._recent_steps[-1:],
                [],
            )
            continues = bool(previous) and step == previous[0].step + 1
            processed = prepared.process_step(step, follows_previous_step=continues)
            # Keep two: a paused page may already have requested the next one.
            self._recent_steps = [*previous, processed]
        state = FrameState(
            step=step,
            number=processed.number,
            n_frames=prepared.frames.n_frames,
            time_s=processed.time_s,
            radar=processed.radar,
            chain=prepared.chain,
            cursor=cursor or processed.followed,
            has_user_cursor=cursor is not None,
            samples=processed.samples,
            power=processed.power,
            resolves_azimuth=prepared.resolves_azimuth,
            history=processed.history,
            detections=processed.detections,
            clusters=processed.clusters,
            tracks=processed.tracks,
            truth=prepared.frames.truth(step),
            scene=prepared.frames.scene(step),
            findings=tuple(
                translate_finding_to_page(finding)
                for finding in (*prepared.findings, *processed.findings)
            ),
        )
        if is_first:  # compile here, for seconds, not when the page reads it
            _ = state.beat_and_spectrum, state.cuts_through_cursor, state.micro_doppler
            _ = state.azimuth_power
        return state


@dataclass(frozen=True)
class _ChosenRamps:
    """Ramps of a triangle that the ranges of moving targets choose, see `recording_stage`."""

    encoding: str
    findings: tuple[Finding, ...]

    def apply_to_scenario(self, scenario: Scenario) -> Scenario:
        """Return the scenario that reads these ramps."""
        assert scenario.recording is not None
        return replace(scenario, recording=replace(scenario.recording, encoding=self.encoding))


def calibrate_detector(source: FrameSource) -> None:
    """Calibrate the threshold factors of the detector of a source: seconds for some. They are kept.

    Another thread may call this while the worker computes frames.

    Raises
    ------
    InvalidSetting
        If a factor cannot be calibrated.
    """
    chain = source.scenario.chain.fit_to_radar(source.radar)
    chain.cfar.false_alarm_probability_error(chain.map_noise_statistics(source.radar))


@dataclass(frozen=True, eq=False)
class _ProcessedStep:
    """Results of a step that do not depend on the cursor."""

    step: int
    number: int
    time_s: float
    radar: Radar
    samples: xr.DataArray
    power: xr.DataArray
    followed: Cursor
    """Cell of the detection that the cursor follows."""
    detections: xr.Dataset
    clusters: xr.Dataset | None
    tracks: tuple[Track, ...]
    history: tuple[HistoryEntry, ...]
    """This frame and earlier ones."""
    findings: tuple[Finding, ...]


class _PreparedScenario:
    """Scenario prepared for processing, with the state kept from frame to frame."""

    def __init__(self, frames: FrameSource) -> None:
        self.frames, scenario, radar = frames, frames.scenario, frames.radar
        self.chain = scenario.chain.fit_to_radar(radar)
        self._chain_findings = fitted_chain_findings(scenario.chain, radar)
        self._counts = _DetectionCounts(radar, self.chain, frames.n_frames)
        self._hidden_echo_findings: tuple[Finding, ...] | None = None
        """Those of the first processed frame, as in `run`."""
        self.history = FrameHistory(scenario, radar)
        self._scenario = scenario
        self.detected: DetectedRecording | None = None
        """Detections in all frames of a recording, once they are known."""
        self._followed: Cursor | None = None
        """Cursor of the last frame."""
        self.resolves_azimuth = (
            can_resolve_directions(radar)
            and checked_direction_aperture(
                radar, self.chain.field_of_view
            ).resolves_azimuth_and_elevation[0]
        )

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings on the source, the chain, the frames processed so far, and the first of them."""
        return (
            *self.frames.findings,
            *(self.detected.findings if self.detected is not None else ()),
            *self._chain_findings,
            *self._counts.findings(),
            *(self._hidden_echo_findings or ()),
        )

    def process_step(self, step: int, *, follows_previous_step: bool) -> _ProcessedStep:
        cube, number = self.frames.cube(step), self.frames.frame_number(step)
        radar = self.frames.radar.for_frame(number)
        frame = self.frames.radar.frame
        start_s = cube.frame.item() if "frame" in cube.coords else frame.frame_start_s(number)
        time_s = start_s + radar.frame.mid_frame_s
        if not (follows_previous_step and self.history.is_after_last_frame(time_s)):
            self.history.reset()
        samples = cube.isel(frame=0)
        (result,) = process_cubes([cube], self.frames.radar, self.chain, first_frame_number=number)
        detections = detections_from_columns(self._columns_of_frame(number, result))
        self._counts.add_frame(number, result, detections)
        # Copy: the map may be a view of a larger array.
        power_values = tuple(part.copy() for part in result.equalised_power)
        power = label_frame_power_map(power_values, cube, number, self.frames.radar, self.chain)
        if self._hidden_echo_findings is None:
            threshold = threshold_map(power, radar, self.chain)
            self._hidden_echo_findings = (
                *hidden_echo_findings(power, threshold, radar, self.chain),
                *unsearched_echo_findings(
                    power,
                    threshold,
                    radar,
                    self.chain,
                    is_recorded=self._scenario.recording is not None,
                ),
            )
        grouped = estimate_ego_motion_and_clusters(detections, self._scenario, self.frames.radar)
        peak = cursor_at_followed_detection(
            power, detections, radar, self._followed if self.history.frames else None
        )
        self._followed = peak
        tracks = self.history.update_tracks(
            grouped.rows_to_track(self._scenario, self.frames.radar), time_s
        )
        self.history.store_frame_map(power, radar, time_s, peak.range_m)
        return _ProcessedStep(
            step=step,
            number=number,
            time_s=time_s,
            radar=radar,
            samples=samples,
            power=power,
            followed=peak,
            detections=grouped.detections,
            clusters=grouped.clusters,
            tracks=tracks,
            history=self.history.frames,
            findings=grouped.findings,
        )

    def _columns_of_frame(self, number: int, result: FrameResult) -> Mapping[str, np.ndarray]:
        """Return the columns of a frame, with the velocities that all frames give it if known."""
        if self.detected is None:
            return result.detections
        columns = self.detected.columns
        rows = slice(*np.searchsorted(columns["frame"], [number, number + 1]))
        if len(columns["frame"][rows]) != len(result.detections["frame"]):  # not measured
            return result.detections
        return {name: column[rows] for name, column in columns.items()}


class _DetectionCounts:
    """Totals of `run` over the frames processed so far, each of which counts once."""

    def __init__(self, radar: Radar, chain: Chain, n_frames: int) -> None:
        self._radar, self._chain, self._totals = radar, chain, FrameTotals()
        self._n_frames = n_frames
        self._numbers: set[int] = set()
        self._findings: tuple[Finding, ...] = ()
        self._n_judged = 0
        self._nearest: xr.Dataset | None = None
        """Nearest detection with a direction, which determines the note on the near field."""
        self._nearest_m = np.inf

    def add_frame(self, number: int, result: FrameResult, detections: xr.Dataset) -> None:
        """Add a frame, unless it was added before."""
        if number in self._numbers:
            return
        self._numbers.add(number)
        self._totals.add_frame_result(result)
        has_angle = np.isfinite(detections.azimuth.values) | np.isfinite(
            detections.elevation.values
        )
        ranges_m = np.where(has_angle, detections.range.values, np.inf)
        nearest_m = float(ranges_m.min(initial=np.inf))
        if self._nearest is None or nearest_m < self._nearest_m:
            self._nearest = detections.isel(detection=np.argsort(ranges_m)[:1])
            self._nearest_m = nearest_m

    def findings(self) -> tuple[Finding, ...]:
        """Return the findings on these frames: after all of them those of `run`."""
        n_shown = len(self._numbers)
        if self._nearest is not None and must_judge_again(n_shown, self._n_judged, self._n_frames):
            self._findings = detection_findings(
                DetectionRun(first_frame=0, detections=self._nearest, frames=self._totals),
                self._radar,
                self._chain,
            )
            self._n_judged = n_shown
        return self._findings
