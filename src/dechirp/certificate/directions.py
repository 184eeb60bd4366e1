"""Claims on direction estimators: errors relative to the Cramér-Rao bound, and resolution.

All members of the estimator family are measured with their default options. The snapshots are those
of far-field sources on a uniform linear array in white noise, as the transforms provide them.
"""

from collections.abc import Mapping

import numpy as np

from dechirp.certificate.claim import CONFIDENCE, Check, Claim, Part, proportion_check
from dechirp.certificate.trials import Job
from dechirp.core.errors import InvalidSetting
from dechirp.core.units import from_decibels
from dechirp.processing.angle.aperture import Aperture
from dechirp.processing.angle.base import DirectionEstimator
from dechirp.theory import confidence_intervals
from dechirp.theory.direction_bounds import (
    conditional_fisher_information,
    crlb_variances,
    unit_vector_derivatives,
)

N_TRIALS = 10_000
N_ELEMENTS = 8
SNR_DB = 20.0
"""SNR of each source per element and snapshot."""
MAX_AZIMUTH_RAD = 0.8
"""Largest azimuth of a source to either side."""
BEAMWIDTH = 0.886 / (N_ELEMENTS / 2)
"""Half-power beamwidth of the uniform linear array, in sine of the angle."""
MIN_BOUND_RATIO = 0.93
"""Lowest permitted RMSE over the bound: a lower one would show a wrong bound.

10,000 trials have an interval of 3.1 %; the margin of 7 % is shared by interval and chance."""
MAX_STATED_RATIO = 1.1
"""Largest permitted ratio of RMSE and the standard error of the estimator, in either direction."""
MAX_RESOLUTION_LOSS = 0.1
"""Largest permitted loss of resolved pairs by noise, a proportion."""
SEPARATIONS = {"1": 1.0, "2": 2.0}
"""Separations of pairs in beamwidths, by their part of the job name."""
_NEGLIGIBLE_NOISE = 1e-8  # noise power relative to a source


def half_wavelength_linear_array() -> Aperture:
    """Return a uniform linear array along y with a spacing of half a wavelength."""
    return Aperture(positions=np.arange(N_ELEMENTS)[:, None] * [0.0, 0.5, 0.0])


def one_and_two_source_trial_jobs(n_trials: int) -> dict[str, Job]:
    """Return the jobs with one and with two sources, for each estimator."""
    jobs = {}
    for kind, member in DirectionEstimator.members().items():
        jobs[f"one source, {kind}"] = Job(
            work=run_error_over_bound_trials,
            n_trials=n_trials,
            arguments={"estimator": member()},
            block_size=500,
        )
        if (pair_estimator := _two_source_estimator_or_none(member)) is not None:
            for name, separation in SEPARATIONS.items():
                jobs[f"two sources {name} apart, {kind}"] = Job(
                    work=run_two_source_resolution_trials,
                    n_trials=n_trials,
                    arguments={"estimator": pair_estimator, "separation": separation * BEAMWIDTH},
                    block_size=500,
                )
    return jobs


def _two_source_estimator_or_none(estimator_class: type) -> DirectionEstimator | None:
    """Return the estimator set to two sources; None if it supports only one."""
    try:
        estimator: DirectionEstimator = estimator_class(n_sources=2)
    except InvalidSetting:
        return None
    return estimator


def run_error_over_bound_trials(
    rng: np.random.Generator, n_trials: int, *, estimator: DirectionEstimator
) -> np.ndarray:
    """Return error and stated standard error, both over the bound, (n_trials, 2)."""
    array, noise = half_wavelength_linear_array(), float(from_decibels(-SNR_DB))
    azimuth = rng.uniform(-MAX_AZIMUTH_RAD, MAX_AZIMUTH_RAD, (n_trials, 1))
    amplitudes = _random_phasors(rng, (n_trials, 1))
    snapshots = _noise_free_snapshots(array, azimuth, amplitudes) + _noise_snapshots(
        rng, n_trials, noise
    )
    estimates = estimator.find_directions(snapshots, array, np.full(n_trials, noise))
    bound = azimuth_cramer_rao_bounds_rad(array, azimuth, amplitudes, noise)
    error = estimates.azimuth_rad[:, :1] - azimuth
    return np.concatenate([error / bound, estimates.azimuth_std_rad[:, :1] / bound], axis=1)


def run_two_source_resolution_trials(
    rng: np.random.Generator, n_trials: int, *, estimator: DirectionEstimator, separation: float
) -> np.ndarray:
    """Return the resolution of two sources (0 or 1), (n_trials, 2): in noise, without noise.

    Two sources are resolved if both estimates lie within half the separation of them.
    """
    array, noise = half_wavelength_linear_array(), float(from_decibels(-SNR_DB))
    sines = rng.uniform(-0.5, 0.5, (n_trials, 1)) + separation / 2 * np.array([-1, 1])
    clean = _noise_free_snapshots(array, np.arcsin(sines), _random_phasors(rng, (n_trials, 2)))
    unit_noise = _noise_snapshots(rng, n_trials, 1.0)
    resolved = np.empty((n_trials, 2))
    for column, power in enumerate((noise, _NEGLIGIBLE_NOISE)):
        estimates = estimator.find_directions(
            clean + np.sqrt(power) * unit_noise, array, np.full(n_trials, power)
        )
        # NaN sorts last and counts as unresolved.
        estimated_sines = np.sort(np.sin(estimates.azimuth_rad), axis=1)[:, :2]
        resolved[:, column] = np.all(abs(estimated_sines - sines) < separation / 2, axis=1)
    return resolved


def _random_phasors(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    return np.exp(2j * np.pi * rng.random(shape))


def _noise_free_snapshots(
    array: Aperture, azimuth: np.ndarray, amplitudes: np.ndarray
) -> np.ndarray:
    """Return noise-free snapshots (n, 1, n_elements) of sources (n, k)."""
    steering = array.steering_vectors(azimuth, np.zeros_like(azimuth))
    return np.asarray(np.sum(amplitudes[..., None] * steering, axis=1)[:, None])


def _noise_snapshots(rng: np.random.Generator, n: int, power: float) -> np.ndarray:
    parts = rng.standard_normal((n, 1, N_ELEMENTS, 2))
    return np.asarray(np.sqrt(power / 2) * (parts[..., 0] + 1j * parts[..., 1]))


def azimuth_cramer_rao_bounds_rad(
    array: Aperture, azimuth: np.ndarray, amplitudes: np.ndarray, noise_power: float
) -> np.ndarray:
    """Return the Cramér-Rao bound of the azimuth of one source per snapshot, (n, 1)."""
    steering = np.swapaxes(array.steering_vectors(azimuth, np.zeros_like(azimuth)), 1, 2)
    # Shape (n, 1, n_elements).
    phase_slopes = unit_vector_derivatives(azimuth, 0.0)[..., 0, :] @ array.positions.T
    derivatives = -2j * np.pi * np.swapaxes(phase_slopes, 1, 2) * steering
    information = conditional_fisher_information(
        steering, derivatives[..., None], amplitudes[..., None], noise_power
    )
    return np.sqrt(crlb_variances(information))


def build_direction_claims(results: Mapping[str, np.ndarray]) -> Part:
    """Return the claims on directions, one for each estimator."""
    return Part(
        id="directions",
        title="Errors of every direction estimator",
        method="One source, or two sources of equal power, and a uniform linear array of"
        f" {N_ELEMENTS} elements with half-wavelength spacing. The SNR per element is {SNR_DB:g}"
        " dB,"
        " with one snapshot. Sources lie within"
        f" {np.degrees(MAX_AZIMUTH_RAD):.0f} degrees of broadside, pairs within 30 degrees. The"
        " bound"
        " is the conditional bound of Stoica and Nehorai. Spatial smoothing and element differences"
        " cost accuracy by design, and the standard error that the estimator states includes this"
        " loss; the requirement is that the error agrees with the stated one. Two sources count as"
        " resolved if both are estimated within half their separation; the theoretical proportion"
        " is that of the same pairs without noise.",
        claims=tuple(
            _estimator_error_and_resolution_claim(kind, results)
            for kind in DirectionEstimator.members()
        ),
    )


def _estimator_error_and_resolution_claim(kind: str, results: Mapping[str, np.ndarray]) -> Claim:
    error, stated_error = results[f"one source, {kind}"].T
    stated = float(np.sqrt(np.mean(stated_error**2)))
    is_finite = bool(np.isfinite(error).all())
    low, high = (
        confidence_intervals.rms_interval(error, confidence=CONFIDENCE)
        if is_finite
        else (np.nan, np.nan)
    )
    checks = [
        Check(
            name="RMSE over the Cramér-Rao bound",
            unit="1",
            measured=float(np.sqrt(np.mean(error**2))),
            low=low,
            high=high,
            at_least=max(MIN_BOUND_RATIO, stated / MAX_STATED_RATIO),
            at_most=stated * MAX_STATED_RATIO,
            limit=stated,
            trials=error.size,
        )
    ]
    for name in SEPARATIONS:
        pairs = results.get(f"two sources {name} apart, {kind}")
        if pairs is not None:
            separation_text = "1 beamwidth" if name == "1" else f"{name} beamwidths"
            noise_free_proportion = float(pairs[:, 1].mean())
            at_least = max(noise_free_proportion - MAX_RESOLUTION_LOSS, 0.0)
            checks.append(
                proportion_check(
                    f"both resolved, separation {separation_text}",
                    pairs[:, 0],
                    at_least=at_least,
                    limit=noise_free_proportion,
                )
            )
    single_source_note = "" if len(checks) > 1 else " It estimates one direction only."
    return Claim(
        id=f"directions_{kind.replace('-', '_')}",
        claim=f"The error of the {kind} estimator agrees with the error that it states, and noise"
        " costs little resolution."
        if not single_source_note
        else f"The error of the {kind} estimator agrees with the error that it states.",
        checks=tuple(checks),
        note=f"Theory: the stated standard error over the bound.{single_source_note}",
    )
