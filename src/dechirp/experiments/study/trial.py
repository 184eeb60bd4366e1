"""Trials of a study: one trial of one point, and blocks of them."""

import warnings
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from functools import lru_cache
from time import perf_counter

import numpy as np
import xarray as xr

from dechirp.core.detection_columns import detections_from_columns
from dechirp.core.errors import DechirpError, InvalidSetting, Mistake
from dechirp.core.findings import Finding, PhysicsWarning, capture_warned_findings
from dechirp.core.threads import exclusive_single_thread
from dechirp.evaluation.association import Associator
from dechirp.evaluation.false_alarms import count_noise_alarms
from dechirp.evaluation.score.base import Need, Score
from dechirp.evaluation.trial import NoiseMap, TrialContext, TrialResult
from dechirp.experiments.object_stage import estimate_ego_motion_clusters_tracks
from dechirp.experiments.scenario import Scenario
from dechirp.experiments.statistical.sensor import StatisticalSensor
from dechirp.experiments.study.block import Block, Failure
from dechirp.experiments.study.data_set import (
    BlockWriter,
    DataSetWriter,
    point_scenario_and_coordinates,
)
from dechirp.experiments.study.layout import ScoreColumnLayout
from dechirp.experiments.study.plan import Plan
from dechirp.experiments.study.study import Requirement, StopRule
from dechirp.experiments.study.trial_context import build_trial_context
from dechirp.processing.detect import FrameProcessor, warn_about_dropped_peaks
from dechirp.processing.noise_maps import can_draw_noise_maps, draw_noise_map
from dechirp.scene.scene import Scene
from dechirp.simulation.monte_carlo import MonteCarloSimulator

NOISE_KEY = 2**31
"""Second spawn key of the noise-only map of a trial; the first is the number of the trial."""


def trial_rng(seed: int, trial: int) -> np.random.Generator:
    """Return the random generator of a trial, the same at every point of a study."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(trial,)))


class TrialRunner:
    """Run trials of a scenario; everything that they share is computed once."""

    def __init__(
        self,
        scenario: Scenario,
        scores: tuple[Score, ...],
        *,
        seed: int,
        sensor: str = "signal",
        keep: Collection[str] = (),
    ) -> None:
        self.scenario, self.scores, self.seed = scenario, scores, seed
        self.context = build_trial_context(scenario)
        check_scores_computable(scores, scenario, self.context, sensor=sensor)
        self.layout = ScoreColumnLayout.from_context(scores, self.context)
        self._needs = frozenset[Need]().union(*(score.needs for score in scores))
        if "maps" in keep:
            self._needs |= {"maps"}
        self._match_detections = Associator(
            self.context.truth, self.context.radar, self.context.scene
        )
        self._sensor = StatisticalSensor(scenario) if sensor == "statistical" else None
        self._simulator = self._noise_simulator = None
        self._cube: xr.DataArray | None = None
        if self._sensor is None:
            self._simulator = _monte_carlo_simulator(scenario, self.context.scene)
        if "noise" in self._needs and not self._can_draw_noise_map_without_samples:
            self._noise_simulator = _monte_carlo_simulator(
                scenario, replace(self.context.scene, targets=())
            )

    @property
    def _can_draw_noise_map_without_samples(self) -> bool:
        """True if maps of noise alone can be drawn without samples."""
        is_white = np.isfinite(self.context.noise_power_w)
        return bool(is_white and can_draw_noise_maps(self.context.radar, self.context.chain))

    @property
    def cube_of_last_trial(self) -> xr.DataArray | None:
        """Samples of the last trial; the next trial overwrites them."""
        return self._cube

    def run_and_score(self, trial: int) -> np.ndarray:
        """Run one trial, and return its score sums, (n_columns,), see `ScoreColumnLayout`."""
        return self.score_sums_of_result(self.run_trial(trial))

    def score_sums_of_result(self, result: TrialResult) -> np.ndarray:
        """Return the sums of all scores of a trial result, (n_columns,)."""
        return np.concatenate(
            [score.trial_sums(result, self.context).ravel() for score in self.scores]
        )

    def run_trial(self, trial: int) -> TrialResult:
        """Simulate and process one trial."""
        rng = trial_rng(self.seed, trial)
        context = self.context
        maps: list[np.ndarray] = []
        if self._sensor is not None:
            started = perf_counter()
            columns: Mapping[str, np.ndarray] = self._sensor.draw_detections(rng)
        else:
            assert self._simulator is not None
            self._cube = self._simulator.simulate_trial(rng, self._cube)
            started = perf_counter()
            processor = FrameProcessor(context.radar, context.chain)
            for frame in processor.process_cubes([self._cube]):
                warn_about_dropped_peaks(frame)
                if "maps" in self._needs:
                    maps += [power.copy() for power in frame.equalised_power]
            columns = processor.joined_detection_columns()
        clusters, tracks = None, None
        if self._needs & {"clusters", "tracks"}:
            columns, clusters, tracks = self._estimate_ego_motion_clusters_tracks(columns)
        processing_s = perf_counter() - started
        return TrialResult(
            detections=columns,
            association=self._match_detections(columns),
            maps=tuple(maps) if "maps" in self._needs else None,
            noise=self._simulate_noise_map_and_count_alarms(trial)
            if "noise" in self._needs
            else None,
            clusters=clusters,
            tracks=tracks,
            processing_s=processing_s,
        )

    def _estimate_ego_motion_clusters_tracks(
        self, detection_columns: Mapping[str, np.ndarray]
    ) -> tuple[Mapping[str, np.ndarray], xr.Dataset | None, xr.Dataset | None]:
        context = self.context
        stage = estimate_ego_motion_clusters_tracks(
            detections_from_columns(detection_columns),
            list(context.times_s),
            self.scenario,
            context.radar,
        )
        columns_by_name = {str(name): column.values for name, column in stage.detections.items()}
        return columns_by_name, stage.clusters, stage.tracks

    def _simulate_noise_map_and_count_alarms(self, trial: int) -> NoiseMap:
        """Simulate the map of the scenario without its targets, from independent noise."""
        sequence = np.random.SeedSequence(self.seed, spawn_key=(trial, NOISE_KEY))
        rng = np.random.default_rng(sequence)
        context = self.context
        if self._noise_simulator is None:
            power = draw_noise_map(context.radar, context.chain, context.noise_power_w, rng)
        else:
            cube = self._noise_simulator.simulate_trial(rng)
            (frame,) = FrameProcessor(context.radar, context.chain).process_cubes([cube[:1]])
            warn_about_dropped_peaks(frame)
            power = frame.equalised_power[0]
        return count_noise_alarms(power, context.radar, context.chain)


def check_scores_computable(
    scores: Iterable[Score], scenario: Scenario, context: TrialContext, *, sensor: str = "signal"
) -> None:
    """Raise `InvalidSetting` if a scenario lacks what a score needs."""
    for score in scores:
        score.check_score_defined(context)
        if "tracks" in score.needs and not scenario.has_tracker:
            raise InvalidSetting(
                "scores",
                value=f"{score.kind()}, of a scenario without a tracker",
                expected="a scenario with a tracker",
                fix=f"set tracker, as tracker: {{}}, or leave out {score.kind()}",
            )
        if "maps" in score.needs and sensor == "statistical":
            raise InvalidSetting(
                "scores",
                value=f"{score.kind()}, with sensor: statistical",
                expected="sensor: signal, since drawn detections have no map",
                fix=f"set sensor: signal, or leave out {score.kind()}",
            )


def check_scores_and_targets_of_study(plan: Plan) -> None:
    """Raise `InvalidSetting` if a study requests scores or targets that its trials do not provide.

    Scores must fit the first point or the last one: a study may vary what they need, and then
    the trials of the other points fail. Targets that `until` and `require` name must be those
    of their scores.
    """
    study = plan.study
    conditions: list[tuple[str, Requirement | StopRule]] = [
        (f"require.{index}", condition) for index, condition in enumerate(study.require)
    ]
    if study.trials.until is not None:
        conditions.append(("trials.until", study.trials.until))
    layout = score_column_layout_of_study(plan)
    for setting, condition in conditions:
        names = layout.scored_target_names[layout.index_of_score(condition.score)]
        if condition.target is not None and condition.target not in names:
            raise InvalidSetting(
                f"{setting}.target",
                value=condition.target,
                expected=f"one of {', '.join(names)}"
                if names
                else f"no target: {condition.score} is not scored by target",
                fix="name a target that the score has" if names else "remove target",
            )
    first_error: InvalidSetting | None = None
    for point in (0, plan.n_points - 1):
        try:
            scenario = plan.scenario_of_point(point, plan.drawn_setting_texts_of_trial(0))
            context = build_trial_context(scenario)
        except DechirpError:  # an invalid point: its trials report it
            return None
        try:
            return check_scores_computable(study.scores, scenario, context, sensor=study.sensor)
        except InvalidSetting as error:
            first_error = first_error or error
    assert first_error is not None
    raise first_error


def _monte_carlo_simulator(scenario: Scenario, echo_scene: Scene) -> MonteCarloSimulator:
    """Create the simulator of a scenario, whose echoes may be those of a reduced scene."""
    assert scenario.scene is not None and scenario.radar is not None
    return MonteCarloSimulator(
        scenario.scene,
        scenario.radar,
        impairments=scenario.impairments,
        n_frames=scenario.n_frames,
        engine=scenario.engine,
        echo_scene=echo_scene,
    )


def run_trial_block(
    plan: Plan, point: int, block_number: int, writer: DataSetWriter | None = None
) -> Block:
    """Run the trials of one block on one thread; failed trials are recorded.

    `writer` writes their items for a data set; they are on disk on return.

    Raises
    ------
    DechirpError
        If memory is short, or the disk is full: errors of the machine, not of the trial.
    """
    trials = plan.study.trials
    first = block_number * trials.block
    numbers = range(first, min(first + trials.block, trials.at_most))
    block_writer = None if writer is None else writer.create_block_writer(point, first)
    with exclusive_single_thread(), capture_warned_findings() as findings:
        started = perf_counter()
        sums, failures = _run_trials_for_sums_and_failures(plan, point, numbers, block_writer)
        items = (
            b""
            if block_writer is None
            else block_writer.write_last_shard_and_pack_arrays(
                _metadata_if_first_block(plan, point, block_number)
            )
        )
        theory = _theoretical_values_of_point(plan, point) if block_number == 0 else None
        seconds = perf_counter() - started
    return Block(
        point=point,
        number=block_number,
        first=first,
        sums=sums,
        seconds=seconds,
        failures=tuple(failures),
        findings=tuple(dict.fromkeys(findings)) if block_number == 0 else (),
        theory=theory,
        items=items,
    )


def _metadata_if_first_block(plan: Plan, point: int, block_number: int) -> Mapping[str, np.ndarray]:
    return {} if block_number else point_scenario_and_coordinates(plan, point)


@lru_cache(maxsize=4)
def score_column_layout_of_study(plan: Plan) -> ScoreColumnLayout:
    """Return the column layout of a study; all of its points have the same targets."""
    return ScoreColumnLayout.from_context(
        plan.study.scores, build_trial_context(plan.study.scenario)
    )


def create_trial_runner(plan: Plan, point: int, trial: int) -> TrialRunner:
    """Prepare the scenario of a trial of a point, with the settings drawn for it."""
    study = plan.study
    scenario = plan.scenario_of_point(point, plan.drawn_setting_texts_of_trial(trial))
    return TrialRunner(
        scenario, study.scores, seed=study.seed, sensor=study.sensor, keep=study.keep
    )


@lru_cache(maxsize=2)
def _shared_runner_and_findings_of_point(
    plan: Plan, point: int
) -> tuple[TrialRunner, tuple[Finding, ...]]:
    """Prepare a point whose trials share all settings; return its warnings too. Cached."""
    with capture_warned_findings() as findings:
        runner = create_trial_runner(plan, point, 0)
    return runner, tuple(findings)


def _trial_runner_with_warnings(plan: Plan, point: int, trial: int) -> TrialRunner:
    """Return the runner of a trial; repeat its warnings, whichever block came first."""
    if plan.has_settings_drawn_per_trial:
        runner = create_trial_runner(plan, point, trial)
    else:
        runner, findings = _shared_runner_and_findings_of_point(plan, point)
        for finding in findings:
            warnings.warn(PhysicsWarning(finding), stacklevel=2)
    _check_same_scored_targets(runner.layout, score_column_layout_of_study(plan))
    return runner


def _run_trials_for_sums_and_failures(
    plan: Plan, point: int, trials: range, block_writer: BlockWriter | None
) -> tuple[np.ndarray, list[Failure]]:
    """Return the sums of trials, (n_trials, n_columns), NaN where one failed, and the failures."""
    sums = np.full((len(trials), score_column_layout_of_study(plan).n_columns), np.nan)
    failures: list[Failure] = []
    for row, trial in enumerate(trials):
        item_and_truth = None
        try:
            runner = _trial_runner_with_warnings(plan, point, trial)
            result = runner.run_trial(trial)
            sums_of_trial = runner.score_sums_of_result(result)
            if block_writer is not None:
                item_and_truth = block_writer.make_item_and_truth(
                    runner.context, runner.cube_of_last_trial, result
                )
            sums[row] = sums_of_trial
        except MemoryError as error:
            raise _too_little_memory_error(point, trial, error) from None
        except Exception as error:  # any error fails this trial only
            failures.append(Failure(trial, f"{type(error).__name__}: {error}"))
        if block_writer is not None:
            block_writer.append_item_or_zeros(item_and_truth)
    return sums, failures


def _theoretical_values_of_point(plan: Plan, point: int) -> np.ndarray:
    """Return the theory of a point; NaN if settings are drawn anew in each trial.

    See `ScoreColumnLayout.theoretical_score_value`.
    """
    layout = score_column_layout_of_study(plan)
    no_theory = [np.full(max(len(names), 1), np.nan) for names in layout.scored_target_names]
    if plan.has_settings_drawn_per_trial:
        return np.concatenate(no_theory)
    try:
        context = _trial_runner_with_warnings(plan, point, 0).context
    except Exception:  # recorded as the failure of each trial of the point
        return np.concatenate(no_theory)
    both = zip(layout.scores, no_theory, strict=True)
    return np.concatenate(
        [_theoretical_values_or_nan_if_raising(score, context, nothing) for score, nothing in both]
    )


def _theoretical_values_or_nan_if_raising(
    score: Score, context: TrialContext, nan_values: np.ndarray
) -> np.ndarray:
    """Return the theory of a score, or NaN with a warning if it raises: the trials still count."""
    try:
        return np.reshape(score.theoretical_values(context), nan_values.shape)
    except Exception as error:
        finding = Finding(
            level="warning",
            setting="scores",
            value=f"{score.kind()}, whose theory raised {type(error).__name__}: {error}",
            expected="a law, or NaN where there is none",
            fix="take what was measured; theory is left out",
        )
        warnings.warn(PhysicsWarning(finding), stacklevel=2)
        return nan_values


def _check_same_scored_targets(
    point_layout: ScoreColumnLayout, study_layout: ScoreColumnLayout
) -> None:
    """Raise unless the sums of a point belong to the same targets as those of the study."""
    for score, names, expected_names in zip(
        study_layout.scores,
        point_layout.scored_target_names,
        study_layout.scored_target_names,
        strict=True,
    ):
        if names != expected_names:
            raise InvalidSetting(
                "vary",
                value=f"targets {', '.join(names) or 'without names'} for {score.kind()}",
                expected="those of the scenario at every point:"
                f" {', '.join(expected_names) or 'none'}",
                fix="vary settings of targets, not which there are; make a study of each",
            )


def _too_little_memory_error(point: int, trial: int, error: MemoryError) -> DechirpError:
    return DechirpError(
        Mistake(
            setting="workers",
            value=f"too little memory for trial {trial} of point {point} ({error})",
            expected="enough for each worker",
            fix="take fewer workers, and call again to continue: finished trials are kept",
        )
    )
