r"""Calibration of the factor of any CFAR in correlated cells by simulation.

The training cells z_i and the cell under test z_0 are jointly Gaussian, circular amplitudes,
K powers summed in each. Of z_i the part c_i z_0 follows the cell under test, with c_i their
correlation: it leaks. The rest z' is independent of it. So, given the rest, noise causes an alarm
if the power r of the cell under test, a gamma variate of K, exceeds the threshold, which its own
leakage raises,

.. math:: r > \alpha\, Z(|z' + c \sqrt{r}|^2), \quad\text{that is}\quad r > r^*,

and the false-alarm probability is the mean of Q(K, r*) over the rest. (Channels and phases can
be rotated so that z_0 is real and in one channel; sums of powers are unchanged.)

Alarms at 1e-6 occur when the training cells happen to be low. They are drawn low, with the
covariance (R^-1 + T)^-1 instead of R, for a diagonal T, and with the weight exp(z^H T z) / det(I +
R T). Were the statistic the mean and T = alpha / N, each draw would have the same product of weight
and probability: the exact law. For other statistics it varies by half of its value in training
windows of hundreds of cells. Draws with several T are mixed, so that no weight is far above the
others.

References
----------
R. Srinivasan, Importance Sampling: Applications in Communications and Detection, Springer,
2002. E. Veach and L. J. Guibas, Optimally combining sampling techniques for Monte Carlo
rendering, SIGGRAPH 1995 (the mixture).
"""

import math
import reprlib
from collections.abc import Callable, Iterator

import numpy as np
import scipy

from dechirp.core.argument_types import check_argument_types
from dechirp.core.errors import InvalidSetting
from dechirp.core.memory import check_free_memory
from dechirp.core.values import frozen_dataclass
from dechirp.theory.cfar import cell_averaging_factor, find_decreasing_root
from dechirp.theory.cfar_correlated_cells import CorrelatedWindow

__all__ = ["CalibratedFactor", "calibrate_factor"]

Statistic = Callable[[np.ndarray], np.ndarray]

MAX_TRAINING_CELLS = 2000  # factoring a matrix of this size takes seconds
_TARGET_ERROR = 0.01  # relative error of the false-alarm probability that ends the draws
_MAX_ERROR = 0.25  # relative error at which the calibration is refused
_MAX_RANDOM_NUMBERS = 3e7  # random numbers for a factor: half a second
_MAX_NUMBERS_PER_BATCH = 4e6  # in memory: 16 MB
_MIN_DRAWS, _MAX_DRAWS = 1000, 100_000
_MAX_LEAKAGE = 0.1  # of the power under test in a training cell; at 0.4 the threshold follows
_TILT_RATIO = 2.5  # ratio of successive tilts


@frozen_dataclass
class CalibratedFactor:
    """Ratio of threshold to statistic for a false-alarm probability, with its error."""

    value: float
    relative_error: float = 0.0
    """Relative standard error of the resulting false-alarm probability; 0 if exact."""


@check_argument_types
def calibrate_factor(
    false_alarm_probability: float,
    statistic: Statistic,
    window: CorrelatedWindow,
    *,
    n_summed: int = 1,
    low_cell_masks: np.ndarray | None = None,
) -> CalibratedFactor:
    """Simulate the ratio of threshold to a statistic of correlated training cells.

    Draws with a fixed seed continue until the relative standard error of the false-alarm
    probability is 1 %, for at most half a second: few training cells at a small probability end
    at 2 or 3 %.

    Parameters
    ----------
    false_alarm_probability : float
        For the cell under test.
    statistic : callable
        From powers (..., n_training) to (...); proportional to the powers.
    window : CorrelatedWindow
        The covariance of the noise.
    n_summed : int
        Powers that are summed in each cell.
    low_cell_masks : bool array (n_sets, n_training), optional
        Sets of cells whose low values cause alarms; by default all cells as one set.

    Raises
    ------
    InvalidSetting
        If there are more than 2,000 training cells, a tenth of the power of the cell under
        test leaks into one of them, or they are so few that the error would exceed 25 %.
    """
    n_cells = window.n_training
    if n_cells > MAX_TRAINING_CELLS:
        raise InvalidSetting(
            "Cfar.n_training",
            value=f"{n_cells} training cells, correlated by a window or padding",
            expected=f"at most {MAX_TRAINING_CELLS}, for which a factor can be calibrated",
            fix="lower n_training, or choose cell-averaging, whose factor is exact",
        )
    covariance = window.covariance
    leak = covariance[:-1, -1]
    if np.max(abs(leak) ** 2) > _MAX_LEAKAGE:
        raise InvalidSetting(
            "Cfar.n_guard",
            value="too small for this window and zero padding",
            expected="guard cells beyond the main lobe of the window",
            fix="widen the guard, pad less, or choose cell-averaging, whose factor is exact",
        )
    sets = np.asarray(np.ones((1, n_cells), bool) if low_cell_masks is None else low_cell_masks)
    if (
        sets.dtype != bool
        or sets.shape[1:] != (n_cells,)
        or not (sets.size and sets.any(axis=1).all())
    ):
        raise InvalidSetting(
            "low_cell_masks",
            value=f"an array {sets.shape} of {sets.dtype}",
            expected=f"a bool array (n_sets, {n_cells}), with True for a training cell or more in"
            " each set",
            fix="omit it for all cells as one set",
        )
    tilts = np.concatenate(
        [
            _importance_sampling_tilts(
                false_alarm_probability, covariance[:-1, :-1], cells, n_summed
            )
            for cells in sets
        ]
    )
    estimate = _FactorEstimate(statistic, leak, false_alarm_probability, n_summed)
    for amplitudes, weights in _draw_training_amplitudes_and_weights(covariance, tilts, n_summed):
        estimate.add_draws(amplitudes, weights)
        if estimate.relative_error <= _TARGET_ERROR:
            break
    if not estimate.relative_error < _MAX_ERROR:
        raise InvalidSetting(
            "Cfar.n_training",
            value=f"{n_cells} cells for a false-alarm probability of {false_alarm_probability:g}",
            expected=f"enough cells to calibrate a factor within {_MAX_ERROR:.0%}",
            fix="train over more cells, allow more false alarms, or choose cell-averaging",
        )
    return CalibratedFactor(value=estimate.factor, relative_error=estimate.relative_error)


class _FactorEstimate:
    """Factor from the draws so far, and the error of its false-alarm probability."""

    factor = np.nan
    relative_error = np.inf

    def __init__(
        self,
        statistic: Statistic,
        leak: np.ndarray,
        false_alarm_probability: float,
        n_summed: int,
    ) -> None:
        self._statistic, self._leak, self._n_summed = statistic, leak, n_summed
        self._log_pfa = math.log(false_alarm_probability)
        self._levels, self._weights = np.empty(0), np.empty(0)
        self._first_factor, self._slope = np.nan, -1.0

    def add_draws(self, amplitudes: np.ndarray, weights: np.ndarray) -> None:
        """Add draws, and update the factor and its error."""
        if not self._levels.size:
            self._first_factor = self._find_self_consistent_factor(amplitudes, weights)
        levels = self._statistic_with_leakage(amplitudes, self._first_factor)
        self._levels = np.append(self._levels, levels)
        self._weights = np.append(self._weights, weights)
        solved_factor = self._solve_factor_for_false_alarm_probability(self._levels, self._weights)
        # Statistics include leakage at the factor of the first draws.
        self.factor = self._first_factor * (solved_factor / self._first_factor) ** (
            -1 / self._slope
        )
        probabilities = self._weighted_alarm_probabilities(
            solved_factor, self._levels, self._weights
        )
        self.relative_error = float(
            probabilities.std() / probabilities.mean() / np.sqrt(probabilities.size)
        )

    def _find_self_consistent_factor(self, amplitudes: np.ndarray, weights: np.ndarray) -> float:
        """Find the factor consistent with its own leakage; set the slope."""
        power = np.sum(abs(amplitudes) ** 2, axis=1)
        log_factor_without_leakage = math.log(
            self._solve_factor_for_false_alarm_probability(self._evaluate_statistic(power), weights)
        )
        if not self._leak.any():
            return math.exp(log_factor_without_leakage)

        def log_excess(log_factor: float) -> float:
            levels = self._statistic_with_leakage(amplitudes, math.exp(log_factor))
            return (
                math.log(self._solve_factor_for_false_alarm_probability(levels, weights))
                - log_factor
            )

        # Much leakage lowers the factor; a little may change the order of cells either way.
        low, high = log_factor_without_leakage - 0.1, log_factor_without_leakage + 0.1
        while log_excess(low) < 0:
            low -= 0.5
        while log_excess(high) > 0:
            high += 0.5
        from scipy.optimize import brentq  # 0.2 s, unused by most commands

        log_factor = brentq(log_excess, low, high, xtol=1e-3)
        self._slope = (log_excess(log_factor + 0.05) - log_excess(log_factor)) / 0.05
        return math.exp(log_factor)

    def _solve_factor_for_false_alarm_probability(
        self, statistics: np.ndarray, weights: np.ndarray
    ) -> float:
        """Solve for the factor with statistics held fixed."""

        def excess(factor: float) -> float:
            probability = self._weighted_alarm_probabilities(factor, statistics, weights).mean()
            return math.log(max(float(probability), 1e-320)) - self._log_pfa

        return find_decreasing_root(excess, start=1.0)

    def _weighted_alarm_probabilities(
        self, factor: float, levels: np.ndarray, weights: np.ndarray
    ) -> np.ndarray:
        """Return the alarm probability of each draw times its weight."""
        return np.asarray(weights * scipy.special.gammaincc(self._n_summed, factor * levels))

    def _evaluate_statistic(self, power: np.ndarray) -> np.ndarray:
        """Return the statistic of powers (n_draws, n_training), (n_draws,)."""
        result = self._statistic(power)
        try:
            levels = np.asarray(result)
        except ValueError:  # lists of unequal lengths
            levels = np.asarray(None)
        is_valid = levels.dtype.kind in "iuf" and levels.shape == power.shape[:-1]
        is_valid &= not np.ma.is_masked(result)
        if not (is_valid and np.all(levels > 0) and np.all(np.isfinite(levels))):
            raise InvalidSetting(
                "statistic",
                value=f"a function that returns {reprlib.repr(result)} of powers {power.shape}",
                expected=f"finite numbers above 0, in the shape {power.shape[:-1]}",
                fix="reduce the last axis, as lambda power: power.mean(axis=-1) does",
            )
        return levels.astype(float)

    def _statistic_with_leakage(self, amplitudes: np.ndarray, factor: float) -> np.ndarray:
        """Return the statistic, (n_draws,), with the leakage of a cell that just exceeds it."""
        first, others = amplitudes[:, 0], np.sum(abs(amplitudes[:, 1:]) ** 2, axis=1)
        levels = self._evaluate_statistic(others + abs(first) ** 2)
        if not self._leak.any():
            return levels
        # Each pass leaves a few per cent of the error, more with strong leakage. If a cell
        # raises its threshold as fast as itself, the passes do not converge: no alarm.
        for _ in range(100):
            amplitude = np.sqrt(np.minimum(factor * levels, 1e9)).astype(np.float32)
            leaked_power = abs(first + amplitude[:, None] * self._leak.astype(np.complex64)) ** 2
            previous_levels = levels
            levels = self._evaluate_statistic(others + leaked_power)
            if np.all(abs(levels - previous_levels) <= 1e-4 * levels):
                break
        return levels


def _importance_sampling_tilts(
    false_alarm_probability: float, covariance: np.ndarray, low_cells: np.ndarray, n_summed: int
) -> np.ndarray:
    """Return diagonals of T, (n_tilts, n_training), for draws in which the marked cells are low.

    The strongest tilt makes them as low as in alarms over their mean. Few cells must be very
    low, so further tilts lead stepwise to untilted noise.
    """
    n = int(np.count_nonzero(low_cells))
    n_independent = n**2 / np.sum(abs(covariance[np.ix_(low_cells, low_cells)]) ** 2)
    factor = cell_averaging_factor(
        false_alarm_probability, n_training=max(round(n_independent), 1), n_summed=n_summed
    )
    # Relative slope of Q(K, x): 1 for one power, less for more.
    terms = np.cumprod((n_summed - np.arange(1.0, n_summed)) / (factor * n_summed))
    relative_slope = 1 / (1 + np.sum(terms))
    strongest = relative_slope * factor / n
    n_tilts = 2 + max(math.ceil(math.log(strongest) / math.log(_TILT_RATIO)), 0)
    return np.outer(strongest / _TILT_RATIO ** np.arange(n_tilts), low_cells)


def _draw_training_amplitudes_and_weights(
    covariance: np.ndarray, tilts: np.ndarray, n_summed: int
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Draw training cells without leakage, (n_draws, n_summed, n_training), and weights."""
    from scipy.linalg import solve_triangular  # 0.2 s, unused by most commands

    leak = covariance[:-1, -1]
    n = leak.size
    # Little white noise is added, since padding makes the covariance singular.
    conditional_covariance = covariance[:-1, :-1] - np.outer(leak, leak.conj()) + 1e-9 * np.eye(n)
    try:
        spread = np.linalg.cholesky(conditional_covariance)
    except np.linalg.LinAlgError:
        raise InvalidSetting(
            "window",
            value="a covariance with a negative eigenvalue",
            expected="the covariance of noise",
            fix="compute it with dechirp.windows.bin_correlation",
        ) from None
    roots, log_dets = [], np.empty(len(tilts))
    for i, tilt in enumerate(tilts):
        # (R^-1 + T)^-1 = B (I + B^H T B)^-1 B^H for R = B B^H: nothing near zero is inverted.
        lower = np.linalg.cholesky(np.eye(n) + (spread.conj().T * tilt) @ spread)
        log_dets[i] = 2 * np.sum(np.log(np.diag(lower).real))
        roots.append(solve_triangular(lower.conj(), spread.T, lower=True).astype(np.complex64))
    rng = np.random.default_rng(1)
    max_batch = max(int(_MAX_NUMBERS_PER_BATCH / (2 * n * n_summed * len(tilts))), 50)
    max_batch = min(max_batch, _MAX_DRAWS // (4 * len(tilts)))
    check_free_memory(
        f"n_summed={n_summed} of {n} training cells",
        # Normal variates, amplitudes and their concatenation.
        needed_bytes=24.0 * n * n_summed * len(tilts) * min(_MIN_DRAWS, max_batch),
        fix="sum fewer powers, or choose cell-averaging, whose factor is exact",
    )
    max_draws = min(_MAX_DRAWS, _MAX_RANDOM_NUMBERS / (2 * n * n_summed))
    n_draws, n_drawn = min(_MIN_DRAWS, max_batch), 0
    while n_drawn < max_draws:
        parts = []
        for root in roots:
            white = rng.standard_normal((n_draws * n_summed, 2 * n), np.float32)
            white *= np.float32(np.sqrt(0.5))
            parts.append((white.view(np.complex64) @ root).reshape(n_draws, n_summed, n))
            n_drawn += n_draws
        amplitudes = np.concatenate(parts)
        # Density of the noise over that of the mixture.
        power = np.sum(abs(amplitudes) ** 2, axis=1, dtype=float)
        yield amplitudes, 1 / np.mean(np.exp(n_summed * log_dets - power @ tilts.T), axis=1)
        n_draws = min(2 * n_draws, max_batch)
