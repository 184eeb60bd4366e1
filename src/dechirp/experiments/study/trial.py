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
from dechirp.core.threads import single_numba_thread
from dechirp.evaluation.association import Associator
from dechirp.evaluation.false_alarms import count_noise_alarms
from dechirp.evaluation.score.base import Need, Score
from dechirp.evaluation.trial import NoiseMap, TrialContext, TrialResult
from dechirp.experiments.object_stage import run_object_stage
from dechirp.experiments.scenario import Scenario
from dechirp.experiments.statistical.sensor import StatisticalSensor
from dechirp.experiments.study.block import Block, Failure
from dechirp.experiments.study.data_set import BlockWriter, DataSetWriter, point_metadata
from dechirp.experiments.study.layout import Layout
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
        self.case = build_trial_context(scenario)
        check_scores(scores, scenario, self.case, sensor=sensor)
        self.layout = Layout.from_context(scores, self.case)
        self._needs = frozenset[Need]().union(*(score.needs for score in scores))
        if "maps" in keep:
            self._needs |= {"maps"}
        self._match_detections = Associator(self.case.truth, self.case.radar, self.case.scene)
        self._sensor = StatisticalSensor(scenario) if sensor == "statistical" else None
        self._simulator = self._noise_simulator = None
        self._cube: xr.DataArray | None = None
        if self._sensor is None:
            self._simulator = _monte_carlo_simulator(scenario, self.case.scene)
        if "noise" in self._needs and not self._can_draw_noise_map:
            self._noise_simulator = _monte_carlo_simulator(
                scenario, replace(self.case.scene, targets=())
            )

    @property
    def _can_draw_noise_map(self) -> bool:
        """True if maps of noise alone can be drawn without samples."""
        is_white = np.isfinite(self.case.noise_power_w)
        return bool(is_white and can_draw_noise_maps(self.case.radar, self.case.chain))

    @property
    def cube(self) -> xr.DataArray | None:
        """Samples of the last trial; the next trial overwrites them."""
        return self._cube

    def run_and_score(self, trial: int) -> np.ndarray:
        """Run one trial, and return the sums of all scores, (n_columns,), see `Layout`."""
        return self.score_sums(self.run(trial))

    def score_sums(self, look: TrialResult) -> np.ndarray:
        """Return the sums of all scores of a trial result, (n_columns,)."""
        return np.concatenate([score.trial_sums(look, self.case).ravel() for score in self.scores])

    def run(self, trial: int) -> TrialResult:
        """Simulate and process one trial."""
        rng = trial_rng(self.seed, trial)
        case = self.case
        maps: list[np.ndarray] = []
        if self._sensor is not None:
            started = perf_counter()
            columns: Mapping[str, np.ndarray] = self._sensor.detections(rng)
        else:
            assert self._simulator is not None
            self._cube = self._simulator.simulate_trial(rng, self._cube)
            started = perf_counter()
            processor = FrameProcessor(case.radar, case.chain)
            for frame in processor.process_cubes([self._cube]):
                warn_about_dropped_peaks(frame)
                if "maps" in self._needs:
                    maps += [power.copy() for power in frame.equalised_power]
            columns = processor.joined_detection_columns()
        clusters, tracks = None, None
        if self._needs & {"clusters", "tracks"}:
            columns, clusters, tracks = self._run_object_stage(columns)
        processing_s = perf_counter() - started
        return TrialResult(
            detections=columns,
            association=self._match_detections(columns),
            maps=tuple(maps) if "maps" in self._needs else None,
            noise=self._noise_map(trial) if "noise" in self._needs else None,
            clusters=clusters,
            tracks=tracks,
            processing_s=processing_s,
        )

    def _run_object_stage(
        self, columns: Mapping[str, np.ndarray]
    ) -> tuple[Mapping[str, np.ndarray], xr.Dataset | None, xr.Dataset | None]:
        case = self.case
        stage = run_object_stage(
            detections_from_columns(columns), list(case.times_s), self.scenario, case.radar
        )
        columns_by_name = {str(name): column.values for name, column in stage.detections.items()}
        return columns_by_name, stage.clusters, stage.tracks

    def _noise_map(self, trial: int) -> NoiseMap:
        """Simulate the map of the scenario without its targets, from independent noise."""
        sequence = np.random.SeedSequence(self.seed, spawn_key=(trial, NOISE_KEY))
        rng = np.random.default_rng(sequence)
        case = self.case
        if self._noise_simulator is None:
            power = draw_noise_map(case.radar, case.chain, case.noise_power_w, rng)
        else:
            cube = self._noise_simulator.simulate_trial(rng)
            (frame,) = FrameProcessor(case.radar, case.chain).process_cubes([cube[:1]])
            warn_about_dropped_peaks(frame)
            power = frame.equalised_power[0]
        return count_noise_alarms(power, case.radar, case.chain)


def check_scores(
    scores: Iterable[Score], scenario: Scenario, case: TrialContext, *, sensor: str = "signal"
) -> None:
    """Raise `InvalidSetting` if a scenario lacks what a score needs."""
    for score in scores:
        score.check_score_defined(case)
        if "tracks" in score.needs and scenario.tracker is None:
            raise InvalidSetting(
                "scores",
                value=f"{score.label()}, of a scenario without a tracker",
                expected="a scenario with a tracker",
                fix=f"set tracker, as tracker: {{}}, or leave out {score.label()}",
            )
        if "maps" in score.needs and sensor == "statistical":
            raise InvalidSetting(
                "scores",
                value=f"{score.label()}, with sensor: statistical",
                expected="sensor: signal for it: drawn detections have no map",
                fix=f"set sensor: signal, or leave out {score.label()}",
            )


def check_study(plan: Plan) -> None:
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
    layout = study_layout(plan)
    for setting, condition in conditions:
        names = layout.subjects[layout.score_index(condition.score)]
        if condition.target is not None and condition.target not in names:
            raise InvalidSetting(
                f"{setting}.target",
                value=condition.target,
                expected=f"one of {', '.join(names)}"
                if names
                else f"left out: {condition.score} has no targets",
                fix="name a target that the score is of, or none for the whole",
            )
    first_error: InvalidSetting | None = None
    for point in (0, plan.n_points - 1):
        try:
            scenario = plan.scenario(point, plan.trial_settings(0))
            case = build_trial_context(scenario)
        except DechirpError:  # an invalid point: its trials report it
            return None
        try:
            return check_scores(study.scores, scenario, case, sensor=study.sensor)
        except InvalidSetting as error:
            first_error = first_error or error
    assert first_error is not None
    raise first_error


def _monte_carlo_simulator(scenario: Scenario, echoes_of: Scene) -> MonteCarloSimulator:
    """Create the simulator of a scenario, whose echoes may be those of a reduced scene."""
    assert scenario.scene is not None and scenario.radar is not None
    return MonteCarloSimulator(
        scenario.scene,
        scenario.radar,
        impairments=scenario.impairments,
        n_frames=scenario.n_frames,
        engine=scenario.engine,
        echo_scene=echoes_of,
    )


def run_block(plan: Plan, point: int, number: int, writer: DataSetWriter | None = None) -> Block:
    """Run the trials of one block on one thread; failed trials are recorded.

    `writer` writes their items for a data set; they are on disk on return.

    Raises
    ------
    DechirpError
        If memory is short, or the disk is full: errors of the machine, not of the trial.
    """
    trials = plan.study.trials
    first = number * trials.block
    numbers = range(first, min(first + trials.block, trials.at_most))
    block_writer = None if writer is None else writer.begin_block(point, first)
    with single_numba_thread(), capture_warned_findings() as findings:
        started = perf_counter()
        sums, failures = _run_trials(plan, point, numbers, block_writer)
        items = (
            b""
            if block_writer is None
            else block_writer.finish(_point_metadata(plan, point, number))
        )
        theory = _point_theory(plan, point) if number == 0 else None
        seconds = perf_counter() - started
    return Block(
        point=point,
        number=number,
        first=first,
        sums=sums,
        seconds=seconds,
        failures=tuple(failures),
        findings=tuple(dict.fromkeys(findings)) if number == 0 else (),
        theory=theory,
        items=items,
    )


def _point_metadata(plan: Plan, point: int, number: int) -> Mapping[str, np.ndarray]:
    return {} if number else point_metadata(plan, point)


@lru_cache(maxsize=4)
def study_layout(plan: Plan) -> Layout:
    """Return the column layout of a study; all of its points have the same targets."""
    return Layout.from_context(plan.study.scores, build_trial_context(plan.study.scenario))


def prepare_trial(plan: Plan, point: int, trial: int) -> TrialRunner:
    """Prepare the scenario of a trial of a point, with the settings drawn for it."""
    study = plan.study
    scenario = plan.scenario(point, plan.trial_settings(trial))
    return TrialRunner(
        scenario, study.scores, seed=study.seed, sensor=study.sensor, keep=study.keep
    )


@lru_cache(maxsize=2)
def _prepare_point(plan: Plan, point: int) -> tuple[TrialRunner, tuple[Finding, ...]]:
    """Prepare a point whose trials share all settings; return its warnings too. Cached."""
    with capture_warned_findings() as findings:
        runner = prepare_trial(plan, point, 0)
    return runner, tuple(findings)


def _trial_runner(plan: Plan, point: int, trial: int) -> TrialRunner:
    """Return the runner of a trial; repeat its warnings, whichever block came first."""
    if plan.has_trial_draws:
        runner = prepare_trial(plan, point, trial)
    else:
        runner, findings = _prepare_point(plan, point)
        for finding in findings:
            warnings.warn(PhysicsWarning(finding), stacklevel=2)
    _check_columns(runner.layout, study_layout(plan))
    return runner


def _run_trials(
    plan: Plan, point: int, trials: range, block_writer: BlockWriter | None
) -> tuple[np.ndarray, list[Failure]]:
    """Return the sums of trials, (n_trials, n_columns), NaN where one failed, and the failures."""
    sums = np.full((len(trials), study_layout(plan).n_columns), np.nan)
    failures: list[Failure] = []
    for row, trial in enumerate(trials):
        item_and_truth = None
        try:
            runner = _trial_runner(plan, point, trial)
            look = runner.run(trial)
            sums_of_trial = runner.score_sums(look)
            if block_writer is not None:
                item_and_truth = block_writer.make_item(runner.case, runner.cube, look)
            sums[row] = sums_of_trial
        except MemoryError as error:
            raise _memory_error(point, trial, error) from None
        except Exception as error:  # any error fails this trial only
            failures.append(Failure(trial, f"{type(error).__name__}: {error}"))
        if block_writer is not None:
            block_writer.add_item(item_and_truth)
    return sums, failures


def _point_theory(plan: Plan, point: int) -> np.ndarray:
    """Return the theory of a point, see `Layout.score_theory`; NaN if settings are drawn anew."""
    layout = study_layout(plan)
    no_theory = [np.full(max(len(names), 1), np.nan) for names in layout.subjects]
    if plan.has_trial_draws:
        return np.concatenate(no_theory)
    try:
        case = _trial_runner(plan, point, 0).case
    except Exception:  # all of its trials failed with it
        return np.concatenate(no_theory)
    both = zip(layout.scores, no_theory, strict=True)
    return np.concatenate([_score_theory(score, case, nothing) for score, nothing in both])


def _score_theory(score: Score, case: TrialContext, no_theory: np.ndarray) -> np.ndarray:
    """Return the theory of a score, or NaN with a warning if it raises: the trials still count."""
    try:
        return np.reshape(score.theoretical_values(case), no_theory.shape)
    except Exception as error:
        finding = Finding(
            level="warning",
            setting="scores",
            value=f"{score.label()}, whose theory raised {type(error).__name__}: {error}",
            expected="a law, or NaN where there is none",
            fix="take what was measured; theory is left out",
        )
        warnings.warn(PhysicsWarning(finding), stacklevel=2)
        return no_theory


def _check_columns(layout: Layout, study_layout: Layout) -> None:
    """Raise unless the sums of a point belong to the same targets as those of the study."""
    for score, names, expected_names in zip(
        study_layout.scores, layout.subjects, study_layout.subjects, strict=True
    ):
        if names != expected_names:
            raise InvalidSetting(
                "vary",
                value=f"targets {', '.join(names) or 'without names'} for {score.label()}",
                expected="those of the scenario at every point:"
                f" {', '.join(expected_names) or 'none'}",
                fix="vary settings of targets, not which there are; make a study of each",
            )


def _memory_error(point: int, trial: int, error: MemoryError) -> DechirpError:
    return DechirpError(
        Mistake(
            setting="workers",
            value=f"too little memory for trial {trial} of point {point} ({error})",
            expected="enough for each worker",
            fix="take fewer workers, and call again to continue: finished trials are kept",
        )
    )
