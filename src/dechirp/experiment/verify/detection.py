"""Claims on detection in noise: at -24 dB, and down to where."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from dechirp.core.units import decibels, from_decibels
from dechirp.core.values import value
from dechirp.experiment.verify import published
from dechirp.experiment.verify.claim import Check, Claim
from dechirp.experiment.verify.estimates import (
    ERROR_SNRS_DB,
    REFERENCE,
    column,
    share,
    true_place,
)
from dechirp.experiment.verify.looks import Look, echo, look_at_target, named, radar, white_noise
from dechirp.experiment.verify.trials import Job, Z, trials_for_probability
from dechirp.process.chain import Chain
from dechirp.process.spectrum import Transform
from dechirp.theory.cfar import cell_averaging_factor
from dechirp.theory.cfar_detection import cell_averaging_detection_probability
from dechirp.theory.detection import exceedance_probability
from dechirp.theory.windows import Window

DETECTION_PROBABILITY = 0.9
BARS_DB: dict[Window, float] = {"rectangular": -40.5, "hann": -37.0}
"""Ratio in each sample at which the reference target must still be found 9 times in 10."""
GRID_DB: dict[Window, tuple[float, ...]] = {
    "rectangular": (-42.5, -42.0, -41.5, -41.0),
    "hann": (-39.25, -38.75, -38.25, -37.75),
}
"""Ratios in each sample at which the curve is measured: down from the limit it is steepest."""
REPORT_GRID_DB = (-25.0, -24.75, -24.5, -24.25, -24.0, -23.75)
MOST_SHIFT_DB = 1.0
"""Between the curve of theory and what is measured, at which the fit gives up."""

Curve = Callable[[np.ndarray], np.ndarray]


def jobs(n_errors: int, n_trials: int) -> dict[str, Job]:
    """Trials of the reference target: so many for errors, and at least so many for the rest.

    Noise takes half the time of a look, so the first trials are looked at for several claims
    at once. What each rests on are independent trials all the same.
    """
    limits = [Look(window=window, snr_db=GRID_DB[window]) for window in GRID_DB]
    errors = [Look(window="hann", snr_db=(snr_db,)) for snr_db in ERROR_SNRS_DB]
    for_limit = {window: max(n_trials, trials_for_limit(window)) for window in GRID_DB}
    n_first = max(n_errors, for_limit["hann"])
    n_more = max(for_limit["rectangular"] - n_first, 0)
    told = REFERENCE._asdict()
    for_share = max(n_trials, trials_for_probability(1.0, at_least=DETECTION_PROBABILITY))
    made = {
        "reference target": Job(
            work=look_at_target, n_trials=n_first, told={**told, "looks": (*errors, *limits)}
        ),
        "report": Job(
            work=report_in_noise,
            n_trials=max(n_trials, 50 * len(REPORT_GRID_DB)),
            told={"snr_db": REPORT_GRID_DB},
        ),
        "report at its limit": Job(
            work=report_in_noise, n_trials=for_share, told={"snr_db": (published.LOWEST_SNR_DB,)}
        ),
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


def report_in_noise(
    rng: np.random.Generator, n_trials: int, *, snr_db: tuple[float, ...]
) -> np.ndarray:
    """What the report's detector makes of the reference target, (n_trials, 4).

    Columns: ratio in dB, whether the target was found, range and velocity. As in the report,
    samples before the echo arrives hold noise alone, the ratio is that of the mean power
    of all samples, and found means any cell within two of the target's.
    """
    samples = late_echo()
    out = np.full((n_trials, 4), np.nan)
    for trial in range(n_trials):
        at_db = snr_db[trial % len(snr_db)]
        noisy = np.float32(np.sqrt(from_decibels(at_db))) * samples
        noisy += white_noise(rng, samples.shape)
        range_m, velocity = published.strongest(noisy)
        near = abs(range_m - 50.0) < 2.0 and abs(velocity - 10.0) < 5.0
        out[trial] = at_db, near, range_m, velocity
    return out


@cache
def late_echo() -> np.ndarray:
    """Echo of the reference target from its arrival on, of unit mean power, (chirp, 1, sample)."""
    samples = np.array(echo(*REFERENCE).values[0])
    delay_s = 2 * REFERENCE.range_m / 299_792_458.0
    samples[..., : round(delay_s * radar().frame.chirp.sample_rate_hz)] = 0
    return np.asarray(samples / np.float32(np.sqrt(np.mean(abs(samples) ** 2))))


@value
class Fit:
    """Where a measured curve reaches 0.9, and where that of theory does."""

    limit_db: float
    low_db: float
    high_db: float
    theory_db: float
    trials: int


def fit(trials: np.ndarray, curve: Curve) -> Fit:
    """Shift of the curve of theory, in dB, that makes the hits likeliest.

    `trials` (n, 2): ratio in dB, and hit or not. The interval follows from the Fisher
    information of the shift, sum (dPd/ds)^2 / (Pd (1 - Pd)) over the trials.
    """
    snr_db, which = np.unique(trials[:, 0], return_inverse=True)
    n_trials, n_hits = np.bincount(which), np.bincount(which, trials[:, 1])

    def unlikely(shift_db: float) -> float:
        p = _inside(curve(snr_db - shift_db))
        return -float(np.sum(n_hits * np.log(p) + (n_trials - n_hits) * np.log1p(-p)))

    shift_db = float(
        minimize_scalar(unlikely, bounds=(-MOST_SHIFT_DB, MOST_SHIFT_DB), method="bounded").x
    )
    information = float(np.sum(n_trials * _information(curve, snr_db - shift_db)))
    half_db = Z / np.sqrt(information)
    theory_db = limit_of_theory_db(curve)
    return Fit(
        limit_db=theory_db + shift_db,
        low_db=float(theory_db + shift_db - half_db),
        high_db=float(theory_db + shift_db + half_db),
        theory_db=theory_db,
        trials=len(trials),
    )


def limit_of_theory_db(curve: Curve) -> float:
    """Ratio in each sample at which the curve reaches 0.9."""
    return float(brentq(lambda s: float(curve(np.array(s))) - DETECTION_PROBABILITY, -60.0, 0.0))


def trials_for_limit(window: Window) -> int:
    """Trials, over the grid in turn, that show the limit to be below its bar."""
    curve = curve_of_theory(window)
    margin_db = BARS_DB[window] - limit_of_theory_db(curve)
    information = np.mean(_information(curve, np.array(GRID_DB[window])))
    return int(np.ceil((2 * Z / margin_db) ** 2 / information))


def _information(curve: Curve, snr_db: np.ndarray) -> np.ndarray:
    """Fisher information of one trial on a shift of the curve, 1 / dB^2."""
    p = _inside(curve(snr_db))
    slope = (curve(snr_db + 0.01) - curve(snr_db - 0.01)) / 0.02
    return slope**2 / (p * (1 - p))


def _inside(probability: np.ndarray) -> np.ndarray:
    """Kept off 0 and 1, where a logarithm has no value."""
    return np.clip(probability, 1e-12, 1 - 1e-12)


def in_map(over_range: Transform, over_velocity: Transform) -> float:
    """Ratio of the reference target in its cell of the map over that in one sample."""
    at, frame = true_place(REFERENCE), radar().frame
    chirp = frame.chirp
    beat_m = at.range_m + chirp.range_doppler_coupling_m(at.velocity_m_per_s)
    fast = chirp.beat_frequency_hz(beat_m) / chirp.sample_rate_hz
    slow = 2 * at.velocity_m_per_s / chirp.wavelength_m * frame.interval_s
    losses = over_range.noise_bandwidth_bins * over_velocity.noise_bandwidth_bins
    straddle = over_range.straddle(fast) * over_velocity.straddle(slow)
    return radar().integration_gain / losses * straddle


def curve_of_theory(window: Window) -> Curve:
    """Probability that the cell of the reference target is detected, over its ratio in dB.

    Cell averaging over as many independent cells as the correlated ones of the ring are
    worth, N^2 / sum |rho|^2: 644 under a rectangular window, about 170 under Hann.
    """
    chain = Chain(range_window=window, doppler_window=window)
    noise, ring = chain.noise(radar()), chain.cfar.ring
    box = ring.box(noise, ring.half_range)
    training = np.ones((len(box.range_covariance), len(box.velocity_covariance)), bool)
    training[box.guard_range, box.guard_velocity] = False
    weight = abs(np.kron(box.range_covariance, box.velocity_covariance)) ** 2
    among = training.ravel()
    n_training = round(among.sum() ** 2 / weight[np.ix_(among, among)].sum())
    assert chain.cfar.false_alarm_probability is not None
    factor = cell_averaging_factor(chain.cfar.false_alarm_probability, n_training=n_training)
    gain = in_map(noise.over_range, noise.over_velocity)
    return lambda snr_db: cell_averaging_detection_probability(
        from_decibels(snr_db) * gain, factor, n_training=n_training
    )


def report_threshold() -> float:
    """Threshold of the report's rule over the mean noise power, a ratio of powers: 785.

    The mean amplitude of noise is sqrt(pi / 4) of the root of its mean power, and the rule
    multiplies it by 31.6.
    """
    return float(from_decibels(published.OFFSET_DB)) ** 2 * np.pi / 4


def report_curve() -> Curve:
    """Probability that the report's rule finds the target, without leakage into its ring."""
    over = (
        Transform(window="rectangular", n_points=2200, n_bins=4096),
        Transform(window="rectangular", n_points=128, n_bins=128),
    )
    # Of 2,200 samples the first 100 are blank, and the ratio is taken over all.
    echoed = np.count_nonzero(late_echo()[0, 0]) / late_echo().shape[-1]
    gain = in_map(*over) * echoed
    return lambda snr_db: exceedance_probability(from_decibels(snr_db) * gain, report_threshold())


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
    theirs = results["report"]
    report = fit(theirs[:, :2], report_curve())
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


def needed_in_map() -> float:
    """Ratio in a cell that the chain needs, rectangular windows, Pd 0.9 at Pfa 1e-6."""
    factor = cell_averaging_factor(1e-6, n_training=644)
    return _needed(lambda snr: cell_averaging_detection_probability(snr, factor, n_training=644))


def needed_by_report() -> float:
    """Ratio in a cell that the report's rule needs for the same probability of detection."""
    return _needed(lambda snr: exceedance_probability(snr, report_threshold()))


def _needed(probability: Curve) -> float:
    def excess(snr_db: float) -> float:
        return float(probability(from_decibels(np.array(snr_db)))) - DETECTION_PROBABILITY

    return float(from_decibels(brentq(excess, 0.0, 50.0)))
