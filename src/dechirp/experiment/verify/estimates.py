"""Claims on where the target is found, and how far off: range, velocity and its sign."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Literal

import numpy as np

from dechirp.core.units import decibels, from_decibels
from dechirp.experiment.verify import published
from dechirp.experiment.verify.claim import CONFIDENCE, Check, Claim, share
from dechirp.experiment.verify.looks import (
    QUIET_SNR_DB,
    RCS_M2,
    REFERENCE,
    Look,
    Motion,
    at_mid_frame,
    column,
    look_at_target,
    radar,
)
from dechirp.experiment.verify.reference_target import ERROR_SNRS_DB, by_snr
from dechirp.experiment.verify.trials import (
    Job,
    trials_for_mean,
    trials_for_probability,
    trials_for_rms,
)
from dechirp.radar.accuracy import standard_errors
from dechirp.radar.budget import snr as sample_snr
from dechirp.theory import intervals

MOST_OF_BOUND = 1.15
"""Root-mean-square error over the Cramer-Rao bound that is required."""
MOST_BIAS = 0.3
"""Mean error over the bound that is required."""
LEAST_RIGHT = 0.95
"""Share of trials that must give the sign of the velocity; all do."""
LEAST_FOUND = 0.9
"""Share of trials that must find the target in the corner; 998 in 1,000 or more do."""
SPREAD = 1.01
"""Root-mean-square error over the bound that the chain reaches, for the trial counts."""


_ERRORS = ("range_error_m", "velocity_error_m_per_s")
_MOTIONS = {
    "at rest": Motion(100.0, 0.0),
    "receding": REFERENCE,
    "approaching": Motion(50.0, -10.0),
    "corner, receding": Motion(200.0, 100.0),
    "corner, approaching": Motion(200.0, -100.0),
}


def jobs(n_trials: int) -> dict[str, Job]:
    """Trials of targets elsewhere than in the reference scenario, at least so many each."""
    for_bias = trials_for_mean(SPREAD, within=MOST_BIAS)
    for_sign = trials_for_probability(1.0, at_least=LEAST_RIGHT)
    for_corner = trials_for_probability(0.998, at_least=LEAST_FOUND)
    counts = {"at rest": for_bias, "receding": for_sign, "approaching": for_sign}
    return {
        name: Job(
            work=look_at_target,
            n_trials=max(n_trials, counts.get(name, for_corner)),
            told={
                **place._asdict(),
                "looks": (Look(window="hann", snr_db=(_snr_db(name),)),),
            },
        )
        for name, place in _MOTIONS.items()
    }


def _snr_db(name: str) -> float:
    """Ratio in each sample: -10 dB; in the corner, that of the car in the receiver's own noise."""
    if not name.startswith("corner"):
        return QUIET_SNR_DB
    return float(decibels(sample_snr(radar(), range_m=published.MAX_RANGE_M, rcs_m2=RCS_M2)))


def trials_for_errors() -> int:
    """Looks at the reference target that show its errors to be small enough."""
    return trials_for_rms(SPREAD, at_most=MOST_OF_BOUND)


def claims(results: Mapping[str, np.ndarray]) -> tuple[Claim, ...]:
    """The claims of this file."""
    errors = by_snr(results)
    looks = {name: results[name][:, 0] for name in _MOTIONS}
    return (
        _stationary(looks["at rest"]),
        _peak(errors[QUIET_SNR_DB]),
        _corner(looks["corner, receding"], looks["corner, approaching"]),
        _direction(looks["receding"], looks["approaching"]),
        _rmse("range", errors),
        _rmse("velocity", errors),
    )


def bounds(snr_db: float) -> Motion:
    """Cramer-Rao bounds of range and velocity at a ratio in each sample."""
    snr = from_decibels(snr_db) * radar().integration_gain
    range_std, velocity_std = standard_errors(radar().frame, snr=snr)
    return Motion(float(range_std), float(velocity_std))


def _interval(of: Callable[..., tuple[float, float]], errors: np.ndarray) -> tuple[float, float]:
    """Interval of errors; none where a trial missed the target, and has no error."""
    if not np.isfinite(errors).all():
        return float("nan"), float("nan")
    return of(errors, confidence=CONFIDENCE)


def _means(
    looks: np.ndarray, place: Motion, said: tuple[float | None, float | None]
) -> tuple[Check, ...]:
    """Checks of the means of range and velocity at -10 dB against the truth."""
    right, bound = at_mid_frame(place), bounds(QUIET_SNR_DB)
    checks = []
    for index, (name, unit) in enumerate((("range", "m"), ("velocity", "m/s"))):
        off = column(looks, _ERRORS[index])
        low, high = _interval(intervals.mean, off)
        checks.append(
            Check(
                name=f"mean {name} at {QUIET_SNR_DB:g} dB",
                unit=unit,
                published=said[index],
                measured=right[index] + float(np.mean(off)),
                low=right[index] + low,
                high=right[index] + high,
                at_least=right[index] - MOST_BIAS * bound[index],
                at_most=right[index] + MOST_BIAS * bound[index],
                limit=right[index],
                trials=off.size,
            )
        )
    return tuple(checks)


def _stationary(looks: np.ndarray) -> Claim:
    return Claim(
        id="range_stationary_100m",
        claim="A target at rest at 100 m is found at 100 m, and at rest.",
        checks=_means(looks, _MOTIONS["at rest"], (100.0, None)),
        note=f"Required: a bias of at most {MOST_BIAS:g} of the Cramér-Rao bound.",
    )


def _peak(looks: np.ndarray) -> Claim:
    return Claim(
        id="range_doppler_peak",
        claim="The peak of the map gives range and velocity of the car at 50 m and 10 m/s.",
        checks=_means(looks, REFERENCE, (published.RANGE_M, published.VELOCITY_M_PER_S)),
        note=f"Required: a bias of at most {MOST_BIAS:g} of the Cramér-Rao bound. Truth and"
        " estimates are those of mid-frame.",
    )


def _corner(receding: np.ndarray, approaching: np.ndarray) -> Claim:
    frame = radar().frame
    return Claim(
        id="corner_200m_100mps",
        claim="The car is found at the largest range and velocity that the requirements name.",
        checks=(
            share("found at 200 m, 100 m/s", column(receding, "hit"), at_least=LEAST_FOUND),
            share("found at 200 m, -100 m/s", column(approaching, "hit"), at_least=LEAST_FOUND),
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
        note="The report never tested it. In the receiver's own noise, within one resolution"
        f" cell on both axes; {_snr_db('corner'):.1f} dB in each sample.",
    )


def _direction(receding: np.ndarray, approaching: np.ndarray) -> Claim:
    right = []
    for name, looks in (("receding", receding), ("approaching", approaching)):
        true = at_mid_frame(_MOTIONS[name]).velocity_m_per_s
        estimated = true + column(looks, "velocity_error_m_per_s")
        right.append(
            share(f"sign right, {name}", (estimated * true > 0).astype(float), at_least=LEAST_RIGHT)
        )
    return Claim(
        id="direction_of_motion",
        claim="The sign of the velocity tells the direction of motion: receding is positive.",
        checks=(replace(right[0], published="approaching is positive"), right[1]),
        note="At 10 m/s either way and -10 dB. The report calls approaching positive, which its"
        " own signals contradict.",
    )


def _rmse(variable: Literal["range", "velocity"], errors: Mapping[float, np.ndarray]) -> Claim:
    index = ("range", "velocity").index(variable)
    said = (published.RANGE_ERROR_M, published.VELOCITY_ERROR_M_PER_S)[index]
    checks = []
    for snr_db in ERROR_SNRS_DB:
        off = column(errors[snr_db], _ERRORS[index])
        bound = bounds(snr_db)[index]
        low, high = _interval(intervals.rms, off)
        checks.append(
            Check(
                name=f"root-mean-square error at {snr_db:g} dB",
                unit=("m", "m/s")[index],
                published=said if snr_db == published.LOWEST_SNR_DB else None,
                measured=float(np.sqrt(np.mean(off**2))),
                low=low,
                high=high,
                at_most=MOST_OF_BOUND * bound,
                limit=bound,
                trials=off.size,
            )
        )
    step = np.diff(published.axes_m_and_m_per_s()[index])[0]
    return Claim(
        id=f"{variable}_rmse",
        claim=f"Errors of {variable} come within 15 % of the Cramér-Rao bound.",
        checks=tuple(checks),
        note=f"The axis of the report steps {step:.3f} {('m', 'm/s')[index]} and nothing is"
        " interpolated: its error "
        + ("is where a cell happens to lie." if index == 0 else "does not follow from its axes."),
    )
