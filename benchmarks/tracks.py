"""How often tracks of ten crossing targets are whole, how sure they are, and how fast.

Trials of `examples/crossing-tracks.yaml`. Whole: every target acquired in time, and then held by
one track to the end. NEES: mean over targets and whole trials in each frame, of four states,
from the frame on in which tracks must be confirmed; beside it the interval in which all of a
consistent filter's would be but once in a million. Frames/s: of one thread, processor time.

    python benchmarks/tracks.py [--trials 50] [--association joint] [--filter unscented]
"""

import argparse
import os
from dataclasses import replace
from pathlib import Path
from time import process_time
from typing import get_args

arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
arguments.add_argument("--trials", type=int, default=50)
arguments.add_argument("--association", default="")
arguments.add_argument("--filter", default="")
asked = arguments.parse_args()
os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np
import xarray as xr

from dechirp.config import loading
from dechirp.evaluation.gospa import gospa
from dechirp.evaluation.nees import mean_nees_interval, nees
from dechirp.evaluation.ospa import ospa_m
from dechirp.evaluation.track_trial import TrackingOutcome, TrackTrial, draw_trial, judge_tracks
from dechirp.tracking.batch import STATE, track
from dechirp.tracking.tracker import Association, Filter

EXAMPLE = Path(__file__).parents[1] / "examples" / "crossing-tracks.yaml"


def states(of: xr.Dataset) -> np.ndarray:
    return np.stack([of[name].values for name in STATE], axis=-1)


def sureness(outcome: TrackingOutcome) -> np.ndarray:
    """NEES of each target, (n_targets, n_frames), NaN while no track holds it."""
    holder = outcome.identities.holder.values
    target, frame = np.nonzero(holder >= 0)
    row = holder[target, frame]
    error = states(outcome.tracks)[row, frame] - states(outcome.drawn.truth)[target, frame]
    found = np.full(holder.shape, np.nan)
    found[target, frame] = nees(error, outcome.tracks.covariance.values[row, frame])
    return found


def distances(outcome: TrackingOutcome, cutoff_m: float) -> np.ndarray:
    """OSPA and GOSPA of each frame, (n_frames, 2)."""
    confirmed = outcome.tracks.status.values == "confirmed"
    found, truth = (states(of)[..., [0, 2]] for of in (outcome.tracks, outcome.drawn.truth))
    return np.array(
        [
            (ospa_m(a, b, cutoff_m=cutoff_m), gospa(a, b, cutoff_m=cutoff_m).error_m)
            for a, b in (
                (found[confirmed[:, frame], frame], truth[:, frame])
                for frame in range(truth.shape[1])
            )
        ]
    )


def measure(trial: TrackTrial) -> None:
    outcomes, took_s = [], 0.0
    for number in range(asked.trials):
        drawn = draw_trial(trial, number)
        begun_s = process_time()
        tracks = track(drawn.detections, trial.times_s, trial.tracker)
        took_s += process_time() - begun_s
        outcomes.append(judge_tracks(trial, drawn, tracks))
    n_targets = len(trial.scene.targets)
    settled = trial.tracker.confirm_after[1]
    whole = [one for one in outcomes if one.is_complete]
    sure = np.nanmean(np.concatenate([sureness(one) for one in whole])[:, settled:], axis=0)
    low, high = mean_nees_interval(4, len(whole) * n_targets, outside_probability=1e-6 / len(sure))
    apart = np.mean([distances(one, trial.cutoff_m) for one in outcomes], axis=0)[settled:]
    print(
        f"{trial.tracker.association:>8} {trial.tracker.filter:>10}:"
        f" {len(whole)} of {asked.trials} whole;"
        f" {sum(int((one.identities.n_lost > 0).sum()) for one in outcomes)} targets lost,"
        f" {sum(int((one.identities.n_swaps > 0).sum()) for one in outcomes)} swapped,"
        f" {sum(int(one.identities.n_false.sum()) for one in outcomes)} frames of false tracks;"
        f" NEES {sure.mean():.2f}, {sure.min():.2f} to {sure.max():.2f} in frames"
        f" ({low:.2f} to {high:.2f}); OSPA {apart[:, 0].mean():.2f} m,"
        f" GOSPA {apart[:, 1].mean():.2f} m; {asked.trials * trial.n_frames / took_s:.1f} frames/s",
        flush=True,
    )


def main() -> None:
    trial = loading.read_settings(EXAMPLE, TrackTrial)
    for association in get_args(Association):
        for name in get_args(Filter):
            if asked.association in ("", association) and asked.filter in ("", name):
                tracker = replace(trial.tracker, association=association, filter=name)
                measure(replace(trial, tracker=tracker))


if __name__ == "__main__":
    main()
