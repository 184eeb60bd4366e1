"""Scale of a map, from the distribution of its noise: power, amplitude or decibels of either.

The power of n averaged channels of noise has a gamma distribution of shape n. Its logarithm has a
spread and an asymmetry that belong to n; a map of amplitudes has half the spread and the same
asymmetry, so the scale follows from the noise alone.
"""

from dataclasses import dataclass

import numpy as np
import scipy

from dechirp.core.units import to_decibels
from dechirp.processing.diagnosis.diagnosis import (
    NOTHING_FOUND,
    Diagnosis,
    cannot_be_told,
    mistake_found,
)
from dechirp.processing.diagnosis.map_peaks import median_noise, noise_correlation

_LEVELS = np.array([0.005, 0.015, 0.04, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8])
"""Quantiles that echoes in a tenth of the cells hardly change."""
_MIN_INDEPENDENT_CELLS = 100
_MIN_ECHO_OVER_MEDIAN = 30.0
"""Noise reaches it in 1e-9 of the cells of powers, in 4e-5 where squares are given as powers."""
_DECISIVE_CHI2 = {0.5: 30.0, 1.0: 30.0, 2.0: 150.0}
"""Lead of each factor over the others: 30 is a likelihood ratio of exp(15) = 3e6. Leakage and
interference spread powers too, as if they were squared, with a lead of 33 in a map."""
_LEAD_OF_KNOWN_LAW = 2 / 3
"""Where the number of averaged powers is known, three laws are compared instead of 120."""
_MAX_CHI2 = 25.0
"""Of 10 degrees of freedom: 0.5 % of right laws stay undecided. Interference, whose powers spread
like the squares of noise, has reached 41."""
_CHANNELS = np.unique(np.round(np.geomspace(1, 512, 40)))


@dataclass(frozen=True)
class NoiseScale:
    """Scale of the decibels of a map, by the law of its noise."""

    factor: float
    """True decibels times this factor are the decibels of the map; NaN if undecided."""
    chi2: float
    """Misfit of the best law."""
    chi2_as_claimed: float
    """Misfit of the best law with a factor of 1."""
    n_cells: float
    """Number of independent cells."""


def measure_noise_scale(power: np.ndarray, n_summed: int | None) -> NoiseScale:
    """Measure the factor of the decibels of a map (velocity, range) of linear powers.

    `n_summed` powers were averaged in each cell; None: any number.
    """
    inner = _cells_without_echoes(power)
    levels = to_decibels(np.maximum(inner / median_noise(inner), 1e-300)).ravel()
    channels = _CHANNELS if n_summed is None else np.array([float(n_summed)])
    n_cells = levels.size / cells_per_independent_cell(inner)
    if n_cells < _MIN_INDEPENDENT_CELLS:
        return NoiseScale(factor=np.nan, chi2=np.nan, chi2_as_claimed=np.nan, n_cells=n_cells)
    measured = np.quantile(levels, _LEVELS)
    misfits = {
        scale: min(_quantile_chi2(measured, n, scale, n_cells) for n in channels)
        for scale in _DECISIVE_CHI2
    }
    best = min(misfits, key=lambda scale: misfits[scale])
    runner_up = min(chi2 for scale, chi2 in misfits.items() if scale != best)
    lead = runner_up - misfits[best]
    is_decided = misfits[best] < _MAX_CHI2 and lead > _DECISIVE_CHI2[best] * (
        1.0 if n_summed is None else _LEAD_OF_KNOWN_LAW
    )
    return NoiseScale(
        factor=best if is_decided else np.nan,
        chi2=misfits[best],
        chi2_as_claimed=misfits[1.0],
        n_cells=n_cells,
    )


def _cells_without_echoes(power: np.ndarray) -> np.ndarray:
    """Return the velocities and ranges of a map without echoes, if they are a quarter of it.

    Without a window, echoes leak into all cells of their velocity and of their range. Ranges about
    DC are left out, where the noise of real samples has another law.
    """
    inner = power[:, 2:-2] if power.shape[1] > 16 else power
    has_echo = inner > _MIN_ECHO_OVER_MEDIAN * median_noise(inner)
    columns = ~has_echo.any(axis=0)
    if columns.mean() > 0.25:
        inner, has_echo = inner[:, columns], has_echo[:, columns]
    rows = ~has_echo.any(axis=1)
    return inner[rows] if rows.mean() > 0.25 else inner


def cells_per_independent_cell(power: np.ndarray) -> float:
    """Return the cells per independent cell of noise: 3.78 for Hann windows over both axes.

    The sum of the correlations of powers over all lags, from the noise itself.
    """
    factor = 1.0
    for axis, size in enumerate(power.shape):
        if size > 8:
            correlation = noise_correlation(power, axis, np.arange(1, 5))
            factor *= 1 + 2 * float(np.sum(np.maximum(correlation, 0.0)))
    return factor


def _quantile_chi2(measured: np.ndarray, n_channels: float, scale: float, n_cells: float) -> float:
    """Return the misfit of quantiles to the law of n channels, with its level fitted.

    Sample quantiles are normal with covariance p_i (1 - p_j) / (f_i f_j n) for i <= j (Mosteller
    1946).
    """
    powers = scipy.special.gammaincinv(n_channels, _LEVELS)
    expected = scale * to_decibels(powers)
    # Density of the decibels: that of the power times the derivative of the power.
    log_density = (n_channels - 1) * np.log(powers) - powers - scipy.special.gammaln(n_channels)
    density = np.exp(log_density) * powers * np.log(10) / (10 * scale)
    low, high = np.minimum.outer(_LEVELS, _LEVELS), np.maximum.outer(_LEVELS, _LEVELS)
    covariance = low * (1 - high) / np.outer(density, density) / n_cells
    deviation, ones = measured - expected, np.ones(_LEVELS.size)
    inverse = np.linalg.inv(covariance)
    deviation = deviation - (ones @ inverse @ deviation) / (ones @ inverse @ ones)
    return float(deviation @ inverse @ deviation)


def diagnose_noise_scale(noise: NoiseScale, scale: str) -> Diagnosis:
    """Compare the scale that the map is said to have with that of its noise."""
    if np.isnan(noise.factor):
        return cannot_be_told(
            "scale",
            value=f"the noise of {noise.n_cells:.0f} independent cells fits no single scale",
            expected="a floor of white noise, at least some hundred cells of it",
            fix="give a map with its noise, before thresholds and clipping",
        )
    if noise.factor == 1:
        return NOTHING_FOUND
    contents = {0.5: "decibels of amplitudes", 2.0: "twice the decibels of powers"}
    if scale != "decibels":
        contents = {0.5: "square roots of what it should be", 2.0: "squares of what it should be"}
    corrections = {
        0.5: "10 log10(abs(X)) is half the decibels: write 20 log10(abs(X)), or square abs(X)"
        " before averages and thresholds",
        2.0: "write 10 log10 of a power that is squared already, or 20 log10 of the amplitude",
    }
    return mistake_found(
        "scale",
        value=f"{contents[noise.factor]}: the decibels of the noise spread by {noise.factor:g}"
        f" times the law of noise (misfit chi2 {noise.chi2_as_claimed:.0f} as claimed,"
        f" {noise.chi2:.0f} with this factor, 10 degrees of freedom)",
        expected=f"a map of {scale}, whose noise power is gamma-distributed",
        fix=corrections[noise.factor],
    )
