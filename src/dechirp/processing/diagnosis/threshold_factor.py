"""Factor of a threshold over the mean of its training cells, and the false alarms it gives."""

import numpy as np
import scipy

from dechirp.core.errors import InvalidSetting
from dechirp.core.text import format_number
from dechirp.processing.diagnosis.diagnosis import (
    NOTHING_FOUND,
    Diagnosis,
    cannot_be_told,
    mistake_found,
)
from dechirp.theory.detection import detection_threshold

_MAX_SPREAD = 0.02  # of the factor over the cells; other detectors than cell averaging vary
_RELATIVE_TOLERANCE = 0.01
_MAX_RATE_RATIO = 2.0
"""Ratio of false-alarm rates that is reported. Correlated training cells, as of Hann windows,
need a larger factor, so a right threshold is at most lower in its rate."""


def training_mean(
    power: np.ndarray, n_training: tuple[int, int], n_guard: tuple[int, int]
) -> tuple[np.ndarray, int]:
    """Return the mean of the training cells of each cell, (velocity, range), and their number.

    Velocity wraps round; columns whose training cells end beyond the map are NaN.
    """
    outer = [2 * (t + g) + 1 for t, g in zip(n_training, n_guard, strict=True)]
    inner = [2 * g + 1 for g in n_guard]
    n_cells = outer[0] * outer[1] - inner[0] * inner[1]
    sums = [
        size[0] * size[1] * scipy.ndimage.uniform_filter(power, size, mode=("wrap", "nearest"))
        for size in (outer, inner)
    ]
    mean = (sums[0] - sums[1]) / n_cells
    edge = outer[1] // 2
    if edge:
        mean[:, :edge] = mean[:, -edge:] = np.nan
    return mean, n_cells


def false_alarm_probability(factor: float, n_cells: int, n_summed: int) -> float:
    """Return the false-alarm probability of a factor over the mean of independent cells.

    Sums of n pulses under test and in N cells are gamma distributed, so their ratio follows a
    beta distribution; for n = 1 it is (1 + factor / N)^-N (Finn and Johnson 1968).
    """
    return float(scipy.special.betainc(n_summed * n_cells, n_summed, 1 / (1 + factor / n_cells)))


def diagnose_factor(
    threshold: np.ndarray,
    power: np.ndarray,
    n_training: tuple[int, int],
    n_guard: tuple[int, int],
    pfa: float,
    n_summed: int,
) -> Diagnosis:
    """Compare the factor of a threshold (velocity, range) with that of its training cells.

    Raises
    ------
    InvalidSetting
        If the threshold is NaN in a cell that has all its training cells.
    """
    mean, n_cells = training_mean(power, n_training, n_guard)
    n_missing = np.count_nonzero(np.isfinite(mean) & np.isnan(threshold))
    if n_missing:
        raise InvalidSetting(
            "threshold",
            value=f"NaN in {n_missing} cells with all their training cells",
            expected="a number there; NaN only where training cells would lie beyond the map",
            fix="compute the threshold from finite powers",
        )
    is_usable = np.isfinite(mean) & np.isfinite(threshold) & (mean > 0)
    factors = threshold[is_usable] / mean[is_usable]
    if not factors.size:
        spread, factor = np.nan, np.nan
    else:
        factor = float(np.median(factors))
        low, high = np.quantile(factors, [0.1, 0.9])
        spread = float((high - low) / factor) if factor > 0 else np.nan
    if not spread < _MAX_SPREAD:
        return cannot_be_told(
            "threshold",
            value=f"a threshold over the mean of {n_cells} training cells that varies by"
            f" {spread:.0%} between cells",
            expected=f"a constant ratio, within {_MAX_SPREAD:.0%}, as of cell averaging",
            fix="check the numbers of training and guard cells, and their order (velocity, range);"
            " other detectors are not judged",
        )
    known_noise = detection_threshold(pfa, n_summed=n_summed) / n_summed
    right = _factor_of_probability(pfa, n_cells, n_summed)
    rate = false_alarm_probability(factor, n_cells, n_summed)
    is_sum = abs(factor / (right * n_cells) - 1) < _RELATIVE_TOLERANCE
    is_one_cell = abs(factor * n_cells / right - 1) < _RELATIVE_TOLERANCE
    is_known_noise = abs(factor / known_noise - 1) < _RELATIVE_TOLERANCE
    if rate < _MAX_RATE_RATIO * pfa and not is_sum:
        return NOTHING_FOUND
    if is_sum:
        cause = "the training cells are summed: divide by their number"
    elif is_one_cell:
        cause = "the factor is N (pfa^(-1/N) - 1) of the mean; without N it belongs to the sum"
    elif is_known_noise:
        cause = "-ln(pfa) belongs to known noise: with N training cells it is N (pfa^(-1/N) - 1)"
    else:
        cause = "use N (pfa^(-1/N) - 1) times the mean of N cells, or dechirp.cfar.cfar_threshold"
    return mistake_found(
        "threshold",
        value=f"a factor of {format_number(factor)} over the mean of {n_cells} training cells"
        f" (varies by {spread:.1%}), whose false-alarm probability is {rate:.2g},"
        f" {format_number(rate / pfa, 3)} times that specified",
        expected=f"{format_number(right)} for a false-alarm probability of {pfa:g}",
        fix=cause,
    )


def _factor_of_probability(pfa: float, n_cells: int, n_summed: int) -> float:
    """Return the factor over the mean of the training cells for a false-alarm probability."""
    ratio = scipy.special.betaincinv(n_summed * n_cells, n_summed, pfa)
    return float(n_cells * (1 / ratio - 1))
