"""Consistency, GOSPA and speed of tracks of ten extended objects with 30 points each.

The objects are rigid. They move straight on but for white acceleration, as the first motion model
of the tracker assumes, or switch between its models at random. NEES is the mean over the four
states of all objects and trials. Frames/s are measured in processor time of one thread.

    python benchmarks/group_tracks.py [--trials 12]
"""

import argparse
import os
from time import process_time

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("--trials", type=int, default=12, help="trials of each motion")
options = parser.parse_args()
os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np
import xarray as xr

from dechirp.evaluation.gospa import gospa
from dechirp.evaluation.nees import nees
from dechirp.tracking.batch import STATE
from dechirp.tracking.group_tracker import GroupTracker
from dechirp.tracking.groups import track_groups
from dechirp.tracking.interacting_models import switching_probabilities

N_OBJECTS, N_POINTS, N_FRAMES, INTERVAL_S = 10, 30, 60, 0.1
EXTENT_M2 = np.diag([0.3, 0.1])
CUTOFF_M = 2.0
STRAIGHT, TURNING, MANOEUVRING = range(3)


def draw_path(
    rng: np.random.Generator, start: np.ndarray, tracker: GroupTracker, *, switches: bool
) -> np.ndarray:
    """Draw the states of an object, (n_frames, 5): x, vx, y, vy, turn rate."""
    t = INTERVAL_S
    switching = switching_probabilities(3, t, tracker.model_time_s)
    decay = np.exp(-t / tracker.model_time_s)
    model, turn_rate = STRAIGHT, 0.0
    path = [np.append(start, 0.0)]
    for _ in range(N_FRAMES - 1):
        if switches:
            after = int(rng.choice(3, p=switching[model]))
            if after == TURNING and model != TURNING:
                turn_rate = rng.normal(0, tracker.turn_rate_std_rad_per_s)
            model = after
        x, vx, y, vy, _ = path[-1]
        if model == TURNING:
            sine, cosine = np.sin(turn_rate * t), np.cos(turn_rate * t)
            along, across = sine / turn_rate, (1 - cosine) / turn_rate
            state = [
                x + along * vx - across * vy,
                cosine * vx - sine * vy,
                y + across * vx + along * vy,
                sine * vx + cosine * vy,
            ]
            noise_std = tracker.turn_rate_std_rad_per_s * np.sqrt(1 - decay**2)
            turn_rate = decay * turn_rate + rng.normal(0, noise_std)
        else:
            state = [x + t * vx, vx, y + t * vy, vy]
        density = (
            tracker.manoeuvre_noise_m2_per_s3
            if model == MANOEUVRING
            else tracker.process_noise_m2_per_s3
        )
        covariance = density * np.array([[t**3 / 3, t**2 / 2], [t**2 / 2, t]])
        noise = rng.multivariate_normal([0, 0], covariance, 2).ravel()
        path.append(np.append(state + noise, turn_rate if model == TURNING else 0.0))
    return np.array(path)


def draw_points(rng: np.random.Generator, paths: np.ndarray, tracker: GroupTracker) -> xr.Dataset:
    """Draw the points of all objects and frames."""
    shape = (*paths.shape[:2], N_POINTS)
    x, vx, y, vy, turn_rate = np.moveaxis(paths, -1, 0)[..., None]
    offset = rng.multivariate_normal([0, 0], EXTENT_M2, shape)
    angle = INTERVAL_S * np.cumsum(turn_rate, axis=1)
    along, across = np.moveaxis(offset.copy(), -1, 0)
    offset[..., 0] = np.cos(angle) * along - np.sin(angle) * across
    offset[..., 1] = np.sin(angle) * along + np.cos(angle) * across
    x, y = x + offset[..., 0], y + offset[..., 1]
    vx, vy = vx - turn_rate * offset[..., 1], vy + turn_rate * offset[..., 0]
    range_m, azimuth = np.hypot(x, y), np.arctan2(y, x)
    rate_std = np.hypot(tracker.velocity_spread_m_per_s, tracker.velocity_std_m_per_s)
    columns = {
        "frame": np.broadcast_to(np.arange(N_FRAMES)[:, None], shape),
        "range": range_m + rng.normal(0, tracker.range_std_m, shape),
        "azimuth": azimuth + rng.normal(0, tracker.azimuth_std_rad, shape),
        "velocity": (vx * x + vy * y) / range_m + rng.normal(0, rate_std, shape),
    }
    return xr.Dataset({name: ("detection", column.ravel()) for name, column in columns.items()})


def measure(tracker: GroupTracker, *, switches: bool) -> None:
    squared_errors, distances_m, n_tracks, elapsed_s = [], [], 0, 0.0
    for seed in range(options.trials):
        rng = np.random.default_rng(seed)
        starts = [
            np.array([15 + 6 * (i % 5), rng.normal(), 20 * (i // 5) - 10, rng.normal()])
            for i in range(N_OBJECTS)
        ]
        paths = np.array([draw_path(rng, start, tracker, switches=switches) for start in starts])
        points = draw_points(rng, paths, tracker)
        start_s = process_time()
        tracks = track_groups(points, INTERVAL_S * np.arange(N_FRAMES), tracker)
        elapsed_s += process_time() - start_s
        n_tracks += tracks.sizes["track"]
        states = np.stack([tracks[name].values for name in STATE], axis=-1)
        for path in paths:
            distance = np.hypot(states[..., 0] - path[:, 0], states[..., 2] - path[:, 2])
            row = np.nanargmin(np.nanmean(distance, axis=1))
            frames = np.isfinite(distance[row])
            squared_errors.append(
                nees((states[row] - path[:, :4])[frames], tracks.covariance.values[row, frames])
            )
        for frame in range(N_FRAMES):
            estimates = states[np.isfinite(states[:, frame, 0]), frame]
            truth = paths[:, frame]
            distances_m.append(
                gospa(estimates[:, [0, 2]], truth[:, [0, 2]], cutoff_m=CUTOFF_M).error_m
            )
    mean_nees = np.mean(np.concatenate(squared_errors))
    print(
        f"{'switching' if switches else 'straight':>9}: {n_tracks} tracks of"
        f" {N_OBJECTS * options.trials} objects; NEES {mean_nees:.2f};"
        f" GOSPA {np.mean(distances_m):.2f} m;"
        f" {options.trials * N_FRAMES / elapsed_s:.0f} frames/s",
        flush=True,
    )


if __name__ == "__main__":
    for switches in (False, True):
        measure(GroupTracker(), switches=switches)
