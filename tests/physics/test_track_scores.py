"""Scores of tracks and clusters: of made-up looks whose score is known."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.evaluation.association import Association
from dechirp.evaluation.score.clusters_per_target import ClustersPerTarget
from dechirp.evaluation.score.false_tracks import FalseTracks
from dechirp.evaluation.score.identity_switches import IdentitySwitches
from dechirp.evaluation.score.one_cluster_probability import OneClusterProbability
from dechirp.evaluation.score.track_completeness import TrackCompleteness
from dechirp.evaluation.score.track_gospa import TrackGospa
from dechirp.evaluation.score.track_nees import TrackNees
from dechirp.evaluation.score.track_ospa import TrackOspa
from dechirp.evaluation.track_states import STATE_NAMES, target_states
from dechirp.evaluation.trial import TrialContext, TrialResult
from dechirp.scene.truth import truth

STD = np.array([0.2, 0.1, 0.3, 0.4])
"""Of x, vx, y and vy, m and m/s."""
OF_TRACKS = (TrackGospa, TrackOspa, TrackCompleteness, IdentitySwitches, TrackNees, FalseTracks)


@pytest.fixture(scope="module")
def case(radar):
    """Two cars side by side, overtaken by a radar that drives at an angle, over 20 frames."""
    cars = [
        dc.Target(name=name, position_m=(30, y, 0), velocity_m_per_s=(15, 0, 0))
        for name, y in (("left", 5), ("right", -5))
    ]
    scene = dc.Scene(targets=cars, ego=dc.Ego(velocity_m_per_s=(20, 0, 0), yaw_rad=0.2))
    radar = replace(radar, frame=replace(radar.frame, period_s=0.05))
    known = truth(scene, radar, n_frames=20)
    chain = dc.Chain(cluster=dc.Dbscan())
    return TrialContext(scene, radar, chain, known, 1e-12, known.time.values)


def tracks_at(case, state):
    """Confirmed tracks of states (track, frame, 4), none where those are NaN."""
    over = ("track", "frame")
    there = np.isfinite(state).all(axis=-1)
    covariance = np.where(there[..., None, None], np.diag(STD**2), np.nan)
    columns = {name: (over, state[..., i]) for i, name in enumerate(STATE_NAMES)}
    columns |= {
        "covariance": ((*over, "state", "other_state"), covariance),
        "status": (over, np.where(there, "confirmed", "")),
    }
    frame = case.truth["frame"].values
    return xr.Dataset(
        columns,
        coords={"frame": frame, "state": list(STATE_NAMES), "other_state": list(STATE_NAMES)},
    )


def true_state(case):
    known = target_states(case)
    return np.stack([known[name].values for name in STATE_NAMES], axis=-1)


def look_of(tracks=None, clusters=None, columns=None, target=()):
    errors = np.full((4, len(target)), np.nan)
    match = Association(np.array(target, int), *errors)
    return TrialResult(
        detections=columns or {}, association=match, clusters=clusters, tracks=tracks
    )


def scored(score, case, *states_of_trials):
    """Estimate of trials whose tracks have those states."""
    looks = [look_of(tracks_at(case, state)) for state in states_of_trials]
    every = [score.trial_sums(look, case) for look in looks]
    assert {one.shape for one in every} == {(max(len(score.subjects(case)), 1), score.n_sums)}
    sums = np.array(every).sum(axis=1)
    return score.estimate(sums, confidence=0.9)


def test_the_truth_of_tracks_is_where_the_radar_sees_targets(case):
    known, seen = target_states(case), case.truth
    np.testing.assert_allclose(np.hypot(known.x, known.y), seen.range, rtol=1e-12)
    np.testing.assert_allclose(np.arctan2(known.y, known.x), seen.azimuth, atol=1e-12)
    along = (known.x * known.vx + known.y * known.vy) / seen.range
    np.testing.assert_allclose(along, seen.velocity, atol=1e-12)


def test_perfect_tracks_have_no_error_and_hold_their_targets(case):
    perfect = true_state(case)
    expected = {TrackCompleteness: 1.0}
    for member in OF_TRACKS:
        assert scored(member(), case, perfect, perfect).value == expected.get(member, 0.0)


def test_no_tracks_are_errors_of_the_cut_off(case):
    none = np.empty((0, 20, 4))
    assert scored(TrackOspa(cutoff_m=4.0), case, none, none).value == pytest.approx(4.0)
    # Order 2: two misses of half its square each.
    assert scored(TrackGospa(cutoff_m=4.0), case, none, none).value == pytest.approx(4.0)
    assert scored(TrackCompleteness(), case, none, none).value == 0
    assert np.isnan(scored(TrackNees(), case, none, none).value)


def test_a_consistent_filter_has_four(case):
    rng, state, score = np.random.default_rng(111), true_state(case), TrackNees(cutoff_m=5.0)
    # Errors that last the whole trial: 100 trials of two targets are 200 errors, not 4,000.
    noisy = [state + STD * rng.standard_normal((2, 1, 4)) for _ in range(100)]
    found = scored(score, case, *noisy)
    assert score.theory(case).tolist() == [4.0, 4.0]
    # Chi-square of four degrees has a standard deviation of 2.83: 0.2, five of them.
    assert found.value == pytest.approx(4.0, abs=1.0)
    assert found.high - found.low == pytest.approx(2 * 1.66 * 0.2, rel=0.3)
    # A filter that takes errors for half as large is seen through.
    assert scored(score, case, *(2 * one - state for one in noisy)).low > 10


def test_tracks_that_swap_their_targets_change_identity_once_each(case):
    state = true_state(case)
    swapped = state.copy()
    swapped[:, 12:] = state[::-1, 12:]
    changes = scored(IdentitySwitches(), case, swapped, state)
    assert changes.value == 0.5  # a change of each target in one of two trials
    assert scored(TrackCompleteness(), case, swapped).value == 1
    assert scored(TrackOspa(), case, swapped).value == 0


def test_a_late_track_and_one_of_nothing_count_by_frames(case):
    state = true_state(case)
    late = state.copy()
    late[0, :5] = np.nan
    ghost = np.full((1, 20, 4), np.nan)
    ghost[0, 15:] = [80.0, 0.0, 20.0, 0.0]
    both = np.concatenate([late, ghost])
    assert scored(TrackCompleteness(), case, both).value == 35 / 40
    assert scored(FalseTracks(), case, both, state).value == 5 / 40
    # Of two targets one is missing, or of three tracks one too many.
    expected = (5 * 3.0 / 2 + 5 * 3.0 / 3) / 20
    assert scored(TrackOspa(cutoff_m=3.0), case, both).value == pytest.approx(expected)
    expected = 10 * np.sqrt(3.0**2 / 2) / 20
    assert scored(TrackGospa(cutoff_m=3.0), case, both).value == pytest.approx(expected)


def test_frames_of_a_track_make_no_surer_than_its_trials(case):
    state = true_state(case)
    lost = np.full_like(state, np.nan)
    few = scored(TrackCompleteness(), case, *([state] * 8 + [lost] * 2))
    assert few.value == 0.8
    # Ten trials, not 400 looks: between 0.49 and 0.96.
    assert few.low < 0.6 and few.high > 0.9


def clusters_of(frames):
    return xr.Dataset({"frame": ("cluster", np.array(frames))})


def test_clusters_belong_to_the_target_of_most_of_their_power(case):
    # Frame 0: the left car in two parts; frame 1: both merged, the right one stronger; frame 2:
    # each alone, beside a cluster of false alarms and a detection that is in none.
    table = [
        (0, 0, 10.0, 0), (0, 1, 10.0, 0),
        (1, 2, 10.0, 0), (1, 2, 12.0, 1),
        (2, 3, 10.0, 0), (2, 4, 12.0, 1), (2, 5, 50.0, -1), (2, -1, 5.0, 0),
    ]  # fmt: skip
    frame, cluster, snr, target = np.array(table).T
    columns = {"frame": frame, "cluster": cluster, "snr": snr}
    look = look_of(None, clusters_of([0, 0, 1, 2, 2, 2]), columns, target)
    one, parts = (
        score.trial_sums(look, case) for score in (OneClusterProbability(), ClustersPerTarget())
    )

    # Left: parts, lost, one; right: lost, one, one; of 20 frames.
    assert one.tolist() == [[1, 20], [2, 20]]
    assert parts.tolist() == [[3, 2], [2, 2]]
    assert ClustersPerTarget().estimate(parts[:1], confidence=0.9).value == 1.5


def test_scores_of_clusters_and_tracks_say_what_is_missing(case):
    empty = replace(case, scene=dc.Scene())
    for member in (*OF_TRACKS[:-1], OneClusterProbability, ClustersPerTarget):
        member().check_context(case)
        with pytest.raises(dc.InvalidSetting, match="without targets"):
            member().check_context(empty)
    FalseTracks().check_context(empty)
    for member in (OneClusterProbability, ClustersPerTarget):
        with pytest.raises(dc.InvalidSetting, match="without clusters"):
            member().check_context(replace(case, chain=dc.Chain()))
    with pytest.raises(dc.InvalidSetting, match="cutoff_m"):
        TrackGospa(cutoff_m=0.0)
