"""Sources of trials: scenes, which are simulated anew, and frames of recordings."""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from time import perf_counter
from typing import Protocol

import numpy as np
import xarray as xr

from dechirp.core.compiled_kernels import use_compiled_kernels
from dechirp.core.detection_columns import detections_from_columns
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import capture_warned_findings
from dechirp.core.threads import exclusive_single_thread
from dechirp.evaluation.association import Associator
from dechirp.evaluation.score.base import Score
from dechirp.evaluation.trial import NoiseMap, TrialContext, TrialResult
from dechirp.experiments.object_stage import estimate_ego_motion_clusters_tracks
from dechirp.experiments.recording_faults import repair_recording, treat_recording_faults
from dechirp.experiments.recording_stage import open_scenario_recording
from dechirp.experiments.run import label_frame_power_map
from dechirp.experiments.scenario import Scenario
from dechirp.experiments.study.block import Block, Failure
from dechirp.experiments.study.layout import ScoreColumnLayout
from dechirp.experiments.study.trial import TrialRunner
from dechirp.experiments.tune.tune import LabelledRecording
from dechirp.processing.detect import process_cubes, warn_about_dropped_peaks
from dechirp.processing.range_doppler_map import threshold_map
from dechirp.recordings.recording import Recording
from dechirp.scene.truth import truth


class _Runner(Protocol):
    layout: ScoreColumnLayout

    def run_and_score(self, trial: int) -> np.ndarray: ...


class RecordingTrialRunner:
    """Run the frames of a recording as trials: frame t of those that are read is trial t."""

    def __init__(self, recorded: LabelledRecording, scores: tuple[Score, ...]) -> None:
        self.recorded, self.scores = recorded, scores
        self.recording = _open_repaired_recording(recorded.scenario)
        self.radar = self.recording.radar
        self.chain = recorded.scenario.chain.fit_to_radar(self.radar)
        last = self.recording.frame_numbers[-1]
        self._truth = truth(recorded.truth, self.radar, n_frames=last + 1, noise_power_w=np.nan)
        first = self._context_of_frame_trial(0)
        for score in scores:
            _check_score_needs_single_frames(score)
            score.check_score_defined(first)
        self.layout = ScoreColumnLayout.from_context(scores, first)
        self._needs = frozenset().union(*(score.needs for score in scores))
        if "noise" in self._needs and recorded.empty_range_m is None:
            raise InvalidSetting(
                "recordings.empty_range",
                value="missing",
                expected="ranges without targets, to count false alarms in",
                fix="give empty_range: [20 m, 60 m], or remove false alarms from the objective",
            )

    def run_and_score(self, trial: int) -> np.ndarray:
        """Process one frame, and return its score sums, (n_columns,), see `ScoreColumnLayout`."""
        result, context = self._process_frame_as_trial(trial), self._context_of_frame_trial(trial)
        return np.concatenate([score.trial_sums(result, context).ravel() for score in self.scores])

    def _context_of_frame_trial(self, trial: int) -> TrialContext:
        frame_truth = self._truth.isel(frame=[self.recording.frame_numbers[trial]])
        return TrialContext(
            scene=self.recorded.truth,
            radar=self.radar,
            chain=self.chain,
            truth=frame_truth,
            noise_power_w=np.nan,
            times_s=frame_truth.time.values,
        )

    def _process_frame_as_trial(self, trial: int) -> TrialResult:
        number = self.recording.frame_numbers[trial]
        (cube,) = self.recording.select_frames(number, number + 1).frames()
        started = perf_counter()
        chain = self.chain.fit_to_radar(self.radar)
        (frame,) = process_cubes([cube], self.radar, chain, first_frame_number=number)
        warn_about_dropped_peaks(frame)
        rows = detections_from_columns(frame.detections)
        clusters = None
        if "clusters" in self._needs:
            untracked = replace(
                self.recorded.scenario, chain=self.chain, tracker=None, group_tracker=None
            )
            times_s = [float(time_s) for time_s in self._context_of_frame_trial(trial).times_s]
            rows, _, clusters, _, _ = estimate_ego_motion_clusters_tracks(
                rows, times_s, untracked, self.radar, first_frame=number
            )
        processing_s = perf_counter() - started
        columns = {str(name): column.values for name, column in rows.items()}
        context = self._context_of_frame_trial(trial)
        power = None
        if self._needs & {"maps", "noise"}:
            power = label_frame_power_map(frame.power, cube, number, self.radar, self.chain)
        return TrialResult(
            detections=columns,
            association=Associator(context.truth, self.radar, self.recorded.truth)(columns),
            maps=None if power is None else (power.values,),
            noise=self._count_alarms_in_empty_range(power, columns["range"], number)
            if "noise" in self._needs
            else None,
            clusters=clusters,
            processing_s=processing_s,
        )

    def _count_alarms_in_empty_range(
        self, power: xr.DataArray | None, detected_ranges_m: np.ndarray, frame_number: int
    ) -> NoiseMap:
        """Count alarms in the part of a frame's map that is known to be empty."""
        assert power is not None and self.recorded.empty_range_m is not None
        nearest_m, furthest_m = self.recorded.empty_range_m
        threshold = threshold_map(power, self.radar.for_frame(frame_number), self.chain)
        rows = (power.range.values >= nearest_m) & (power.range.values <= furthest_m)
        power_inside = power.transpose("velocity", "range").values[:, rows]
        threshold_inside = threshold.transpose("velocity", "range").values[:, rows]
        inside = (detected_ranges_m >= nearest_m) & (detected_ranges_m <= furthest_m)
        return NoiseMap(
            power=power_inside,
            n_tested=int(np.isfinite(threshold_inside).sum()),
            n_over=int((power_inside > threshold_inside).sum()),
            n_peaks=int(inside.sum()),
        )


def _open_repaired_recording(scenario: Scenario) -> Recording:
    """Open the recording of a scenario with its faults repaired as in `run`.

    A repair of bursts is a setting of the chain: candidates try it.
    """
    assert scenario.recording is not None
    recording = open_scenario_recording(scenario)
    treatment = treat_recording_faults(
        recording,
        scenario.chain,
        repairs_faults=scenario.recording.repair_faults,
        fits_chain=False,
    )
    return repair_recording(recording, treatment)


def _check_score_needs_single_frames(score: Score) -> None:
    """Raise `InvalidSetting` if a score cannot be computed from single frames of a recording."""
    if "tracks" in score.needs:
        requirement = "tracks"
    elif score.needs >= {"maps", "noise"}:
        requirement = "a map of noise in addition to that of targets"
    else:
        return
    raise InvalidSetting(
        "objective",
        value=f"{score.kind()}, of {requirement}",
        expected="scores of single frames, for recordings",
        fix="take scores of detections or clusters, or scenarios",
    )


def scenario_of_source(source: Scenario | LabelledRecording) -> Scenario:
    """Return the scenario of a source."""
    return source if isinstance(source, Scenario) else source.scenario


def source_with_scenario(
    source: Scenario | LabelledRecording, scenario: Scenario
) -> Scenario | LabelledRecording:
    """Return the source with another scenario."""
    return scenario if isinstance(source, Scenario) else replace(source, scenario=scenario)


def sum_scores_over_targets(layout: ScoreColumnLayout, sums: np.ndarray) -> np.ndarray:
    """Sum each score over all its targets, side by side, (n_trials, n)."""
    return np.hstack([layout.select_score_sums(sums, score.kind()) for score in layout.scores])


@lru_cache(maxsize=4)
def create_runner_of_source(
    source: Scenario | LabelledRecording, scores: tuple[Score, ...], seed: int
) -> _Runner:
    """Prepare a source for trials; cached, as blocks of one source follow each other."""
    if isinstance(source, Scenario):
        return TrialRunner(source, scores, seed=seed)
    return RecordingTrialRunner(source, scores)


def run_trial_block_of_source(
    source: Scenario | LabelledRecording,
    scores: tuple[Score, ...],
    seed: int,
    *,
    point: int,
    block_number: int,
    trials: range,
) -> Block:
    """Run a block of trials of a source on one thread; the sums cover all targets together.

    A trial that raises ends the block: settings that fail once are rejected.
    """
    n_sums = sum(score.n_sums for score in scores)
    sums = np.full((len(trials), n_sums), np.nan)
    failures: tuple[Failure, ...] = ()
    started = perf_counter()
    use_compiled_kernels()
    with exclusive_single_thread(), capture_warned_findings():
        for row, trial in enumerate(trials):
            try:
                runner = create_runner_of_source(source, scores, seed)
                sums[row] = sum_scores_over_targets(
                    runner.layout, runner.run_and_score(trial)[None]
                )
            except Exception as error:  # any error rejects the settings
                failures = (Failure(trial, f"{type(error).__name__}: {error}"),)
                break
    seconds = perf_counter() - started
    return Block(point, block_number, trials.start, sums, seconds, failures)


def n_frames_per_source_or_none(
    sources: Sequence[Scenario | LabelledRecording],
) -> tuple[int | None, ...]:
    """Return the number of frames of each recording; None for scenes, which have no limit."""
    return tuple(
        None if isinstance(source, Scenario) else open_scenario_recording(source.scenario).n_frames
        for source in sources
    )
