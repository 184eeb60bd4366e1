"""Scores of estimation errors: RMSE and bias of trials against the Cramer-Rao bound."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.evaluation.association import Associator
from dechirp.evaluation.case_bounds import rms_error_bounds
from dechirp.evaluation.score.errors import (
    AzimuthBias,
    AzimuthRmse,
    ElevationBias,
    ElevationRmse,
    RangeBias,
    RangeRmse,
    VelocityBias,
    VelocityRmse,
)
from dechirp.evaluation.trial import TrialResult
from dechirp.processing.chain import Chain
from dechirp.scene.bodies.vehicle import Car
from nightly import nightly
from trial_cases import iter_trials, make_target, small_radar, trial_context

CONFIDENCE = 1 - 1e-6


def build_radar_with_array(rx_m) -> dc.Radar:
    return replace(small_radar(), array=dc.Array(rx_m=rx_m))


@nightly
def test_errors_reach_bound_without_bias_on_all_axes():
    """2 x 4 receivers, one chain, 300 trials at 35 dB: noncoherent summing costs 0.1 %."""
    planar_radar = build_radar_with_array(
        [(0, 1.9e-3 * y, 1.9e-3 * z) for y in range(4) for z in range(2)]
    )
    case = trial_context(planar_radar, Chain(), 35.0)
    rmses = [RangeRmse(), VelocityRmse(), AzimuthRmse(), ElevationRmse()]
    biases = [RangeBias(), VelocityBias(), AzimuthBias(), ElevationBias()]
    trials = list(iter_trials(case, 300))
    for score in (*rmses, *biases):
        score.check_score_defined(case)
        sums = np.array([score.trial_sums(trial, case)[0] for trial in trials])

        estimate = score.estimate_with_interval(sums, confidence=CONFIDENCE)

        (theory,) = score.theoretical_values(case)
        assert np.isfinite(theory)
        assert estimate.low < theory < estimate.high, score.kind()
        assert estimate.high - estimate.low < 0.5 * rms_error_bounds(case)[score.axis][0] * (
            2 if score in biases else 1.5
        )


def test_bound_falls_with_square_root_of_snr():
    low_snr_bounds, high_snr_bounds = (
        rms_error_bounds(trial_context(small_radar(4), Chain(), snr_db)) for snr_db in (20.0, 40.0)
    )

    for axis in ("range", "velocity", "azimuth"):
        assert low_snr_bounds[axis][0] == pytest.approx(10 * high_snr_bounds[axis][0], rel=1e-9)
    assert np.isnan(low_snr_bounds["elevation"][0])


def test_bound_is_nan_outside_its_assumptions():
    chain, radar = Chain(), small_radar(4)
    single_case = trial_context(radar, chain, 30.0)
    cases_without_bound = [
        trial_context(radar, chain, 30.0, make_target(), make_target(21.0)),
        trial_context(radar, chain, 30.0, make_target(fluctuation="swerling-1")),
        trial_context(radar, chain, 30.0, make_target(body=Car())),
        replace(single_case, noise_power_w=np.nan),
    ]

    assert np.isfinite(RangeRmse().theoretical_values(single_case)).all()
    for case in cases_without_bound:
        assert np.isnan(RangeRmse().theoretical_values(case)).all()
        assert np.isnan(RangeBias().theoretical_values(case)).all()
    assert np.isnan(
        AzimuthRmse().theoretical_values(replace(single_case, chain=replace(chain, angle=None)))
    ).all()


def build_trial_result(case, **overrides) -> TrialResult:
    """Build detections of the first frame at the target's position, except for overrides."""
    n = max(np.size(column) for column in overrides.values())
    values = {
        "frame": 0,
        "range": case.truth.range.values[0, 0],
        "velocity": case.truth.velocity.values[0, 0],
        "azimuth": np.nan,
        "elevation": np.nan,
        "ambiguity_number": np.nan,
        "snr": 100.0,
        **overrides,
    }
    detections = {name: np.broadcast_to(column, n) for name, column in values.items()}
    return TrialResult(
        detections=detections,
        association=Associator(case.truth, case.radar, case.scene)(detections),
    )


def test_strongest_detection_of_target_counts_not_nearest():
    case = trial_context(small_radar(4), Chain(), 30.0)
    true_m = case.truth.range.item()
    trial = build_trial_result(
        case, range=true_m + np.array([0.0, 0.5, 30.0]), snr=[20.0, 90.0, 900.0]
    )

    assert RangeRmse().trial_sums(trial, case) == pytest.approx(np.array([[0.25, 1.0]]))
    assert RangeBias().trial_sums(trial, case) == pytest.approx(np.array([[0.5, 1.0]]))
    # The strongest detection has no azimuth: no error is counted, instead of an error of zero.
    assert AzimuthRmse().trial_sums(trial, case) == pytest.approx(np.zeros((1, 2)))


def test_errors_sum_over_targets_and_frames():
    case = trial_context(small_radar(), Chain(), 30.0, make_target(), make_target(40.0), n_frames=3)
    true_ranges_m = case.truth.range.values
    indices = [0, 0, 1], [0, 2, 2]
    trial = build_trial_result(
        case,
        frame=[0, 2, 2],
        range=true_ranges_m[indices] + np.array([0.1, -0.2, 0.3]),
        velocity=case.truth.velocity.values[0, 0],
    )

    assert RangeBias().trial_sums(trial, case) == pytest.approx(np.array([[-0.1, 2], [0.3, 1]]))
    sums = RangeRmse().trial_sums(trial, case).sum(axis=0)
    assert RangeRmse().estimate_with_interval(sums[None], confidence=0.9).value == pytest.approx(
        np.sqrt(0.14 / 3)
    )


def test_rejects_cases_without_score_and_suggests_fix():
    one_chirp = replace(small_radar(), frame=replace(small_radar().frame, n_chirps=1))
    cfar = (
        dc.Cfar(
            estimator=dc.cfar.CellAveraging(),
            n_training=dc.Cells(range=8, velocity=0),
            n_guard=dc.Cells(range=2, velocity=0),
            false_alarm_probability=1e-4,
        )
        if hasattr(dc, "Cells")
        else Chain().cfar
    )
    cases = [
        (AzimuthRmse(), trial_context(small_radar(4), Chain(angle=None), 30.0), "chain.angle"),
        (ElevationBias(), trial_context(small_radar(4), Chain(), 30.0), "resolves no elevation"),
        (VelocityRmse(), trial_context(one_chirp, Chain(cfar=cfar), 30.0), "with one chirp"),
        (
            RangeRmse(),
            trial_context(small_radar(), Chain(), 30.0, make_target(body=Car())),
            "bodies alone",
        ),
    ]
    for score, case, message in cases:
        with pytest.raises(dc.InvalidSetting, match=message) as error:
            score.check_score_defined(case)
        (mistake,) = error.value.mistakes
        assert score.kind() in mistake.value
        assert mistake.fix.endswith(f"or leave out {score.kind()}")
