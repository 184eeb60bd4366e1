"""Scores of detection and resolution probability: trials against theory."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.evaluation.detector_law import find_detector_law
from dechirp.evaluation.gates import echo_cycles_per_sample_and_chirp
from dechirp.evaluation.predicted_detection import (
    nearest_cell_snr_fraction,
    theoretical_detection_probabilities,
)
from dechirp.evaluation.score.probabilities import DetectionProbability, ResolutionProbability
from dechirp.processing.cfar.base import Cfar
from dechirp.processing.cfar.ordered_statistic import OrderedStatistic
from dechirp.processing.cfar.trimmed_mean import TrimmedMean
from dechirp.processing.chain import Chain
from dechirp.processing.mitigation.mean_subtraction import MeanSubtraction
from dechirp.processing.range_doppler_map import power_map, threshold_map
from dechirp.scene.aliasing import RangeVelocity
from dechirp.scene.bodies.vehicle import Car
from nightly import nightly
from trial_cases import (
    iter_noisy_cubes,
    iter_trials,
    make_target,
    small_radar,
    trial_context,
    trial_sums,
)

CONFIDENCE = 1 - 1e-6
HANN = Chain(angle=None)
RECTANGULAR = Chain(range_window="rectangular", doppler_window="rectangular", angle=None)
PADDED = Chain(n_range_bins=128, n_velocity_bins=64, angle=None)
ORDERED = Chain(angle=None, cfar=Cfar(estimator=OrderedStatistic(), false_alarm_probability=1e-4))


def measure_detection_probability(case, n_trials: int):
    return DetectionProbability().estimate_with_interval(
        trial_sums(DetectionProbability(), case, n_trials).sum(axis=1), confidence=CONFIDENCE
    )


@nightly
def test_detection_probability_matches_theory():
    case = trial_context(small_radar(4), HANN, 17.0)

    estimate = measure_detection_probability(case, 300)

    (theory,) = DetectionProbability().theoretical_values(case)
    assert 0.5 < theory < 0.75
    assert estimate.low < theory < estimate.high


@nightly
@pytest.mark.parametrize(
    ("radar", "chain", "snr_db"),
    [
        (small_radar(), HANN, 15.0),
        (small_radar(), RECTANGULAR, 13.0),
        (small_radar(), PADDED, 15.0),
        (small_radar(), ORDERED, 14.0),
        (small_radar(4), HANN, 17.0),
        (small_radar(sampling="real", n_samples=128), HANN, 15.0),
    ],
)
def test_theory_is_within_0_02_of_20_000_trials(radar, chain, snr_db):
    case = trial_context(radar, chain, snr_db)

    estimate = measure_detection_probability(case, 20_000)

    (theory,) = DetectionProbability().theoretical_values(case)
    assert 0.3 < theory < 0.8
    assert estimate.value == pytest.approx(theory, abs=0.02)
    assert estimate.low < theory < estimate.high


@nightly
def test_neighbouring_cells_add_detections_as_predicted():
    """Four cells are equally strong half a cell off on both axes: a quarter more detections."""
    case = trial_context(small_radar(), HANN, 17.0, make_target(20.4745, 4.3397))
    noise, n_more = case.chain.map_noise_statistics(case.radar), 0
    n_trials = 600
    truth = RangeVelocity(case.truth.range.values, case.truth.velocity.values)
    fast_cycles, slow_cycles = (
        float(cycles.item()) for cycles in echo_cycles_per_sample_and_chirp(truth, case.radar)
    )
    assert (64 * fast_cycles, 32 * slow_cycles) == pytest.approx((17.5, 2.5), abs=1e-3)
    row, column = round(fast_cycles * 64), round(slow_cycles * 32) + 16
    frames = iter_noisy_cubes(case, np.random.default_rng(1))
    for trial in iter_trials(case, n_trials, seed=1):
        power = power_map(next(frames).isel(frame=0), case.radar, case.chain)
        is_detected = power > threshold_map(power, case.radar, case.chain)
        n_more += int((trial.association.target == 0).any()) - int(is_detected.values[column, row])

    snr_fraction = nearest_cell_snr_fraction(
        truth, case.radar, noise.range_transform, noise.doppler_transform
    )
    nearest_probability = find_detector_law(case.chain.cfar, noise).detection_probability(
        case.truth.snr.values * snr_fraction
    )
    (theory,) = theoretical_detection_probabilities(case) - nearest_probability.ravel()
    assert theory > 0.2
    # The chain almost never misses a target that the nearest cell detects: a binomial share.
    assert n_more / n_trials == pytest.approx(theory, abs=4.9 * np.sqrt(theory / n_trials))


def test_theory_is_nan_outside_its_assumptions():
    car = make_target()
    cases = {
        "lone": trial_context(small_radar(), HANN, 15.0, car),
        "far from other target": trial_context(
            small_radar(), HANN, 15.0, car, make_target(55.0, -10.0)
        ),
        "two cells from other target": trial_context(
            small_radar(), HANN, 15.0, car, make_target(22.5)
        ),
        "in training window of strong target": trial_context(
            small_radar(), HANN, 15.0, car, make_target(30.0, rcs_m2=1e3)
        ),
        "extended body": trial_context(small_radar(), HANN, 15.0, make_target(body=Car())),
        "chirp-to-chirp fluctuation": trial_context(
            small_radar(), HANN, 15.0, make_target(fluctuation="swerling-2")
        ),
        "trimmed mean": trial_context(
            small_radar(),
            replace(HANN, cfar=Cfar(estimator=TrimmedMean(), false_alarm_probability=1e-4)),
            15.0,
        ),
        "mitigation": trial_context(
            small_radar(), replace(HANN, mitigation=(MeanSubtraction(),)), 15.0
        ),
        "range walk": trial_context(small_radar(), HANN, 15.0, make_target(velocity=700.0)),
    }
    cases["unknown noise"] = replace(cases["lone"], noise_power_w=np.nan)

    has_law = {
        name: bool(np.isfinite(theoretical_detection_probabilities(case)[0]))
        for name, case in cases.items()
    }

    assert [name for name, is_available in has_law.items() if is_available] == [
        "lone",
        "far from other target",
    ]
    lone_probability, far_probability = (
        theoretical_detection_probabilities(cases[name])[0]
        for name in ("lone", "far from other target")
    )
    assert far_probability == pytest.approx(lone_probability, abs=1e-12)


def test_fading_loss_matches_swerling_and_strong_target_is_certain():
    steady_probability, fading_probability = (
        theoretical_detection_probabilities(
            trial_context(small_radar(), HANN, 25.0, make_target(fluctuation=kind))
        )[0]
        for kind in ("steady", "swerling-1")
    )
    strong_probability = theoretical_detection_probabilities(
        trial_context(small_radar(), HANN, 90.0)
    )[0]

    # 25 dB, minus 3.5 dB of two Hann windows and scalloping loss: Pd = Pfa^(1 / (1 + snr)).
    assert steady_probability > 0.9999
    assert 0.8 < fading_probability < 0.95
    assert strong_probability == pytest.approx(1.0, abs=1e-6)


def test_resolution_requires_one_detection_per_target():
    score = ResolutionProbability()
    separate_case = trial_context(small_radar(), HANN, 40.0, make_target(), make_target(30.0))
    close_case = trial_context(small_radar(), HANN, 40.0, make_target(), make_target(20.5))
    shares = [
        score.estimate_with_interval(trial_sums(score, case, 40)[:, 0], confidence=CONFIDENCE)
        for case in (separate_case, close_case)
    ]

    assert shares[0].value == 1.0
    # Targets half a cell apart give one peak.
    assert shares[1].high < 0.5
    with pytest.raises(dc.InvalidSetting, match="resolution_probability, in a scene of 1"):
        score.check_score_defined(trial_context(small_radar(), HANN, 40.0))
