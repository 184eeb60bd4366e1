"""Consistency, GOSPA and speed of tracks of ten extended objects; errors of a turning car.

The ten objects are rigid, with 30 points each. They move straight on but for white acceleration, as
the first motion model of the tracker assumes, or switch between its models at random. NEES is the
mean over the four states of all objects and trials. Frames/s are measured in processor time of one
thread.

The car is a rectangle of 4.5 m by 1.8 m with 20 points, evenly distributed. Its errors are those
of the turn without its first half second. Last, the body of a car is simulated and detected, once.

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

import dechirp as dc
from dechirp.evaluation.gospa import gospa
from dechirp.evaluation.nees import nees
from dechirp.tracking.batch import STATE
from dechirp.tracking.group_tracker import GroupTracker
from dechirp.tracking.groups import track_groups
from dechirp.tracking.interacting_models import switching_probabilities

N_OBJECTS, N_POINTS, N_FRAMES, INTERVAL_S = 10, 30, 60, 0.1
EXTENT_M2 = np.diag([0.3, 0.1])
CUTOFF_M = 2.0
CAR_SIZE_M, N_CAR_POINTS, CAR_INTERVAL_S, TURN_START_S = (4.5, 1.8), 20, 0.05, 2.0
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


def drive_car(
    start_m: tuple[float, float], speed_m_per_s: np.ndarray, turn_rate_rad_per_s: float
) -> np.ndarray:
    """Integrate the states of a car that drives to the left, then turns, (n_frames, 5)."""
    t = CAR_INTERVAL_S
    is_turning = np.arange(len(speed_m_per_s)) * t >= TURN_START_S
    turn_rate = np.where(is_turning, turn_rate_rad_per_s, 0.0)
    turned = t * np.cumsum(turn_rate)
    heading = np.pi / 2 + turned - t * turn_rate
    middle = np.pi / 2 + turned - t * turn_rate / 2  # between a frame and the next
    step_m = t * speed_m_per_s * np.array([np.cos(middle), np.sin(middle)])
    x, y = np.array(start_m)[:, None] + np.cumsum(step_m, axis=1) - step_m
    vx, vy = speed_m_per_s * np.array([np.cos(heading), np.sin(heading)])
    return np.stack([x, vx, y, vy, turn_rate], axis=-1)


def rotate(offset: np.ndarray, angle: np.ndarray) -> np.ndarray:
    along, across = np.moveaxis(offset, -1, 0)
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.stack([cosine * along - sine * across, sine * along + cosine * across], axis=-1)


def draw_points(
    rng: np.random.Generator,
    paths: np.ndarray,
    offset: np.ndarray,
    tracker: GroupTracker,
    rate_std: float,
) -> xr.Dataset:
    """Draw the points of rigid objects, at offsets (object, frame, point, 2) from their centres."""
    shape = offset.shape[:-1]
    x, vx, y, vy, turn_rate = np.moveaxis(paths, -1, 0)[..., None]
    x, y = x + offset[..., 0], y + offset[..., 1]
    vx, vy = vx - turn_rate * offset[..., 1], vy + turn_rate * offset[..., 0]
    range_m, azimuth = np.hypot(x, y), np.arctan2(y, x)
    columns = {
        "frame": np.broadcast_to(np.arange(shape[1])[:, None], shape),
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
        offset = rng.multivariate_normal([0, 0], EXTENT_M2, (N_OBJECTS, N_FRAMES, N_POINTS))
        angle = INTERVAL_S * np.cumsum(paths[..., 4:], axis=1)
        rate_std = float(np.hypot(tracker.velocity_spread_m_per_s, tracker.velocity_std_m_per_s))
        points = draw_points(rng, paths, rotate(offset, angle), tracker, rate_std)
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


def measure_car(label: str, path: np.ndarray) -> None:
    tracker = GroupTracker(
        size_std_m=0.8, range_std_m=0.1, azimuth_std_rad=0.01, velocity_std_m_per_s=0.1
    )
    times_s = CAR_INTERVAL_S * np.arange(len(path))
    is_turn = times_s >= TURN_START_S + 0.5
    errors, squared_errors, lengths_m, n_tracks = [], [], [], 0
    for seed in range(options.trials):
        rng = np.random.default_rng(seed)
        offset = rng.uniform(-0.5, 0.5, (1, len(path), N_CAR_POINTS, 2)) * CAR_SIZE_M
        heading = np.arctan2(path[:, 3], path[:, 1])[:, None]
        points = draw_points(
            rng, path[None], rotate(offset, heading), tracker, tracker.velocity_std_m_per_s
        )
        tracks = track_groups(points, times_s, tracker)
        n_tracks += tracks.sizes["track"]
        row = int(np.isfinite(tracks.x.values).sum(axis=1).argmax())
        states = np.stack([tracks[name].values[row, is_turn] for name in STATE], axis=-1)
        errors.append(states - path[is_turn, :4])
        squared_errors.append(nees(errors[-1], tracks.covariance.values[row, is_turn]))
        lengths_m.append(tracks.length.values[row, is_turn])
    rms = np.sqrt(np.mean(np.square(errors), axis=(0, 1)))
    print(
        f"{label}: {n_tracks} tracks of {options.trials} cars;"
        f" RMS errors {np.hypot(rms[0], rms[2]):.2f} m, {np.hypot(rms[1], rms[3]):.2f} m/s;"
        f" NEES {np.mean(squared_errors):.1f}; length {np.mean(lengths_m):.1f} m",
        flush=True,
    )


def measure_simulated_car(path: np.ndarray) -> None:
    """Track a body of scatterers in detections of a radar with eight receivers."""
    chirp = dc.Chirp(
        start_frequency_hz=77e9,
        slope_hz_per_s=50e12,
        adc_start_s=2e-6,
        ramp_duration_s=30e-6,
        sample_rate_hz=20e6,
        n_samples=512,
        sampling="complex",
    )
    radar = dc.Radar(
        frame=dc.Frame(chirp=chirp, n_chirps=512, interval_s=35e-6, period_s=CAR_INTERVAL_S),
        array=dc.Array(tx_m=[(0, 0, 0)], rx_m=[(0, 1.93e-3 * n, 0) for n in range(8)]),
        hardware=dc.Hardware(transmit_power_w=16e-3, antenna_gain=10.0, noise_factor=20.0),
    )
    times_s = CAR_INTERVAL_S * np.arange(len(path))
    position_m = np.column_stack([path[:, [0, 2]], np.full(len(path), -0.6)])
    waypoints = [
        dc.Waypoint(time_s=time_s, position_m=tuple(point_m))
        for time_s, point_m in zip(times_s[2::2], position_m[2::2], strict=True)
    ]
    car = dc.Target(position_m=tuple(position_m[0]), waypoints=waypoints, body=dc.bodies.Car())
    cubes = dc.simulate(dc.Scene(targets=[car]), radar, n_frames=len(path), seed=1)
    detections = dc.detect(cubes, radar)
    tracks = track_groups(detections, times_s, GroupTracker(size_std_m=0.8))
    row = int(np.isfinite(tracks.x.values).sum(axis=1).argmax())
    is_turn = times_s >= TURN_START_S
    x, vx, y, vy = (
        tracks[name].values[row, is_turn] - path[is_turn, n] for n, name in enumerate(STATE)
    )
    print(
        f"simulated, 0.35 rad/s: {tracks.sizes['track']} tracks of 1 car;"
        f" {detections.sizes['detection'] / len(path):.1f} detections a frame;"
        f" RMS error {np.sqrt(np.nanmean(vx**2 + vy**2)):.2f} m/s;"
        f" mean error {np.hypot(np.nanmean(x), np.nanmean(y)):.1f} m",
        flush=True,
    )


if __name__ == "__main__":
    for switches in (False, True):
        measure(GroupTracker(), switches=switches)
    measure_car("0.35 rad/s at 21 m, 7 m/s", drive_car((21, -19), np.full(160, 7.0), 0.35))
    measure_car("-0.7 rad/s at 12 m, 4 m/s", drive_car((12, -8), np.full(160, 4.0), -0.7))
    braking_s = np.clip(CAR_INTERVAL_S * np.arange(130) - TURN_START_S, 0, 2)
    measure_car("0.4 rad/s, braking with 4 m/s^2", drive_car((18, -20), 12 - 4 * braking_s, 0.4))
    measure_simulated_car(drive_car((21, -14), np.full(100, 7.0), 0.35))
