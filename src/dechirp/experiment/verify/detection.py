"""Claims on detection in noise: at -24 dB, and down to where."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from dechirp.core.units import decibels, from_decibels
from dechirp.experiment.verify import published
from dechirp.experiment.verify.claim import Check, Claim, share
from dechirp.experiment.verify.looks import REFERENCE, column, late_echo, named, white_noise
from dechirp.experiment.verify.reference_target import by_snr, by_window
from dechirp.experiment.verify.sensitivity import (
    BARS_DB,
    DETECTION_PROBABILITY,
    curve_of_theory,
    fit,
    needed_by_report,
    needed_in_map,
    report_curve,
    report_threshold,
)
from dechirp.experiment.verify.trials import Job, trials_for_probability

REPORT_GRID_DB = (-25.0, -24.75, -24.5, -24.25, -24.0, -23.75)


def jobs(n_trials: int) -> dict[str, Job]:
    """Trials of the report's rule, at least so many at each ratio."""
    for_share = trials_for_probability(1.0, at_least=DETECTION_PROBABILITY)
    return {
        "report": Job(
            work=report_in_noise,
            n_trials=max(n_trials, 50 * len(REPORT_GRID_DB)),
            told={"snr_db": REPORT_GRID_DB},
        ),
        "report at its limit": Job(
            work=report_in_noise,
            n_trials=max(n_trials, for_share),
            told={"snr_db": (published.LOWEST_SNR_DB,)},
        ),
    }


def report_in_noise(
    rng: np.random.Generator, n_trials: int, *, snr_db: tuple[float, ...]
) -> np.ndarray:
    """What the report's detector makes of the reference target, (n_trials, 2).

    Columns: ratio in dB, and whether the target was found. As in the report, samples before
    the echo arrives hold noise alone, and the ratio is that of the mean power of all samples.
    Found means that the strongest cell over threshold lies within 2 m and 5 m/s of the target,
    four and two cells.
    """
    samples = late_echo()
    out = np.empty((n_trials, 2))
    for trial in range(n_trials):
        at_db = snr_db[trial % len(snr_db)]
        noisy = np.float32(np.sqrt(from_decibels(at_db))) * samples
        noisy += white_noise(rng, samples.shape)
        range_m, velocity = published.strongest(noisy)
        near = (
            abs(range_m - REFERENCE.range_m) < 2.0
            and abs(velocity - REFERENCE.velocity_m_per_s) < 5.0
        )
        out[trial] = at_db, near
    return out


def claims(results: Mapping[str, np.ndarray]) -> tuple[Claim, ...]:
    """The claims of this file."""
    return _at_its_limit(results), _limit(results)


def _at_its_limit(results: Mapping[str, np.ndarray]) -> Claim:
    ours = column(by_snr(results)[published.LOWEST_SNR_DB], "hit")
    theirs = results["report at its limit"][:, 1]
    found = share(
        "found by the chain",
        ours,
        at_least=DETECTION_PROBABILITY,
        limit=float(curve_of_theory("hann")(np.array(published.LOWEST_SNR_DB))),
    )
    return Claim(
        id="detection_at_minus24db",
        claim="The car is found at -24 dB in each sample.",
        checks=(
            replace(found, published="found"),
            Check(
                name="found by the report's rule, for comparison",
                unit="1",
                measured=float(theirs.mean()),
                limit=float(report_curve()(np.array(published.LOWEST_SNR_DB))),
                trials=theirs.size,
            ),
        ),
        note=f"The report's rule, whose limit this is, finds it in {theirs.mean():.0%} of the"
        f" frames, the chain in {ours.mean():.0%}.",
    )


def _limit(results: Mapping[str, np.ndarray]) -> Claim:
    checks: list[Check] = []
    for window, trials in by_window(results).items():
        found = fit(trials, curve_of_theory(window))
        checks.append(
            Check(
                name=named(window),
                unit="dB",
                published=published.LOWEST_SNR_DB if not checks else None,
                measured=found.limit_db,
                low=found.low_db,
                high=found.high_db,
                at_most=BARS_DB[window],
                limit=found.theory_db,
                trials=found.trials,
            )
        )
    report = fit(results["report"], report_curve())
    checks.append(
        Check(
            name="the report's rule, for comparison",
            unit="dB",
            measured=report.limit_db,
            low=report.low_db,
            high=report.high_db,
            limit=report.theory_db,
            trials=report.trials,
        )
    )
    apart = needed_by_report() / needed_in_map()
    return Claim(
        id="snr_limit",
        claim="The lowest ratio in each sample at which the car is found 9 times in 10.",
        checks=tuple(checks),
        note=f"The report's rule takes amplitudes for powers: its 15 dB over the mean amplitude"
        f" are {float(decibels(report_threshold())):.1f} dB over the mean power, so it needs"
        f" {float(decibels(apart)):.1f} dB more than a false-alarm probability of 1e-6 asks for.",
    )
