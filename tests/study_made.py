"""Studies with known answers: sums drawn from their laws, without a radar behind them."""

import dataclasses

import numpy as np

from dechirp.core.findings import Finding
from dechirp.core.values import frozen_dataclass
from dechirp.evaluation.score.base import Estimate, Score
from dechirp.experiments.scenario import reference
from dechirp.experiments.study.block import Failure
from dechirp.experiments.study.layout import Layout
from dechirp.experiments.study.results import PointData, estimate_points
from dechirp.experiments.study.study import (
    RandomSetting,
    Sampling,
    Study,
    SweptSetting,
    TrialBudget,
)
from dechirp.theory import confidence_intervals


@frozen_dataclass
class Share(Score):
    """Hits in looks."""

    n_sums = 2

    @classmethod
    def label(cls):
        return "detection_probability"

    def trial_sums(self, result, context):
        raise NotImplementedError

    def estimate(self, sums, *, confidence):
        hits, looks = np.nansum(sums, axis=0)
        if not looks:
            return Estimate(np.nan, np.nan, np.nan)
        return Estimate(
            hits / looks,
            *confidence_intervals.binomial_interval(int(hits), int(looks), confidence=confidence),
        )


@frozen_dataclass
class Rms(Share):
    """Squared errors, one a trial."""

    unit = "m"
    n_sums = 1

    @classmethod
    def label(cls):
        return "range_rmse"

    def estimate(self, sums, *, confidence):
        errors = np.sqrt(sums[~np.isnan(sums[:, 0]), 0])
        ends = confidence_intervals.rms_interval(errors, confidence=confidence)
        return Estimate(np.sqrt(np.mean(errors**2)), *ends)


@frozen_dataclass
class Alarms(Share):
    """False alarms in cells, of the whole."""

    @classmethod
    def label(cls):
        return "false_alarm_probability"


RCS = SweptSetting(
    path="scene.targets.car.rcs",
    texts=tuple(f"{n} dBsm" for n in range(-10, 25, 5)),
    numbers=tuple(float(n) for n in range(-10, 25, 5)),
    unit="dBsm",
)
WINDOW = SweptSetting(
    path="chain.range_window", texts=("hann", "rectangular"), numbers=None, unit=""
)
DISTANCE = SweptSetting(
    path="scene.targets.car.position.0",
    texts=tuple(f"{n} m" for n in (10, 20, 40, 80, 160)),
    numbers=(10.0, 20.0, 40.0, 80.0, 160.0),
    unit="m",
)
OFFSET = RandomSetting(
    path="scene.targets.car.position.1", distribution="uniform", first=-1.0, second=1.0, unit="m"
)

SCORES = (Share(), Rms(), Alarms())


def layout(*, targets=("car",), scores=SCORES):
    return Layout(scores, tuple(() if isinstance(score, Alarms) else targets for score in scores))


def study(*axes, targets=("car",), n_trials=200, scores=SCORES, **settings):
    scenario = reference()
    (only,) = scenario.scene.targets
    named = tuple(dataclasses.replace(only, name=name) for name in targets)
    return Study(
        scenario=dataclasses.replace(
            scenario, scene=dataclasses.replace(scenario.scene, targets=named)
        ),
        seed=7,
        vary=axes,
        trials=TrialBudget(at_most=n_trials),
        scores=scores,
        **settings,
    )


def points(axes, *, n_draws=0):
    """Settings and numbers of each, lists as a grid, the last one fastest, then draws."""
    made = [((), ())]
    for axis in axes:
        if isinstance(axis, SweptSetting):
            numbers = axis.numbers or (None,) * len(axis.texts)
            made = [
                ((*settings, (axis.path, text)), (*known, number))
                for settings, known in made
                for text, number in zip(axis.texts, numbers, strict=True)
            ]
    drawn = [axis for axis in axes if isinstance(axis, RandomSetting)]
    if not (drawn and n_draws):
        return made
    rng = np.random.default_rng(3)
    places = rng.uniform(-1, 1, (n_draws, len(drawn))).round(4)
    return [
        (
            (*settings, *((a.path, f"{x} {a.unit}") for a, x in zip(drawn, place, strict=True))),
            (*known, *place.tolist()),
        )
        for settings, known in made
        for place in places
    ]


def sums(rng, probability, rms_m, n_trials, *, n_targets=1, scores=SCORES):
    """Of each trial, in the order of `layout`."""
    columns = []
    for score in scores:
        for turn in range(1 if isinstance(score, Alarms) else n_targets):
            if isinstance(score, Rms):
                columns.append((rms_m * (1 + turn) * rng.standard_normal((n_trials, 1))) ** 2)
            else:
                p = 1e-3 if isinstance(score, Alarms) else probability ** (1 + turn)
                looks = 1000 if isinstance(score, Alarms) else 1
                hits = rng.binomial(looks, p, (n_trials, 1))
                columns.append(np.hstack([hits, np.full((n_trials, 1), looks)]))
    return np.hstack(columns).astype(float)


def theory(probability, rms_m, *, n_targets=1, scores=SCORES):
    told = []
    for score in scores:
        if isinstance(score, Alarms):
            told.append(1e-3)
        elif isinstance(score, Rms):
            told += [rms_m * (1 + turn) for turn in range(n_targets)]
        else:
            told += [probability ** (1 + turn) for turn in range(n_targets)]
    return np.array(told)


def truth_of(settings):
    """Probability and error of a point: they follow the cross section, window and distance."""
    known = dict(settings)
    level_db = float(known.get(RCS.path, "5 dBsm").split()[0])
    level_db -= 1.76 * (known.get(WINDOW.path) == "hann")
    level_db -= 10 * np.log10(float(known.get(DISTANCE.path, "40 m").split()[0]) / 40)
    level_db += 8 * float(known.get(OFFSET.path, "0 m").split()[0])
    return 1 / (1 + np.exp(-(level_db - 5) / 3)), 0.05 * 10 ** (-level_db / 20)


def result(*axes, targets=("car",), scores=SCORES, n_draws=0, n_trials=200, failed=(), **settings):
    """Result of a study of these axes; `failed`: (point, trial, message)."""
    rng = np.random.default_rng(11)
    known = points(axes, n_draws=n_draws)
    made, kept = [], []
    for point, (at, numbers) in enumerate(known):
        probability, rms_m = truth_of(at)
        of_point = sums(rng, probability, rms_m, n_trials, n_targets=len(targets), scores=scores)
        failures = [Failure(trial, message) for where, trial, message in failed if where == point]
        for failure in failures:
            of_point[failure.trial] = np.nan
        kept.append(of_point)
        found = Finding(
            level="warning",
            setting="chain",
            value="a late echo",
            expected="an early one",
            fix="Wait.",
        )
        made.append(
            PointData(
                settings=at,
                numbers=numbers,
                sums=of_point,
                theory=theory(probability, rms_m, n_targets=len(targets), scores=scores),
                failures=tuple(failures),
                findings=(found,) if point % 2 else (),
            )
        )
    draw = Sampling(n=n_draws) if n_draws else None
    what = study(*axes, targets=targets, n_trials=n_trials, scores=scores, draw=draw, **settings)
    return estimate_points(what, layout(targets=targets, scores=scores), made), kept
