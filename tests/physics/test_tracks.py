"""Tracking: accuracy, covariance consistency, confirmation, association and bad input."""

import re
import sys
from dataclasses import replace
from itertools import product
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import psutil
import pytest
import xarray as xr

from dechirp.config import loading
from dechirp.core.errors import InvalidSetting, NotEnoughMemory
from dechirp.core.findings import PhysicsWarning
from dechirp.evaluation.nees import mean_nees_interval, nees
from dechirp.evaluation.track_trial import (
    TrackTrial,
    assess_track_completeness,
    draw_truth_and_detections,
)
from dechirp.scene.scene import Scene
from dechirp.scene.target import Target
from dechirp.tracking import stone_soup
from dechirp.tracking.batch import track
from dechirp.tracking.false_alarms import FalseAlarms
from dechirp.tracking.kalman_filter import StateEstimates
from dechirp.tracking.measurements import usable_rows_to_measurements
from dechirp.tracking.online import LiveTracker
from dechirp.tracking.separation import is_within_separation
from dechirp.tracking.track_update import predict_associate_and_update
from dechirp.tracking.tracker import Tracker
from nightly import nightly

EXAMPLE = Path(__file__).parents[2] / "examples" / "crossing-tracks.yaml"
STD = {"range": 0.15, "azimuth": 0.01, "velocity": 0.1}
FEW_FALSE_ALARMS = FalseAlarms(per_frame=1e-3)
STATE_NAMES = ("x", "vx", "y", "vy")


def build_detections(frames, state, **columns) -> xr.Dataset:
    """Build exact detections of states (n, 4), x vx y vy, with standard errors."""
    x, vx, y, vy = np.atleast_2d(state).T
    range_m = np.hypot(x, y)
    values = {
        "frame": np.asarray(frames),
        "range": range_m,
        "azimuth": np.arctan2(y, x),
        "velocity": (x * vx + y * vy) / range_m,
        **{f"{name}_std": np.full(len(x), std) for name, std in STD.items()},
        **columns,
    }
    return xr.Dataset({name: ("detection", column) for name, column in values.items()})


def straight_states(start, times_s) -> np.ndarray:
    """States of a target on a straight path, (n_times, 4)."""
    x, vx, y, vy = start
    t = np.asarray(times_s)
    return np.stack([x + vx * t, 0 * t + vx, y + vy * t, 0 * t + vy], axis=-1)


def stack_states(tracks: xr.Dataset) -> np.ndarray:
    return np.stack([tracks[name].values for name in STATE_NAMES], axis=-1)


def build_trial(**overrides) -> TrackTrial:
    """Build a trial of ten targets at least 9 m apart on separate paths, without false alarms."""
    targets = [
        Target(
            position_m=(20 + 9 * i, (-1) ** i * 10, 0), velocity_m_per_s=((-1) ** i * 5, i - 5, 0)
        )
        for i in range(10)
    ]
    settings = {
        "scene": Scene(targets=targets),
        "n_frames": 25,
        "wander_m2_per_s3": 0.5,
        "false_alarms": FEW_FALSE_ALARMS,
        "tracker": Tracker(
            process_noise_m2_per_s3=0.5, detection_probability=0.9, false_alarms=FEW_FALSE_ALARMS
        ),
    }
    return TrackTrial(**{**settings, **overrides})


@pytest.mark.parametrize("filter", ["extended", "unscented"])
@pytest.mark.parametrize("association", ["nearest", "joint"])
def test_track_follows_its_target(filter, association):
    # Target to the left and receding: all measurement components are positive.
    times_s = np.arange(20) * 0.1
    truth = straight_states((40.0, 6.0, 15.0, 3.0), times_s)
    tracker = Tracker(filter=filter, association=association, false_alarms=FEW_FALSE_ALARMS)

    tracks = track(build_detections(np.arange(20), truth), times_s, tracker)

    # Exact measurements: the initial guess leaves a quarter of a standard error.
    [error] = stack_states(tracks)[:, -1] - truth[-1]
    spread = np.sqrt(np.diagonal(tracks.covariance.values[0, -1]))
    assert np.all(abs(error) < 0.25 * spread)


def run_tracking_trial(trial: TrackTrial, number: int):
    """Draw the trial of that number, track it, and assess the tracks."""
    data = draw_truth_and_detections(trial, number)
    tracks = track(data.detections, trial.times_s, trial.tracker)
    return assess_track_completeness(trial, data, tracks)


def measure_mean_nees(trial: TrackTrial, n_trials: int) -> np.ndarray:
    """Average the NEES over trials and targets, per frame after the confirmation period."""
    detections = []
    for number in range(n_trials):
        realisation, tracks, holding, _ = run_tracking_trial(trial, number)
        truth = stack_states(realisation.truth)
        for target, row in enumerate(holding.holder.values):
            value = np.full(len(row), np.nan)
            frames = np.flatnonzero(row >= 0)
            error = stack_states(tracks)[row[frames], frames] - truth[target, frames]
            value[frames] = nees(error, tracks.covariance.values[row[frames], frames])
            detections.append(value)
    return np.nanmean(np.array(detections)[:, trial.tracker.confirm_after[1] :], axis=0)


# 60 independent targets, 20 frames: a correct filter fails once in 1e6.
NEES_INTERVAL = {"n_states": 4, "n_independent": 60, "outside_probability": 1e-6 / 20}


@nightly
def test_unscented_track_has_consistent_covariance():
    trial = build_trial(tracker=replace(build_trial().tracker, filter="unscented"))
    low, high = mean_nees_interval(**NEES_INTERVAL)

    detections = measure_mean_nees(trial, 6)

    assert np.all((low < detections) & (detections < high)), detections


def test_too_little_process_noise_makes_covariance_too_small():
    trial = build_trial(
        tracker=replace(build_trial().tracker, filter="unscented", process_noise_m2_per_s3=1e-3)
    )

    wider_interval = NEES_INTERVAL | {"n_independent": 20}  # of two trials instead of six
    assert measure_mean_nees(trial, 2)[-1] > mean_nees_interval(**wider_interval)[1]


@nightly
@pytest.mark.parametrize("number", range(2))
def test_ten_crossing_targets_are_neither_lost_nor_swapped(number):
    trial = loading.read_settings(EXAMPLE, TrackTrial)
    assert (len(trial.scene.targets), trial.n_frames) == (10, 100)
    assert (trial.detection_probability, trial.false_alarms.per_frame) == (0.9, 10)

    _, _, holding, is_whole = run_tracking_trial(trial, number)

    assert is_whole, holding


def test_ten_targets_of_example_cross():
    trial = replace(loading.read_settings(EXAMPLE, TrackTrial), wander_m2_per_s3=0.0)
    positions_m = stack_states(draw_truth_and_detections(trial, 0).truth)[..., [0, 2]]

    min_distances_m = np.linalg.norm(positions_m[:, None] - positions_m, axis=-1).min(axis=-1)

    is_crossing = min_distances_m[np.triu_indices(10, 1)] < 2
    assert is_crossing.sum() == 12, np.sort(min_distances_m[np.triu_indices(10, 1)])


def test_track_is_confirmed_after_m_detections_in_n_frames():
    times_s = np.arange(12) * 0.1
    truth = straight_states((40.0, 6.0, 15.0, 3.0), times_s)
    tracker = Tracker(confirm_after=(3, 4), false_alarms=FEW_FALSE_ALARMS)

    for frames, first_frame in (([0, 1, 3], 3), ([0, 2, 4, 5, 7], 7), ([0, 3, 6, 9], None)):
        live_tracker = LiveTracker(tracker)
        confirmed_frames = []
        for k, time_s in enumerate(times_s):
            detected_frames = [k] if k in frames else []
            tracks = live_tracker.step(
                build_detections(detected_frames, truth[detected_frames]), time_s
            )
            confirmed_frames += [k for live_track in tracks if live_track.status == "confirmed"]
        assert (confirmed_frames[0] if confirmed_frames else None) == first_frame


def track_rear_and_later_part(later_m, min_separation_m, first_frame=5):
    """Track the rear of a car along x at 6 m/s, and a part beside it from a later frame on."""
    times_s = np.arange(15) * 0.1
    rear, part = (
        straight_states((40.0 + x_m, 6.0, y_m, 0.0), times_s) for x_m, y_m in ((0, 0), later_m)
    )
    frames = np.concatenate([np.arange(15), np.arange(first_frame, 15)])
    detections = build_detections(frames, np.concatenate([rear, part[first_frame:]]))
    tracker = Tracker(min_separation_m=min_separation_m, false_alarms=FEW_FALSE_ALARMS)
    return rear, track(detections.sortby("frame"), times_s, tracker)


@pytest.mark.parametrize(
    ("later_m", "min_separation_m", "n_tracks"),
    [
        ((4.5, 0.0), (0.0, 0.0), 2),
        ((4.5, 0.0), (5.0, 5.0), 1),
        ((4.5, 0.0), (3.0, 3.0), 2),
        ((4.5, 0.0), (7.0, 3.0), 1),  # the front of the car
        ((0.5, 3.6), (7.0, 3.0), 2),  # a car in the next lane
        ((0.5, 3.6), (7.0, 7.0), 1),
    ],
)
def test_parts_of_a_target_start_no_second_track_within_the_separation(
    later_m, min_separation_m, n_tracks
):
    rear, tracks = track_rear_and_later_part(later_m, min_separation_m)

    assert tracks.sizes["track"] == n_tracks
    assert tracks["x"].values[0] == pytest.approx(rear[:, 0], abs=STD["range"])


@pytest.mark.parametrize(("min_separation_m", "n_tracks"), [((0.0, 0.0), 2), ((7.0, 3.0), 1)])
def test_parts_that_appear_together_confirm_no_second_track(min_separation_m, n_tracks):
    _, tracks = track_rear_and_later_part((4.5, 0.0), min_separation_m, first_frame=0)

    assert tracks.sizes["track"] == n_tracks


def test_separation_of_an_unknown_direction_is_a_disc_of_equal_mean_square():
    # A track at rest with equal variances of its velocities: radius sqrt((7^2 + 3^2) / 2) = 5.39 m.
    # At 20 m/s along y the semi-axes are those of the settings, but for 2 / (400 + 2) of the shape.
    mean = np.array([[10.0, 0.0, 0.0, 0.0], [10.0, 0.0, 0.0, 20.0]])
    tracks = StateEstimates(mean, np.tile(np.eye(4), (2, 1, 1)))
    shape_m2 = np.diag([9.0, 49.0]) + np.diag([40.0, -40.0]) / 402
    for index, radii_m in ((0, (5.385, 5.385)), (1, np.sqrt(np.diag(shape_m2)))):
        one = StateEstimates(*(part[[index]] for part in tracks))
        for axis, radius_m in enumerate(radii_m):
            offsets_m = np.outer([radius_m - 0.01, -radius_m - 0.01], np.eye(2)[axis])
            is_within = is_within_separation(mean[index, [0, 2]] + offsets_m, one, 7.0, 3.0)
            assert is_within.tolist() == [True, False]


# The gate of 99.9 % is 4 standard errors wide: 12 m of 15 m, or 16 m; 2.8 rad, or 3.3 rad.
@pytest.mark.parametrize(
    ("errors", "n_tracks"),
    [
        ({"range_std": 3.0}, 1),
        ({"range_std": 4.0}, 0),
        ({"azimuth_std": 0.7}, 1),
        ({"azimuth_std": 0.81}, 0),
    ],
)
def test_detections_whose_gate_contains_the_radar_or_all_azimuths_start_no_track(errors, n_tracks):
    wide = {name: np.full(1, std) for name, std in errors.items()}
    live_tracker = LiveTracker(Tracker(target_size_m=2.0, false_alarms=FEW_FALSE_ALARMS))

    tracks = live_tracker.step(build_detections([0], [15.0, 1.0, 0.0, 0.0], **wide), 0.0)

    assert len(tracks) == n_tracks


def test_confirmed_track_ends_after_missed_frames():
    times_s = np.arange(20) * 0.1
    truth = straight_states((40.0, 6.0, 15.0, 3.0), times_s)
    detected_frames = np.arange(10)
    tracker = Tracker(drop_after=4, false_alarms=FEW_FALSE_ALARMS)

    [status] = track(
        build_detections(detected_frames, truth[detected_frames]), times_s, tracker
    ).status.values

    assert list(status[9:]) == ["confirmed"] * 4 + [""] * 7


@pytest.mark.parametrize("disturbance", ["missing", "empty", "late"])
def test_missing_late_or_empty_frame_does_not_break_track(disturbance):
    times_s = np.arange(30) * 0.1
    if disturbance == "late":
        times_s[15:] += 0.35
    truth = straight_states((40.0, 6.0, 15.0, 3.0), times_s)
    is_detected = np.ones(30, bool)
    if disturbance != "late":
        is_detected[[15, 16, 20]] = False
    frames = np.flatnonzero(is_detected)
    if disturbance == "missing":  # frames that the radar skipped
        times_s, frames = times_s[is_detected], np.arange(is_detected.sum())

    tracks = track(
        build_detections(frames, truth[is_detected]),
        times_s,
        Tracker(false_alarms=FEW_FALSE_ALARMS),
    )

    assert tracks.sizes["track"] == 1
    assert list(tracks.status.values[0, 2:]) == ["confirmed"] * (len(times_s) - 2)
    assert np.hypot(tracks.x[0, -1] - truth[-1, 0], tracks.y[0, -1] - truth[-1, 2]) < 0.5


def test_rejects_time_going_backwards_and_keeps_tracks():
    times_s = np.arange(10) * 0.1
    truth = straight_states((40.0, 6.0, 15.0, 3.0), times_s)
    live_tracker, reference_tracker = (
        LiveTracker(Tracker(false_alarms=FEW_FALSE_ALARMS)) for _ in range(2)
    )
    for k in range(6):
        live_tracker.step(build_detections([k], truth[k]), times_s[k])
        reference_tracker.step(build_detections([k], truth[k]), times_s[k])

    for invalid_time_s in (times_s[5], times_s[2], np.nan):
        with pytest.raises(InvalidSetting, match="time_s:"):
            live_tracker.step(build_detections([6], truth[6]), invalid_time_s)
    with pytest.raises(InvalidSetting, match="later than the frame before; pass frames in"):
        track(build_detections([0], truth[:1]), times_s[::-1])

    assert live_tracker.step(build_detections([6], truth[6]), 0.6) == reference_tracker.step(
        build_detections([6], truth[6]), 0.6
    )


def test_live_tracks_equal_batch_tracks():
    realisation = draw_truth_and_detections(build_trial(n_frames=12), 0)
    tracker, times_s = build_trial().tracker, np.arange(12) * 0.1
    live_tracker = LiveTracker(tracker)
    for k, time_s in enumerate(times_s):
        frame_detections = np.flatnonzero(realisation.detections.frame.values == k)
        live_tracks = live_tracker.step(
            realisation.detections.isel(detection=frame_detections), time_s
        )

    batch_states = stack_states(track(realisation.detections, times_s, tracker))[:, -1]

    live_states = [
        live_track.state for live_track in live_tracks if live_track.status == "confirmed"
    ]
    assert np.array_equal(batch_states[np.isfinite(batch_states[:, 0])], live_states)


def test_target_passing_behind_radar_keeps_its_track():
    times_s = np.arange(40) * 0.1
    truth = straight_states((-20.0, 0.0, 8.0, -4.0), times_s)  # from 158 to -158 degrees
    tracks = track(
        build_detections(np.arange(40), truth), times_s, Tracker(false_alarms=FEW_FALSE_ALARMS)
    )

    assert tracks.sizes["track"] == 1
    assert tracks.y.values[0, -1] == pytest.approx(truth[-1, 2], abs=0.5)


def test_velocity_of_unknown_ambiguity_is_used_modulo_span():
    times_s = np.arange(40) * 0.1
    truth = straight_states((20.0, 33.0, 5.0, 2.0), times_s)
    detections = build_detections(np.arange(40), truth)
    span_m_per_s = 20.0
    true_velocities = detections.velocity.values
    aliased_velocities = np.mod(true_velocities + span_m_per_s / 2, span_m_per_s) - span_m_per_s / 2
    detections = detections.assign(
        velocity=("detection", aliased_velocities),
        ambiguity_number=("detection", np.full(40, np.nan)),
    )
    tracker = Tracker(false_alarms=FEW_FALSE_ALARMS, speed_std_m_per_s=20.0)

    tracks = track(detections, times_s, tracker, velocity_span_m_per_s=span_m_per_s)
    tracks_without_span = track(detections, times_s, tracker)

    # Accuracy of the velocities of the last few frames.
    assert stack_states(tracks)[0, -1, 1] == pytest.approx(33.0, abs=0.2)
    assert not np.any(abs(tracks_without_span.vx.values[:, -1] - 33.0) < 5)
    # Detections with a known ambiguity number need no span.
    resolved_detections = detections.assign(
        velocity=("detection", true_velocities), ambiguity_number=("detection", np.ones(40))
    )
    resolved_tracks = track(
        resolved_detections, times_s, tracker, velocity_span_m_per_s=span_m_per_s
    )
    assert resolved_tracks.vx.values[0, -1] == pytest.approx(33.0, abs=0.2)


def test_without_velocities_tracks_follow_positions():
    times_s = np.arange(30) * 0.1
    truth = straight_states((40.0, 6.0, 15.0, 3.0), times_s)
    detections = build_detections(np.arange(30), truth, velocity=np.full(30, np.nan))

    [last_state] = stack_states(track(detections, times_s, Tracker(false_alarms=FEW_FALSE_ALARMS)))[
        :, -1
    ]

    assert last_state == pytest.approx(truth[-1], abs=1.0)


def test_elevated_target_is_tracked_at_its_ground_position():
    times_s = np.arange(30) * 0.1
    truth = straight_states((30.0, 6.0, 5.0, 3.0), times_s)
    height_m = 6.0
    x, vx, y, vy = truth.T
    slant_m = np.sqrt(x**2 + y**2 + height_m**2)
    detections = build_detections(np.arange(30), truth).assign(
        range=("detection", slant_m),
        velocity=("detection", (x * vx + y * vy) / slant_m),
        elevation=("detection", np.arcsin(height_m / slant_m)),
        elevation_std=("detection", np.full(30, 0.02)),
    )

    [last_state] = stack_states(track(detections, times_s, Tracker(false_alarms=FEW_FALSE_ALARMS)))[
        :, -1
    ]

    assert last_state == pytest.approx(truth[-1], abs=0.3)


def test_warns_of_detections_without_azimuth_and_ignores_them():
    times_s = np.arange(10) * 0.1
    truth = straight_states((40.0, 6.0, 15.0, 3.0), times_s)
    detections = build_detections(np.arange(10), truth)
    detections_without_azimuth = build_detections(np.arange(10), truth, azimuth=np.full(10, np.nan))

    with pytest.warns(PhysicsWarning, match="10 of 20 detections without range, azimuth"):
        tracks = track(xr.concat([detections, detections_without_azimuth], "detection"), times_s)

    xr.testing.assert_identical(tracks, track(detections, times_s))


def test_empty_detections_give_no_tracks():
    tracks = track(build_detections([], np.zeros((0, 4))), np.arange(5) * 0.1)

    assert tracks.sizes == {"track": 0, "frame": 5, "state": 4, "other_state": 4}


def test_extended_filter_matches_textbook_equations():
    times_s = np.array([0.0, 0.1, 0.25, 0.3, 0.5])
    rng = np.random.default_rng(3)
    truth = straight_states((40.0, 6.0, 15.0, 3.0), times_s) + rng.normal(0, 0.1, (5, 4))
    tracker = Tracker(
        filter="extended",
        association="nearest",
        process_noise_m2_per_s3=0.7,
        confirm_after=(1, 1),
        false_alarms=FEW_FALSE_ALARMS,
    )
    detections = build_detections(np.arange(5), truth)
    tracks = track(detections, times_s, tracker)

    mean, covariance = stack_states(tracks)[0, 0], tracks.covariance.values[0, 0]
    noise = np.diag([STD["azimuth"] ** 2, STD["range"] ** 2, STD["velocity"] ** 2])
    for k in range(1, 5):
        t = times_s[k] - times_s[k - 1]
        axis_transition = np.array([[1, t], [0, 1]])
        transition = np.kron(np.eye(2), axis_transition)
        process_noise = 0.7 * np.kron(np.eye(2), [[t**3 / 3, t**2 / 2], [t**2 / 2, t]])
        mean, covariance = transition @ mean, transition @ covariance @ transition.T + process_noise
        x, vx, y, vy = mean
        r = np.hypot(x, y)
        rate = (x * vx + y * vy) / r
        h = np.array([np.arctan2(y, x), r, rate])
        jacobian = np.array(
            [
                [-y / r**2, 0, x / r**2, 0],
                [x / r, 0, y / r, 0],
                [vx / r - rate * x / r**2, x / r, vy / r - rate * y / r**2, y / r],
            ]
        )
        gain = covariance @ jacobian.T @ np.linalg.inv(jacobian @ covariance @ jacobian.T + noise)
        z = np.array([detections[name].values[k] for name in ("azimuth", "range", "velocity")])
        mean = mean + gain @ (z - h)
        covariance = (np.eye(4) - gain @ jacobian) @ covariance
        assert stack_states(tracks)[0, k] == pytest.approx(mean, rel=1e-10)
        assert tracks.covariance.values[0, k] == pytest.approx(covariance, rel=1e-9, abs=1e-12)


def test_joint_shares_match_enumeration_of_joint_events():
    tracker = Tracker(
        filter="extended",
        association="joint",
        gate_probability=0.9999,
        false_alarms=FalseAlarms(per_frame=2000.0),
    )
    spread = np.diag([1.0, 0.5, 1.0, 0.5])
    means = np.array([[40.0, 5, y, 1.0] for y in (0.0, 1.2)])
    measured_states = np.array([[40.3, 5, 0.2, 1], [40.0, 5, 0.9, 1], [40.4, 5, 1.5, 1]])
    frame = usable_rows_to_measurements(
        build_detections([0] * 3, measured_states), target_size_m=0, velocity_span_m_per_s=None
    )

    def shares_of(tracks, detections):
        states = StateEstimates(means[tracks], np.array([spread] * len(tracks)))
        chosen = frame.select_measurements(detections)
        return predict_associate_and_update(tracker, states, 0.1, chosen).shares

    shares = shares_of([0, 1], [0, 1, 2])

    # Weight of each pair, from a single track without competitors.
    miss_probability = 1 - tracker.hit_probability
    weight = np.empty((2, 3))
    for i, j in product(range(2), range(3)):
        share = shares_of([i], [j])[0, 0]
        weight[i, j] = miss_probability * share / (1 - share)
    sums, total = np.zeros((2, 3)), 0.0
    for first_choice, second_choice in product([None, 0, 1, 2], repeat=2):
        if first_choice is not None and first_choice == second_choice:
            continue
        probability = np.prod(
            [
                miss_probability if j is None else weight[i, j]
                for i, j in enumerate((first_choice, second_choice))
            ]
        )
        total += probability
        for i, j in enumerate((first_choice, second_choice)):
            if j is not None:
                sums[i, j] += probability
    assert shares == pytest.approx(sums / total, rel=1e-6)
    assert np.all(shares > 0.01)  # all six pairs are gated


@nightly
def test_shares_of_many_tracks_approximate_exact_sums(monkeypatch):
    rng = np.random.default_rng(3)
    positions_m = rng.normal(size=(9, 2)) * [0.1, 0.25] + [40, 0]
    measured_states = np.stack([*positions_m.T, np.full(9, 5.0), np.ones(9)])[[0, 2, 1, 3]].T
    states = StateEstimates(measured_states, np.array([np.diag([0.1, 0.05] * 2)] * 9))
    frame = usable_rows_to_measurements(
        build_detections([0] * 9, measured_states), target_size_m=0, velocity_span_m_per_s=None
    )
    tracker = Tracker(association="joint")

    approximate_shares = predict_associate_and_update(tracker, states, 0.1, frame).shares
    monkeypatch.setattr(stone_soup, "_MAX_EXACT_TRACKS", 9)
    exact_shares = predict_associate_and_update(tracker, states, 0.1, frame).shares

    assert np.all(np.sum(exact_shares > 0.01, axis=0) > 1)  # all compete
    assert 0 < abs(approximate_shares - exact_shares).max() < 0.1


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ({"scene": Scene()}, "TrackTrial.scene.targets: empty"),
        ({"scene": None}, "TrackTrial.scene: None"),
        ({"n_frames": 2}, "TrackTrial.n_frames: 2; expected at least 3"),
        ({"azimuth_std_rad": 0.0}, "azimuth_std_rad: 0"),
        ({"wander_m2_per_s3": -1.0}, "wander_m2_per_s3: -1"),
        ({"detection_probability": 1.0}, "detection_probability: 1"),
    ],
)
def test_rejects_invalid_trials(overrides, message):
    with pytest.raises(InvalidSetting, match=message):
        build_trial(**overrides)


INVALID_TRACKERS = [
    ({"confirm_after": (6, 5)}, "confirm_after: 6 detections in 5 frames"),
    ({"confirm_after": (5, 5), "detection_probability": 0.1}, "a chance of 0.0001;"),
    ({"confirm_after": (3,)}, "two counts"),
    ({"confirm_after": 3}, "two counts"),
    ({"confirm_after": (0, 5)}, "confirm_after.0: 0"),
    ({"drop_after": 0}, "drop_after: 0"),
    ({"min_separation_m": 7.0}, "min_separation_m: 7"),
    ({"min_separation_m": (-1.0, 3.0)}, "min_separation_m.0: -1"),
    ({"min_separation_m": (7.0,)}, "two distances"),
    ({"min_separation_m": (7.0, 0.0)}, "two distances"),
    ({"process_noise_m2_per_s3": 0.0}, "process_noise_m2_per_s3: 0"),
    ({"gate_probability": 1.0}, "gate_probability: 1"),
    ({"filter": "kalman"}, "filter: 'kalman'"),
    ({"association": None}, "association: None"),
    ({"false_alarms": 10}, "false_alarms: 10"),
]


@pytest.mark.parametrize(("settings", "message"), INVALID_TRACKERS)
def test_rejects_invalid_tracker_settings(settings, message):
    with pytest.raises(InvalidSetting, match=r"^Tracker\..*" + re.escape(message)) as error:
        Tracker(**settings)
    assert "; expected " in str(error.value)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"per_frame": 0.0}, "per_frame: 0"),
        ({"range_m": (10.0, 5.0)}, "range_m: (10.0, 5.0); expected two numbers, the smaller"),
        ({"azimuth_rad": (-4.0, 4.0)}, "azimuth_rad.0: -4"),
        ({"velocity_m_per_s": 3.0}, "velocity_m_per_s: 3.0"),
    ],
)
def test_rejects_invalid_false_alarm_region(settings, message):
    with pytest.raises(InvalidSetting, match=re.escape(f"FalseAlarms.{message}")):
        FalseAlarms(**settings)


def test_too_few_frames_are_a_warning_and_dense_false_alarms_an_error():
    truth = straight_states((40.0, 6.0, 15.0, 3.0), np.arange(5) * 0.1)
    detections = build_detections(np.arange(5), truth)
    with pytest.warns(PhysicsWarning, match="3 detections, in a run of 2 frames"):
        assert track(detections.isel(detection=slice(2)), [0.0, 0.1]).sizes["track"] == 0
    # 0.9 / (density x spread) is below 1 - 0.9 x 0.999 for a density of 9 or more.
    dense = FalseAlarms(per_frame=1e6, range_m=(0, 20), velocity_m_per_s=(-1, 1))
    with pytest.raises(InvalidSetting, match=r"Tracker.false_alarms: a density of \d+"):
        track(detections, np.arange(5) * 0.1, Tracker(false_alarms=dense))


@pytest.mark.parametrize(
    ("detections", "times_s", "message"),
    [
        (build_detections([7], [40, 6, 15, 3]), np.arange(5.0), "detections.frame: 7"),
        (
            build_detections([0], [40, 6, 15, 3]).drop_vars("azimuth_std"),
            np.arange(5.0),
            "without azim",
        ),
        (build_detections([0], [40, 6, 15, 3]).drop_vars("frame"), np.arange(5.0), "without frame"),
        (build_detections([0], [40, 6, 15, 3]), [0.0, 1.0, np.nan], "times_s: nan"),
        (None, np.arange(5.0), "detections: None; expected Dataset"),
        (build_detections([0.5], [40, 6, 15, 3]), np.arange(5.0), "detections.frame: 0.5"),
        (
            build_detections([0], [40, 6, 15, 3]).assign(range=("detection", ["far"])),
            np.arange(5.0),
            "whose range are not a number for each row",
        ),
    ],
)
def test_rejects_invalid_detection_tables(detections, times_s, message):
    with pytest.raises(InvalidSetting, match=message):
        track(detections, times_s)


def test_rejects_frame_without_required_column():
    detections = build_detections([0], [40, 6, 15, 3]).drop_vars("azimuth_std")
    with pytest.raises(InvalidSetting, match="detections: a table without azimuth_std"):
        LiveTracker(Tracker()).step(detections, 0.0)


def test_rejects_pairs_that_exceed_memory(monkeypatch):
    crowd = build_detections(np.zeros(600), np.tile([40.0, 6, 15, 3], (600, 1)))
    live_tracker = LiveTracker(Tracker())
    live_tracker.step(crowd, 0.0)
    monkeypatch.setattr(psutil, "virtual_memory", lambda: SimpleNamespace(available=5e7))
    with pytest.raises(NotEnoughMemory, match="pairs of tracks and detections"):
        live_tracker.step(crowd, 0.1)


def test_rejects_object_that_is_not_tracker():
    with pytest.raises(InvalidSetting, match="tracker: an int"):
        track(build_detections([0], [40, 6, 15, 3]), np.arange(5.0), 5)


def test_missing_stone_soup_error_gives_install_command(monkeypatch):
    monkeypatch.delitem(sys.modules, "dechirp.tracking.stone_soup")
    for name in [name for name in sys.modules if name.partition(".")[0] == "stonesoup"]:
        monkeypatch.setitem(sys.modules, name, None)

    with pytest.raises(InvalidSetting, match=r"pip install 'dechirp\[track\]'"):
        LiveTracker(Tracker())
