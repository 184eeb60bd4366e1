"""How faint the reference target can be: by theory, and read off what was measured."""

from collections.abc import Callable
from functools import cache

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from dechirp.core.units import from_decibels
from dechirp.core.values import value
from dechirp.evaluate.detector import Detector
from dechirp.evaluate.detector import detector as detector_of
from dechirp.evaluate.expected import kept_in_cell
from dechirp.experiment.verify import published
from dechirp.experiment.verify.looks import REFERENCE, at_mid_frame, late_echo, radar
from dechirp.experiment.verify.reference_target import GRID_DB
from dechirp.experiment.verify.trials import Z
from dechirp.process.chain import Chain
from dechirp.process.spectrum import Transform
from dechirp.scene.folding import Place
from dechirp.theory.detection import exceedance_probability
from dechirp.theory.windows import Window

DETECTION_PROBABILITY = 0.9
BARS_DB: dict[Window, float] = {"rectangular": -40.5, "hann": -37.0}
"""Ratio in each sample at which the reference target must still be found 9 times in 10."""
MOST_SHIFT_DB = 1.0
"""Between the curve of theory and what is measured; farther off, the fit has no interval."""

DetectionCurve = Callable[[np.ndarray], np.ndarray]


@value
class Fit:
    """Where a measured curve reaches 0.9, and where that of theory does."""

    limit_db: float
    low_db: float
    high_db: float
    theory_db: float
    trials: int


def fit(trials: np.ndarray, curve: DetectionCurve) -> Fit:
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
    half_db = Z / np.sqrt(information) if abs(shift_db) < 0.99 * MOST_SHIFT_DB else np.nan
    theory_db = limit_of_theory_db(curve)
    return Fit(
        limit_db=theory_db + shift_db,
        low_db=float(theory_db + shift_db - half_db),
        high_db=float(theory_db + shift_db + half_db),
        theory_db=theory_db,
        trials=len(trials),
    )


def limit_of_theory_db(curve: DetectionCurve) -> float:
    """Ratio in each sample at which the curve reaches 0.9."""
    return float(brentq(lambda s: float(curve(np.array(s))) - DETECTION_PROBABILITY, -60.0, 0.0))


def trials_for_limit(window: Window) -> int:
    """Trials, over the grid in turn, that show the limit to be below its bar."""
    curve = curve_of_theory(window)
    margin_db = BARS_DB[window] - limit_of_theory_db(curve)
    information = np.mean(_information(curve, np.array(GRID_DB[window])))
    return int(np.ceil((2 * Z / margin_db) ** 2 / information))


def _information(curve: DetectionCurve, snr_db: np.ndarray) -> np.ndarray:
    """Fisher information of one trial on a shift of the curve, 1 / dB^2."""
    p = _inside(curve(snr_db))
    slope = (curve(snr_db + 0.01) - curve(snr_db - 0.01)) / 0.02
    return slope**2 / (p * (1 - p))


def _inside(probability: np.ndarray) -> np.ndarray:
    """Kept off 0 and 1, where a logarithm has no value."""
    return np.clip(probability, 1e-12, 1 - 1e-12)


def in_map(over_range: Transform, over_velocity: Transform) -> float:
    """Ratio of the reference target in its cell of the map over that in one sample."""
    at = at_mid_frame(REFERENCE)
    kept = kept_in_cell(Place(*map(np.array, at)), radar(), over_range, over_velocity)
    return radar().integration_gain * float(kept)


@cache
def detector(window: Window) -> Detector:
    """The detector of the chain, with as many independent cells as those of its ring are worth.

    644 under a rectangular window, 181 under Hann.
    """
    chain = Chain(range_window=window, doppler_window=window)
    made = detector_of(chain.cfar, chain.noise(radar()))
    assert made is not None
    return made


def curve_of_theory(window: Window) -> DetectionCurve:
    """Probability that the cell of the reference target is detected, over its ratio in dB."""
    noise = Chain(range_window=window, doppler_window=window).noise(radar())
    gain = in_map(noise.over_range, noise.over_velocity)
    return lambda snr_db: detector(window).probability(from_decibels(snr_db) * gain)


def report_threshold() -> float:
    """Threshold of the report's rule over the mean noise power, a ratio of powers: 785.

    The mean amplitude of noise is sqrt(pi / 4) of the root of its mean power, and the rule
    multiplies it by 31.6.
    """
    return float(from_decibels(published.OFFSET_DB)) ** 2 * np.pi / 4


def report_curve() -> DetectionCurve:
    """Probability that the report's rule finds the target, without leakage into its ring."""
    # Of 2,200 samples the first 100 are blank, and the ratio is taken over all.
    echoed = np.count_nonzero(late_echo()[0, 0]) / late_echo().shape[-1]
    gain = in_map(published.OVER_RANGE, published.OVER_VELOCITY) * echoed
    return lambda snr_db: exceedance_probability(from_decibels(snr_db) * gain, report_threshold())


def needed_in_map() -> float:
    """Ratio in a cell that the chain needs for 0.9, rectangular windows."""
    return _needed(detector("rectangular").probability)


def needed_by_report() -> float:
    """Ratio in a cell that the report's rule needs for the same probability of detection."""
    return _needed(lambda snr: exceedance_probability(snr, report_threshold()))


def _needed(probability: DetectionCurve) -> float:
    def excess(snr_db: float) -> float:
        return float(probability(from_decibels(np.array(snr_db)))) - DETECTION_PROBABILITY

    return float(from_decibels(brentq(excess, 0.0, 50.0)))
