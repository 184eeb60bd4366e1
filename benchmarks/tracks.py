"""Completeness, consistency and speed of tracks of ten crossing targets.

The script runs trials of `examples/crossing-tracks.yaml`. In a complete trial, every target is
acquired in time and then kept by one track to the end. NEES is the mean over the four states of all
targets and complete trials, in each frame after the time limit for confirmation. The interval after
it contains the values of all frames with a probability of 1 - 1e-6 if the filter is consistent.
Frames/s are measured in processor time of one thread.

    python benchmarks/tracks.py [--trials 50] [--association joint] [--filter unscented]
"""

import argparse
import os
from dataclasses import replace
from pathlib import Path
from time import process_time
from typing import get_args

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("--trials", type=int, default=50, help="trials per tracker")
parser.add_argument("--association", default="", help="only this association")
parser.add_argument("--filter", default="", help="only this filter")
options = parser.parse_args()
os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np
import xarray as xr

from dechirp.config import loading
from dechirp.evaluation.gospa import gospa
from dechirp.evaluation.nees import mean_nees_interval, nees
from dechirp.evaluation.ospa import ospa_m
from dechirp.evaluation.track_trial import (
    TrackingOutcome,
    TrackTrial,
    assess_track_completeness,
    draw_truth_and_detections,
)
from dechirp.tracking.batch import STATE, track
from dechirp.tracking.tracker import Association, Filter

EXAMPLE = Path(__file__).parents[1] / "examples" / "crossing-tracks.yaml"


def stack_states(dataset: xr.Dataset) -> np.ndarray:
    return np.stack([dataset[name].values for name in STATE], axis=-1)


def compute_nees(outcome: TrackingOutcome) -> np.ndarray:
    """Compute the NEES of each target, (n_targets, n_frames), NaN for targets without a track."""
    holder = outcome.identities.holder.values
    target, frame = np.nonzero(holder >= 0)
    row = holder[target, frame]
    error = (
        stack_states(outcome.tracks)[row, frame] - stack_states(outcome.data.truth)[target, frame]
    )
    squared_errors = np.full(holder.shape, np.nan)
    squared_errors[target, frame] = nees(error, outcome.tracks.covariance.values[row, frame])
    return squared_errors


def compute_distances(outcome: TrackingOutcome, cutoff_m: float) -> np.ndarray:
    """Compute the OSPA and GOSPA of each frame, (n_frames, 2)."""
    confirmed = outcome.tracks.status.values == "confirmed"
    estimates, truth = (
        stack_states(dataset)[..., [0, 2]] for dataset in (outcome.tracks, outcome.data.truth)
    )
    return np.array(
        [
            (ospa_m(a, b, cutoff_m=cutoff_m), gospa(a, b, cutoff_m=cutoff_m).error_m)
            for a, b in (
                (estimates[confirmed[:, frame], frame], truth[:, frame])
                for frame in range(truth.shape[1])
            )
        ]
    )


def measure(trial: TrackTrial) -> None:
    outcomes, elapsed_s = [], 0.0
    for number in range(options.trials):
        trial_data = draw_truth_and_detections(trial, number)
        start_s = process_time()
        tracks = track(trial_data.detections, trial.times_s, trial.tracker)
        elapsed_s += process_time() - start_s
        outcomes.append(assess_track_completeness(trial, trial_data, tracks))
    n_targets = len(trial.scene.targets)
    first_frame = trial.tracker.confirm_after[1]
    complete = [outcome for outcome in outcomes if outcome.is_complete]
    mean_nees = np.nanmean(
        np.concatenate([compute_nees(outcome) for outcome in complete])[:, first_frame:], axis=0
    )
    low, high = mean_nees_interval(
        4, len(complete) * n_targets, outside_probability=1e-6 / len(mean_nees)
    )
    distances_m = np.mean(
        [compute_distances(outcome, trial.cutoff_m) for outcome in outcomes], axis=0
    )[first_frame:]
    print(
        f"{trial.tracker.association:>8} {trial.tracker.filter:>10}:"
        f" {len(complete)} of {options.trials} complete;"
        f" {sum(int((outcome.identities.n_lost > 0).sum()) for outcome in outcomes)} targets lost,"
        f" {sum(int((outcome.identities.n_swaps > 0).sum()) for outcome in outcomes)} swapped,"
        f" {sum(int(outcome.identities.n_false.sum()) for outcome in outcomes)}"
        " frames of false tracks;"
        f" NEES {mean_nees.mean():.2f}, {mean_nees.min():.2f} to {mean_nees.max():.2f} in frames"
        f" ({low:.2f} to {high:.2f}); OSPA {distances_m[:, 0].mean():.2f} m,"
        f" GOSPA {distances_m[:, 1].mean():.2f} m;"
        f" {options.trials * trial.n_frames / elapsed_s:.1f} frames/s",
        flush=True,
    )


def main() -> None:
    trial = loading.read_settings(EXAMPLE, TrackTrial)
    for association in get_args(Association):
        for name in get_args(Filter):
            if options.association in ("", association) and options.filter in ("", name):
                tracker = replace(trial.tracker, association=association, filter=name)
                measure(replace(trial, tracker=tracker))


if __name__ == "__main__":
    main()
