"""Studies with known answers: sums drawn from their distributions, without a simulation."""

import dataclasses

import numpy as np

from dechirp.core.findings import Finding
from dechirp.core.values import frozen_dataclass
from dechirp.evaluation.score.base import Estimate, Score
from dechirp.experiments.scenario import reference
from dechirp.experiments.study.block import Failure
from dechirp.experiments.study.layout import ScoreColumnLayout
from dechirp.experiments.study.results import PointData, estimate_scores_of_points
from dechirp.experiments.study.study import (
    RandomSetting,
    Sampling,
    Study,
    SweptSetting,
    TrialBudget,
)
from dechirp.theory import confidence_intervals


@frozen_dataclass
class HitProbability(Score):
    """Fraction of hits in trials."""

    n_sums = 2

    @classmethod
    def kind(cls):
        return "detection_probability"

    def trial_sums(self, result, context):
        raise NotImplementedError

    def estimate_with_interval(self, sums, *, confidence):
        hits, looks = np.nansum(sums, axis=0)
        if not looks:
            return Estimate(np.nan, np.nan, np.nan)
        return Estimate(
            hits / looks,
            *confidence_intervals.binomial_interval(int(hits), int(looks), confidence=confidence),
        )


@frozen_dataclass
class RmsError(HitProbability):
    """RMSE of one error per trial."""

    unit = "m"
    n_sums = 1

    @classmethod
    def kind(cls):
        return "range_rmse"

    def estimate_with_interval(self, sums, *, confidence):
        errors = np.sqrt(sums[~np.isnan(sums[:, 0]), 0])
        ends = confidence_intervals.rms_interval(errors, confidence=confidence)
        return Estimate(np.sqrt(np.mean(errors**2)), *ends)


@frozen_dataclass
class AlarmProbability(HitProbability):
    """False alarms per cell, one value for the whole scene."""

    @classmethod
    def kind(cls):
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

SCORES = (HitProbability(), RmsError(), AlarmProbability())


def make_layout(*, targets=("car",), scores=SCORES):
    return ScoreColumnLayout(
        scores, tuple(() if isinstance(score, AlarmProbability) else targets for score in scores)
    )


def make_study(*axes, targets=("car",), n_trials=200, scores=SCORES, **settings):
    scenario = reference()
    (target,) = scenario.scene.targets
    targets_by_name = tuple(dataclasses.replace(target, name=name) for name in targets)
    return Study(
        scenario=dataclasses.replace(
            scenario, scene=dataclasses.replace(scenario.scene, targets=targets_by_name)
        ),
        seed=7,
        vary=axes,
        trials=TrialBudget(at_most=n_trials),
        scores=scores,
        **settings,
    )


def make_points(axes, *, n_draws=0):
    """Return settings and numbers of each point: a grid, last axis fastest, then draws."""
    grid = [((), ())]
    for axis in axes:
        if isinstance(axis, SweptSetting):
            numbers = axis.numbers or (None,) * len(axis.texts)
            grid = [
                ((*settings, (axis.path, text)), (*point_numbers, number))
                for settings, point_numbers in grid
                for text, number in zip(axis.texts, numbers, strict=True)
            ]
    random_axes = [axis for axis in axes if isinstance(axis, RandomSetting)]
    if not (random_axes and n_draws):
        return grid
    rng = np.random.default_rng(3)
    draws = rng.uniform(-1, 1, (n_draws, len(random_axes))).round(4)
    return [
        (
            (
                *settings,
                *((a.path, f"{x} {a.unit}") for a, x in zip(random_axes, place, strict=True)),
            ),
            (*point_numbers, *place.tolist()),
        )
        for settings, point_numbers in grid
        for place in draws
    ]


def random_sums(rng, probability, rms_m, n_trials, *, n_targets=1, scores=SCORES):
    """Draw the sums of each trial, in the order of `make_layout`."""
    columns = []
    for score in scores:
        for target_index in range(1 if isinstance(score, AlarmProbability) else n_targets):
            if isinstance(score, RmsError):
                columns.append(
                    (rms_m * (1 + target_index) * rng.standard_normal((n_trials, 1))) ** 2
                )
            else:
                p = (
                    1e-3
                    if isinstance(score, AlarmProbability)
                    else probability ** (1 + target_index)
                )
                n_trials_per_sum = 1000 if isinstance(score, AlarmProbability) else 1
                hits = rng.binomial(n_trials_per_sum, p, (n_trials, 1))
                columns.append(np.hstack([hits, np.full((n_trials, 1), n_trials_per_sum)]))
    return np.hstack(columns).astype(float)


def theory_values(probability, rms_m, *, n_targets=1, scores=SCORES):
    values = []
    for score in scores:
        if isinstance(score, AlarmProbability):
            values.append(1e-3)
        elif isinstance(score, RmsError):
            values += [rms_m * (1 + target_index) for target_index in range(n_targets)]
        else:
            values += [probability ** (1 + target_index) for target_index in range(n_targets)]
    return np.array(values)


def true_probability_and_error(settings):
    """Return the true probability and RMSE of a point, from cross section, window and range."""
    texts = dict(settings)
    level_db = float(texts.get(RCS.path, "5 dBsm").split()[0])
    level_db -= 1.76 * (texts.get(WINDOW.path) == "hann")
    level_db -= 10 * np.log10(float(texts.get(DISTANCE.path, "40 m").split()[0]) / 40)
    level_db += 8 * float(texts.get(OFFSET.path, "0 m").split()[0])
    return 1 / (1 + np.exp(-(level_db - 5) / 3)), 0.05 * 10 ** (-level_db / 20)


def make_result(
    *axes, targets=("car",), scores=SCORES, n_draws=0, n_trials=200, failed=(), **settings
):
    """Return the result of a study of the axes; `failed` lists (point, trial, message)."""
    rng = np.random.default_rng(11)
    point_settings = make_points(axes, n_draws=n_draws)
    points, sums_by_point = [], []
    for point, (settings_of_point, numbers) in enumerate(point_settings):
        probability, rms_m = true_probability_and_error(settings_of_point)
        point_sums = random_sums(
            rng, probability, rms_m, n_trials, n_targets=len(targets), scores=scores
        )
        failures = [Failure(trial, message) for where, trial, message in failed if where == point]
        for failure in failures:
            point_sums[failure.trial] = np.nan
        sums_by_point.append(point_sums)
        finding = Finding(
            level="warning",
            setting="chain",
            value="a late echo",
            expected="an early one",
            fix="Wait.",
        )
        points.append(
            PointData(
                settings=settings_of_point,
                numbers=numbers,
                sums=point_sums,
                theory=theory_values(probability, rms_m, n_targets=len(targets), scores=scores),
                failures=tuple(failures),
                findings=(finding,) if point % 2 else (),
            )
        )
    draw = Sampling(n=n_draws) if n_draws else None
    made_study = make_study(
        *axes, targets=targets, n_trials=n_trials, scores=scores, draw=draw, **settings
    )
    return estimate_scores_of_points(
        made_study, make_layout(targets=targets, scores=scores), points
    ), sums_by_point
