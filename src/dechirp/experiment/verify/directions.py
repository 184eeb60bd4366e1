"""Claims on directions: errors of every estimator against the Cramer-Rao bound, and resolution.

Members of the family are discovered, each with its default options. Snapshots are those of far
sources on a line of elements in white noise: what the transforms hand to an estimator.
"""

from collections.abc import Mapping

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.core.units import from_decibels
from dechirp.experiment.verify.claim import CONFIDENCE, Check, Claim, Part, share
from dechirp.experiment.verify.trials import Job
from dechirp.process.angle.aperture import Aperture
from dechirp.process.angle.base import DirectionEstimator
from dechirp.theory import intervals
from dechirp.theory.direction_bounds import conditional_information, slopes, variances

N_TRIALS = 10_000
N_ELEMENTS = 8
SNR_DB = 20.0
"""Of each source in one element, in one look."""
WIDEST_RAD = 0.8
"""Sources lie so far to either side at most."""
BEAMWIDTH = 0.886 / (N_ELEMENTS / 2)
"""Width at half power of a uniform line, in sines."""
LEAST_OF_BOUND = 0.93
"""Root-mean-square error over the bound, at least: less would be a wrong bound.

10,000 trials have an interval of 3.1 %: half of the 7 % for it, half for chance."""
MOST_OF_OWN = 1.1
"""Root-mean-square error over what the estimator itself says of its error, either way."""
MOST_LOST = 0.1
"""Share of pairs that noise may cost of those that are resolved without it."""
APART = {"1": 1.0, "2": 2.0}
"""Separations of pairs, in beamwidths."""
_QUIET = 1e-8  # noise over a source, where it hides nothing


def line() -> Aperture:
    """Elements along y, half a wavelength apart."""
    return Aperture(positions=np.arange(N_ELEMENTS)[:, None] * [0.0, 0.5, 0.0])


def jobs(n_trials: int) -> dict[str, Job]:
    """Looks at one source and at two, for each estimator."""
    made = {}
    for kind, member in DirectionEstimator.members().items():
        made[f"one source, {kind}"] = Job(
            work=one_source, n_trials=n_trials, told={"estimator": member()}, n_each=500
        )
        if (pairs := _of_pairs(member)) is not None:
            for name, apart in APART.items():
                made[f"two sources {name} apart, {kind}"] = Job(
                    work=two_sources,
                    n_trials=n_trials,
                    told={"estimator": pairs, "apart": apart * BEAMWIDTH},
                    n_each=500,
                )
    return made


def _of_pairs(member: type) -> DirectionEstimator | None:
    """The estimator of two directions; none where it is of one alone."""
    try:
        made: DirectionEstimator = member(n_sources=2)
    except InvalidSetting:
        return None
    return made


def one_source(
    rng: np.random.Generator, n_trials: int, *, estimator: DirectionEstimator
) -> np.ndarray:
    """Error and standard error by the estimator, both over the bound, (n_trials, 2)."""
    array, noise = line(), float(from_decibels(-SNR_DB))
    azimuth = rng.uniform(-WIDEST_RAD, WIDEST_RAD, (n_trials, 1))
    amplitudes = _of_any_phase(rng, (n_trials, 1))
    snapshots = _clean(array, azimuth, amplitudes) + _noise(rng, n_trials, noise)
    found = estimator.directions(snapshots, array, np.full(n_trials, noise))
    bound = bounds_rad(array, azimuth, amplitudes, noise)
    error = found.azimuth_rad[:, :1] - azimuth
    return np.concatenate([error / bound, found.azimuth_std_rad[:, :1] / bound], axis=1)


def two_sources(
    rng: np.random.Generator, n_trials: int, *, estimator: DirectionEstimator, apart: float
) -> np.ndarray:
    """Whether both are found within half their separation, (n_trials, 2): in noise, without."""
    array, noise = line(), float(from_decibels(-SNR_DB))
    sines = rng.uniform(-0.5, 0.5, (n_trials, 1)) + apart / 2 * np.array([-1, 1])
    clean = _clean(array, np.arcsin(sines), _of_any_phase(rng, (n_trials, 2)))
    white = _noise(rng, n_trials, 1.0)
    out = np.empty((n_trials, 2))
    for column, power in enumerate((noise, _QUIET)):
        found = estimator.directions(
            clean + np.sqrt(power) * white, array, np.full(n_trials, power)
        )
        there = np.sort(np.sin(found.azimuth_rad), axis=1)[:, :2]  # NaN sorts last, and misses
        out[:, column] = np.all(abs(there - sines) < apart / 2, axis=1)
    return out


def _of_any_phase(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    return np.exp(2j * np.pi * rng.random(shape))


def _clean(array: Aperture, azimuth: np.ndarray, amplitudes: np.ndarray) -> np.ndarray:
    """Snapshots (n, 1, n_elements) of sources (n, k)."""
    steering = array.steering(azimuth, np.zeros_like(azimuth))
    return np.asarray(np.sum(amplitudes[..., None] * steering, axis=1)[:, None])


def _noise(rng: np.random.Generator, n: int, power: float) -> np.ndarray:
    parts = rng.standard_normal((n, 1, N_ELEMENTS, 2))
    return np.asarray(np.sqrt(power / 2) * (parts[..., 0] + 1j * parts[..., 1]))


def bounds_rad(
    array: Aperture, azimuth: np.ndarray, amplitudes: np.ndarray, noise_power: float
) -> np.ndarray:
    """Cramer-Rao bound of the azimuth of one source, (n, 1), in each of n looks."""
    steering = np.swapaxes(array.steering(azimuth, np.zeros_like(azimuth)), 1, 2)
    turns = slopes(azimuth, 0.0)[..., 0, :] @ array.positions.T  # (n, 1, n_elements)
    derivatives = -2j * np.pi * np.swapaxes(turns, 1, 2) * steering
    information = conditional_information(
        steering, derivatives[..., None], amplitudes[..., None], noise_power
    )
    return np.sqrt(variances(information))


def part(results: Mapping[str, np.ndarray]) -> Part:
    """The claims of this file: one for each estimator."""
    return Part(
        id="directions",
        title="Errors of every direction estimator",
        how=f"One source, and two of equal power, on a line of {N_ELEMENTS} elements half a"
        f" wavelength apart, {SNR_DB:g} dB above the noise in each element, one look, anywhere"
        f" within {np.degrees(WIDEST_RAD):.0f} degrees of broadside (pairs: 30). The bound is the"
        " conditional one of Stoica and Nehorai. An estimator that smooths or that takes"
        " differences loses some of it by design, and says so in the error that it states; what"
        " is required is that the error is what it states. Two sources count as resolved where"
        " both are found within half their separation; the theory beside that share is the same"
        " pairs without noise.",
        claims=tuple(_claim(kind, results) for kind in DirectionEstimator.members()),
    )


def _claim(kind: str, results: Mapping[str, np.ndarray]) -> Claim:
    error, own = results[f"one source, {kind}"].T
    stated = float(np.sqrt(np.mean(own**2)))
    finite = bool(np.isfinite(error).all())
    low, high = intervals.rms(error, confidence=CONFIDENCE) if finite else (np.nan, np.nan)
    checks = [
        Check(
            name="root-mean-square error over the Cramér-Rao bound",
            unit="1",
            measured=float(np.sqrt(np.mean(error**2))),
            low=low,
            high=high,
            at_least=max(LEAST_OF_BOUND, stated / MOST_OF_OWN),
            at_most=stated * MOST_OF_OWN,
            limit=stated,
            trials=error.size,
        )
    ]
    for name in APART:
        pairs = results.get(f"two sources {name} apart, {kind}")
        if pairs is not None:
            told = "a beamwidth" if name == "1" else f"{name} beamwidths"
            quiet = float(pairs[:, 1].mean())
            at_least = max(quiet - MOST_LOST, 0.0)
            checks.append(
                share(f"both found, {told} apart", pairs[:, 0], at_least=at_least, limit=quiet)
            )
    alone = "" if len(checks) > 1 else " It tells one direction alone."
    return Claim(
        id=f"directions_{kind.replace('-', '_')}",
        claim=f"The {kind} estimator errs as it says, and resolves in noise what it resolves"
        " without."
        if not alone
        else f"The {kind} estimator errs as it says.",
        checks=tuple(checks),
        note=f"Theory: the standard error that it states, over the bound.{alone}",
    )
