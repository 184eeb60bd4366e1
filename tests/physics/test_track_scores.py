"""Scores of tracks and clusters, on synthetic trials with known scores."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.evaluation.association import Association
from dechirp.evaluation.score.clusters import ClustersPerTarget, OneClusterProbability
from dechirp.evaluation.score.tracks import (
    FalseTracks,
    IdentitySwitches,
    TrackCompleteness,
    TrackGospa,
    TrackNees,
    TrackOspa,
)
from dechirp.evaluation.track_states import STATE_NAMES, true_target_states
from dechirp.evaluation.trial import TrialContext, TrialResult
from dechirp.scene.truth import truth

STD = np.array([0.2, 0.1, 0.3, 0.4])
"""Standard errors of x, vx, y and vy, m and m/s."""
TRACK_SCORES = (TrackGospa, TrackOspa, TrackCompleteness, IdentitySwitches, TrackNees, FalseTracks)


@pytest.fixture(scope="module")
def context(radar):
    """Trial context of two cars side by side and an overtaking radar with yaw, 20 frames."""
    cars = [
        dc.Target(name=name, position_m=(30, y, 0), velocity_m_per_s=(15, 0, 0))
        for name, y in (("left", 5), ("right", -5))
    ]
    scene = dc.Scene(targets=cars, ego=dc.Ego(velocity_m_per_s=(20, 0, 0), yaw_rad=0.2))
    radar = replace(radar, frame=replace(radar.frame, period_s=0.05))
    ground_truth = truth(scene, radar, n_frames=20)
    chain = dc.Chain(cluster=dc.Dbscan())
    return TrialContext(scene, radar, chain, ground_truth, 1e-12, ground_truth.time.values)


def build_tracks(context, state):
    """Build confirmed tracks of states (track, frame, 4); NaN marks missing frames."""
    dims = ("track", "frame")
    has_state = np.isfinite(state).all(axis=-1)
    covariance = np.where(has_state[..., None, None], np.diag(STD**2), np.nan)
    columns = {name: (dims, state[..., i]) for i, name in enumerate(STATE_NAMES)}
    columns |= {
        "covariance": ((*dims, "state", "other_state"), covariance),
        "status": (dims, np.where(has_state, "confirmed", "")),
    }
    frame = context.truth["frame"].values
    return xr.Dataset(
        columns,
        coords={"frame": frame, "state": list(STATE_NAMES), "other_state": list(STATE_NAMES)},
    )


def stack_true_states(context):
    targets = true_target_states(context)
    return np.stack([targets[name].values for name in STATE_NAMES], axis=-1)


def build_trial_result(tracks=None, clusters=None, columns=None, target=()):
    errors = np.full((4, len(target)), np.nan)
    match = Association(np.array(target, int), *errors)
    return TrialResult(
        detections=columns or {}, association=match, clusters=clusters, tracks=tracks
    )


def estimate_score(score, context, *states_of_trials):
    """Estimate a score from trials whose tracks have the given states."""
    trials = [build_trial_result(build_tracks(context, state)) for state in states_of_trials]
    sums_of_trials = [score.trial_sums(trial, context) for trial in trials]
    assert {trial_sums.shape for trial_sums in sums_of_trials} == {
        (max(len(score.scored_target_names(context)), 1), score.n_sums)
    }
    sums = np.array(sums_of_trials).sum(axis=1)
    return score.estimate_with_interval(sums, confidence=0.9)


def test_true_states_match_ground_truth_of_radar(context):
    targets, ground_truth = true_target_states(context), context.truth
    np.testing.assert_allclose(np.hypot(targets.x, targets.y), ground_truth.range, rtol=1e-12)
    np.testing.assert_allclose(np.arctan2(targets.y, targets.x), ground_truth.azimuth, atol=1e-12)
    radial_velocity = (targets.x * targets.vx + targets.y * targets.vy) / ground_truth.range
    np.testing.assert_allclose(radial_velocity, ground_truth.velocity, atol=1e-12)


def test_perfect_tracks_have_no_error_and_full_completeness(context):
    state = stack_true_states(context)
    expected = {TrackCompleteness: 1.0}
    for member in TRACK_SCORES:
        assert estimate_score(member(), context, state, state).value == expected.get(member, 0.0)


def test_missing_tracks_score_the_cutoff(context):
    no_tracks = np.empty((0, 20, 4))
    assert estimate_score(
        TrackOspa(cutoff_m=4.0), context, no_tracks, no_tracks
    ).value == pytest.approx(4.0)
    # Order 2: two missed targets of half the squared cutoff each.
    assert estimate_score(
        TrackGospa(cutoff_m=4.0), context, no_tracks, no_tracks
    ).value == pytest.approx(4.0)
    assert estimate_score(TrackCompleteness(), context, no_tracks, no_tracks).value == 0
    assert np.isnan(estimate_score(TrackNees(), context, no_tracks, no_tracks).value)


def test_consistent_filter_has_nees_of_four(context):
    rng, state, score = (
        np.random.default_rng(111),
        stack_true_states(context),
        TrackNees(cutoff_m=5.0),
    )
    # Errors are constant over a trial: 100 trials of two targets are 200 errors, not 4,000.
    noisy_states = [state + STD * rng.standard_normal((2, 1, 4)) for _ in range(100)]
    estimate = estimate_score(score, context, *noisy_states)
    assert score.theoretical_values(context).tolist() == [4.0, 4.0]
    # Chi-squared of four degrees of freedom has a standard deviation of 2.83: 0.2, five of them.
    assert estimate.value == pytest.approx(4.0, abs=1.0)
    assert estimate.high - estimate.low == pytest.approx(2 * 1.66 * 0.2, rel=0.3)
    # A filter that understates its errors by half has a clearly larger NEES.
    assert (
        estimate_score(
            score, context, *(2 * noisy_state - state for noisy_state in noisy_states)
        ).low
        > 10
    )


def test_swapped_tracks_count_one_identity_switch_per_target(context):
    state = stack_true_states(context)
    swapped_state = state.copy()
    swapped_state[:, 12:] = state[::-1, 12:]
    switches = estimate_score(IdentitySwitches(), context, swapped_state, state)
    assert switches.value == 0.5  # one switch per target in one of two trials
    assert estimate_score(TrackCompleteness(), context, swapped_state).value == 1
    assert estimate_score(TrackOspa(), context, swapped_state).value == 0


def test_late_and_false_tracks_count_by_frames(context):
    state = stack_true_states(context)
    late_state = state.copy()
    late_state[0, :5] = np.nan
    ghost_state = np.full((1, 20, 4), np.nan)
    ghost_state[0, 15:] = [80.0, 0.0, 20.0, 0.0]
    all_states = np.concatenate([late_state, ghost_state])
    assert estimate_score(TrackCompleteness(), context, all_states).value == 35 / 40
    assert estimate_score(FalseTracks(), context, all_states, state).value == 5 / 40
    # One of two targets is missing, or one of three tracks is false.
    expected = (5 * 3.0 / 2 + 5 * 3.0 / 3) / 20
    assert estimate_score(TrackOspa(cutoff_m=3.0), context, all_states).value == pytest.approx(
        expected
    )
    expected = 10 * np.sqrt(3.0**2 / 2) / 20
    assert estimate_score(TrackGospa(cutoff_m=3.0), context, all_states).value == pytest.approx(
        expected
    )


def test_confidence_depends_on_number_of_trials_not_frames(context):
    state = stack_true_states(context)
    lost_state = np.full_like(state, np.nan)
    estimate = estimate_score(TrackCompleteness(), context, *([state] * 8 + [lost_state] * 2))
    assert estimate.value == 0.8
    # Ten trials, not 400 track frames: between 0.49 and 0.96.
    assert estimate.low < 0.6 and estimate.high > 0.9


def build_clusters(frames):
    return xr.Dataset({"frame": ("cluster", np.array(frames))})


def test_cluster_belongs_to_target_with_most_of_its_power(context):
    # Frame 0: left car in two clusters; frame 1: both cars in one cluster, the right one stronger;
    # frame 2: one cluster per car, a cluster of false alarms and an unclustered detection.
    table = [
        (0, 0, 10.0, 0), (0, 1, 10.0, 0),
        (1, 2, 10.0, 0), (1, 2, 12.0, 1),
        (2, 3, 10.0, 0), (2, 4, 12.0, 1), (2, 5, 50.0, -1), (2, -1, 5.0, 0),
    ]  # fmt: skip
    frame, cluster, snr, target = np.array(table).T
    columns = {"frame": frame, "cluster": cluster, "snr": snr}
    trial = build_trial_result(None, build_clusters([0, 0, 1, 2, 2, 2]), columns, target)
    one_cluster_sums, cluster_sums = (
        score.trial_sums(trial, context) for score in (OneClusterProbability(), ClustersPerTarget())
    )

    # Left car: two clusters, none, one; right car: none, one, one; of 20 frames.
    assert one_cluster_sums.tolist() == [[1, 20], [2, 20]]
    assert cluster_sums.tolist() == [[3, 2], [2, 2]]
    assert ClustersPerTarget().estimate_with_interval(cluster_sums[:1], confidence=0.9).value == 1.5


def test_rejects_contexts_without_targets_or_clusters(context):
    empty_context = replace(context, scene=dc.Scene())
    for member in (*TRACK_SCORES[:-1], OneClusterProbability, ClustersPerTarget):
        member().check_score_defined(context)
        with pytest.raises(dc.InvalidSetting, match="without targets"):
            member().check_score_defined(empty_context)
    FalseTracks().check_score_defined(empty_context)
    for member in (OneClusterProbability, ClustersPerTarget):
        with pytest.raises(dc.InvalidSetting, match="without clusters"):
            member().check_score_defined(replace(context, chain=dc.Chain()))
    with pytest.raises(dc.InvalidSetting, match="cutoff_m"):
        TrackGospa(cutoff_m=0.0)
