"""Checks of a study before its first trial, verdicts, and effective training cells."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import dechirp as dc
from dechirp.core.errors import DechirpError, InvalidFile, InvalidSetting
from dechirp.evaluation.detector_law import find_detector_law
from dechirp.evaluation.score.errors import RangeRmse
from dechirp.evaluation.score.probabilities import DetectionProbability
from dechirp.experiments.study.layout import ScoreColumnLayout
from dechirp.experiments.study.plan import Plan
from dechirp.experiments.study.requirements import judge_requirements
from dechirp.experiments.study.results import PointData, estimate_scores_of_points
from dechirp.experiments.study.run import replay_trial
from dechirp.experiments.study.study import Requirement
from dechirp.experiments.study.trial_context import build_trial_context
from dechirp.theory.cfar_correlated_cells import CorrelatedWindow
from nightly import nightly
from sample_studies import WINDOW, HitProbability, make_layout, make_study

STUDY = """
scenario:
  radar:
    frame:
      chirp: {start_frequency: 77 GHz, slope: 10 MHz/us, adc_start: 1 us, ramp_duration: 8 us,
              sample_rate: 10 MHz, n_samples: 64, sampling: complex}
      n_chirps: 32
      interval: 10 us
    hardware: {transmit_power: 12 dBm, antenna_gain: 10 dBi, noise_factor: 12 dB}
  scene: {targets: [{name: car, position: [30 m, 0, 0], rcs: 1 dBsm}]}
  chain: {cfar: {estimator: {kind: cell-averaging}, n_training: {range: 6, velocity: 4},
                 n_guard: {range: 2, velocity: 2}, false_alarm_probability: 1e-4}}
vary:
  VARY
trials: {at_most: 4, block: 2UNTIL}
scores: [SCORES]
"""


@pytest.fixture
def load_study(tmp_path):
    """Return a function that loads a study with given scores and varied settings."""

    def load_with(
        scores="detection_probability",
        vary="chain.range_window: [hann, hamming]",
        until="",
        more="",
    ):
        text = STUDY.replace("VARY", vary).replace("SCORES", scores).replace("UNTIL", until)
        (tmp_path / "study.yaml").write_text(text + more)
        return dc.load_study(tmp_path / "study.yaml")

    return load_with


@pytest.mark.parametrize(
    ("score", "more", "value"),
    [
        ("azimuth_rmse", "", "chain.angle none"),
        ("clusters_per_target", "", "with a chain without clusters"),
        ("track_ospa", "", "without a tracker"),
        ("roc", "sensor: statistical", "sensor: statistical"),
    ],
)
def test_rejects_score_that_fits_no_point_before_first_trial(
    load_study, tmp_path, score, more, value
):
    checked_study = load_study(score, more=more)
    with pytest.raises(InvalidSetting, match=value) as error:
        dc.run_study(checked_study, tmp_path / "out")
    assert error.value.mistakes[0].setting == "scores"
    assert not (tmp_path / "out").exists()
    with pytest.raises(InvalidSetting, match=value):
        replay_trial(checked_study, 0)


def test_score_that_fits_some_points_runs(load_study, tmp_path):
    vary = "chain.cluster: [null, {min_detections: 1}]"
    study = load_study("clusters_per_target", vary=vary, more="stop_after_failures: 1")
    with ThreadPoolExecutor(1) as thread:
        outcome = dc.run_study(study, tmp_path, executor=thread)
    assert outcome.result.n_failed_trials_per_point.tolist() == [4, 0]


@pytest.mark.parametrize(
    ("until", "more", "setting"),
    [
        (
            ", until: {score: false_alarm_probability, target: car, width: 0.5}",
            "",
            "trials.until.target",
        ),
        (
            "",
            "require: [{score: false_alarm_probability, target: car, at_most: 0.5}]",
            "require.0.target",
        ),
    ],
)
def test_rejects_target_of_score_without_targets_before_first_trial(
    load_study, tmp_path, until, more, setting
):
    checked_study = load_study("false_alarm_probability", until=until, more=more)
    with pytest.raises(DechirpError) as error:
        dc.run_study(checked_study, tmp_path / "out")
    assert error.value.mistakes[0].setting == setting


@pytest.mark.parametrize(
    ("until", "more", "setting"),
    [
        ("", "require: [{score: detection_probability, at_least: 90}]", "require.0.at_least"),
        ("", "require: [{score: detection_probability, at_most: -0.1}]", "require.0.at_most"),
        (", until: {score: detection_probability, width: 5}", "", "trials.until.width"),
    ],
)
def test_rejects_probability_requirements_outside_0_to_1(load_study, until, more, setting):
    with pytest.raises(InvalidFile) as error:
        load_study(until=until, more=more)
    (mistake,) = error.value.mistakes
    assert mistake.setting == setting
    assert mistake.line is not None


def test_range_of_names_is_reported_once(load_study):
    with pytest.raises(InvalidFile) as error:
        load_study(vary="chain.range_window: {from: hann, to: hamming, n: 2}")
    assert [mistake.value for mistake in error.value.mistakes] == ["a range"]


def test_rejects_excessive_number_of_values(load_study):
    with pytest.raises(InvalidFile) as error:
        load_study(vary="scene.targets.car.rcs: {from: 0 dBsm, to: 9 dBsm, step: 1e-300 dB}")
    (mistake,) = error.value.mistakes
    assert len(mistake.value) < 80
    assert mistake.fix == "take fewer"


def test_point_on_limit_is_undecided_at_any_confidence():
    # One hit in two puts the value on the limit, but no bound: 0.29 to 0.71 at confidence 0.
    sums = np.array([[1.0, 1.0], [0.0, 1.0]])
    limit = Requirement(score="detection_probability", at_least=0.5)
    points = [
        PointData(settings=((WINDOW.path, text),), numbers=(None,), sums=sums, theory=np.array([1]))
        for text in WINDOW.texts
    ]
    checked_study = make_study(WINDOW, scores=(HitProbability(),), require=(limit,))
    (verdict,) = judge_requirements(
        estimate_scores_of_points(checked_study, make_layout(scores=(HitProbability(),)), points),
        lambda _: sums,
    )
    assert verdict.decision == "undecided"
    assert verdict.certainty == pytest.approx(0.5)


def test_combined_theory_is_mean_of_ratios_and_undefined_for_errors():
    joint_layout = ScoreColumnLayout(
        (DetectionProbability(), RangeRmse()), (("car", "van"), ("car", "van"))
    )
    theory = np.array([0.5, 1.0, 0.1, 0.3])
    assert joint_layout.theoretical_score_value(theory, "detection_probability") == 0.75
    assert np.isnan(joint_layout.theoretical_score_value(theory, "range_rmse"))
    assert joint_layout.theoretical_score_value(theory, "range_rmse", "van") == 0.3
    single_layout = ScoreColumnLayout((RangeRmse(),), (("car",),))
    assert single_layout.theoretical_score_value(np.array([0.1]), "range_rmse") == 0.1


@nightly
def test_ordered_statistic_has_more_effective_cells_than_mean(load_study):
    checked_study = load_study(vary="chain.cfar.estimator: [{kind: ordered-statistic}]")
    context = build_trial_context(Plan.from_study(checked_study).scenario_of_point(0))
    noise, training_window = (
        context.chain.map_noise_statistics(context.radar),
        context.chain.cfar.training_window,
    )
    box = training_window.noise_covariance_in_box(noise, training_window.half_range)
    roots = [np.linalg.cholesky(c) for c in (box.velocity_covariance, box.range_covariance)]
    rng = np.random.default_rng(3)
    shape = (20_000, len(roots[0]), len(roots[1]))
    white_noise = (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)
    power = abs(roots[0] @ white_noise @ roots[1].T) ** 2
    indices = box.training_offsets + np.array(
        [training_window.half_velocity, training_window.half_range]
    )
    quantiles = np.quantile(power[:, indices[:, 0], indices[:, 1]], 0.75, axis=1)

    # The variance over n independent exponential cells is p q / (n p^2), known here to 5 % at
    # five standard errors. The effective number of cells of a mean would make it 1.3 times larger.
    n_effective = 0.75 / 0.25 / quantiles.var()
    assert box.n_independent_for_quantile(0.75) == pytest.approx(n_effective, rel=0.08)
    assert box.n_independent < 0.85 * n_effective
    law = find_detector_law(context.chain.cfar, noise)
    assert law.n_training == round(box.n_independent_for_quantile(0.75))


def test_effective_number_of_independent_cells_is_their_number():
    window = CorrelatedWindow(
        range_covariance=np.eye(9),
        velocity_covariance=np.eye(7),
        guard_range=slice(3, 6),
        guard_velocity=slice(2, 5),
        cell_under_test=(4, 3),
    )
    for rank in (0.1, 0.5, 0.75, 0.99):
        assert window.n_independent_for_quantile(rank) == pytest.approx(window.n_training)
