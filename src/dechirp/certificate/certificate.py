"""Certificate of the package: claims of the reference report, checked against measurements.

`verify` measures each claim and compares it with the requirement and with theory. A full run also
certifies the detectors, the direction estimators and the impairments of the package.
"""

import datetime
import os
import platform
from collections.abc import Callable
from concurrent.futures import Executor
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from time import perf_counter

from dechirp.certificate import (
    detection,
    estimates,
    extended,
    false_alarms,
    resolution,
    shared_trials,
    transforms,
    waveform,
)
from dechirp.certificate.claim import Claim, Part
from dechirp.certificate.corrections import Correction, list_corrections_of_published_report
from dechirp.certificate.detection_curves import (
    MeasuredCurve,
    build_detection_and_resolution_curves,
)
from dechirp.certificate.sensitivity import count_trials_to_prove_snr_limit
from dechirp.certificate.shared_trials import LIMIT_SNRS_DB
from dechirp.certificate.tables import Table, build_report_tables
from dechirp.certificate.trials import Job, count_trial_blocks, run_jobs
from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_integer
from dechirp.core.values import frozen_dataclass
from dechirp.experiments.study.environment import versions_system_and_processor
from dechirp.experiments.study.executors import workers_from_executor

CLAIM_IDS = (
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
"""Ids of the claims, in the order of the report."""

FULL_TRIALS = 10_000
_LIBRARIES = ("numpy", "scipy", "numba", "llvmlite", "xarray")


@frozen_dataclass
class Certificate:
    """Verified claims, with the tables, curves and provenance of the run."""

    claims: tuple[Claim, ...]
    """Claims of the reference report, in the order of `CLAIM_IDS`."""
    parts: tuple[Part, ...] = ()
    """Claims beyond the report; empty unless `full`."""
    corrections: tuple[Correction, ...]
    """Statements of the report that are wrong or contradict each other."""
    tables: tuple[Table, ...]
    """Tables 5, 6 and 7 of the report: published and computed values."""
    curves: tuple[MeasuredCurve, ...]
    """Measured curves that the claims on detection and resolution are read from."""
    seed: int
    trials: int | None
    """Requested number of trials; None if each claim uses the number that it needs."""
    full: bool
    date: str
    versions: dict[str, str]
    machine: str
    timing_s: dict[str, float]

    @property
    def passed(self) -> bool:
        """True if all claims passed."""
        extended_claims = (claim for part in self.parts for claim in part.claims)
        return all(claim.passed for claim in (*self.claims, *extended_claims))


@check_argument_types
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
        Minimum number of trials of each claim on detection, estimation and resolution. A claim
        whose interval needs more trials uses the number that it needs, so that a low value does
        not weaken the certificate. The number of noise frames follows from the number of cells.
    full : bool
        Use 10,000 trials unless `trials` is given, measure the false-alarm rate at 1e-6 over 3e9
        cells, and certify more than the report: false alarms of every detector with every window
        over 1e9 cells each, errors of every direction estimator, and every impairment against its
        formula. This takes a quarter of an hour on two cores, otherwise one and a half minutes,
        and a minute more where kernels are compiled for the first time.
    seed : int
        Seed of all trials. The results do not depend on the number of workers.
    executor : Executor, optional
        Executor of `concurrent.futures` that runs the trials; default: one process per core.
    progress : callable, optional
        Called with the number of finished blocks of trials and the total number.

    Raises
    ------
    InvalidSetting
        If `trials` or `seed` is not an integer or lies outside its range.
    """
    check_integer("seed", seed, at_least=0, at_most=2**63 - 1)
    if trials is not None:
        check_integer("trials", trials, at_least=1, at_most=100_000_000)
    start_s = perf_counter()
    first_jobs = _trial_jobs_of_report_claims(trials, full=full)
    if full:
        first_jobs |= extended.calibration_direction_impairment_jobs(trials or FULL_TRIALS)
    n_first, n_later = (
        count_trial_blocks(first_jobs),
        extended.count_noise_map_trial_blocks() if full else 0,
    )

    def progress_after(n_before: int) -> Callable[[int, int], None] | None:
        if progress is None:
            return None
        return lambda done, _: progress(n_before + done, n_first + n_later)

    with workers_from_executor(executor) as workers:
        run = partial(
            run_jobs,
            seed=seed,
            executor=workers.executor,
            worker_errors=workers.death_errors,
            restart_workers=workers.renew,
        )
        results = run(first_jobs, progress=progress_after(0))
        if full:
            results |= run(
                extended.noise_map_false_alarm_jobs(results), progress=progress_after(n_first)
            )
    trials_end_s = perf_counter()
    claims = [
        *waveform.evaluate_claims(),
        *transforms.evaluate_claims(results),
        *estimates.evaluate_claims(results),
        *detection.evaluate_claims(results),
        *false_alarms.evaluate_claims(results, full=full),
        *resolution.evaluate_claims(results),
    ]
    claims_by_id = {claim.id: claim for claim in claims}
    return Certificate(
        claims=tuple(claims_by_id[name] for name in CLAIM_IDS),
        parts=extended.build_claims_beyond_report(results) if full else (),
        corrections=list_corrections_of_published_report(),
        tables=build_report_tables(claims_by_id),
        curves=build_detection_and_resolution_curves(results),
        seed=seed,
        trials=trials,
        full=full,
        date=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        versions=_library_versions(),
        machine=f"{platform.system()} {platform.machine()},"
        f" {versions_system_and_processor()['processor']}, {os.cpu_count()} cores",
        timing_s={"trials": trials_end_s - start_s, "claims": perf_counter() - trials_end_s},
    )


def _trial_jobs_of_report_claims(trials: int | None, *, full: bool) -> dict[str, Job]:
    """Return the jobs of the report's claims, each with at least the trials that it needs."""
    min_trials = trials or (FULL_TRIALS if full else 0)
    n_limit_trials = {
        window: max(min_trials, count_trials_to_prove_snr_limit(window)) for window in LIMIT_SNRS_DB
    }
    return {
        **transforms.map_noise_trial_jobs(),
        **shared_trials.error_and_snr_limit_trial_jobs(
            max(min_trials, estimates.count_trials_to_prove_rmse()), n_limit_trials
        ),
        **detection.report_rule_trial_jobs(min_trials),
        **(detection.required_snr_trial_jobs() if full else {}),
        **estimates.target_motion_trial_jobs(min_trials),
        **false_alarms.noise_and_target_frame_jobs(full=full),
        **resolution.resolution_trial_jobs(min_trials),
    }


def _library_versions() -> dict[str, str]:
    versions = {"python": platform.python_version()}
    for name in ("dechirp", *_LIBRARIES):
        try:
            versions[name] = version(name)
        except PackageNotFoundError:  # imported from a folder, not installed
            continue
    return versions
