"""`verify`: every claim of the reference report, measured against the claim and against theory.

In full also what the package says of its detectors, direction estimators and impairments.
"""

import datetime
import os
import platform
from collections.abc import Callable
from concurrent.futures import Executor
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from time import perf_counter

from dechirp.core.checks import whole
from dechirp.core.values import value
from dechirp.experiment.study.environment import environment
from dechirp.experiment.study.executors import given
from dechirp.experiment.verify import (
    detection,
    estimates,
    false_alarms,
    further,
    reference_target,
    resolution,
    transforms,
    waveform,
)
from dechirp.experiment.verify.claim import Claim, Part
from dechirp.experiment.verify.corrections import Correction, corrections
from dechirp.experiment.verify.curves import Curve, curves
from dechirp.experiment.verify.reference_target import GRID_DB
from dechirp.experiment.verify.sensitivity import trials_for_limit
from dechirp.experiment.verify.tables import Table, tables
from dechirp.experiment.verify.trials import Job, n_blocks, run_all

CLAIMS = (
    "chirp_linearity",
    "beat_frequency_50m",
    "range_stationary_100m",
    "range_doppler_peak",
    "integration_gain",
    "corner_200m_100mps",
    "echo_power_50m",
    "direction_of_motion",
    "blind_doppler",
    "false_alarms_minus10db",
    "detection_at_minus24db",
    "snr_limit",
    "false_alarm_rate",
    "range_rmse",
    "velocity_rmse",
    "two_targets_resolved",
)
"""Their ids, in the order of the report."""

FULL_TRIALS = 10_000
_LIBRARIES = ("numpy", "scipy", "numba", "llvmlite", "xarray")


@value
class Certificate:
    """What was certified, with what it rests on."""

    claims: tuple[Claim, ...]
    """Of the reference report, in the order of `CLAIMS`."""
    parts: tuple[Part, ...] = ()
    """What is certified beyond the report; empty unless in full."""
    corrections: tuple[Correction, ...]
    """Where the report contradicts itself or is wrong."""
    tables: tuple[Table, ...]
    """The report's tables 5, 6 and 7, as published and as computed here."""
    curves: tuple[Curve, ...]
    """What the detection and resolution claims were read from."""
    seed: int
    trials: int | None
    """As asked for; none: as many as each claim needs."""
    full: bool
    date: str
    versions: dict[str, str]
    machine: str
    timing_s: dict[str, float]

    @property
    def passed(self) -> bool:
        """Whether every claim did."""
        further_claims = (claim for part in self.parts for claim in part.claims)
        return all(claim.passed for claim in (*self.claims, *further_claims))


def verify(
    *,
    trials: int | None = None,
    full: bool = False,
    seed: int = 1,
    executor: Executor | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Certificate:
    """Measure every claim of the reference report.

    Parameters
    ----------
    trials : int, optional
        Of each claim on detection, estimates and resolution. One whose interval needs more
        of them to decide takes what it needs: a certificate does not become weaker to be
        quicker. Frames of noise alone are as many as their cells ask for.
    full : bool
        10,000 trials where `trials` does not say, false alarms at 1e-6 over 3e9 cells, and
        beyond the report false alarms of every detector under every window over 1e9 cells each,
        errors of every direction estimator, and every impairment against its formula: a quarter
        of an hour on two cores. Without it, under two minutes.
    seed : int
        The same seed gives the same numbers, for any number of workers.
    executor : Executor, optional
        Where the trials run: any of `concurrent.futures`; without it, one process a core.
    progress : callable, optional
        Called with the number of blocks of trials done and of all.

    Raises
    ------
    InvalidSetting
        If `trials` or `seed` is no whole number, or negative.
    """
    whole("seed", seed, at_least=0, at_most=2**63 - 1)
    if trials is not None:
        whole("trials", trials, at_least=1, at_most=100_000_000)
    started = perf_counter()
    first = _jobs(trials, full=full)
    if full:
        first |= further.jobs(trials or FULL_TRIALS)
    n_first, n_later = n_blocks(first), further.n_later() if full else 0

    def after(n_before: int) -> Callable[[int, int], None] | None:
        if progress is None:
            return None
        return lambda done, _: progress(n_before + done, n_first + n_later)

    with given(executor) as workers:
        run = partial(
            run_all,
            seed=seed,
            executor=workers.executor,
            lost=workers.lost,
            renew=workers.renew,
        )
        results = run(first, progress=after(0))
        if full:
            results |= run(further.later(results), progress=after(n_first))
    measured = perf_counter()
    found = [
        *waveform.claims(),
        *transforms.claims(results),
        *estimates.claims(results),
        *detection.claims(results),
        *false_alarms.claims(results, full=full),
        *resolution.claims(results),
    ]
    by_id = {claim.id: claim for claim in found}
    return Certificate(
        claims=tuple(by_id[name] for name in CLAIMS),
        parts=further.parts(results) if full else (),
        corrections=corrections(),
        tables=tables(by_id),
        curves=curves(results),
        seed=seed,
        trials=trials,
        full=full,
        date=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        versions=_versions(),
        machine=f"{platform.system()} {platform.machine()}, {environment()['processor']},"
        f" {os.cpu_count()} cores",
        timing_s={"trials": measured - started, "claims": perf_counter() - measured},
    )


def _jobs(trials: int | None, *, full: bool) -> dict[str, Job]:
    """All trials: so many as their claims need, or as asked if that is more."""
    least = trials or (FULL_TRIALS if full else 0)
    for_limit = {window: max(least, trials_for_limit(window)) for window in GRID_DB}
    return {
        **transforms.jobs(),
        **reference_target.jobs(max(least, estimates.trials_for_errors()), for_limit),
        **detection.jobs(least),
        **estimates.jobs(least),
        **false_alarms.jobs(full=full),
        **resolution.jobs(least),
    }


def _versions() -> dict[str, str]:
    known = {"python": platform.python_version()}
    for name in ("dechirp", *_LIBRARIES):
        try:
            known[name] = version(name)
        except PackageNotFoundError:  # imported from a folder, not installed
            continue
    return known
