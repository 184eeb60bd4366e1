"""Stated errors of fused tracks of cars and trucks, against their errors (NEES)."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import dechirp as dc
from dechirp.evaluation.identity import track_identities
from dechirp.evaluation.nees import nees
from nightly import nightly_except

PAIR = "radars=[{mount: front-left}, {mount: front-right, start_offset: 20 ms}]"
SIZES = {"car": (4.5, 1.8, 1.5), "truck": (10.0, 2.5, 3.6)}


def turn_left(t):
    """Return a position on a path that turns on a circle of 15 m after half a second, at 8 m/s."""
    angle = max(t - 0.5, 0.0) * 8 / 15
    return 14 + 8 * min(t, 0.5) + 15 * np.sin(angle), 19 - 15 * np.cos(angle)


# Speed of the radar's vehicle along x, and path of the other body.
PATHS = {
    "passing": (12.0, lambda t: (18 + 16 * t, 3.6)),
    "turning": (4.0, turn_left),
    "parked": (8.0, lambda t: (45.0, 4.0)),
    "oncoming": (12.0, lambda t: (75 - 12 * t, 3.6)),
    "ahead": (15.0, lambda t: (22 + 15 * t, 0.0)),
}


def write_trace(path, kind, case, end_s):
    speed, position_m = PATHS[case]
    objects = [("car", lambda t: (speed * t, 0.0)), (kind, position_m)]
    rows = ["time,id,class,x,y,heading,length,width,height"]
    for number, (its_kind, path_m) in enumerate(objects, 1):
        for t in np.arange(0, end_s + 0.05, 0.1):
            x_m, y_m = path_m(t)
            ahead_m = np.subtract(path_m(t + 0.01), (x_m, y_m))
            heading = float(np.arctan2(*ahead_m[::-1])) if ahead_m.any() else 0.0
            size = ",".join(map(str, SIZES[its_kind]))
            rows.append(f"{t:.1f},{number},{its_kind},{x_m:.4f},{y_m:.4f},{heading:.5f},{size}")
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")


def mean_nees_per_axis(tracks, objects):
    """Return the mean NEES of position and velocity over 2, from the centre of the only object."""
    centres = objects[["centre_x", "centre_y"]].rename(centre_x="x", centre_y="y")
    cutoff_m = float(objects["length"].values[0]) / 2 + 3
    holder = track_identities(tracks, centres, cutoff_m=cutoff_m)["holder"].values[0]
    in_view = objects["in_view"].values[0]
    frames = np.flatnonzero(in_view & (holder >= 0))
    assert len(frames) > 0.9 * in_view.sum()
    rows = holder[frames]
    states = np.stack([tracks[name].values[rows, frames] for name in ("x", "vx", "y", "vy")], -1)
    truth = np.stack(
        [objects[n].values[0, frames] for n in ("centre_x", "vx", "centre_y", "vy")], -1
    )
    covariances = tracks["covariance"].values[rows, frames]
    return [
        nees((states - truth)[:, axes], covariances[:, axes][..., axes]).mean() / 2
        for axes in ([0, 2], [1, 3])
    ]


# Largest mean NEES of the position, per axis. Its expected value is 1 over all bodies. The echo of
# the rear of a truck ahead is 5 m from its centre, and nothing in it shows the length: 5^2 m^2 over
# 2 axes of the stated 1.8 m. Parts of parked and oncoming trucks form separate clusters, whose
# extents are smaller than the truck.
LARGEST = {("truck", "ahead"): 4.5, ("truck", "parked"): 4.0, ("truck", "oncoming"): 4.0}


@pytest.mark.parametrize(
    ("kind", "case"),
    nightly_except(1, [(kind, case) for case in PATHS for kind in SIZES]),
)
def test_stated_errors_of_bodies_are_honest(tmp_path, kind, case):
    end_s = 1.0 if (kind, case) == ("car", "passing") else 3.0
    write_trace(tmp_path / "trace.csv", kind, case, end_s)
    scenario = dc.traffic.traffic_scenario(tmp_path / "trace.csv", ["traffic.ego=1", PAIR])

    with ThreadPoolExecutor(1) as executor:
        result = dc.fusion.run_radars(scenario, kind="statistical", executor=executor)

    position, velocity = mean_nees_per_axis(result.tracks, result.objects)
    assert 0.3 < position < LARGEST.get((kind, case), 2.0)
    # Errors of the velocity are overstated where bodies do not accelerate as the tracker expects.
    assert velocity < 2.5
