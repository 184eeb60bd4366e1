"""Tracks of extended objects: filter against brute force, consistency, counting, bad input."""

import re
from types import SimpleNamespace

import numpy as np
import psutil
import pytest
import scipy
import xarray as xr

from dechirp.core.errors import InvalidSetting, NotEnoughMemory
from dechirp.evaluation.gospa import gospa
from dechirp.evaluation.nees import mean_nees_interval, nees
from dechirp.results.object_lists.object_list import object_list
from dechirp.tracking.group_filter import start_groups, update_groups
from dechirp.tracking.group_points import usable_rows_to_group_points
from dechirp.tracking.group_tracker import GroupTracker
from dechirp.tracking.groups import LiveGroupTracker, track_groups
from nightly import nightly, nightly_except

PERSON = np.diag([0.04, 0.06])
"""Covariance of points about the centre, m^2."""
CAR = np.diag([1.3, 0.3])
INTERVAL_S = 0.05


def draw_points(
    rng,
    paths,
    *,
    covariance,
    mean_count,
    tracker=None,
    poisson=True,
    velocity_spread=0.5,
    turn_rates=None,
) -> xr.Dataset:
    """Draw points of objects on paths (n_objects, n_frames, 4), x vx y vy; NaN without points.

    With turn rates (n_frames,), bodies are rigid: each point moves with v + w J (p - c). At first,
    they point along x.
    """
    tracker = GroupTracker() if tracker is None else tracker
    rows = []
    for path in paths:
        rates = np.zeros(len(path)) if turn_rates is None else turn_rates
        for frame, (x, vx, y, vy) in enumerate(path):
            n = 0 if np.isnan(x) else rng.poisson(mean_count) if poisson else mean_count
            offset = rng.multivariate_normal([0, 0], covariance, n) if n else np.empty((0, 2))
            angle = rates[:frame].sum() * INTERVAL_S
            offset = offset @ [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
            position = offset + np.array([x, y])
            range_m, azimuth = np.hypot(*position.T), np.arctan2(position[:, 1], position[:, 0])
            velocity = (vx - rates[frame] * offset[:, 1]) * np.cos(azimuth)
            velocity += (vy + rates[frame] * offset[:, 0]) * np.sin(azimuth)
            velocity += velocity_spread * rng.standard_normal(n)
            errors = (tracker.range_std_m, tracker.azimuth_std_rad, tracker.velocity_std_m_per_s)
            values = np.stack([range_m, azimuth, velocity], axis=-1)
            values += errors * rng.standard_normal((n, 3))
            rows.append(np.column_stack([np.full(n, frame), values]))
    return build_points(*np.concatenate(rows).T)


def build_points(frame, range_m, azimuth, velocity, **columns) -> xr.Dataset:
    values = {
        "frame": np.asarray(frame, int),
        "range": range_m,
        "azimuth": azimuth,
        "velocity": velocity,
        **columns,
    }
    return xr.Dataset({name: ("detection", column) for name, column in values.items()})


def straight_path(n_frames, x, vx, y, vy, interval_s=INTERVAL_S) -> np.ndarray:
    t = np.arange(n_frames) * interval_s
    return np.stack([x + vx * t, 0 * t + vx, y + vy * t, 0 * t + vy], axis=-1)


def times_of(paths, interval_s=INTERVAL_S) -> np.ndarray:
    return np.arange(len(paths[0])) * interval_s


def count_objects(tracks: xr.Dataset) -> np.ndarray:
    return np.isfinite(tracks.x.values).sum(axis=0)


def rms_gospa_m(tracks: xr.Dataset, paths) -> float:
    position = np.stack([tracks.x.values, tracks.y.values], axis=-1)
    errors = [
        gospa(
            position[np.isfinite(position[:, frame, 0]), frame],
            np.array([path[frame, [0, 2]] for path in paths]),
            cutoff_m=2,
        ).error_m
        for frame in range(position.shape[1])
    ]
    return float(np.sqrt(np.mean(np.square(errors))))


# The filter


def test_update_equals_a_kalman_filter_of_all_points():
    # The stacked filter inverts 3 n by 3 n matrices; its points have the mean error of all points.
    # The turning model expects rates of v + w J (p - c), linearised at its mean; p is likely
    # between the measured point and the centroid.
    rng = np.random.default_rng(3)
    tracker = GroupTracker()
    table = draw_points(
        rng, [straight_path(1, 8, 1, 3, -2)], covariance=PERSON, mean_count=12, poisson=False
    )
    points = usable_rows_to_group_points(table, tracker, None)
    prior = start_groups(points, np.zeros(12, int), tracker)
    model_means = prior.mean + rng.normal(0, 0.2, prior.mean.shape)
    prior = prior._replace(mean=model_means, probability=np.array([[0.5, 0.3, 0.2]]))

    posterior = update_groups(prior, points, np.ones((1, 12)), tracker)

    n_prior = 10  # points that the expected extent and spread count for
    extent = (n_prior * tracker.size_std_m**2 * np.eye(2) + prior.scatter_m2[0]) / (n_prior + 12)
    error = points.position_covariance.mean(axis=0)
    point_covariance = extent + error
    centroid = points.position_m.mean(axis=0)
    shrinkage = extent @ np.linalg.inv(point_covariance)
    px, py = position = (centroid + (points.position_m - centroid) @ shrinkage.T).T
    ux, uy = sight = position / np.hypot(px, py)
    across = np.array([-uy, ux])
    azimuth_variance = np.sum(across * (shrinkage @ error @ across), axis=0) / (px**2 + py**2)
    turns = (False, True, False)

    def expected_rates(state, model):
        x, vx, y, vy, turn_rate = state
        rate = turn_rate * turns[model]
        return ux * (vx - rate * (py - y)) + uy * (vy + rate * (px - x))

    mean_rates = prior.probability[0] @ [expected_rates(prior.mean[0, m], m) for m in range(3)]
    at_radar = np.linalg.lstsq(sight.T, mean_rates)[0]
    spread = (n_prior * 0.5**2 + prior.rate_scatter[0]) / (n_prior + 12)
    rate_variance = (
        points.rate_variance
        + spread
        + (at_radar[1] * ux - at_radar[0] * uy) ** 2 * azimuth_variance
    )
    noise = scipy.linalg.block_diag(*[point_covariance] * 12, np.diag(rate_variance))
    measured = np.concatenate([points.position_m.ravel(), points.rate_m_per_s])
    likelihood = []
    for model in range(3):
        mean, covariance = prior.mean[0, model], prior.covariance[0, model]
        x, _, y, _, turn_rate = mean * [1, 1, 1, 1, turns[model]]
        design = np.zeros((36, 5))
        design[:24:2, 0] = design[1:24:2, 2] = 1
        design[24:, 1], design[24:, 3] = ux, uy
        design[24:, 0], design[24:, 2] = -turn_rate * uy, turn_rate * ux
        design[24:, 4] = turns[model] * (ux * y - uy * x)
        innovation = design @ covariance @ design.T + noise
        gain = covariance @ design.T @ np.linalg.inv(innovation)
        expected = np.concatenate([np.tile(mean[[0, 2]], 12), expected_rates(mean, model)])
        residual = measured - expected
        likelihood.append(scipy.stats.multivariate_normal.logpdf(residual, cov=innovation))
        # Rounding through matrices of condition 1e5.
        assert posterior.mean[0, model] == pytest.approx(mean + gain @ residual, abs=1e-9)
        assert posterior.covariance[0, model] == pytest.approx(
            covariance - gain @ design @ covariance, abs=1e-9
        )
    weight = prior.probability[0] * np.exp(np.array(likelihood) - max(likelihood))
    assert posterior.probability[0] == pytest.approx(weight / weight.sum(), abs=1e-6)


@pytest.mark.parametrize("covariance", [PERSON, CAR])
def test_extent_converges_to_that_of_the_object(covariance):
    # 60 frames of 30 points, faded with 1 s: 20 effective frames, so a variance has a standard
    # error of sqrt(2 / 600), 6 %; the expected extent counts for 10 points of 600 more.
    path = straight_path(60, 10, 1, 2, 0.5)
    points = draw_points(np.random.default_rng(5), [path], covariance=covariance, mean_count=30)
    tracker = GroupTracker(size_std_m=float(np.sqrt(covariance[0, 0])))

    tracks = track_groups(points, times_of([path]), tracker)

    extent = tracks.extent.values[0, -1]
    assert np.diag(extent) == pytest.approx(np.diag(covariance), rel=5 * 0.06 + 0.05)
    axes = tracks.width.values[0, -1], tracks.length.values[0, -1]
    assert axes == pytest.approx(4 * np.sqrt(np.linalg.eigvalsh(extent)))
    assert abs(extent[0, 1]) < 5 * 0.06 * np.sqrt(covariance[0, 0] * covariance[1, 1])


def test_velocity_across_the_line_of_sight_follows_from_one_frame():
    # 200 points at 8 m with 1 m of standard deviation differ by 0.12 rad in azimuth, so rates
    # with a spread of 0.5 m/s give the other component to 0.5 / (0.12 sqrt(200)), 0.3 m/s, if the
    # object does not turn.
    path = straight_path(1, 8, 2, 1, 6)
    tracker = GroupTracker(
        size_std_m=1.0,
        azimuth_std_rad=1e-3,
        turn_rate_std_rad_per_s=1e-6,
        confirm_after=(1, 1),
    )
    points = draw_points(
        np.random.default_rng(2),
        [path],
        covariance=np.eye(2),
        mean_count=200,
        tracker=tracker,
        poisson=False,
    )

    [track] = LiveGroupTracker(tracker).step(points, 0.0)

    error = np.array(track.state)[[1, 3]] - [2, 6]
    std = np.sqrt(np.diag(track.covariance)[[1, 3]])
    assert std[1] == pytest.approx(0.3, abs=0.1)
    assert np.all(np.abs(error) < 5 * std)


@nightly
@pytest.mark.parametrize(
    "changes",
    [{"model_time_s": 1e6}, {"manoeuvre_noise_m2_per_s3": 0.5, "model_time_s": 1e6}],
)
def test_nees_of_straight_motion_is_in_its_interval(changes):
    # 60 independent objects in 25 frames; the interval is exceeded once in 1e6.
    tracker = GroupTracker(process_noise_m2_per_s3=0.5, **changes)
    values = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        paths = [
            wander(rng, 25, [12 + 6 * (i % 5), 1, -10 + 20 * (i // 5), i - 5], 0.5)
            for i in range(10)
        ]
        points = draw_points(rng, paths, covariance=PERSON, mean_count=15)
        tracks = track_groups(points, times_of(paths), tracker)
        assert tracks.sizes["track"] == 10
        values += [nees_of_path(tracks, path) for path in paths]
    low, high = mean_nees_interval(4, 60, outside_probability=1e-6 / 20)

    mean = np.mean(values, axis=0)[5:]

    assert np.all((low < mean) & (mean < high)), mean


def wander(rng, n_frames, start, density_m2_per_s3) -> np.ndarray:
    """Draw a path with white acceleration."""
    t = INTERVAL_S
    covariance = density_m2_per_s3 * np.array([[t**3 / 3, t**2 / 2], [t**2 / 2, t]])
    noise = rng.multivariate_normal([0, 0], covariance, (n_frames - 1, 2)).reshape(-1, 4)
    path = np.empty((n_frames, 4))
    path[0] = start
    for frame in range(1, n_frames):
        x, vx, y, vy = path[frame - 1]
        path[frame] = np.array([x + vx * t, vx, y + vy * t, vy]) + noise[frame - 1]
    return path


def nees_of_path(tracks: xr.Dataset, path) -> np.ndarray:
    state = np.stack([tracks[name].values for name in ("x", "vx", "y", "vy")], axis=-1)
    row = np.hypot(*(state[:, -1] - path[-1])[:, [0, 2]].T).argmin()
    return nees(state[row] - path, tracks.covariance.values[row])


# Turning and braking


def braking_path() -> np.ndarray:
    """A car at 15 m/s across the line of sight brakes at 6 m/s^2 after 2 s, and stands."""
    t = np.arange(130) * INTERVAL_S
    braking = np.clip(t - 2, 0, 2.5)
    y = -25 + 15 * np.clip(t, 0, 2) + 15 * braking - 3 * braking**2
    vy = 15 - 6 * braking
    return np.stack([0 * t + 15, 0 * t, y, vy], axis=-1)


def turning_path() -> np.ndarray:
    """A car at 8 m/s turns to the left with 0.5 rad/s after 2 s."""
    t = np.arange(130) * INTERVAL_S
    angle = 0.5 * np.clip(t - 2, 0, None)
    vx, vy = 8 * np.cos(angle), 8 * np.sin(angle)
    x = 15 + 8 * np.clip(t, 0, 2) + 16 * np.sin(angle)
    y = -5 + 16 * (1 - np.cos(angle))
    return np.stack([x, vx, y, vy], axis=-1)


TURN_RATES = np.where(np.arange(130) * INTERVAL_S < 2, 0.0, 0.5)
"""Of `turning_path`, rad/s."""


@nightly
@pytest.mark.parametrize(
    ("path", "turn_rates"),
    [(braking_path(), None), (turning_path(), TURN_RATES)],
    ids=["braking", "turning"],
)
def test_manoeuvring_car_is_followed_by_interacting_models(path, turn_rates):
    points = draw_points(
        np.random.default_rng(7), [path], covariance=CAR, mean_count=12, turn_rates=turn_rates
    )
    # Without turns and manoeuvres, three models of straight motion.
    straight_only = {"turn_rate_std_rad_per_s": 1e-6, "manoeuvre_noise_m2_per_s3": 0.1}

    tracks, straight = (
        track_groups(points, times_of([path]), GroupTracker(size_std_m=0.8, **changes))
        for changes in ({}, straight_only)
    )

    assert tracks.sizes["track"] == 1
    # The mean of 12 points has an error of sqrt((1.3 + 0.3 + 0.2) / 12), 0.39 m, in a frame of its
    # own. The filter halves it; straight motion lags by more.
    assert rms_gospa_m(tracks, [path]) < 0.25
    assert rms_gospa_m(straight, [path]) > 1.5 * rms_gospa_m(tracks, [path])


def sine_path() -> np.ndarray:
    """A person at 1.2 m/s swings 1 m to both sides every 4 s, as in TI's sine tests."""
    t = np.arange(130) * INTERVAL_S
    angle = 2 * np.pi / 4 * t
    y, vy = np.sin(angle), 2 * np.pi / 4 * np.cos(angle)
    return np.stack([8 + 1.2 * t, 1.2 + 0 * t, y, vy], axis=-1)


def nees_of_acceleration(density_m2_per_s3, variance_m2, acceleration_m_per_s2) -> float:
    """Compute the NEES that a constant acceleration adds to a filter of straight motion.

    In the steady state, the bias is (I - A F)^-1 A g with A = I - K H and g = a (T^2 / 2, T).
    """
    t = INTERVAL_S
    transition, observed = np.array([[1, t], [0, 1]]), np.array([[1.0, 0.0]])
    noise = density_m2_per_s3 * np.array([[t**3 / 3, t**2 / 2], [t**2 / 2, t]])
    predicted = scipy.linalg.solve_discrete_are(
        transition.T, observed.T, noise, np.array([[variance_m2]])
    )
    gain = predicted @ observed.T / (predicted[0, 0] + variance_m2)
    kept = np.eye(2) - gain @ observed
    push = acceleration_m_per_s2 * np.array([t**2 / 2, t])
    bias = np.linalg.solve(np.eye(2) - kept @ transition, kept @ push)
    return float(bias @ np.linalg.solve(kept @ predicted, bias))


# In a steady turn, one of the models is true, and nothing is added. Swinging by 2.5 m/s^2 at most,
# straight motion remains likely: the models together are not worse than straight motion alone,
# 0.1 m^2/s^3. To it, braking by 6 m/s^2 would add 258, so the evidence is against it: the noise is
# at least that of equal probabilities, 3.4 m^2/s^3. Brakes act in 2 of the 5 s without a change.
SWINGING_NEES = nees_of_acceleration(0.1, (0.06 + 0.02) / 12, (np.pi / 2) ** 2 / np.sqrt(2))
BRAKING_NEES = nees_of_acceleration((0.1 + 0.1 + 10) / 3, 1.8 / 12, 6.0)


@nightly
@pytest.mark.parametrize(
    ("path", "turn_rates", "covariance", "size_std_m", "changes_s", "added"),
    [
        (turning_path(), TURN_RATES, CAR, 0.8, (2.0,), 0.0),
        (braking_path(), None, CAR, 0.8, (2.0, 4.5), 2 / 5 * BRAKING_NEES),
        (sine_path(), None, PERSON, 0.3, (), SWINGING_NEES),
    ],
    ids=["turning", "braking", "sine"],
)
def test_nees_of_manoeuvres_is_bounded(path, turn_rates, covariance, size_std_m, changes_s, added):
    # A filter with the true model has a mean of 4.
    n_seeds = 12
    values = []
    for seed in range(n_seeds):
        points = draw_points(
            np.random.default_rng(seed),
            [path],
            covariance=covariance,
            mean_count=12,
            turn_rates=turn_rates,
        )
        tracks = track_groups(points, times_of([path]), GroupTracker(size_std_m=size_std_m))
        assert tracks.sizes["track"] == 1
        values.append(nees_of_path(tracks, path))
    times_s = np.arange(len(path)) * INTERVAL_S
    is_change = np.any(
        [(change_s <= times_s) & (times_s < change_s + 0.5) for change_s in changes_s]
        + [times_s < 0.5],
        axis=0,
    )

    mean = np.mean(values, axis=0)

    # The standard error of a mean of 12 paths, in 10 independent parts of half a second, is 0.26.
    low, high = mean_nees_interval(4, n_seeds * 10, outside_probability=1e-6)
    assert low < mean[~is_change].mean() < high + added
    # Where a manoeuvre begins or ends, models change within half a second.
    assert mean[times_s > 0.5].max() < 30


def test_turn_rate_is_estimated():
    path = turning_path()
    points = draw_points(
        np.random.default_rng(8), [path], covariance=CAR, mean_count=30, turn_rates=TURN_RATES
    )

    tracks = track_groups(points, times_of([path]), GroupTracker(size_std_m=0.8))

    assert tracks.turn_rate.values[0, 80:].mean() == pytest.approx(0.5, abs=0.15)
    assert tracks.turn_rate.values[0, 10:40].mean() == pytest.approx(0.0, abs=0.15)


@nightly
@pytest.mark.parametrize(("turn_rate", "speed", "range_m"), [(0.35, 7.0, 21.0), (-0.7, 4.0, 12.0)])
def test_turning_car_near_the_radar_keeps_its_position_and_size(turn_rate, speed, range_m):
    # A car crosses at the side and turns after 2 s. Its range rates have the slope over azimuth of
    # 7 or 8 m/s across the line of sight, which is none of its velocity.
    n_seeds, t = 6, np.arange(120) * INTERVAL_S
    rates = np.where(t < 2, 0.0, turn_rate)
    angle = np.pi / 2 + turn_rate * np.clip(t - 2, 0, None)
    radius_m = speed / turn_rate
    x = range_m + radius_m * np.sin(angle) - radius_m
    y = -radius_m * np.cos(angle) + speed * (np.clip(t, None, 2) - 2)
    path = np.stack([x, speed * np.cos(angle), y, speed * np.sin(angle)], axis=-1)
    tracker = GroupTracker(size_std_m=0.8, velocity_spread_m_per_s=0.1, azimuth_std_rad=0.01)
    values, lengths_m = [], []
    for seed in range(n_seeds):
        points = draw_points(
            np.random.default_rng(seed),
            [path],
            covariance=np.diag([0.3, 1.3]),  # along y at first
            mean_count=20,
            tracker=tracker,
            velocity_spread=0.1,
            turn_rates=rates,
        )
        tracks = track_groups(points, times_of([path]), tracker)
        assert tracks.sizes["track"] == 1
        assert rms_gospa_m(tracks, [path]) < 0.2
        values.append(nees_of_path(tracks, path)[40:])
        lengths_m.append(tracks.length.values[0, 40:])

    # 8 independent parts of half a second in each turn.
    assert np.mean(values) < mean_nees_interval(4, n_seeds * 8, outside_probability=1e-6)[1]
    # 400 points, of the last second, give a length to sqrt(1 / 800), 3.5 %.
    length_m = 4 * np.sqrt(1.3)
    assert np.array(lengths_m) == pytest.approx(np.full((n_seeds, 80), length_m), rel=6 * 0.035)


# Several objects


@nightly
def test_points_of_crossing_people_are_divided_between_their_tracks():
    paths = [straight_path(160, 3, 0.8, y, -0.3 * y) for y in (-2, 2)]
    points = draw_points(np.random.default_rng(1), paths, covariance=PERSON, mean_count=8)

    tracks = track_groups(points, times_of(paths))

    assert tracks.sizes["track"] == 2
    assert np.mean(count_objects(tracks) == 2) > 0.97
    # 0.1 m is the error of a filtered mean of 8 points; two people have sqrt(2) of it.
    assert rms_gospa_m(tracks, paths) < 0.2
    for track, path in enumerate(sorted(paths, key=lambda path: path[0, 2])):
        row = int(np.argsort(tracks.y.values[:, 5])[track])
        assert tracks.y.values[row, -1] == pytest.approx(path[-1, 2], abs=0.5)


@nightly
def test_group_that_separates_becomes_two_tracks():
    paths = [straight_path(160, 3, 0.5, 0.15 * sign, 0.4 * sign) for sign in (-1, 1)]
    points = draw_points(np.random.default_rng(2), paths, covariance=PERSON, mean_count=8)

    counts = count_objects(track_groups(points, times_of(paths)))

    assert counts[20] == 1  # 0.7 m apart
    assert np.all(counts[120:] == 2)  # 5 m apart


def test_clutter_starts_no_track_and_does_not_disturb():
    rng = np.random.default_rng(4)
    paths = [straight_path(100, 4, 0.6, 1, -0.5)]
    n = 100 * 10
    clutter = build_points(
        rng.integers(0, 100, n), rng.uniform(1, 15, n), rng.uniform(-1, 1, n), rng.uniform(-3, 3, n)
    )
    points = draw_points(rng, paths, covariance=PERSON, mean_count=8)

    tracks = track_groups(xr.concat([points, clutter], "detection"), times_of(paths))

    assert tracks.sizes["track"] == 1
    assert rms_gospa_m(tracks, paths) < 0.2


def test_person_who_sits_down_is_held_and_one_who_leaves_is_not():
    sitting = straight_path(200, 4, 0, 1, 0)
    sitting[40:] = np.nan  # a radar that removes static echoes
    leaving = straight_path(200, 3, 1.2, -1, -0.5)
    leaving[40:] = np.nan
    points = draw_points(
        np.random.default_rng(6), [sitting, leaving], covariance=PERSON, mean_count=8
    )

    held = track_groups(points, times_of([sitting]))
    dropped = track_groups(points, times_of([sitting]), GroupTracker(hold_time_s=2.0))

    assert count_objects(held)[[38, 60, 199]].tolist() == [2, 1, 1]
    last = held.isel(frame=-1).dropna("track", subset=["x"])
    assert (last.x.item(), last.y.item()) == pytest.approx((4, 1), abs=0.3)
    assert count_objects(dropped)[[38, 75, 85]].tolist() == [2, 1, 0]


def test_ambiguous_velocities_are_unfolded_along_the_track():
    path = straight_path(100, 5, 6.0, 1, 0.5)
    points = draw_points(np.random.default_rng(9), [path], covariance=PERSON, mean_count=10)
    span = 8.0
    folded = points.assign(
        velocity=(points.velocity + span / 2) % span - span / 2,
        ambiguity_number=("detection", np.full(points.sizes["detection"], np.nan)),
    )

    tracks = track_groups(folded, times_of([path]), velocity_span_m_per_s=span)

    assert tracks.sizes["track"] == 1
    assert tracks.vx.values[0, -1] == pytest.approx(6.0, abs=0.3)


def test_elevation_is_projected_onto_the_plane():
    path = straight_path(30, 4, 1, 1, 0)
    points = draw_points(np.random.default_rng(3), [path], covariance=PERSON, mean_count=10)
    elevation = 0.6
    raised = points.assign(
        range=points.range / np.cos(elevation),
        velocity=points.velocity * np.cos(elevation),
        elevation=("detection", np.full(points.sizes["detection"], elevation)),
    )
    tracker = GroupTracker(range_std_m=0.05)

    tracks = [track_groups(table, times_of([path]), tracker) for table in (points, raised)]

    # Errors of range and rate are scaled, which moves the estimate by a fraction of them.
    for name in ("x", "y", "vx"):
        assert tracks[0][name].values == pytest.approx(tracks[1][name].values, abs=0.05)


def test_frames_one_by_one_give_the_same_tracks():
    path = straight_path(20, 4, 1, 1, 0)
    points = draw_points(np.random.default_rng(3), [path], covariance=PERSON, mean_count=10)
    live = LiveGroupTracker(GroupTracker())

    steps = [
        live.step(points.isel(detection=points.frame.values == frame), time_s)
        for frame, time_s in enumerate(times_of([path]))
    ]

    tracks = track_groups(points, times_of([path]))
    [last] = steps[-1]
    assert last.state == tuple(tracks[name].values[0, -1] for name in ("x", "vx", "y", "vy"))
    assert last.n_points == tracks.n_points.values[0, -1]
    assert np.array_equal(last.extent_m2, tracks.extent.values[0, -1])
    assert (last.status, last.age) == ("confirmed", 19)


def test_object_list_contains_people_with_their_size():
    path = straight_path(20, 4, 1, 1, 0)
    points = draw_points(np.random.default_rng(3), [path], covariance=PERSON, mean_count=10)
    tracks = track_groups(points, times_of([path]))

    last = object_list(tracks).isel(object=-1)

    for name in ("x", "y", "vx", "vy", "length", "width"):
        assert last[name].item() == tracks[name].values[0, -1]


# Bad input


def some_points(n=12) -> xr.Dataset:
    rng = np.random.default_rng(0)
    return build_points(np.arange(n) % 3, 5 + rng.random(n), rng.random(n), rng.random(n))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"size_std_m": 0}, "GroupTracker.size_std_m"),
        ({"azimuth_std_rad": 2.0}, "GroupTracker.azimuth_std_rad"),
        ({"gate_probability": 1.0}, "GroupTracker.gate_probability"),
        ({"min_points": 0}, "GroupTracker.min_points"),
        ({"min_points": 2.5}, "GroupTracker.min_points"),
        ({"confirm_after": (4, 3)}, "GroupTracker.confirm_after"),
        ({"confirm_after": 3}, "GroupTracker.confirm_after"),
        ({"drop_after": -1}, "GroupTracker.drop_after"),
        ({"hold_time_s": -1.0}, "GroupTracker.hold_time_s"),
        ({"still_speed_m_per_s": np.nan}, "GroupTracker.still_speed_m_per_s"),
        ({"model_time_s": np.inf}, "GroupTracker.model_time_s"),
        ({"manoeuvre_noise_m2_per_s3": 0.01}, "GroupTracker.manoeuvre_noise_m2_per_s3"),
        ({"turn_rate_std_rad_per_s": "fast"}, "GroupTracker.turn_rate_std_rad_per_s"),
    ],
)
def test_invalid_settings_are_refused(changes, message):
    with pytest.raises(InvalidSetting, match=re.escape(message)):
        GroupTracker(**changes)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"points": 3}, "points"),
        ({"points": some_points().drop_vars("azimuth")}, "a table without azimuth"),
        ({"points": some_points().drop_vars("frame")}, "a table without frame"),
        ({"points": some_points().assign(velocity=("detection", ["a"] * 12))}, "velocity are not"),
        ({"points": some_points().assign(frame=("detection", np.arange(12)))}, "points.frame"),
        ({"times_s": [0.0, 0.2, 0.1]}, "later than the frame before"),
        ({"times_s": [0.0, np.nan, 0.1]}, "times_s"),
        ({"tracker": 5}, "tracker"),
        ({"first": -1}, "first"),
        ({"velocity_span_m_per_s": 0.0}, "velocity_span_m_per_s"),
    ],
)
def test_invalid_arguments_are_refused(arguments, message):
    valid = {"points": some_points(), "times_s": [0.0, 0.1, 0.2]}

    with pytest.raises(InvalidSetting, match=re.escape(message)):
        track_groups(**{**valid, **arguments})


@pytest.mark.parametrize(
    "value",
    nightly_except(4, [np.nan, -np.inf, 0.0, 1e300, np.inf, -1.0, 1e-300, 1e12]),
)
@pytest.mark.parametrize(
    "column",
    nightly_except(1, ["range", "azimuth", "velocity", "elevation", "range_std", "velocity_std"]),
)
def test_damaged_numbers_leave_finite_tracks_or_are_refused(column, value):
    path = straight_path(20, 4, 1, 1, 0)
    points = draw_points(np.random.default_rng(3), [path], covariance=PERSON, mean_count=10)
    n = points.sizes["detection"]
    damaged = points.get(column, xr.DataArray(np.full(n, 0.1), dims="detection")).values.copy()
    damaged[::4] = value
    points = points.assign({column: ("detection", damaged)})
    is_impossible = abs(value) > np.pi if column == "azimuth" else value < 0
    if is_impossible and column not in ("velocity", "elevation"):
        with pytest.raises(InvalidSetting, match=rf"points\.{column}: .* in {-(-n // 4)} of {n}"):
            track_groups(points, times_of([path]))
        return

    tracks = track_groups(points, times_of([path]))

    finite = np.isfinite(tracks.x.values)
    assert finite.any()
    assert np.isfinite(tracks.covariance.values[finite]).all()


def test_no_points_give_no_tracks():
    tracks = track_groups(some_points(0), [0.0, 0.1, 0.2])

    assert dict(tracks.sizes) == {
        **{"track": 0, "frame": 3, "state": 4, "other_state": 4, "axis": 2, "other_axis": 2}
    }


def test_pairs_that_would_not_fit_are_refused(monkeypatch):
    monkeypatch.setattr(psutil, "virtual_memory", lambda: SimpleNamespace(available=1e6, total=1e6))

    with pytest.raises(NotEnoughMemory):
        LiveGroupTracker(GroupTracker()).step(some_points(1000), 0.0)
