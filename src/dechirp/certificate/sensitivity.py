"""SNR limit of detecting the reference target, by theory and from measured trials."""

from collections.abc import Callable
from functools import cache

import numpy as np
import scipy

from dechirp.certificate import published
from dechirp.certificate.reference_trials import (
    REFERENCE_TARGET,
    motion_at_mid_frame,
    reference_echo_zero_before_arrival,
    reference_radar,
)
from dechirp.certificate.shared_trials import LIMIT_SNRS_DB
from dechirp.certificate.trials import Z_SCORE
from dechirp.core.units import from_decibels
from dechirp.core.values import frozen_dataclass
from dechirp.evaluation.detector_law import DetectorLaw, find_detector_law
from dechirp.evaluation.predicted_detection import nearest_cell_snr_fraction
from dechirp.processing.chain import Chain
from dechirp.processing.spectrum import Transform
from dechirp.scene.aliasing import RangeVelocity
from dechirp.theory.detection import exceedance_probability
from dechirp.theory.windows import Window

DETECTION_PROBABILITY = 0.9
REQUIRED_SNR_DB: dict[Window, float] = {"rectangular": -40.5, "hann": -37.0}
"""SNR per sample at which the reference target must be detected with a probability of 0.9."""
MAX_SHIFT_DB = 1.0
"""Largest shift between measured and theoretical curve; a larger shift gives no interval."""

DetectionCurve = Callable[[np.ndarray], np.ndarray]


@frozen_dataclass
class LimitFit:
    """SNR at which the measured and the theoretical detection curve reach 0.9."""

    limit_db: float
    low_db: float
    high_db: float
    theory_db: float
    trials: int


def fit_snr_limit(trials: np.ndarray, curve: DetectionCurve) -> LimitFit:
    """Fit a shift of the theoretical curve in dB to the trials, by maximum likelihood.

    `trials` (n, 2) holds the SNR in dB and hits (0 or 1). The interval follows from the Fisher
    information of the shift, sum (dPd/ds)^2 / (Pd (1 - Pd)) over the trials.
    """
    snr_db, inverse = np.unique(trials[:, 0], return_inverse=True)
    n_trials, n_hits = np.bincount(inverse), np.bincount(inverse, trials[:, 1])

    def negative_log_likelihood(shift_db: float) -> float:
        p = _clip_probability(curve(snr_db - shift_db))
        return -float(np.sum(n_hits * np.log(p) + (n_trials - n_hits) * np.log1p(-p)))

    shift_db = float(
        scipy.optimize.minimize_scalar(
            negative_log_likelihood, bounds=(-MAX_SHIFT_DB, MAX_SHIFT_DB), method="bounded"
        ).x
    )
    information = float(
        np.sum(n_trials * _fisher_information_of_curve_shift(curve, snr_db - shift_db))
    )
    half_interval_db = (
        Z_SCORE / np.sqrt(information) if abs(shift_db) < 0.99 * MAX_SHIFT_DB else np.nan
    )
    theory_db = theoretical_limit_db(curve)
    return LimitFit(
        limit_db=theory_db + shift_db,
        low_db=float(theory_db + shift_db - half_interval_db),
        high_db=float(theory_db + shift_db + half_interval_db),
        theory_db=theory_db,
        trials=len(trials),
    )


def theoretical_limit_db(curve: DetectionCurve) -> float:
    """Return the SNR per sample at which the curve reaches 0.9."""
    return float(
        scipy.optimize.brentq(
            lambda s: float(curve(np.array(s))) - DETECTION_PROBABILITY, -60.0, 0.0
        )
    )


def count_trials_to_prove_snr_limit(window: Window) -> int:
    """Return the number of trials that prove the limit to be below the requirement."""
    curve = theoretical_curve(window)
    margin_db = REQUIRED_SNR_DB[window] - theoretical_limit_db(curve)
    information = np.mean(
        _fisher_information_of_curve_shift(curve, np.array(LIMIT_SNRS_DB[window]))
    )
    return int(np.ceil((2 * Z_SCORE / margin_db) ** 2 / information))


def _fisher_information_of_curve_shift(curve: DetectionCurve, snr_db: np.ndarray) -> np.ndarray:
    """Return the Fisher information of one trial about a shift of the curve, 1 / dB^2."""
    p = _clip_probability(curve(snr_db))
    slope = (curve(snr_db + 0.01) - curve(snr_db - 0.01)) / 0.02
    return slope**2 / (p * (1 - p))


def _clip_probability(probability: np.ndarray) -> np.ndarray:
    """Clip probabilities away from 0 and 1, where the logarithm diverges."""
    return np.clip(probability, 1e-12, 1 - 1e-12)


def snr_gain_in_map(over_range: Transform, over_velocity: Transform) -> float:
    """Return the SNR of the reference target in its map cell over the SNR per sample."""
    motion = motion_at_mid_frame(REFERENCE_TARGET)
    peak_fraction = nearest_cell_snr_fraction(
        RangeVelocity(*map(np.array, motion)), reference_radar(), over_range, over_velocity
    )
    return reference_radar().integration_gain * float(peak_fraction)


@cache
def chain_detector_law(window: Window) -> DetectorLaw:
    """Return the detector law of the chain.

    The training window counts as 644 independent cells with rectangular windows, 181 with Hann.
    """
    chain = Chain(range_window=window, doppler_window=window)
    law = find_detector_law(chain.cfar, chain.map_noise_statistics(reference_radar()))
    assert law is not None
    return law


def theoretical_curve(window: Window) -> DetectionCurve:
    """Return the theoretical detection probability of the reference target over the SNR in dB."""
    noise = Chain(range_window=window, doppler_window=window).map_noise_statistics(
        reference_radar()
    )
    gain = snr_gain_in_map(noise.range_transform, noise.doppler_transform)
    return lambda snr_db: chain_detector_law(window).detection_probability(
        from_decibels(snr_db) * gain
    )


def report_threshold() -> float:
    """Return the threshold of the report's rule over the mean noise power, a power ratio of 785.

    The mean amplitude of noise is sqrt(pi / 4) times the square root of its mean power. The rule
    multiplies it by 31.6.
    """
    return float(from_decibels(published.OFFSET_DB)) ** 2 * np.pi / 4


def report_rule_curve() -> DetectionCurve:
    r"""Return the detection probability of the report's rule over the SNR.

    The target leaks into its own training cells, where the mean amplitude follows Rice's law:

    .. math:: \sqrt{\pi / 4} \, e^{-x/2} \left( (1 + x) I_0(x/2) + x I_1(x/2) \right)

    with the SNR x of a cell and the variance 1 + x less its square (S. O. Rice, Mathematical
    analysis of random noise, Bell System Technical J., 1945). The threshold is the rule's multiple
    of the mean of the training cells. This mean of many cells is normal; zero padding correlates
    them, as if there were fewer by its factor.
    """
    # The first 100 of 2,200 samples are zero, and the SNR refers to all of them.
    peak_gain, training_gains = published.peak_and_training_power(
        reference_echo_zero_before_arrival()
    )
    n_independent = training_gains.size * published.N_SAMPLES / published.N_RANGE_BINS
    deviations, weights = np.polynomial.hermite_e.hermegauss(15)

    def detection_probability(snr_db: np.ndarray) -> np.ndarray:
        snr = from_decibels(np.asarray(snr_db, float))[..., None]
        half = snr * training_gains / 2
        means = np.sqrt(np.pi / 4) * (
            (1 + 2 * half) * scipy.special.ive(0, half) + 2 * half * scipy.special.ive(1, half)
        )
        variance = (1 + 2 * half - means**2).mean(axis=-1) / n_independent
        amplitude = means.mean(axis=-1)[..., None] + np.sqrt(variance)[..., None] * deviations
        threshold = (from_decibels(published.OFFSET_DB) * amplitude) ** 2
        exceeds = np.vectorize(exceedance_probability)(snr * peak_gain, threshold)
        return np.asarray(exceeds @ weights / weights.sum())

    return detection_probability


def chain_required_snr() -> float:
    """Return the SNR per cell that the chain needs for Pd = 0.9 with rectangular windows."""
    return _snr_at_required_detection_probability(
        chain_detector_law("rectangular").detection_probability
    )


def report_rule_required_snr() -> float:
    """Return the SNR per cell that the report's rule needs for Pd = 0.9."""
    return _snr_at_required_detection_probability(
        lambda snr: exceedance_probability(snr, report_threshold())
    )


def _snr_at_required_detection_probability(detection_curve: DetectionCurve) -> float:
    def excess(snr_db: float) -> float:
        return float(detection_curve(from_decibels(np.array(snr_db)))) - DETECTION_PROBABILITY

    return float(from_decibels(scipy.optimize.brentq(excess, 0.0, 50.0)))
