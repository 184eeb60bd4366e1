"""Tracks go where targets go, are as sure as they may be, and end when nothing is seen."""

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
from dechirp.evaluation.track_trial import TrackTrial, draw_trial, run_trial
from dechirp.scene.scene import Scene
from dechirp.scene.target import Target
from dechirp.tracking import stone_soup
from dechirp.tracking.batch import track
from dechirp.tracking.false_alarms import FalseAlarms
from dechirp.tracking.measurements import to_measurements
from dechirp.tracking.online import LiveTracker
from dechirp.tracking.stone_soup import StateEstimate, StoneSoup
from dechirp.tracking.tracker import Tracker

EXAMPLE = Path(__file__).parents[2] / "examples" / "crossing-tracks.yaml"
STD = {"range": 0.15, "azimuth": 0.01, "velocity": 0.1}
FEW = FalseAlarms(per_frame=1e-3)
STATE = ("x", "vx", "y", "vy")


def detections(frames, state, **columns) -> xr.Dataset:
    """Exact detections of states (n, 4), x vx y vy, with standard errors."""
    x, vx, y, vy = np.atleast_2d(state).T
    range_m = np.hypot(x, y)
    told = {
        "frame": np.asarray(frames),
        "range": range_m,
        "azimuth": np.arctan2(y, x),
        "velocity": (x * vx + y * vy) / range_m,
        **{f"{name}_std": np.full(len(x), std) for name, std in STD.items()},
        **columns,
    }
    return xr.Dataset({name: ("detection", column) for name, column in told.items()})


def line(start, times_s) -> np.ndarray:
    """States of a target that goes straight on, (n_times, 4)."""
    x, vx, y, vy = start
    t = np.asarray(times_s)
    return np.stack([x + vx * t, 0 * t + vx, y + vy * t, 0 * t + vy], axis=-1)


def states(tracks: xr.Dataset) -> np.ndarray:
    return np.stack([tracks[name].values for name in STATE], axis=-1)


def trial(**changed) -> TrackTrial:
    """Ten targets 9 m and more apart, on paths that do not meet, without false alarms."""
    targets = [
        Target(
            position_m=(20 + 9 * i, (-1) ** i * 10, 0), velocity_m_per_s=((-1) ** i * 5, i - 5, 0)
        )
        for i in range(10)
    ]
    told = {
        "scene": Scene(targets=targets),
        "n_frames": 25,
        "wander_m2_per_s3": 0.5,
        "false_alarms": FEW,
        "tracker": Tracker(
            process_noise_m2_per_s3=0.5, detection_probability=0.9, false_alarms=FEW
        ),
    }
    return TrackTrial(**{**told, **changed})


@pytest.mark.parametrize("filter", ["extended", "unscented"])
@pytest.mark.parametrize("association", ["nearest", "joint"])
def test_a_track_goes_where_its_target_goes(filter, association):
    # To the left and away: all signs of the measurement at once.
    times_s = np.arange(20) * 0.1
    truth = line((40.0, 6.0, 15.0, 3.0), times_s)
    tracker = Tracker(filter=filter, association=association, false_alarms=FEW)

    tracks = track(detections(np.arange(20), truth), times_s, tracker)

    # Exact measurements: a quarter of a standard error is left of the first, wide guess.
    [error] = states(tracks)[:, -1] - truth[-1]
    spread = np.sqrt(np.diagonal(tracks.covariance.values[0, -1]))
    assert np.all(abs(error) < 0.25 * spread)


def mean_nees(told: TrackTrial, n_trials: int) -> np.ndarray:
    """Over trials and targets, in each frame from the one on in which tracks must be confirmed."""
    found = []
    for number in range(n_trials):
        drawn, tracks, held, _ = run_trial(told, number)
        truth = states(drawn.truth)
        for target, row in enumerate(held.holder.values):
            value = np.full(len(row), np.nan)
            at = np.flatnonzero(row >= 0)
            error = states(tracks)[row[at], at] - truth[target, at]
            value[at] = nees(error, tracks.covariance.values[row[at], at])
            found.append(value)
    return np.nanmean(np.array(found)[:, told.tracker.confirm_after[1] :], axis=0)


# Of 60 targets that do not depend on each other, in each of 20 frames: by chance once in 1e6.
INSIDE = {"n_states": 4, "n_independent": 60, "outside_probability": 1e-6 / 20}


def test_an_unscented_track_is_as_sure_as_it_may_be():
    told = trial(tracker=replace(trial().tracker, filter="unscented"))
    low, high = mean_nees_interval(**INSIDE)

    found = mean_nees(told, 6)

    assert np.all((low < found) & (found < high)), found


def test_a_track_that_takes_wandering_targets_for_steady_ones_is_too_sure():
    told = trial(tracker=replace(trial().tracker, filter="unscented", process_noise_m2_per_s3=1e-3))

    assert mean_nees(told, 6)[-1] > mean_nees_interval(**INSIDE)[1]


@pytest.mark.parametrize("number", range(2))
def test_ten_crossing_targets_are_neither_lost_nor_swapped(number):
    told = loading.read_settings(EXAMPLE, TrackTrial)
    assert (len(told.scene.targets), told.n_frames) == (10, 100)
    assert (told.detection_probability, told.false_alarms.per_frame) == (0.9, 10)

    _, _, held, is_whole = run_trial(told, number)

    assert is_whole, held


def test_the_ten_targets_of_the_example_cross():
    told = replace(loading.read_settings(EXAMPLE, TrackTrial), wander_m2_per_s3=0.0)
    place_m = states(draw_trial(told, 0).truth)[..., [0, 2]]

    apart_m = np.linalg.norm(place_m[:, None] - place_m, axis=-1).min(axis=-1)

    near = apart_m[np.triu_indices(10, 1)] < 2
    assert near.sum() == 12, np.sort(apart_m[np.triu_indices(10, 1)])


def test_a_track_is_confirmed_by_m_detections_in_n_frames_and_no_later():
    times_s = np.arange(12) * 0.1
    truth = line((40.0, 6.0, 15.0, 3.0), times_s)
    tracker = Tracker(confirm_after=(3, 4), false_alarms=FEW)

    for frames, first in (([0, 1, 3], 3), ([0, 2, 4, 5, 7], 7), ([0, 3, 6, 9], None)):
        live = LiveTracker(tracker)
        confirmed = []
        for k, time_s in enumerate(times_s):
            now = [k] if k in frames else []
            tracks = live.step(detections(now, truth[now]), time_s)
            confirmed += [k for one in tracks if one.status == "confirmed"]
        assert (confirmed[0] if confirmed else None) == first


def test_a_confirmed_track_ends_after_so_many_frames_without_a_detection():
    times_s = np.arange(20) * 0.1
    truth = line((40.0, 6.0, 15.0, 3.0), times_s)
    seen = np.arange(10)
    tracker = Tracker(drop_after=4, false_alarms=FEW)

    [status] = track(detections(seen, truth[seen]), times_s, tracker).status.values

    assert list(status[9:]) == ["confirmed"] * 4 + [""] * 7


@pytest.mark.parametrize("what", ["missing", "empty", "late"])
def test_a_frame_that_is_missing_late_or_empty_does_not_break_a_track(what):
    times_s = np.arange(30) * 0.1
    if what == "late":
        times_s[15:] += 0.35
    truth = line((40.0, 6.0, 15.0, 3.0), times_s)
    kept = np.ones(30, bool)
    if what != "late":
        kept[[15, 16, 20]] = False
    frames = np.flatnonzero(kept)
    if what == "missing":  # as if the radar had never sent them
        times_s, frames = times_s[kept], np.arange(kept.sum())

    tracks = track(detections(frames, truth[kept]), times_s, Tracker(false_alarms=FEW))

    assert tracks.sizes["track"] == 1
    assert list(tracks.status.values[0, 2:]) == ["confirmed"] * (len(times_s) - 2)
    assert np.hypot(tracks.x[0, -1] - truth[-1, 0], tracks.y[0, -1] - truth[-1, 2]) < 0.5


def test_time_that_goes_backwards_is_refused_and_leaves_the_tracks_as_they_were():
    times_s = np.arange(10) * 0.1
    truth = line((40.0, 6.0, 15.0, 3.0), times_s)
    live, other = (LiveTracker(Tracker(false_alarms=FEW)) for _ in range(2))
    for k in range(6):
        live.step(detections([k], truth[k]), times_s[k])
        other.step(detections([k], truth[k]), times_s[k])

    for wrong_s in (times_s[5], times_s[2], np.nan):
        with pytest.raises(InvalidSetting, match="time_s:"):
            live.step(detections([6], truth[6]), wrong_s)
    with pytest.raises(InvalidSetting, match="later than the frame before; pass frames in"):
        track(detections([0], truth[:1]), times_s[::-1])

    assert live.step(detections([6], truth[6]), 0.6) == other.step(detections([6], truth[6]), 0.6)


def test_tracks_of_frames_as_they_arrive_are_those_of_all_together():
    drawn = draw_trial(trial(n_frames=12), 0)
    tracker, times_s = trial().tracker, np.arange(12) * 0.1
    live = LiveTracker(tracker)
    for k, time_s in enumerate(times_s):
        own = np.flatnonzero(drawn.detections.frame.values == k)
        last = live.step(drawn.detections.isel(detection=own), time_s)

    together = states(track(drawn.detections, times_s, tracker))[:, -1]

    confirmed = [one.state for one in last if one.status == "confirmed"]
    assert np.array_equal(together[np.isfinite(together[:, 0])], confirmed)


def test_a_target_that_passes_behind_the_radar_keeps_its_track():
    times_s = np.arange(40) * 0.1
    truth = line((-20.0, 0.0, 8.0, -4.0), times_s)  # from 158 to -158 degrees
    tracks = track(detections(np.arange(40), truth), times_s, Tracker(false_alarms=FEW))

    assert tracks.sizes["track"] == 1
    assert tracks.y.values[0, -1] == pytest.approx(truth[-1, 2], abs=0.5)


def test_velocities_of_unknown_fold_are_taken_up_to_a_span():
    times_s = np.arange(40) * 0.1
    truth = line((20.0, 33.0, 5.0, 2.0), times_s)
    found = detections(np.arange(40), truth)
    span_m_per_s = 20.0
    true = found.velocity.values
    folded = np.mod(true + span_m_per_s / 2, span_m_per_s) - span_m_per_s / 2
    found = found.assign(
        velocity=("detection", folded), ambiguity_number=("detection", np.full(40, np.nan))
    )
    tracker = Tracker(false_alarms=FEW, speed_std_m_per_s=20.0)

    tracks = track(found, times_s, tracker, velocity_span_m_per_s=span_m_per_s)
    plainly = track(found, times_s, tracker)

    # As exact as the velocities of the last few frames.
    assert states(tracks)[0, -1, 1] == pytest.approx(33.0, abs=0.2)
    assert not np.any(abs(plainly.vx.values[:, -1] - 33.0) < 5)
    # Those whose fold is told need no span.
    told = found.assign(velocity=("detection", true), ambiguity_number=("detection", np.ones(40)))
    surely = track(told, times_s, tracker, velocity_span_m_per_s=span_m_per_s)
    assert surely.vx.values[0, -1] == pytest.approx(33.0, abs=0.2)


def test_without_velocities_tracks_follow_positions():
    times_s = np.arange(30) * 0.1
    truth = line((40.0, 6.0, 15.0, 3.0), times_s)
    found = detections(np.arange(30), truth, velocity=np.full(30, np.nan))

    [last] = states(track(found, times_s, Tracker(false_alarms=FEW)))[:, -1]

    assert last == pytest.approx(truth[-1], abs=1.0)


def test_a_target_above_is_tracked_on_the_ground_below_it():
    times_s = np.arange(30) * 0.1
    truth = line((30.0, 6.0, 5.0, 3.0), times_s)
    height_m = 6.0
    x, vx, y, vy = truth.T
    slant_m = np.sqrt(x**2 + y**2 + height_m**2)
    found = detections(np.arange(30), truth).assign(
        range=("detection", slant_m),
        velocity=("detection", (x * vx + y * vy) / slant_m),
        elevation=("detection", np.arcsin(height_m / slant_m)),
        elevation_std=("detection", np.full(30, 0.02)),
    )

    [last] = states(track(found, times_s, Tracker(false_alarms=FEW)))[:, -1]

    assert last == pytest.approx(truth[-1], abs=0.3)


def test_detections_without_an_azimuth_are_left_out_with_a_warning():
    times_s = np.arange(10) * 0.1
    truth = line((40.0, 6.0, 15.0, 3.0), times_s)
    found = detections(np.arange(10), truth)
    dull = detections(np.arange(10), truth, azimuth=np.full(10, np.nan))

    with pytest.warns(PhysicsWarning, match="10 of 20 detections without range, azimuth"):
        both = track(xr.concat([found, dull], "detection"), times_s)

    xr.testing.assert_identical(both, track(found, times_s))


def test_no_detections_at_all_are_no_tracks():
    tracks = track(detections([], np.zeros((0, 4))), np.arange(5) * 0.1)

    assert tracks.sizes == {"track": 0, "frame": 5, "state": 4, "other_state": 4}


def test_the_extended_filter_is_the_one_of_the_textbook():
    times_s = np.array([0.0, 0.1, 0.25, 0.3, 0.5])
    rng = np.random.default_rng(3)
    truth = line((40.0, 6.0, 15.0, 3.0), times_s) + rng.normal(0, 0.1, (5, 4))
    tracker = Tracker(
        filter="extended",
        association="nearest",
        process_noise_m2_per_s3=0.7,
        confirm_after=(1, 1),
        false_alarms=FEW,
    )
    found = detections(np.arange(5), truth)
    tracks = track(found, times_s, tracker)

    mean, covariance = states(tracks)[0, 0], tracks.covariance.values[0, 0]
    noise = np.diag([STD["azimuth"] ** 2, STD["range"] ** 2, STD["velocity"] ** 2])
    for k in range(1, 5):
        t = times_s[k] - times_s[k - 1]
        one = np.array([[1, t], [0, 1]])
        go = np.kron(np.eye(2), one)
        kick = 0.7 * np.kron(np.eye(2), [[t**3 / 3, t**2 / 2], [t**2 / 2, t]])
        mean, covariance = go @ mean, go @ covariance @ go.T + kick
        x, vx, y, vy = mean
        r = np.hypot(x, y)
        rate = (x * vx + y * vy) / r
        h = np.array([np.arctan2(y, x), r, rate])
        slope = np.array(
            [
                [-y / r**2, 0, x / r**2, 0],
                [x / r, 0, y / r, 0],
                [vx / r - rate * x / r**2, x / r, vy / r - rate * y / r**2, y / r],
            ]
        )
        gain = covariance @ slope.T @ np.linalg.inv(slope @ covariance @ slope.T + noise)
        z = np.array([found[name].values[k] for name in ("azimuth", "range", "velocity")])
        mean = mean + gain @ (z - h)
        covariance = (np.eye(4) - gain @ slope) @ covariance
        # Stone Soup takes differences of 1e-8 for slopes.
        assert states(tracks)[0, k] == pytest.approx(mean, rel=1e-6)
        assert tracks.covariance.values[0, k] == pytest.approx(covariance, rel=1e-5, abs=1e-9)


def test_joint_shares_are_those_of_all_joint_events():
    tracker = Tracker(
        filter="extended",
        association="joint",
        gate_probability=0.9999,
        false_alarms=FalseAlarms(per_frame=2000.0),
    )
    spread = np.diag([1.0, 0.5, 1.0, 0.5])
    beliefs = [StateEstimate(np.array([40.0, 5, y, 1.0]), spread) for y in (0.0, 1.2)]
    seen = np.array([[40.3, 5, 0.2, 1], [40.0, 5, 0.9, 1], [40.4, 5, 1.5, 1]])
    frame = to_measurements(detections([0] * 3, seen), target_size_m=0, velocity_span_m_per_s=None)
    soup = StoneSoup(tracker)

    shares = soup.update(beliefs, 0.1, frame).shares

    # Weights of each pair alone, from a track that nobody competes with.
    missed = 1 - tracker.hit_probability
    weight = np.empty((2, 3))
    for i, j in product(range(2), range(3)):
        alone = soup.update(beliefs[i : i + 1], 0.1, frame.select([j])).shares[0, 0]
        weight[i, j] = missed * alone / (1 - alone)
    sums, total = np.zeros((2, 3)), 0.0
    for one, other in product([None, 0, 1, 2], repeat=2):
        if one is not None and one == other:
            continue
        chance = np.prod(
            [missed if j is None else weight[i, j] for i, j in enumerate((one, other))]
        )
        total += chance
        for i, j in enumerate((one, other)):
            if j is not None:
                sums[i, j] += chance
    assert shares == pytest.approx(sums / total, rel=1e-6)
    assert np.all(shares > 0.01)  # all six pairs are in the gates


def test_a_crowd_of_tracks_is_shared_out_as_by_exact_sums(monkeypatch):
    rng = np.random.default_rng(3)
    place_m = rng.normal(size=(9, 2)) * [0.1, 0.25] + [40, 0]
    beliefs = [StateEstimate(np.array([x, 5, y, 1]), np.diag([0.1, 0.05] * 2)) for x, y in place_m]
    seen = np.stack([*place_m.T, np.full(9, 5.0), np.ones(9)])[[0, 2, 1, 3]].T
    frame = to_measurements(detections([0] * 9, seen), target_size_m=0, velocity_span_m_per_s=None)
    soup = StoneSoup(Tracker(association="joint"))

    crowd = soup.update(beliefs, 0.1, frame).shares
    monkeypatch.setattr(stone_soup, "_MAX_EXACT_TRACKS", 9)
    exact = soup.update(beliefs, 0.1, frame).shares

    assert np.all(np.sum(exact > 0.01, axis=0) > 1)  # all compete
    assert 0 < abs(crowd - exact).max() < 0.1


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"scene": Scene()}, "TrackTrial.scene.targets: empty"),
        ({"scene": None}, "TrackTrial.scene: None"),
        ({"n_frames": 2}, "3 detections, in a run of 2 frames"),
        ({"azimuth_std_rad": 0.0}, "azimuth_std_rad: 0"),
        ({"wander_m2_per_s3": -1.0}, "wander_m2_per_s3: -1"),
        ({"detection_probability": 1.0}, "detection_probability: 1"),
    ],
)
def test_trials_that_cannot_be_are_refused(changed, message):
    with pytest.raises(InvalidSetting, match=message):
        trial(**changed)


NEVER = [
    ({"confirm_after": (6, 5)}, "confirm_after: 6 detections in 5 frames"),
    ({"confirm_after": (5, 5), "detection_probability": 0.1}, "a chance of 0.0001;"),
    ({"confirm_after": (3,)}, "two counts"),
    ({"confirm_after": 3}, "two counts"),
    ({"confirm_after": (0, 5)}, "confirm_after.0: 0"),
    ({"drop_after": 0}, "drop_after: 0"),
    ({"process_noise_m2_per_s3": 0.0}, "process_noise_m2_per_s3: 0"),
    ({"gate_probability": 1.0}, "gate_probability: 1"),
    ({"filter": "kalman"}, "filter: 'kalman'"),
    ({"association": None}, "association: None"),
    ({"false_alarms": 10}, "false_alarms: 10"),
]


@pytest.mark.parametrize(("settings", "message"), NEVER)
def test_settings_that_cannot_work_are_refused(settings, message):
    with pytest.raises(InvalidSetting, match=r"^Tracker\..*" + re.escape(message)) as told:
        Tracker(**settings)
    assert "; expected " in str(told.value)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"per_frame": 0.0}, "per_frame: 0"),
        ({"range_m": (10.0, 5.0)}, "range_m: (10.0, 5.0); expected two numbers, the smaller"),
        ({"azimuth_rad": (-4.0, 4.0)}, "azimuth_rad.0: -4"),
        ({"velocity_m_per_s": 3.0}, "velocity_m_per_s: 3.0"),
    ],
)
def test_false_alarms_that_are_nowhere_are_refused(settings, message):
    with pytest.raises(InvalidSetting, match=re.escape(f"FalseAlarms.{message}")):
        FalseAlarms(**settings)


def test_a_run_that_can_never_confirm_a_track_is_refused():
    truth = line((40.0, 6.0, 15.0, 3.0), np.arange(5) * 0.1)
    found = detections(np.arange(5), truth)
    with pytest.raises(InvalidSetting, match="3 detections, in a run of 2 frames"):
        track(found.isel(detection=slice(2)), [0.0, 0.1])
    # 0.9 / (density x spread) is below 1 - 0.9 x 0.999 from 9 of them on.
    dense = FalseAlarms(per_frame=1e6, range_m=(0, 20), velocity_m_per_s=(-1, 1))
    with pytest.raises(InvalidSetting, match=r"Tracker.false_alarms: a density of \d+"):
        track(found, np.arange(5) * 0.1, Tracker(false_alarms=dense))


@pytest.mark.parametrize(
    ("found", "times_s", "message"),
    [
        (detections([7], [40, 6, 15, 3]), np.arange(5.0), "detections.frame: 7"),
        (detections([0], [40, 6, 15, 3]).drop_vars("azimuth_std"), np.arange(5.0), "without azim"),
        (detections([0], [40, 6, 15, 3]).drop_vars("frame"), np.arange(5.0), "without frame"),
        (detections([0], [40, 6, 15, 3]), [0.0, 1.0, np.nan], "times_s: nan"),
        (None, np.arange(5.0), "detections: a table without range"),
        (detections([0.5], [40, 6, 15, 3]), np.arange(5.0), "detections.frame: 0.5"),
        (
            detections([0], [40, 6, 15, 3]).assign(range=("detection", ["far"])),
            np.arange(5.0),
            "whose range are not a number for each row",
        ),
    ],
)
def test_tables_that_do_not_fit_are_refused(found, times_s, message):
    with pytest.raises(InvalidSetting, match=message):
        track(found, times_s)


def test_a_frame_without_a_column_that_is_needed_is_refused():
    found = detections([0], [40, 6, 15, 3]).drop_vars("azimuth_std")
    with pytest.raises(InvalidSetting, match="detections: a table without azimuth_std"):
        LiveTracker(Tracker()).step(found, 0.0)


def test_pairs_of_tracks_and_detections_that_would_not_fit_are_refused(monkeypatch):
    crowd = detections(np.zeros(600), np.tile([40.0, 6, 15, 3], (600, 1)))
    live = LiveTracker(Tracker())
    live.step(crowd, 0.0)
    monkeypatch.setattr(psutil, "virtual_memory", lambda: SimpleNamespace(available=5e7))
    with pytest.raises(NotEnoughMemory, match="pairs of tracks and detections"):
        live.step(crowd, 0.1)


def test_what_is_no_tracker_is_refused():
    with pytest.raises(InvalidSetting, match="tracker: a int"):
        track(detections([0], [40, 6, 15, 3]), np.arange(5.0), 5)


def test_without_stone_soup_a_tracker_says_what_to_install(monkeypatch):
    monkeypatch.delitem(sys.modules, "dechirp.tracking.stone_soup")
    for name in [name for name in sys.modules if name.partition(".")[0] == "stonesoup"]:
        monkeypatch.setitem(sys.modules, name, None)

    with pytest.raises(InvalidSetting, match=r"pip install 'dechirp\[track\]'"):
        LiveTracker(Tracker())
