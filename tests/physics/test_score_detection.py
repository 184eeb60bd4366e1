"""Detection probability and resolution, measured beside what theory says of them."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.evaluation.detector_law import find_detector_law
from dechirp.evaluation.gates import normalised_frequencies
from dechirp.evaluation.predicted_detection import cell_snr_fraction, detection_probabilities
from dechirp.evaluation.score.detection_probability import DetectionProbability
from dechirp.evaluation.score.resolution_probability import ResolutionProbability
from dechirp.processing.cfar.base import Cfar
from dechirp.processing.cfar.ordered_statistic import OrderedStatistic
from dechirp.processing.cfar.trimmed_mean import TrimmedMean
from dechirp.processing.chain import Chain
from dechirp.processing.mitigation.mean_subtraction import MeanSubtraction
from dechirp.processing.range_doppler_map import power_map, threshold_map
from dechirp.scene.aliasing import RangeVelocity
from dechirp.scene.bodies.vehicle import Car
from nightly import nightly
from trial_cases import case_of, cubes, looks, small, sums, target

SURE = 1 - 1e-6
HANN = Chain(angle=None)
RECTANGULAR = Chain(range_window="rectangular", doppler_window="rectangular", angle=None)
PADDED = Chain(n_range_bins=128, n_velocity_bins=64, angle=None)
ORDERED = Chain(angle=None, cfar=Cfar(estimator=OrderedStatistic(), false_alarm_probability=1e-4))


def measured(case, n_trials: int):
    return DetectionProbability().estimate(
        sums(DetectionProbability(), case, n_trials).sum(axis=1), confidence=SURE
    )


def test_a_target_is_found_as_often_as_theory_says():
    case = case_of(small(4), HANN, 17.0)

    found = measured(case, 600)

    (theory,) = DetectionProbability().theory(case)
    assert 0.5 < theory < 0.75
    assert found.low < theory < found.high


@nightly
@pytest.mark.parametrize(
    ("radar", "chain", "snr_db"),
    [
        (small(), HANN, 15.0),
        (small(), RECTANGULAR, 13.0),
        (small(), PADDED, 15.0),
        (small(), ORDERED, 14.0),
        (small(4), HANN, 17.0),
        (small(sampling="real", n_samples=128), HANN, 15.0),
    ],
)
def test_theory_is_within_0_02_of_20_000_trials(radar, chain, snr_db):
    case = case_of(radar, chain, snr_db)

    found = measured(case, 20_000)

    (theory,) = DetectionProbability().theory(case)
    assert 0.3 < theory < 0.8
    assert found.value == pytest.approx(theory, abs=0.02)
    assert found.low < theory < found.high


def test_cells_beside_the_nearest_find_as_many_more_as_theory_says():
    """Half a cell off on both axes four cells hold as much: a quarter of all trials."""
    case = case_of(small(), HANN, 17.0, target(20.4745, 4.3397))
    noise, n_trials, n_more = case.chain.map_noise(case.radar), 600, 0
    place = RangeVelocity(case.truth.range.values, case.truth.velocity.values)
    fast, slow = (float(cycles.item()) for cycles in normalised_frequencies(place, case.radar))
    assert (64 * fast, 32 * slow) == pytest.approx((17.5, 2.5), abs=1e-3)
    row, column = round(fast * 64), round(slow * 32) + 16
    frames = cubes(case, np.random.default_rng(1))
    for look in looks(case, n_trials, seed=1):
        power = power_map(next(frames).isel(frame=0), case.radar, case.chain)
        over = power > threshold_map(power, case.radar, case.chain)
        n_more += int((look.association.target == 0).any()) - int(over.values[column, row])

    kept = cell_snr_fraction(place, case.radar, noise.range_transform, noise.doppler_transform)
    nearest = find_detector_law(case.chain.cfar, noise).detection_probability(
        case.truth.snr.values * kept
    )
    (theory,) = detection_probabilities(case) - nearest.ravel()
    assert theory > 0.2
    # Hardly ever does the nearest cell find it and the chain not: it is a share of the trials.
    assert n_more / n_trials == pytest.approx(theory, abs=4.9 * np.sqrt(theory / n_trials))


def test_no_law_is_told_where_none_holds():
    one = target()
    told = {
        "lone": case_of(small(), HANN, 15.0, one),
        "far from another": case_of(small(), HANN, 15.0, one, target(55.0, -10.0)),
        "two cells from another": case_of(small(), HANN, 15.0, one, target(22.5)),
        "in the ring of a strong one": case_of(small(), HANN, 15.0, one, target(30.0, rcs_m2=1e3)),
        "a body": case_of(small(), HANN, 15.0, target(body=Car())),
        "from chirp to chirp": case_of(small(), HANN, 15.0, target(fluctuation="swerling-2")),
        "trimmed mean": case_of(
            small(),
            replace(HANN, cfar=Cfar(estimator=TrimmedMean(), false_alarm_probability=1e-4)),
            15.0,
        ),
        "cleaned": case_of(small(), replace(HANN, mitigation=(MeanSubtraction(),)), 15.0),
        "across cells": case_of(small(), HANN, 15.0, target(velocity=700.0)),
    }
    told["other noise"] = replace(told["lone"], noise_power_w=np.nan)

    has_law = {
        name: bool(np.isfinite(detection_probabilities(case)[0])) for name, case in told.items()
    }

    assert [name for name, is_told in has_law.items() if is_told] == ["lone", "far from another"]
    alone, beside = (
        detection_probabilities(told[name])[0] for name in ("lone", "far from another")
    )
    assert beside == pytest.approx(alone, abs=1e-12)


def test_fading_costs_what_swerling_says_and_a_strong_target_is_always_found():
    steady, faded = (
        detection_probabilities(case_of(small(), HANN, 25.0, target(fluctuation=kind)))[0]
        for kind in ("steady", "swerling-1")
    )
    strong = detection_probabilities(case_of(small(), HANN, 90.0))[0]

    # At 25 dB, less 3.5 dB of two Hann windows and what it lies off: Pd = Pfa^(1 / (1 + snr)).
    assert steady > 0.9999
    assert 0.8 < faded < 0.95
    assert strong == pytest.approx(1.0, abs=1e-6)


def test_targets_are_resolved_where_each_has_a_detection_of_its_own():
    score = ResolutionProbability()
    apart = case_of(small(), HANN, 40.0, target(), target(30.0))
    near = case_of(small(), HANN, 40.0, target(), target(20.5))
    shares = [
        score.estimate(sums(score, case, 40)[:, 0], confidence=SURE) for case in (apart, near)
    ]

    assert shares[0].value == 1.0
    # Half a cell apart there is one peak.
    assert shares[1].high < 0.5
    with pytest.raises(dc.InvalidSetting, match="resolution_probability, in a scene of 1"):
        score.check_context(case_of(small(), HANN, 40.0))
