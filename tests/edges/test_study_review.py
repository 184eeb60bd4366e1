"""What a user of `dechirp study` gets wrong is told before a trial is run."""

import numpy as np
import pytest

import dechirp as dc
from dechirp.core.errors import DechirpError, InvalidFile, InvalidSetting
from dechirp.evaluation.detector_law import find_detector_law
from dechirp.evaluation.score.detection_probability import DetectionProbability
from dechirp.evaluation.score.errors import RangeRmse
from dechirp.experiments.study.layout import Layout
from dechirp.experiments.study.plan import Plan
from dechirp.experiments.study.requirements import judge_requirements
from dechirp.experiments.study.results import PointData, estimate_points
from dechirp.experiments.study.run import replay_trial
from dechirp.experiments.study.study import Requirement
from dechirp.experiments.study.trial_context import build_trial_context
from dechirp.theory.cfar_correlated_cells import CorrelatedWindow
from study_made import WINDOW, Share, layout, study

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
def load(tmp_path):
    """Read a study of these scores."""

    def loaded(
        scores="detection_probability",
        vary="chain.range_window: [hann, hamming]",
        until="",
        more="",
    ):
        text = STUDY.replace("VARY", vary).replace("SCORES", scores).replace("UNTIL", until)
        (tmp_path / "study.yaml").write_text(text + more)
        return dc.load_study(tmp_path / "study.yaml")

    return loaded


@pytest.mark.parametrize(
    ("score", "more", "value"),
    [
        ("azimuth_rmse", "", "chain.angle none"),
        ("clusters_per_target", "", "with a chain without clusters"),
        ("track_ospa", "", "without a tracker"),
        ("roc", "sensor: statistical", "sensor: statistical"),
    ],
)
def test_a_score_that_fits_no_point_is_refused_before_any_trial(load, tmp_path, score, more, value):
    asked = load(score, more=more)
    with pytest.raises(InvalidSetting, match=value) as error:
        dc.run_study(asked, tmp_path / "out")
    assert error.value.mistakes[0].setting == "scores"
    assert not (tmp_path / "out").exists()
    with pytest.raises(InvalidSetting, match=value):
        replay_trial(asked, 0)


def test_a_score_that_fits_some_points_is_tried(load, tmp_path):
    vary = "chain.cluster: [null, {min_detections: 1}]"
    done = dc.run_study(
        load("clusters_per_target", vary=vary, more="stop_after_failures: 1"), tmp_path
    )
    assert done.result.n_failures.tolist() == [4, 0]


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
def test_a_target_of_a_score_that_has_none_is_refused_before_any_trial(
    load, tmp_path, until, more, setting
):
    asked = load("false_alarm_probability", until=until, more=more)
    with pytest.raises(DechirpError) as error:
        dc.run_study(asked, tmp_path / "out")
    assert error.value.mistakes[0].setting == setting


@pytest.mark.parametrize(
    ("until", "more", "setting"),
    [
        ("", "require: [{score: detection_probability, at_least: 90}]", "require.0.at_least"),
        ("", "require: [{score: detection_probability, at_most: -0.1}]", "require.0.at_most"),
        (", until: {score: detection_probability, width: 5}", "", "trials.until.width"),
    ],
)
def test_no_probability_is_asked_to_be_what_none_can_be(load, until, more, setting):
    with pytest.raises(InvalidFile) as error:
        load(until=until, more=more)
    (one,) = error.value.mistakes
    assert one.setting == setting
    assert one.line is not None


def test_a_range_of_words_is_told_once(load):
    with pytest.raises(InvalidFile) as error:
        load(vary="chain.range_window: {from: hann, to: hamming, n: 2}")
    assert [one.value for one in error.value.mistakes] == ["a range"]


def test_so_many_values_that_none_can_confirm_them_are_not_to_be_confirmed(load):
    with pytest.raises(InvalidFile) as error:
        load(vary="scene.targets.car.rcs: {from: 0 dBsm, to: 9 dBsm, step: 1e-300 dB}")
    (one,) = error.value.mistakes
    assert len(one.value) < 80
    assert one.fix == "take fewer"


def test_points_that_show_nothing_at_any_confidence_are_undecided():
    # Of 1 hit in 2 the value is on the limit, and no bound is: 0.29 to 0.71 at confidence 0.
    kept = np.array([[1.0, 1.0], [0.0, 1.0]])
    limit = Requirement(score="detection_probability", at_least=0.5)
    made = [
        PointData(settings=((WINDOW.path, text),), numbers=(None,), sums=kept, theory=np.array([1]))
        for text in WINDOW.texts
    ]
    what = study(WINDOW, scores=(Share(),), require=(limit,))
    (one,) = judge_requirements(
        estimate_points(what, layout(scores=(Share(),)), made), lambda _: kept
    )
    assert one.decision == "undecided"
    assert one.certainty == pytest.approx(0.5)


def test_errors_of_targets_together_have_no_theory_and_shares_have_the_mean():
    both = Layout((DetectionProbability(), RangeRmse()), (("car", "van"), ("car", "van")))
    theory = np.array([0.5, 1.0, 0.1, 0.3])
    assert both.score_theory(theory, "detection_probability") == 0.75
    assert np.isnan(both.score_theory(theory, "range_rmse"))
    assert both.score_theory(theory, "range_rmse", "van") == 0.3
    alone = Layout((RangeRmse(),), (("car",),))
    assert alone.score_theory(np.array([0.1]), "range_rmse") == 0.1


def test_an_ordered_statistic_is_worth_more_cells_than_their_mean_under_a_window(load):
    study = load(vary="chain.cfar.estimator: [{kind: ordered-statistic}]")
    case = build_trial_context(Plan.from_study(study).scenario(0))
    noise, ring = case.chain.map_noise(case.radar), case.chain.cfar.training_window
    box = ring.noise_box(noise, ring.half_range)
    roots = [np.linalg.cholesky(c) for c in (box.velocity_covariance, box.range_covariance)]
    rng = np.random.default_rng(3)
    shape = (20_000, len(roots[0]), len(roots[1]))
    white = (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)
    power = abs(roots[0] @ white @ roots[1].T) ** 2
    at = box.offsets + np.array([ring.half_velocity, ring.half_range])
    drawn = np.quantile(power[:, at[:, 0], at[:, 1]], 0.75, axis=1)

    # Of n independent exponential cells: p q / (n p^2), and the variance itself is known to 5 %
    # at five standard errors. As many cells as the mean is worth would make it 1.3 times as much.
    worth = 0.75 / 0.25 / drawn.var()
    assert box.n_independent_for_quantile(0.75) == pytest.approx(worth, rel=0.08)
    assert box.n_independent < 0.85 * worth
    law = find_detector_law(case.chain.cfar, noise)
    assert law.n_training == round(box.n_independent_for_quantile(0.75))


def test_independent_cells_are_worth_themselves_at_every_rank():
    white = CorrelatedWindow(
        range_covariance=np.eye(9),
        velocity_covariance=np.eye(7),
        guard_range=slice(3, 6),
        guard_velocity=slice(2, 5),
        cell_under_test=(4, 3),
    )
    for share in (0.1, 0.5, 0.75, 0.99):
        assert white.n_independent_for_quantile(share) == pytest.approx(white.n_training)
