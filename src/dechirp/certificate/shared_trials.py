"""Trials of the reference target that several claims share."""

from collections.abc import Mapping

import numpy as np

from dechirp.certificate.published import LOWEST_SNR_DB
from dechirp.certificate.reference_trials import (
    QUIET_SNR_DB,
    REFERENCE_TARGET,
    TrialCondition,
    run_target_trials,
    trial_column,
)
from dechirp.certificate.trials import Job
from dechirp.theory.windows import Window

ERROR_SNRS_DB = (LOWEST_SNR_DB, QUIET_SNR_DB)
"""SNR per sample at which the errors are measured."""
LIMIT_SNRS_DB: dict[Window, tuple[float, ...]] = {
    "rectangular": (-42.5, -42.0, -41.5, -41.0),
    "hann": (-39.25, -38.75, -38.25, -37.75),
}
"""SNR per sample at which the detection curve is measured; below the limit it is steepest."""


def error_and_snr_limit_trial_jobs(
    n_error_trials: int, n_limit_trials: Mapping[Window, int]
) -> dict[str, Job]:
    """Return the jobs for the errors and for the SNR limit with each window.

    Generating noise takes half the time of a trial, so the first trials serve several claims. The
    trials of each single claim are independent.
    """
    limits = [
        TrialCondition(window=window, snr_db=LIMIT_SNRS_DB[window]) for window in LIMIT_SNRS_DB
    ]
    errors = [TrialCondition(window="hann", snr_db=(snr_db,)) for snr_db in ERROR_SNRS_DB]
    n_first = max(n_error_trials, n_limit_trials["hann"])
    n_additional = max(n_limit_trials["rectangular"] - n_first, 0)
    motion = REFERENCE_TARGET._asdict()
    jobs = {
        "reference target": Job(
            work=run_target_trials,
            n_trials=n_first,
            arguments={**motion, "conditions": (*errors, *limits)},
        )
    }
    if n_additional:
        jobs["reference target, faint"] = Job(
            work=run_target_trials,
            n_trials=n_additional,
            arguments={**motion, "conditions": (limits[0],)},
        )
    return jobs


def error_trials_by_snr(results: Mapping[str, np.ndarray]) -> dict[float, np.ndarray]:
    """Return the trials for the errors, by SNR in dB."""
    trials = results["reference target"]
    return {snr_db: trials[:, index] for index, snr_db in enumerate(ERROR_SNRS_DB)}


def snr_limit_trials_by_window(results: Mapping[str, np.ndarray]) -> dict[Window, np.ndarray]:
    """Return the trials for the limit, by window: SNR in dB and hit (0 or 1), (n_trials, 2)."""
    first = len(ERROR_SNRS_DB)
    trials = {
        window: results["reference target"][:, first + index]
        for index, window in enumerate(LIMIT_SNRS_DB)
    }
    additional = results.get("reference target, faint")
    if additional is not None:
        trials["rectangular"] = np.concatenate([trials["rectangular"], additional[:, 0]])
    return {
        window: np.stack(
            [trial_column(window_trials, "snr_db"), trial_column(window_trials, "hit")], axis=-1
        )
        for window, window_trials in trials.items()
    }
