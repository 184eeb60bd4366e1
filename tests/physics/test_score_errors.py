"""Errors of estimates, measured beside the Cramer-Rao bound."""

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
from trial_cases import case_of, looks, small, target

SURE = 1 - 1e-6


def array(rx_m) -> dc.Radar:
    return replace(small(), array=dc.Array(rx_m=rx_m))


def test_errors_reach_the_bound_and_are_even_on_all_axes():
    """2 x 4 receivers, one chain of 300 trials at 35 dB: what adding powers costs, 0.1 %."""
    plane = array([(0, 1.9e-3 * y, 1.9e-3 * z) for y in range(4) for z in range(2)])
    case = case_of(plane, Chain(), 35.0)
    rmses = [RangeRmse(), VelocityRmse(), AzimuthRmse(), ElevationRmse()]
    biases = [RangeBias(), VelocityBias(), AzimuthBias(), ElevationBias()]
    seen = list(looks(case, 300))
    for score in (*rmses, *biases):
        score.check_context(case)
        sums = np.array([score.trial_sums(look, case)[0] for look in seen])

        found = score.estimate(sums, confidence=SURE)

        (theory,) = score.theory(case)
        assert np.isfinite(theory)
        assert found.low < theory < found.high, score.label()
        assert found.high - found.low < 0.5 * rms_error_bounds(case)[score.axis][0] * (
            2 if score in biases else 1.5
        )


def test_the_bound_falls_with_the_root_of_the_ratio():
    low, high = (rms_error_bounds(case_of(small(4), Chain(), snr_db)) for snr_db in (20.0, 40.0))

    for axis in ("range", "velocity", "azimuth"):
        assert low[axis][0] == pytest.approx(10 * high[axis][0], rel=1e-9)
    assert np.isnan(low["elevation"][0])


def test_no_bound_is_told_where_none_holds():
    chain, radar = Chain(), small(4)
    lone = case_of(radar, chain, 30.0)
    none = [
        case_of(radar, chain, 30.0, target(), target(21.0)),
        case_of(radar, chain, 30.0, target(fluctuation="swerling-1")),
        case_of(radar, chain, 30.0, target(body=Car())),
        replace(lone, noise_power_w=np.nan),
    ]

    assert np.isfinite(RangeRmse().theory(lone)).all()
    for case in none:
        assert np.isnan(RangeRmse().theory(case)).all()
        assert np.isnan(RangeBias().theory(case)).all()
    assert np.isnan(AzimuthRmse().theory(replace(lone, chain=replace(chain, angle=None)))).all()


def columns(case, **told) -> TrialResult:
    """Detections of the first frame, those of the target's place but for what is told."""
    n = max(np.size(column) for column in told.values())
    at = {
        "frame": 0,
        "range": case.truth.range.values[0, 0],
        "velocity": case.truth.velocity.values[0, 0],
        "azimuth": np.nan,
        "elevation": np.nan,
        "ambiguity_number": np.nan,
        "snr": 100.0,
        **told,
    }
    found = {name: np.broadcast_to(column, n) for name, column in at.items()}
    return TrialResult(
        detections=found, association=Associator(case.truth, case.radar, case.scene)(found)
    )


def test_the_strongest_detection_of_a_target_counts_and_not_the_nearest():
    case = case_of(small(4), Chain(), 30.0)
    true_m = case.truth.range.item()
    look = columns(case, range=true_m + np.array([0.0, 0.5, 30.0]), snr=[20.0, 90.0, 900.0])

    assert RangeRmse().trial_sums(look, case) == pytest.approx(np.array([[0.25, 1.0]]))
    assert RangeBias().trial_sums(look, case) == pytest.approx(np.array([[0.5, 1.0]]))
    # The strongest tells no azimuth: there is no error, rather than none.
    assert AzimuthRmse().trial_sums(look, case) == pytest.approx(np.zeros((1, 2)))


def test_targets_and_frames_add_up():
    case = case_of(small(), Chain(), 30.0, target(), target(40.0), n_frames=3)
    at_m = case.truth.range.values
    places = [0, 0, 1], [0, 2, 2]
    look = columns(
        case,
        frame=[0, 2, 2],
        range=at_m[places] + np.array([0.1, -0.2, 0.3]),
        velocity=case.truth.velocity.values[0, 0],
    )

    assert RangeBias().trial_sums(look, case) == pytest.approx(np.array([[-0.1, 2], [0.3, 1]]))
    whole = RangeRmse().trial_sums(look, case).sum(axis=0)
    assert RangeRmse().estimate(whole[None], confidence=0.9).value == pytest.approx(
        np.sqrt(0.14 / 3)
    )


def test_what_cannot_be_scored_is_refused_with_what_to_do():
    one_chirp = replace(small(), frame=replace(small().frame, n_chirps=1))
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
    refused = [
        (AzimuthRmse(), case_of(small(4), Chain(angle=None), 30.0), "chain.angle"),
        (ElevationBias(), case_of(small(4), Chain(), 30.0), "tells no elevation"),
        (VelocityRmse(), case_of(one_chirp, Chain(cfar=cfar), 30.0), "of one chirp"),
        (RangeRmse(), case_of(small(), Chain(), 30.0, target(body=Car())), "bodies alone"),
    ]
    for score, case, what in refused:
        with pytest.raises(dc.InvalidSetting, match=what) as wrong:
            score.check_context(case)
        (mistake,) = wrong.value.mistakes
        assert score.label() in mistake.value
        assert mistake.fix.endswith(f"or leave out {score.label()}")
