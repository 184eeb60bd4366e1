"""One trial of one point, and some of them in a block."""

import warnings
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import replace
from functools import lru_cache
from time import perf_counter

import numpy as np
import xarray as xr

from dechirp.core.errors import DechirpError, InvalidSetting, Mistake
from dechirp.core.findings import Finding, PhysicsWarning, heard
from dechirp.core.threads import alone
from dechirp.echoes.repeated import Repeated
from dechirp.evaluate.look import Case, Look, NoiseMap
from dechirp.evaluate.match import Matcher
from dechirp.evaluate.noise_only import counted
from dechirp.evaluate.score.base import Need, Score
from dechirp.experiment.followed import follow
from dechirp.experiment.scenario import Scenario
from dechirp.experiment.statistical.sensor import Sensor
from dechirp.experiment.study.block import Block, Failure
from dechirp.experiment.study.case import case_of
from dechirp.experiment.study.data_set import Keeper, Keeping, about_point
from dechirp.experiment.study.layout import Layout
from dechirp.experiment.study.plan import Plan
from dechirp.experiment.study.study import Requirement, Until
from dechirp.process.detect import detected_columns, labelled_detections
from dechirp.process.noise_maps import draw_noise_map, draws_directly
from dechirp.scene.scene import Scene

NOISE_KEY = 2**31
"""Second spawn key of the noise-only map of a trial; its first is the number of the trial."""


def generator(seed: int, trial: int) -> np.random.Generator:
    """Chance of a trial: the same at every point of a study."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(trial,)))


class Prepared:
    """A scenario that is tried again and again: what is the same in each trial is done once."""

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
        self.case = case_of(scenario)
        check_scores(scores, scenario, self.case, sensor=sensor)
        self.layout = Layout.of_case(scores, self.case)
        self._needs = frozenset[Need]().union(*(score.needs for score in scores))
        if "maps" in keep:
            self._needs |= {"maps"}
        self._match = Matcher(self.case.truth, self.case.radar, self.case.scene)
        self._sensor = Sensor(scenario) if sensor == "statistical" else None
        self._echoes = self._noises = None
        self._cube: xr.DataArray | None = None
        if self._sensor is None:
            self._echoes = _repeated(scenario, self.case.scene)
        if "noise" in self._needs and not self._draws_noise:
            self._noises = _repeated(scenario, replace(self.case.scene, targets=()))

    @property
    def _draws_noise(self) -> bool:
        """Whether maps of noise alone need no samples."""
        is_white = np.isfinite(self.case.noise_power_w)
        return bool(is_white and draws_directly(self.case.radar, self.case.chain))

    @property
    def cube(self) -> xr.DataArray | None:
        """Samples of the trial that was looked at last, which the next one overwrites."""
        return self._cube

    def sums(self, trial: int) -> np.ndarray:
        """Sums of all scores of one trial, (n_columns,), see `Layout`."""
        return self.sums_of(self.look(trial))

    def sums_of(self, look: Look) -> np.ndarray:
        """Sums of all scores of what a trial shows, (n_columns,)."""
        return np.concatenate([score.sums(look, self.case).ravel() for score in self.scores])

    def look(self, trial: int) -> Look:
        """What a trial shows to the scores."""
        rng = generator(self.seed, trial)
        case = self.case
        maps: list[np.ndarray] = []
        if self._sensor is not None:
            started = perf_counter()
            columns: Mapping[str, np.ndarray] = self._sensor.detections(rng)
        else:
            assert self._echoes is not None
            self._cube = self._echoes.cube(rng, self._cube)
            started = perf_counter()
            keep = _copies_into(maps) if "maps" in self._needs else None
            columns = detected_columns((self._cube,), case.radar, case.chain, maps=keep)
        clusters, tracks = None, None
        if self._needs & {"clusters", "tracks"}:
            columns, clusters, tracks = self._followed(columns)
        processing_s = perf_counter() - started
        return Look(
            detections=columns,
            match=self._match(columns),
            maps=tuple(maps) if "maps" in self._needs else None,
            noise=self._noise(trial) if "noise" in self._needs else None,
            clusters=clusters,
            tracks=tracks,
            processing_s=processing_s,
        )

    def _followed(
        self, columns: Mapping[str, np.ndarray]
    ) -> tuple[Mapping[str, np.ndarray], xr.Dataset | None, xr.Dataset | None]:
        case = self.case
        found = follow(labelled_detections(columns), list(case.times_s), self.scenario, case.radar)
        named = {str(name): column.values for name, column in found.detections.items()}
        return named, found.clusters, found.tracks

    def _noise(self, trial: int) -> NoiseMap:
        """Map of the scenario without its targets, of its own chance."""
        sequence = np.random.SeedSequence(self.seed, spawn_key=(trial, NOISE_KEY))
        rng = np.random.default_rng(sequence)
        case = self.case
        if self._noises is None:
            power = draw_noise_map(case.radar, case.chain, case.noise_power_w, rng)
        else:
            cube = self._noises.cube(rng)
            maps: list[np.ndarray] = []
            detected_columns((cube[:1],), case.radar, case.chain, maps=_copies_into(maps))
            power = maps[0]
        return counted(power, case.radar, case.chain)


def _copies_into(maps: list[np.ndarray]) -> Callable[[np.ndarray], None]:
    """Keep copies of maps, which the next frame overwrites."""

    def keep(power: np.ndarray) -> None:
        maps.append(power.copy())

    return keep


def check_scores(
    scores: Iterable[Score], scenario: Scenario, case: Case, *, sensor: str = "signal"
) -> None:
    """Raise `InvalidSetting` where a scenario has nothing that could be scored so."""
    for score in scores:
        score.check(case)
        if "tracks" in score.needs and scenario.tracker is None:
            raise InvalidSetting(
                "scores",
                got=f"{score.label()}, of a scenario without a tracker",
                need="tracker for it",
                fix=f"Set tracker, as tracker: {{}}, or leave out {score.label()}.",
            )
        if "maps" in score.needs and sensor == "statistical":
            raise InvalidSetting(
                "scores",
                got=f"{score.label()}, with sensor: statistical",
                need="sensor: signal for it: drawn detections have no map",
                fix=f"Set sensor: signal, or leave out {score.label()}.",
            )


def check_study(plan: Plan) -> None:
    """Raise `InvalidSetting` where a study asks for what its trials cannot give.

    Scores must fit the first point or the last one: a study may vary what they need, and then
    the trials of the other points fail. Targets that `until` and `require` name must be those
    of their scores.
    """
    study = plan.study
    asked: list[tuple[str, Requirement | Until]] = [
        (f"require.{at}", one) for at, one in enumerate(study.require)
    ]
    if study.trials.until is not None:
        asked.append(("trials.until", study.trials.until))
    layout = layout_of(plan)
    for where, one in asked:
        names = layout.subjects[layout.index(one.score)]
        if one.target is not None and one.target not in names:
            raise InvalidSetting(
                f"{where}.target",
                got=one.target,
                need=f"one of {', '.join(names)}"
                if names
                else f"left out: {one.score} has no targets",
                fix="Name a target that the score is of, or none for the whole.",
            )
    wrong: InvalidSetting | None = None
    for point in (0, plan.n_points - 1):
        try:
            scenario = plan.scenario(point, plan.drawn(0))
            case = case_of(scenario)
        except DechirpError:  # a point that cannot be: its trials tell so
            return None
        try:
            return check_scores(study.scores, scenario, case, sensor=study.sensor)
        except InvalidSetting as error:
            wrong = wrong or error
    assert wrong is not None
    raise wrong


def _repeated(scenario: Scenario, echoes_of: Scene) -> Repeated:
    """Cubes of a scenario, with echoes of what may be less than its scene."""
    assert scenario.scene is not None and scenario.radar is not None
    return Repeated(
        scenario.scene,
        scenario.radar,
        impairments=scenario.impairments,
        n_frames=scenario.n_frames,
        engine=scenario.engine,
        echoes_of=echoes_of,
    )


def run_block(plan: Plan, point: int, number: int, keeper: Keeper | None = None) -> Block:
    """Trials of one block, those that raise left out and told, on one thread.

    `keeper` keeps their items for a data set; they are on disk on return.

    Raises
    ------
    DechirpError
        If memory is short, or the disk is full: that is not the trial's, which would do on
        another machine.
    """
    trials = plan.study.trials
    first = number * trials.block
    numbers = range(first, min(first + trials.block, trials.at_most))
    keeping = None if keeper is None else keeper.block(point, first)
    with alone(), heard() as said:
        started = perf_counter()
        sums, failures = _tried(plan, point, numbers, keeping)
        items = b"" if keeping is None else keeping.end(_about(plan, point, number))
        theory = _theory(plan, point) if number == 0 else None
        seconds = perf_counter() - started
    return Block(
        point=point,
        number=number,
        first=first,
        sums=sums,
        seconds=seconds,
        failures=tuple(failures),
        findings=tuple(dict.fromkeys(said)) if number == 0 else (),
        theory=theory,
        items=items,
    )


def _about(plan: Plan, point: int, number: int) -> Mapping[str, np.ndarray]:
    return {} if number else about_point(plan, point)


@lru_cache(maxsize=4)
def layout_of(plan: Plan) -> Layout:
    """Columns of the blocks of a study: its points have the same targets."""
    return Layout.of_case(plan.study.scores, case_of(plan.study.scenario))


def prepared(plan: Plan, point: int, trial: int) -> Prepared:
    """The scenario of a trial of a point, with what is drawn anew for it."""
    study = plan.study
    scenario = plan.scenario(point, plan.drawn(trial))
    return Prepared(scenario, study.scores, seed=study.seed, sensor=study.sensor, keep=study.keep)


@lru_cache(maxsize=2)
def _of_point(plan: Plan, point: int) -> tuple[Prepared, tuple[Finding, ...]]:
    """The same where all trials of a point are alike, and what was warned of; kept."""
    with heard() as said:
        made = prepared(plan, point, 0)
    return made, tuple(said)


def _ready(plan: Plan, point: int, trial: int) -> Prepared:
    """Ready for a trial; warns as if it had just been prepared, whichever block came first."""
    if plan.draws_anew:
        made = prepared(plan, point, trial)
    else:
        made, said = _of_point(plan, point)
        for finding in said:
            warnings.warn(PhysicsWarning(finding), stacklevel=2)
    _must_have_the_columns(made.layout, layout_of(plan))
    return made


def _tried(
    plan: Plan, point: int, trials: range, keeping: Keeping | None
) -> tuple[np.ndarray, list[Failure]]:
    """Sums of some trials, (n_trials, n_columns), NaN where one raised, and what it said."""
    sums = np.full((len(trials), layout_of(plan).n_columns), np.nan)
    failures: list[Failure] = []
    for row, trial in enumerate(trials):
        taken = None
        try:
            ready = _ready(plan, point, trial)
            look = ready.look(trial)
            of_trial = ready.sums_of(look)
            if keeping is not None:
                taken = keeping.taken(ready.case, ready.cube, look)
            sums[row] = of_trial
        except MemoryError as error:
            raise _short_of_memory(point, trial, error) from None
        except Exception as error:  # whatever it is, it is this trial's: told with its number
            failures.append(Failure(trial, f"{type(error).__name__}: {error}"))
        if keeping is not None:
            keeping.add(taken)
    return sums, failures


def _theory(plan: Plan, point: int) -> np.ndarray:
    """What theory gives for a point, see `Layout.theory_of`; of what is drawn anew, nothing."""
    layout = layout_of(plan)
    untold = [np.full(max(len(names), 1), np.nan) for names in layout.subjects]
    if plan.draws_anew:
        return np.concatenate(untold)
    try:
        case = _ready(plan, point, 0).case
    except Exception:  # each of its trials has failed of it
        return np.concatenate(untold)
    both = zip(layout.scores, untold, strict=True)
    return np.concatenate([_theory_of(score, case, nothing) for score, nothing in both])


def _theory_of(score: Score, case: Case, nothing: np.ndarray) -> np.ndarray:
    """Theory of a score; where it raises, which is no reason to lose the trials, nothing."""
    try:
        return np.reshape(score.theory(case), nothing.shape)
    except Exception as error:
        finding = Finding(
            level="warning",
            setting="scores",
            got=f"{score.label()}, whose theory raised {type(error).__name__}: {error}",
            need="a law, or NaN where there is none",
            fix="Take what was measured; theory is left out.",
        )
        warnings.warn(PhysicsWarning(finding), stacklevel=2)
        return nothing


def _must_have_the_columns(layout: Layout, of_study: Layout) -> None:
    """Raise unless the sums of a point belong to the same targets as those of the study."""
    for score, own, asked in zip(of_study.scores, layout.subjects, of_study.subjects, strict=True):
        if own != asked:
            raise InvalidSetting(
                "vary",
                got=f"targets {', '.join(own) or 'without names'} for {score.label()}",
                need=f"those of the scenario at every point: {', '.join(asked) or 'none'}",
                fix="Vary settings of targets, not which there are; make a study of each.",
            )


def _short_of_memory(point: int, trial: int, error: MemoryError) -> DechirpError:
    return DechirpError(
        Mistake(
            setting="workers",
            got=f"too little memory for trial {trial} of point {point} ({error})",
            need="enough for each worker",
            fix="Take fewer workers, and call again to go on. What was done is kept.",
        )
    )
