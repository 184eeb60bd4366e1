"""Claims on detection in noise: at -24 dB, and the lowest SNR."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from dechirp.certificate import published
from dechirp.certificate.claim import Check, Claim, proportion_check
from dechirp.certificate.reference_trials import (
    REFERENCE_TARGET,
    TrialCondition,
    complex_white_noise,
    reference_echo_zero_before_arrival,
    run_target_trials,
    trial_column,
    window_label,
)
from dechirp.certificate.sensitivity import (
    DETECTION_PROBABILITY,
    REQUIRED_SNR_DB,
    chain_required_snr,
    fit_snr_limit,
    report_rule_curve,
    report_rule_required_snr,
    report_threshold,
    theoretical_curve,
)
from dechirp.certificate.shared_trials import error_trials_by_snr, snr_limit_trials_by_window
from dechirp.certificate.trials import Job, count_trials_to_prove_probability
from dechirp.core.units import from_decibels, to_decibels
from dechirp.theory.windows import Window

REPORT_SNRS_DB = (-25.0, -24.75, -24.5, -24.25, -24.0, -23.75)


def report_rule_trial_jobs(min_trials: int) -> dict[str, Job]:
    """Return the jobs that run the report's rule, with at least `min_trials` trials each."""
    n_decision_trials = count_trials_to_prove_probability(1.0, at_least=DETECTION_PROBABILITY)
    return {
        "report": Job(
            work=run_report_rule_trials,
            n_trials=max(min_trials, 50 * len(REPORT_SNRS_DB)),
            arguments={"snr_db": REPORT_SNRS_DB},
        ),
        "report at its limit": Job(
            work=run_report_rule_trials,
            n_trials=max(min_trials, n_decision_trials),
            arguments={"snr_db": (published.LOWEST_SNR_DB,)},
        ),
    }


def required_snr_trial_jobs() -> dict[str, Job]:
    """Return the job that observes the reference target at the required SNR of each window."""
    n_trials = {
        window: count_trials_to_prove_probability(
            float(theoretical_curve(window)(np.array(snr_db))), at_least=DETECTION_PROBABILITY
        )
        for window, snr_db in REQUIRED_SNR_DB.items()
    }
    return {
        _required_snr_job_name(window): Job(
            work=run_target_trials,
            n_trials=n_trials[window],
            arguments={
                **REFERENCE_TARGET._asdict(),
                "conditions": (TrialCondition(window=window, snr_db=(snr_db,)),),
            },
        )
        for window, snr_db in REQUIRED_SNR_DB.items()
    }


def _required_snr_job_name(window: Window) -> str:
    return f"reference target at the required SNR, {window}"


def run_report_rule_trials(
    rng: np.random.Generator, n_trials: int, *, snr_db: tuple[float, ...]
) -> np.ndarray:
    """Apply the report's rule to the reference target in noise; columns (n_trials, 2).

    The columns are the SNR in dB and the hit (0 or 1). As in the report, samples before the echo
    arrives contain only noise, and the SNR refers to the mean power of all samples. A hit is a
    strongest detection within 2 m and 5 m/s of the target, four and two cells.
    """
    samples = reference_echo_zero_before_arrival()
    trials = np.empty((n_trials, 2))
    for trial in range(n_trials):
        level_db = snr_db[trial % len(snr_db)]
        frame = np.float32(np.sqrt(from_decibels(level_db))) * samples
        frame += complex_white_noise(rng, samples.shape)
        range_m, velocity = published.find_strongest_report_rule_detection(frame)
        is_hit = (
            abs(range_m - REFERENCE_TARGET.range_m) < 2.0
            and abs(velocity - REFERENCE_TARGET.velocity_m_per_s) < 5.0
        )
        trials[trial] = level_db, is_hit
    return trials


def evaluate_claims(results: Mapping[str, np.ndarray]) -> tuple[Claim, ...]:
    """Return the claims on detection."""
    return _detected_at_minus_24_db_claim(results), _snr_limit_meets_requirement_claim(results)


def _detected_at_minus_24_db_claim(results: Mapping[str, np.ndarray]) -> Claim:
    chain_hits = trial_column(error_trials_by_snr(results)[published.LOWEST_SNR_DB], "hit")
    report_hits = results["report at its limit"][:, 1]
    check = proportion_check(
        "detected by the chain",
        chain_hits,
        at_least=DETECTION_PROBABILITY,
        limit=float(theoretical_curve("hann")(np.array(published.LOWEST_SNR_DB))),
    )
    return Claim(
        id="detection_at_minus24db",
        claim="The car is detected at an SNR of -24 dB per sample.",
        checks=(
            replace(check, published="detected"),
            Check(
                name="detected by the report's rule, for comparison",
                unit="1",
                measured=float(report_hits.mean()),
                limit=float(report_rule_curve()(np.array(published.LOWEST_SNR_DB))),
                trials=report_hits.size,
            ),
        ),
        note=f"The report's rule, whose SNR limit this is, detects it in {report_hits.mean():.0%}"
        " of"
        f" the frames, the chain in {chain_hits.mean():.0%}.",
    )


def _snr_limit_meets_requirement_claim(results: Mapping[str, np.ndarray]) -> Claim:
    checks: list[Check] = []
    for window, trials in snr_limit_trials_by_window(results).items():
        limit_fit = fit_snr_limit(trials, theoretical_curve(window))
        checks.append(
            Check(
                name=window_label(window),
                unit="dB",
                published=published.LOWEST_SNR_DB if not checks else None,
                measured=limit_fit.limit_db,
                low=limit_fit.low_db,
                high=limit_fit.high_db,
                at_most=REQUIRED_SNR_DB[window],
                limit=limit_fit.theory_db,
                trials=limit_fit.trials,
            )
        )
    report_fit = fit_snr_limit(results["report"], report_rule_curve())
    checks.append(
        Check(
            name="the report's rule, for comparison",
            unit="dB",
            measured=report_fit.limit_db,
            low=report_fit.low_db,
            high=report_fit.high_db,
            limit=report_fit.theory_db,
            trials=report_fit.trials,
        )
    )
    checks += [
        proportion_check(
            f"detection probability observed at {snr_db:g} dB, {window_label(window)}",
            trial_column(results[_required_snr_job_name(window)][:, 0], "hit"),
            at_least=DETECTION_PROBABILITY,
            limit=float(theoretical_curve(window)(np.array(snr_db))),
        )
        for window, snr_db in REQUIRED_SNR_DB.items()
        if _required_snr_job_name(window) in results
    ]
    snr_ratio = report_rule_required_snr() / chain_required_snr()
    return Claim(
        id="snr_limit",
        claim="The SNR limit for a detection probability of 0.9 meets the requirement.",
        checks=tuple(checks),
        note="The report's rule uses amplitudes as powers: 15 dB above the mean amplitude is"
        f" {float(to_decibels(report_threshold())):.1f} dB above the mean power, so the rule needs"
        f" {float(to_decibels(snr_ratio)):.1f} dB more SNR than a false-alarm probability of 1e-6"
        " requires.",
    )
