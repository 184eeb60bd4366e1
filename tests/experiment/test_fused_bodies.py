"""Stated errors of fused tracks of cars and trucks, against their errors (NEES)."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import dechirp as dc
from dechirp.evaluation.nees import mean_nees_interval, nees
from nightly import nightly

PAIR = "radars=[{mount: front-left}, {mount: front-right, start_offset: 20 ms}]"
SIZES = {
    "car": (4.5, 1.8, 1.5),
    "van": (5.9, 2.0, 2.6),
    "truck": (10.0, 2.5, 3.6),
    "semitrailer": (16.5, 2.55, 4.0),
}
POSITION, VELOCITY = [0, 2], [1, 3]


def turn_left(t):
    """Return a position on a path that turns on a circle of 15 m after half a second, at 8 m/s."""
    angle = max(t - 0.5, 0.0) * 8 / 15
    return 14 + 8 * min(t, 0.5) + 15 * np.sin(angle), 19 - 15 * np.cos(angle)


# Speed of the radar's vehicle along x, and path of the other body.
PATHS = {
    "ahead": (15.0, lambda t: (22 + 15 * t, 0.0)),
    "passing": (12.0, lambda t: (18 + 16 * t, 3.6)),
    "turning": (4.0, turn_left),
    "parked": (8.0, lambda t: (45.0, 4.0)),
    "oncoming": (12.0, lambda t: (75 - 12 * t, 3.6)),
}


def write_trace(path, kind, position_m, speed, end_s):
    objects = [("car", lambda t: (speed * t, 0.0)), (kind, position_m)]
    rows = ["time,id,class,x,y,heading,length,width,height"]
    for number, (its_kind, path_m) in enumerate(objects, 1):
        for t in np.arange(0, end_s + 0.05, 0.1):
            x_m, y_m = path_m(t)
            ahead_m = np.subtract(path_m(t + 0.01), (x_m, y_m))
            heading = float(np.arctan2(*ahead_m[::-1])) if ahead_m.any() else 0.0
            size = ",".join(map(str, SIZES[its_kind]))
            name = "truck" if its_kind == "semitrailer" else its_kind
            rows.append(f"{t:.1f},{number},{name},{x_m:.4f},{y_m:.4f},{heading:.5f},{size}")
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")


def fuse_pair(path, kind, position_m, speed, *, end_s, seed=1):
    """Run two corner radars with one other body, and return fused tracks and objects."""
    write_trace(path, kind, position_m, speed, end_s)
    scenario = dc.traffic.traffic_scenario(path, ["traffic.ego=1", PAIR, f"seed={seed}"])
    with ThreadPoolExecutor(1) as executor:
        result = dc.fusion.run_radars(scenario, kind="statistical", executor=executor)
    return result.tracks, result.objects


def errors_of_centre(tracks, objects):
    """Return errors (frame, 4) and covariances of the track of the only object, from its centre.

    A truck may have a second track at its far end, and short ones of its wheels, which count as
    false tracks: its track is the one that is confirmed in most frames.
    """
    x_m, y_m = tracks["x"].values, tracks["y"].values
    away_m = np.hypot(x_m - objects["centre_x"].values, y_m - objects["centre_y"].values)
    is_near = away_m < float(objects["length"].values[0]) / 2 + 3
    is_near &= tracks["status"].values == "confirmed"
    n_confirmed = is_near.sum(axis=1, keepdims=True)
    in_view = objects["in_view"].values[0]
    frames = np.flatnonzero(in_view & is_near.any(axis=0))
    assert len(frames) > 0.8 * in_view.sum()
    rows = np.where(is_near, n_confirmed, 0).argmax(axis=0)[frames]
    states = np.stack([tracks[name].values[rows, frames] for name in ("x", "vx", "y", "vy")], -1)
    truth = np.stack(
        [objects[n].values[0, frames] for n in ("centre_x", "vx", "centre_y", "vy")], -1
    )
    return states - truth, tracks["covariance"].values[rows, frames]


def mean_nees_per_axis(errors, covariances, axes):
    return nees(errors[:, axes], covariances[:, axes][..., axes]).mean() / 2


# Half the length of the body, less the offset that the tracker expects (2 m), and half its width:
# 0.25 m and 0.9 m for a car, 3 m and 1.25 m for a truck of 10 m; a few frames show its far end.
LARGEST_RMSE_M = {"car": 1.0, "truck": 3.5}


@nightly
@pytest.mark.parametrize(
    ("kind", "case"),
    [(kind, case) for case in PATHS for kind in ("truck", "car")],
)
def test_stated_errors_of_bodies_are_honest(tmp_path, kind, case):
    end_s = 1.0 if (kind, case) == ("truck", "ahead") else 3.0
    speed, position_m = PATHS[case]

    errors, covariances = errors_of_centre(
        *fuse_pair(tmp_path / "trace.csv", kind, position_m, speed, end_s=end_s)
    )

    position_rmse_m = np.sqrt((errors[:, POSITION] ** 2).sum(axis=1).mean())
    assert position_rmse_m < LARGEST_RMSE_M[kind]
    # 80 % of a chi-square of two degrees are below 2 * 1.6: the offset is one draw for all frames.
    assert mean_nees_per_axis(errors, covariances, POSITION) < 1.6
    # Errors of the velocity are overstated where bodies do not accelerate as the tracker expects.
    assert mean_nees_per_axis(errors, covariances, VELOCITY) < 1.6


N_BODIES = 60
LANES_M = (-7.2, -3.6, 3.6, 7.2)


def draw_path(rng, length_m):
    """Draw the speed of the radar's vehicle, and the path of the other body."""
    lane_m = rng.choice(LANES_M) + rng.normal(0, 0.3)
    speed = rng.uniform(5, 20)
    case = rng.choice(list(PATHS))
    if case == "passing":
        start_m, own = rng.uniform(8, 30), speed + rng.uniform(-4, 6)
        return speed, lambda t: (start_m + own * t, lane_m)
    if case == "parked":
        start_m = rng.uniform(35, 70)
        return speed, lambda t: (start_m, lane_m)
    if case == "oncoming":
        start_m, own = rng.uniform(60, 110), rng.uniform(5, 15)
        return speed, lambda t: (start_m - own * t, abs(lane_m))
    if case == "ahead":
        start_m = rng.uniform(12, 50) + length_m / 2
        own, side_m = speed + rng.uniform(-2, 2), rng.normal(0, 0.3)
        return speed, lambda t: (start_m + own * t, side_m)
    start_m, own, radius_m = rng.uniform(12, 30), rng.uniform(5, 9), rng.uniform(12, 25)
    side, far_m = rng.choice([-1, 1]), rng.uniform(16, 22)

    def turn(t):
        angle = max(t - 0.5, 0.0) * own / radius_m
        x_m = start_m + own * min(t, 0.5) + radius_m * np.sin(angle)
        return x_m, side * (far_m - radius_m * (1 - np.cos(angle)))

    return rng.uniform(2, 6), turn


@nightly
def test_nees_of_random_bodies_is_in_its_interval(tmp_path):
    # Seven bodies in ten are cars; one each is a van, a truck and a semitrailer. The offset of an
    # echo from its centre lasts for seconds, so each body is one independent draw of two axes.
    values, squared_errors_m2 = [], []
    for number in range(N_BODIES):
        rng = np.random.default_rng(number)
        kind = rng.choice(["car", "van", "truck", "semitrailer"], p=[0.7, 0.1, 0.1, 0.1])
        speed, position_m = draw_path(rng, SIZES[kind][0])
        tracks, objects = fuse_pair(
            tmp_path / "trace.csv", kind, position_m, speed, end_s=2.0, seed=number
        )
        if objects["in_view"].values.any():
            errors, covariances = errors_of_centre(tracks, objects)
            values.append(mean_nees_per_axis(errors, covariances, POSITION))
            squared_errors_m2.append((errors[:, POSITION] ** 2).sum(axis=1).mean())

    low, high = mean_nees_interval(2, len(values), outside_probability=1e-6)
    assert len(values) > 0.9 * N_BODIES
    assert low / 2 < np.mean(values) < high / 2  # 0.49 to 1.76
    # Offsets without a mean on the near side have an RMS error of 3.5 m.
    assert np.sqrt(np.mean(squared_errors_m2)) < 2.8
