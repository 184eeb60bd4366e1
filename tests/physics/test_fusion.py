"""Fused tracks of several radars: calibrated errors, the bound of all radars, poses and views."""

import math
from typing import NamedTuple

import numpy as np
import pytest
import scipy
import xarray as xr

import dechirp as dc
from dechirp.core.errors import InvalidSetting
from dechirp.evaluation.nees import mean_nees_interval, nees
from dechirp.tracking.false_alarms import FalseAlarms
from nightly import NIGHTLY, nightly, nightly_except

RANGE_STD_M, AZIMUTH_STD_RAD, RATE_STD = 0.15, 0.01, 0.1
PROCESS_NOISE, SPEED_STD = 1.0, 15.0
TRACKER = dc.Tracker(
    process_noise_m2_per_s3=PROCESS_NOISE,
    speed_std_m_per_s=SPEED_STD,
    detection_probability=0.99,
    gate_probability=0.999999,
    false_alarms=FalseAlarms(per_frame=1e-3),
)
PERIOD_S, N_FRAMES = 0.05, 12
CORNERS = {"front-left": (2.25, 0.9, math.pi / 4), "front-right": (2.25, -0.9, -math.pi / 4)}
OFFSETS_S = {"front-left": 0.0, "front-right": 0.02}
N_RUNS = 500 if NIGHTLY else 15
FAILURE = 1e-6  # probability that a correct filter fails a test


class Vehicle(NamedTuple):
    """Motion of the vehicle over the ground: along an arc from the origin."""

    speed: float = 0.0
    turn_rate: float = 0.0

    def pose(self, time_s: float, corner: tuple[float, float, float]) -> dc.fusion.RadarPose:
        """Return the pose of a radar on the vehicle: of its centre, plus the lever arm."""
        heading, (x, y, yaw) = self.turn_rate * time_s, corner
        cos, sin = math.cos(heading), math.sin(heading)
        ahead, aside = self.speed * time_s, 0.0
        if self.turn_rate:
            radius = self.speed / self.turn_rate
            ahead, aside = radius * sin, radius * (1 - cos)
        arm = (cos * x - sin * y, sin * x + cos * y)
        return dc.fusion.RadarPose(
            position_m=(ahead + arm[0], aside + arm[1]),
            yaw_rad=heading + yaw,
            velocity_m_per_s=(
                self.speed * cos - self.turn_rate * arm[1],
                self.speed * sin + self.turn_rate * arm[0],
            ),
        )


def draw_truth(times_s: np.ndarray, n_runs: int, rng: np.random.Generator) -> np.ndarray:
    """Draw states x vx y vy (run, time, 4): random starts, and white acceleration afterwards.

    Speeds are within 3 standard deviations: at 3.7, one of 500 tracks started a second time, since
    the product of a speed across and an azimuth error changes the range rate.
    """
    vx, vy = SPEED_STD * np.clip(rng.standard_normal((2, n_runs)), -3, 3)
    state = np.stack([rng.uniform(30, 60, n_runs), vx, rng.uniform(-8, 8, n_runs), vy], axis=-1)
    states = [state]
    for interval_s in np.diff(times_s):
        matrix, covariance = motion(interval_s)
        noise = rng.multivariate_normal(np.zeros(4), covariance, n_runs)
        states.append(states[-1] @ matrix.T + noise)
    return np.stack(states, axis=1)


def draw_offsets_m(
    times_s: np.ndarray,
    poses: list[dc.fusion.RadarPose],
    centres_m: np.ndarray,
    size_m: float,
    rng: np.random.Generator,
) -> np.ndarray:
    """Draw offsets of echoes from the centres of bodies, (run, time, 2).

    First-order Gauss-Markov with 4 s (Bar-Shalom 2001, 8.4), about a mean on the near side.
    """
    from_radars_m = centres_m - np.array([pose.position_m for pose in poses])
    near_m = -size_m * from_radars_m / np.linalg.norm(from_radars_m, axis=-1, keepdims=True)
    offsets_m = [near_m[:, 0] + size_m * rng.standard_normal(near_m[:, 0].shape)]
    for index, interval_s in enumerate(np.diff(times_s), 1):
        decay = math.exp(-interval_s / 4.0)
        change = math.sqrt(1 - decay**2) * size_m * rng.standard_normal(near_m[:, 0].shape)
        offsets_m.append(decay * offsets_m[-1] + (1 - decay) * near_m[:, index] + change)
    return np.stack(offsets_m, axis=1)


def motion(interval_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Return transition and covariance of white acceleration (Bar-Shalom 2001, 6.2.2)."""
    step = np.array([[1, interval_s], [0, 1]])
    spread = PROCESS_NOISE * np.array(
        [[interval_s**3 / 3, interval_s**2 / 2], [interval_s**2 / 2, interval_s]]
    )
    return np.kron(np.eye(2), step), np.kron(np.eye(2), spread)


def measure(states: np.ndarray, pose: dc.fusion.RadarPose) -> np.ndarray:
    """Return azimuth, range and range rate of states (..., 4)."""
    x, vx, y, vy = np.moveaxis(states, -1, 0)
    x, y = x - pose.position_m[0], y - pose.position_m[1]
    vx, vy = vx - pose.velocity_m_per_s[0], vy - pose.velocity_m_per_s[1]
    azimuth = np.arctan2(y, x) - pose.yaw_rad
    azimuth = (azimuth + np.pi) % (2 * np.pi) - np.pi
    range_m = np.hypot(x, y)
    return np.stack([azimuth, range_m, (x * vx + y * vy) / range_m], axis=-1)


def table(frames: list[int], measured: np.ndarray) -> xr.Dataset:
    """Return a table of detections with their stated errors."""
    columns = {"frame": np.array(frames, float)}
    for axis, (name, std) in enumerate(
        (("azimuth", AZIMUTH_STD_RAD), ("range", RANGE_STD_M), ("velocity", RATE_STD))
    ):
        columns |= {name: measured[:, axis], f"{name}_std": np.full(len(frames), std)}
    return xr.Dataset({name: ("detection", column) for name, column in columns.items()})


class Trials(NamedTuple):
    """Errors of fused tracks and their covariances over runs, and the bound, per fused frame."""

    errors: np.ndarray
    """(run, frame, 4)."""
    covariances: np.ndarray
    bounds: np.ndarray
    """(run, frame, 4, 4): covariance of the posterior Cramer-Rao bound about each path."""


def run_trials(
    names: tuple[str, ...],
    vehicle: Vehicle,
    n_runs: int = N_RUNS,
    tracker: dc.Tracker = TRACKER,
) -> Trials:
    """Track random targets: points, or bodies if the tracker has a target size."""
    rng = np.random.default_rng([2026, len(names), round(10 * vehicle.speed)])
    frames = sorted(
        (OFFSETS_S[name] + number * PERIOD_S, name, number)
        for name in names
        for number in range(N_FRAMES)
    )
    times_s = np.array([time_s for time_s, _, _ in frames])
    truth = draw_truth(times_s, n_runs, rng)
    poses = [vehicle.pose(time_s, CORNERS[name]) for time_s, name, _ in frames]
    std = np.array([AZIMUTH_STD_RAD, RANGE_STD_M, RATE_STD])
    echoes = truth.copy()
    echoes[..., ::2] += draw_offsets_m(times_s, poses, truth[..., ::2], tracker.target_size_m, rng)
    measured = np.stack(
        [measure(echoes[:, index], pose) for index, pose in enumerate(poses)], axis=1
    )
    measured += std * rng.standard_normal(measured.shape)
    # Bodies turn with a lateral acceleration of 2 m/s^2, at radii of at least 8 m.
    speeds = np.hypot(truth[..., 1], truth[..., 3])
    turns = tracker.target_size_m * np.minimum(speeds / 8, 2 / speeds)
    measured[..., 2] += turns * rng.standard_normal(turns.shape)
    errors, covariances = [], []
    for run in range(n_runs):
        radars = []
        for name in names:
            rows = [index for index, frame in enumerate(frames) if frame[1] == name]
            radars.append(
                dc.fusion.RadarDetections(
                    name=name,
                    detections=table([frames[row][2] for row in rows], measured[run, rows]),
                    times_s=tuple(times_s[rows]),
                    poses=tuple(poses[row] for row in rows),
                )
            )
        tracks = dc.fusion.fuse_detections(radars, tracker)
        is_present = tracks["status"].values != ""
        # One of 1,000 detections is outside the gate of the default, and may start a second track.
        assert len(is_present) == 1 or tracker is not TRACKER, run
        track = int(is_present.sum(axis=1).argmax())
        states = np.stack([tracks[name].values[track] for name in ("x", "vx", "y", "vy")], axis=-1)
        errors.append(states - truth[run])
        covariances.append(tracks["covariance"].values[track])
    return Trials(np.array(errors), np.array(covariances), posterior_bounds(truth, times_s, poses))


def posterior_bounds(truth: np.ndarray, times_s: np.ndarray, poses: list) -> np.ndarray:
    """Return the bound of each frame by the recursion of Tichavsky et al. (1998), eq. 21.

    Linear motion: J' = (Q + F J^-1 F')^-1 + H' R^-1 H, about each true path. The expectation of the
    information over all paths would be a bound that no filter reaches: it adds precise directions.
    """
    weights = np.array([AZIMUTH_STD_RAD, RANGE_STD_M, RATE_STD]) ** -2.0
    information = np.diag([0, SPEED_STD**-2, 0, SPEED_STD**-2])
    bounds = []
    for index, pose in enumerate(poses):
        if index:
            matrix, covariance = motion(times_s[index] - times_s[index - 1])
            information = np.linalg.inv(covariance + matrix @ bounds[-1] @ matrix.T)
        jacobian = np.stack(
            [
                (measure(truth[:, index] + shift, pose) - measure(truth[:, index] - shift, pose))
                / 2e-4
                for shift in 1e-4 * np.eye(4)
            ],
            axis=-1,
        )
        information = information + np.einsum("rmi,m,rmj->rij", jacobian, weights, jacobian)
        bounds.append(np.linalg.inv(information))
    return np.stack(bounds, axis=1)


def squared_position_errors_over_bound(trials: Trials) -> np.ndarray:
    bound_m2 = np.einsum("rfii->rf", trials.bounds[..., ::2, ::2])
    return np.sum(trials.errors[..., ::2] ** 2, axis=-1) / bound_m2


@nightly
@pytest.mark.parametrize(
    "vehicle",
    [
        pytest.param(Vehicle(), id="parked"),
        pytest.param(Vehicle(speed=15.0, turn_rate=0.3), id="turning"),
    ],
)
def test_pair_of_corner_radars_is_consistent_and_reaches_bound_of_both(vehicle):
    trials = run_trials(("front-left", "front-right"), vehicle)

    # After the frames of the confirmation. Frames of one run are correlated: each is tested, all of
    # them together fail once in 1e6.
    confirmed = slice(TRACKER.confirm_after[1], None)
    values = nees(trials.errors[:, confirmed], trials.covariances[:, confirmed]).mean(axis=0)
    low, high = mean_nees_interval(4, N_RUNS, outside_probability=FAILURE / values.size)
    assert np.all((low < values) & (values < high)), values
    # 3.3 to 4.7 for 500 runs: half the variance would be noticed.
    assert not np.all(2 * values < high)
    # At the bound, the mean of squared position errors over it is a weighted sum of chi-squares; it
    # spreads most if one direction has all the error: n_runs degrees of freedom.
    ratio = np.mean(squared_position_errors_over_bound(trials)[:, confirmed], axis=0)
    tails = np.array([1 - FAILURE / ratio.size, FAILURE / ratio.size])
    low, high = scipy.special.chdtri(N_RUNS, tails) / N_RUNS
    assert np.all((low < ratio) & (ratio < high)), ratio


@pytest.mark.parametrize("size_m", nightly_except(1, [0.0, 2.0]), ids=["points", "bodies"])
def test_default_tracker_is_consistent_for_points_and_bodies(size_m):
    # The NEES of each frame is chi-square of 4 degrees; its mean over runs, times the runs, is of
    # 4 n. The targets accelerate as the default expects.
    tracker = dc.Tracker(target_size_m=size_m)

    trials = run_trials(("front-left", "front-right"), Vehicle(speed=15.0), tracker=tracker)

    confirmed = slice(tracker.confirm_after[1], None)
    values = nees(trials.errors[:, confirmed], trials.covariances[:, confirmed]).mean(axis=0)
    low, high = mean_nees_interval(4, N_RUNS, outside_probability=FAILURE / values.size)
    assert np.all((low < values) & (values < high)), values
    # The offset does not average out: the centre is known no better than by its size.
    if size_m:
        stated_m = np.sqrt(trials.covariances[:, -1, 0, 0])
        assert np.all(stated_m > 0.8 * size_m)


def test_bound_of_pair_is_below_that_of_each_radar():
    times_s = np.arange(24) * PERIOD_S / 2
    truth = np.tile([40.0, 0, 0, 0], (1, 24, 1))
    poses = [dc.fusion.RadarPose(position_m=(x, y), yaw_rad=yaw) for x, y, yaw in CORNERS.values()]

    pair = posterior_bounds(truth, times_s, poses * 12)[0, -1, ::2, ::2]
    one = posterior_bounds(truth[:, ::2], times_s[::2], poses[:1] * 12)[0, -1, ::2, ::2]

    # Twice the measurements of a position: half the variance at rest, to the power of 3/4 in steady
    # state under white acceleration (Bar-Shalom 2001, 6.5.3).
    assert 0.5**1.1 < np.trace(pair) / np.trace(one) < 0.5**0.7


def exact_radar(name: str, corner: str, frames: list[int], state, **settings):
    """Return a radar with exact detections of one target at rest in some of ten frames."""
    x, y, yaw = CORNERS[corner]
    pose = dc.fusion.RadarPose(position_m=(x, y), yaw_rad=yaw)
    measured = measure(np.tile(np.array(state, float), (len(frames), 1)), pose)
    return dc.fusion.RadarDetections(
        name=name,
        detections=table(frames, measured),
        times_s=tuple(0.05 * np.arange(10)),
        poses=pose,
        **settings,
    )


def test_frames_of_equal_times_are_fused_in_the_order_of_the_radars():
    radars = [exact_radar(name, name, list(range(10)), (30, 0, 5, 0)) for name in CORNERS]

    tracks = dc.fusion.fuse_detections(radars, TRACKER)

    assert tracks["radar"].values.tolist() == [*CORNERS] * 10
    assert tracks["radar_frame"].values.tolist() == [frame for frame in range(10) for _ in "ab"]
    assert tracks["time"].values[::2].tolist() == tracks["time"].values[1::2].tolist()
    # Sigma points of the azimuth shorten the range by its variance over two: 1.5 mm.
    assert tracks["x"].values[0, -1] == pytest.approx(30, abs=3e-3)
    assert tracks["y"].values[0, -1] == pytest.approx(5, abs=3e-3)


def test_radar_that_looks_elsewhere_does_not_end_tracks():
    blind = {"half_angle_rad": math.radians(60), "max_range_m": 100.0}
    state = (5, 0, 30, 0)  # to the left: behind the right radar
    radars = [
        exact_radar("front-left", "front-left", list(range(10)), state, **blind),
        exact_radar("front-right", "front-right", [], state, **blind),
    ]

    tracks = dc.fusion.fuse_detections(radars, dc.Tracker(drop_after=1))

    assert tracks.sizes["track"] == 1
    assert (tracks["status"].values[0] != "").all()


def test_track_out_of_all_views_ends():
    blind = {"half_angle_rad": math.radians(1)}
    state = (5, 0, 30, 0)
    radars = [
        exact_radar("front-left", "front-left", list(range(4)), state, **blind),
        exact_radar("front-right", "front-right", [], state, **blind),
    ]

    tracks = dc.fusion.fuse_detections(radars, dc.Tracker(drop_after=2, confirm_after=(3, 3)))

    # The last detection is in frame 6 of both together; three frames of each radar follow.
    assert np.flatnonzero(tracks["status"].values[0] != "")[-1] == 6 + 2 * 3 - 1


def test_single_radar_at_origin_has_tracks_of_track():
    radar = exact_radar("front", "front-left", list(range(10)), (30, 0, 5, 0))
    alone = dc.fusion.RadarDetections(
        name="front", detections=radar.detections, times_s=radar.times_s
    )

    fused = dc.fusion.fuse_detections([alone], TRACKER)

    tracks = dc.track(radar.detections, radar.times_s, TRACKER)
    xr.testing.assert_identical(fused.drop_vars(["radar", "radar_frame"]), tracks)


def test_velocities_of_unknown_ambiguity_follow_moving_radar():
    """A target at rest seen at 31 m/s, modulo 20 m/s, from a radar that drives at it."""
    pose = dc.fusion.RadarPose(velocity_m_per_s=(31.0, 0.0))
    poses = tuple(
        dc.fusion.RadarPose(position_m=(31 * 0.05 * n, 0.0), velocity_m_per_s=pose.velocity_m_per_s)
        for n in range(10)
    )
    measured = np.concatenate([measure(np.array([[90.0, 0, 0, 0]]), pose) for pose in poses])
    measured[:, 2] = (measured[:, 2] + 10) % 20 - 10
    detections = table(list(range(10)), measured)
    detections["ambiguity_number"] = "detection", np.full(10, np.nan)
    radar = dc.fusion.RadarDetections(
        name="front",
        detections=detections,
        times_s=tuple(0.05 * np.arange(10)),
        poses=poses,
        velocity_span_m_per_s=20.0,
    )

    tracks = dc.fusion.fuse_detections([radar], dc.Tracker(speed_std_m_per_s=2.0))

    assert tracks["vx"].values[0, -1] == pytest.approx(0, abs=0.1)


RADAR = {"detections": table([0], np.array([[0.1, 30.0, 0.0]])), "times_s": (0.0, 0.1, 0.2)}


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"name": ""}, "RadarDetections.name"),
        ({"times_s": (0.0, 0.2, 0.1)}, "RadarDetections.times_s"),
        ({"poses": (dc.fusion.RadarPose(),)}, "1 poses of front, for 3 frames"),
        ({"poses": ("front",)}, "RadarDetections.poses"),
        ({"half_angle_rad": 4.0}, "RadarDetections.half_angle_rad"),
        ({"max_range_m": 0.0}, "RadarDetections.max_range_m"),
        ({"first": -1}, "RadarDetections.first"),
        ({"velocity_span_m_per_s": -1.0}, "RadarDetections.velocity_span_m_per_s"),
        ({"detections": xr.Dataset()}, "a table without"),
    ],
)
def test_rejects_invalid_radar_detections(settings, message):
    with pytest.raises(InvalidSetting, match=message):
        dc.fusion.RadarDetections(**{"name": "front", **RADAR, **settings})


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"position_m": (0.0, 0.0, 0.5)}, "RadarPose.position_m"),
        ({"velocity_m_per_s": (math.nan, 0.0)}, "RadarPose.velocity_m_per_s"),
        ({"yaw_rad": math.inf}, "RadarPose.yaw_rad"),
    ],
)
def test_rejects_invalid_poses(settings, message):
    with pytest.raises(InvalidSetting, match=message):
        dc.fusion.RadarPose(**settings)


@pytest.mark.parametrize(("n_radars", "message"), [(0, "empty"), (2, "2 radars named front")])
def test_rejects_missing_radars_and_repeated_names(n_radars, message):
    with pytest.raises(InvalidSetting, match=message):
        dc.fusion.fuse_detections([dc.fusion.RadarDetections(name="front", **RADAR)] * n_radars)
