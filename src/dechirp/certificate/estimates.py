"""Claims on the estimates of range and velocity: bias, RMSE and sign of the velocity."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Literal

import numpy as np

from dechirp.certificate import published
from dechirp.certificate.claim import CONFIDENCE, Check, Claim, proportion_check
from dechirp.certificate.reference_trials import (
    QUIET_SNR_DB,
    RCS_M2,
    REFERENCE_TARGET,
    TargetMotion,
    TrialCondition,
    motion_at_mid_frame,
    reference_radar,
    run_target_trials,
    trial_column,
)
from dechirp.certificate.shared_trials import ERROR_SNRS_DB, error_trials_by_snr
from dechirp.certificate.trials import (
    Job,
    count_trials_to_prove_mean,
    count_trials_to_prove_probability,
    count_trials_to_prove_rms,
)
from dechirp.core.units import from_decibels, to_decibels
from dechirp.radar.budget import sample_snr
from dechirp.radar.estimation_bounds import range_and_velocity_crlb_std
from dechirp.theory import confidence_intervals

MAX_RMSE_RATIO = 1.15
"""Largest permitted RMSE over the Cramér-Rao bound."""
MAX_BIAS_RATIO = 0.3
"""Largest permitted bias over the Cramér-Rao bound."""
MIN_SIGN_PROPORTION = 0.95
"""Required proportion of trials with the correct sign of the velocity; all have it."""
MIN_CORNER_PROPORTION = 0.9
"""Required detection probability at largest range and velocity; it is at least 0.998."""
EXPECTED_RMSE_RATIO = 1.01
"""Expected RMSE of the chain over the Cramér-Rao bound, for the trial counts."""


_ERROR_COLUMNS = ("range_error_m", "velocity_error_m_per_s")
_MOTIONS = {
    "at rest": TargetMotion(100.0, 0.0),
    "receding": REFERENCE_TARGET,
    "approaching": TargetMotion(50.0, -10.0),
    "corner, receding": TargetMotion(200.0, 100.0),
    "corner, approaching": TargetMotion(200.0, -100.0),
}


def target_motion_trial_jobs(min_trials: int) -> dict[str, Job]:
    """Return the jobs of targets at other ranges and velocities, with `min_trials` or more each."""
    n_bias_trials = count_trials_to_prove_mean(EXPECTED_RMSE_RATIO, tolerance=MAX_BIAS_RATIO)
    n_sign_trials = count_trials_to_prove_probability(1.0, at_least=MIN_SIGN_PROPORTION)
    n_corner_trials = count_trials_to_prove_probability(0.998, at_least=MIN_CORNER_PROPORTION)
    counts = {"at rest": n_bias_trials, "receding": n_sign_trials, "approaching": n_sign_trials}
    return {
        name: Job(
            work=run_target_trials,
            n_trials=max(min_trials, counts.get(name, n_corner_trials)),
            arguments={
                **start._asdict(),
                "conditions": (TrialCondition(window="hann", snr_db=(_snr_db_of_job(name),)),),
            },
        )
        for name, start in _MOTIONS.items()
    }


def _snr_db_of_job(job_name: str) -> float:
    """Return the SNR per sample: -10 dB, or at the largest range that in thermal noise."""
    if not job_name.startswith("corner"):
        return QUIET_SNR_DB
    return float(
        to_decibels(sample_snr(reference_radar(), range_m=published.MAX_RANGE_M, rcs_m2=RCS_M2))
    )


def count_trials_to_prove_rmse() -> int:
    """Return the number of trials that prove the RMSE to meet the requirement."""
    return count_trials_to_prove_rms(EXPECTED_RMSE_RATIO, at_most=MAX_RMSE_RATIO)


def evaluate_claims(results: Mapping[str, np.ndarray]) -> tuple[Claim, ...]:
    """Return the claims on estimates."""
    errors = error_trials_by_snr(results)
    trials = {name: results[name][:, 0] for name in _MOTIONS}
    return (
        _stationary_target_unbiased_claim(trials["at rest"]),
        _moving_target_unbiased_claim(errors[QUIET_SNR_DB]),
        _detected_at_max_range_and_velocity_claim(
            trials["corner, receding"], trials["corner, approaching"]
        ),
        _velocity_sign_is_right_claim(trials["receding"], trials["approaching"]),
        _rmse_near_cramer_rao_bound_claim("range", errors),
        _rmse_near_cramer_rao_bound_claim("velocity", errors),
    )


def range_velocity_cramer_rao_bounds(snr_db: float) -> TargetMotion:
    """Return the Cramér-Rao bounds of range and velocity for an SNR per sample."""
    snr = from_decibels(snr_db) * reference_radar().integration_gain
    range_std, velocity_std = range_and_velocity_crlb_std(reference_radar().frame, snr=snr)
    return TargetMotion(float(range_std), float(velocity_std))


def _error_interval_or_nan_if_undetected(
    interval_function: Callable[..., tuple[float, float]], errors: np.ndarray
) -> tuple[float, float]:
    """Return the interval of errors; NaN if a trial has no detection and therefore no error."""
    if not np.isfinite(errors).all():
        return float("nan"), float("nan")
    return interval_function(errors, confidence=CONFIDENCE)


def _mean_range_and_velocity_checks(
    trials: np.ndarray, start: TargetMotion, published_values: tuple[float | None, float | None]
) -> tuple[Check, ...]:
    """Return checks of mean range and mean velocity at -10 dB against the truth."""
    expected, bound = motion_at_mid_frame(start), range_velocity_cramer_rao_bounds(QUIET_SNR_DB)
    checks = []
    for index, (name, unit) in enumerate((("range", "m"), ("velocity", "m/s"))):
        errors = trial_column(trials, _ERROR_COLUMNS[index])
        low, high = _error_interval_or_nan_if_undetected(confidence_intervals.mean_interval, errors)
        checks.append(
            Check(
                name=f"mean {name} at {QUIET_SNR_DB:g} dB",
                unit=unit,
                published=published_values[index],
                measured=expected[index] + float(np.mean(errors)),
                low=expected[index] + low,
                high=expected[index] + high,
                at_least=expected[index] - MAX_BIAS_RATIO * bound[index],
                at_most=expected[index] + MAX_BIAS_RATIO * bound[index],
                limit=expected[index],
                trials=errors.size,
            )
        )
    return tuple(checks)


def _stationary_target_unbiased_claim(trials: np.ndarray) -> Claim:
    return Claim(
        id="range_stationary_100m",
        claim="A stationary target at 100 m is measured at 100 m and 0 m/s.",
        checks=_mean_range_and_velocity_checks(trials, _MOTIONS["at rest"], (100.0, None)),
        note=f"Required: a bias of at most {MAX_BIAS_RATIO:g} times the Cramér-Rao bound.",
    )


def _moving_target_unbiased_claim(trials: np.ndarray) -> Claim:
    return Claim(
        id="range_doppler_peak",
        claim="The peak of the map gives the range and velocity of the car at 50 m and 10 m/s.",
        checks=_mean_range_and_velocity_checks(
            trials, REFERENCE_TARGET, (published.RANGE_M, published.VELOCITY_M_PER_S)
        ),
        note=f"Required: a bias of at most {MAX_BIAS_RATIO:g} times the Cramér-Rao bound. Truth and"
        " estimates refer to mid-frame.",
    )


def _detected_at_max_range_and_velocity_claim(
    receding: np.ndarray, approaching: np.ndarray
) -> Claim:
    frame = reference_radar().frame
    return Claim(
        id="corner_200m_100mps",
        claim="The car is detected at the largest required range and velocity.",
        checks=(
            proportion_check(
                "detected at 200 m, 100 m/s",
                trial_column(receding, "hit"),
                at_least=MIN_CORNER_PROPORTION,
            ),
            proportion_check(
                "detected at 200 m, -100 m/s",
                trial_column(approaching, "hit"),
                at_least=MIN_CORNER_PROPORTION,
            ),
            Check(
                name="unambiguous range, by design",
                unit="m",
                measured=frame.chirp.max_range_m,
                at_least=published.MAX_RANGE_M,
            ),
            Check(
                name="unambiguous velocity of either sign, by design",
                unit="m/s",
                measured=frame.max_velocity_m_per_s,
                at_least=published.MAX_VELOCITY_M_PER_S,
            ),
        ),
        note="Not tested in the report. Measured in thermal noise, at an SNR of"
        f" {_snr_db_of_job('corner'):.1f} dB per sample. A detection counts within one resolution"
        " cell on both axes.",
    )


def _velocity_sign_is_right_claim(receding: np.ndarray, approaching: np.ndarray) -> Claim:
    checks = []
    for name, trials in (("receding", receding), ("approaching", approaching)):
        true_velocity = motion_at_mid_frame(_MOTIONS[name]).velocity_m_per_s
        estimated = true_velocity + trial_column(trials, "velocity_error_m_per_s")
        checks.append(
            proportion_check(
                f"sign right, {name}",
                (estimated * true_velocity > 0).astype(float),
                at_least=MIN_SIGN_PROPORTION,
            )
        )
    return Claim(
        id="direction_of_motion",
        claim="The sign of the velocity gives the direction of motion: receding is positive.",
        checks=(replace(checks[0], published="approaching is positive"), checks[1]),
        note="At ±10 m/s and -10 dB. The report defines approaching as positive, which its own"
        " signals contradict.",
    )


def _rmse_near_cramer_rao_bound_claim(
    variable: Literal["range", "velocity"], errors: Mapping[float, np.ndarray]
) -> Claim:
    index = ("range", "velocity").index(variable)
    published_error = (published.RANGE_ERROR_M, published.VELOCITY_ERROR_M_PER_S)[index]
    checks = []
    for snr_db in ERROR_SNRS_DB:
        component_errors = trial_column(errors[snr_db], _ERROR_COLUMNS[index])
        bound = range_velocity_cramer_rao_bounds(snr_db)[index]
        low, high = _error_interval_or_nan_if_undetected(
            confidence_intervals.rms_interval, component_errors
        )
        checks.append(
            Check(
                name=f"RMSE at {snr_db:g} dB",
                unit=("m", "m/s")[index],
                published=published_error if snr_db == published.LOWEST_SNR_DB else None,
                measured=float(np.sqrt(np.mean(component_errors**2))),
                low=low,
                high=high,
                at_most=MAX_RMSE_RATIO * bound,
                limit=bound,
                trials=component_errors.size,
            )
        )
    axis_step = np.diff(published.report_range_and_velocity_axes()[index])[0]
    return Claim(
        id=f"{variable}_rmse",
        claim=f"The RMSE of {variable} is within 15 % of the Cramér-Rao bound.",
        checks=tuple(checks),
        note=f"The step of the report's axis is {axis_step:.3f} {('m', 'm/s')[index]} without"
        " interpolation. Its published error "
        + (
            "is the distance from the nearest cell."
            if index == 0
            else "does not follow from its axes."
        ),
    )
