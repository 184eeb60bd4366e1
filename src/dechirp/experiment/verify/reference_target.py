"""Looks at the reference target, which several claims share."""

from collections.abc import Mapping

import numpy as np

from dechirp.experiment.verify.looks import (
    QUIET_SNR_DB,
    REFERENCE,
    Look,
    column,
    look_at_target,
)
from dechirp.experiment.verify.published import LOWEST_SNR_DB
from dechirp.experiment.verify.trials import Job
from dechirp.theory.windows import Window

ERROR_SNRS_DB = (LOWEST_SNR_DB, QUIET_SNR_DB)
"""Ratios in each sample at which the errors are measured."""
GRID_DB: dict[Window, tuple[float, ...]] = {
    "rectangular": (-42.5, -42.0, -41.5, -41.0),
    "hann": (-39.25, -38.75, -38.25, -37.75),
}
"""Ratios in each sample at which the curve is measured: down from the limit it is steepest."""


def jobs(n_errors: int, n_limit: Mapping[Window, int]) -> dict[str, Job]:
    """So many trials for the errors, and for the limit under each window.

    Noise takes half the time of a look, so the first trials are looked at for several claims
    at once. What each rests on are independent trials all the same.
    """
    limits = [Look(window=window, snr_db=GRID_DB[window]) for window in GRID_DB]
    errors = [Look(window="hann", snr_db=(snr_db,)) for snr_db in ERROR_SNRS_DB]
    n_first = max(n_errors, n_limit["hann"])
    n_more = max(n_limit["rectangular"] - n_first, 0)
    told = REFERENCE._asdict()
    made = {
        "reference target": Job(
            work=look_at_target, n_trials=n_first, told={**told, "looks": (*errors, *limits)}
        )
    }
    if n_more:
        made["reference target, faint"] = Job(
            work=look_at_target, n_trials=n_more, told={**told, "looks": (limits[0],)}
        )
    return made


def by_snr(results: Mapping[str, np.ndarray]) -> dict[float, np.ndarray]:
    """Looks for errors, by their ratio in dB."""
    looks = results["reference target"]
    return {snr_db: looks[:, index] for index, snr_db in enumerate(ERROR_SNRS_DB)}


def by_window(results: Mapping[str, np.ndarray]) -> dict[Window, np.ndarray]:
    """Trials for the limit, by window: ratio in dB, and hit or not, (n_trials, 2) each."""
    first = len(ERROR_SNRS_DB)
    looks = {
        window: results["reference target"][:, first + index]
        for index, window in enumerate(GRID_DB)
    }
    more = results.get("reference target, faint")
    if more is not None:
        looks["rectangular"] = np.concatenate([looks["rectangular"], more[:, 0]])
    return {
        window: np.stack([column(of, "snr_db"), column(of, "hit")], axis=-1)
        for window, of in looks.items()
    }
