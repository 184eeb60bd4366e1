r"""Factor of any CFAR in correlated cells, by simulation, with its uncertainty.

The training cells z_i and the cell under test z_0 are jointly Gaussian, circular amplitudes,
K powers summed in each. Of z_i the part c_i z_0 follows the cell under test, with c_i their
correlation: it leaks. The rest z' is independent of it. So, given the rest, noise alarms where
the power r of the cell under test, a gamma variate of K, exceeds the threshold that it raises
itself by leakage,

.. math:: r > \alpha\, Z(|z' + c \sqrt{r}|^2), \quad\text{that is}\quad r > r^*,

and the false-alarm probability is the mean of Q(K, r*) over the rest. (Channels and phases may
be turned so that z_0 is real and in one channel: sums of powers do not change by it.)

Alarms at 1e-6 come where the training cells are low by chance. They are drawn low: with the
covariance (R^-1 + T)^-1 instead of R, for a diagonal T, and with the weight
exp(z^H T z) / det(I + R T). Were the statistic the mean and T = alpha / N, each draw would have
the same product of weight and probability: the exact law. For other statistics it varies by
half of itself in rings of hundreds of cells. Draws with several T are mixed, so that no weight
is far above the others.

References
----------
R. Srinivasan, Importance Sampling: Applications in Communications and Detection, Springer,
2002. E. Veach and L. J. Guibas, Optimally combining sampling techniques for Monte Carlo
rendering, SIGGRAPH 1995 (the mixture).
"""

import math
from collections.abc import Callable, Iterator

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import brentq
from scipy.special import gammaincc

from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.theory.cfar import cell_averaging_factor, falling_root
from dechirp.theory.correlated import Box

Statistic = Callable[[np.ndarray], np.ndarray]

MOST_CELLS = 2000  # a matrix of so many rows is factored in seconds
_ERROR = 0.01  # of the false-alarm probability, at which draws are enough
_MOST_ERROR = 0.25  # at which they are too few, however many
_MOST_NUMBERS = 3e7  # random numbers for a factor: half a second
_AT_A_TIME = 4e6  # of them in memory: 16 MB
_FEWEST_DRAWS, _MOST_DRAWS = 1000, 100_000
_MOST_LEAK = 0.1  # of the power under test, into a training cell: at 0.4 most goes into raising
_STEP = 2.5  # between the tilts that are mixed


@value
class Factor:
    """Threshold over statistic for a false-alarm probability."""

    value: float
    error: float = 0.0
    """Standard error of the false-alarm probability that it gives, relative; 0: exact."""


def calibrated_factor(
    false_alarm_probability: float,
    statistic: Statistic,
    box: Box,
    *,
    n_summed: int = 1,
    low: np.ndarray | None = None,
) -> Factor:
    """Threshold over a statistic of correlated training cells, from draws of a fixed seed.

    Drawn until the standard error of the false-alarm probability is 1 % of it, for half a second
    at most: few training cells at a small probability end at 2 or 3 %.

    Parameters
    ----------
    false_alarm_probability : float
        For the cell under test.
    statistic : callable
        From powers (..., n_training) to (...); of twice the powers twice as much.
    box : Box
        The covariance of the noise.
    n_summed : int
        Powers that are summed in each cell.
    low : bool array (n_sets, n_training), optional
        Sets of cells each of which brings alarms when it is low; all as one set without it.

    Raises
    ------
    InvalidSetting
        If there are more than 2,000 training cells, or a tenth of the power of the cell
        under test leaks into one of them, or they are so few that the error would exceed 25 %.
    """
    n_cells = box.n_training
    if n_cells > MOST_CELLS:
        raise InvalidSetting(
            "Cfar.n_training",
            got=f"{n_cells} training cells that a window or padding ties together",
            need=f"at most {MOST_CELLS}, for which a factor can be calibrated",
            fix="Lower n_training, or choose cell-averaging, whose factor is exact.",
        )
    covariance = box.covariance
    leak = covariance[:-1, -1]
    if np.max(abs(leak) ** 2) > _MOST_LEAK:
        raise InvalidSetting(
            "Cfar.n_guard",
            got="too small for this window and zero padding",
            need="guard cells beyond the main lobe of the window",
            fix="Widen the guard, pad less, or choose cell-averaging, whose factor is exact.",
        )
    sets = np.ones((1, n_cells), bool) if low is None else low
    tilts = np.concatenate(
        [_tilts(false_alarm_probability, covariance[:-1, :-1], cells, n_summed) for cells in sets]
    )
    alarms = _Alarms(statistic, leak, false_alarm_probability, n_summed)
    for amplitudes, weights in _draws(covariance, tilts, n_summed):
        alarms.add(amplitudes, weights)
        if alarms.error <= _ERROR:
            break
    if not alarms.error < _MOST_ERROR:
        raise InvalidSetting(
            "Cfar.n_training",
            got=f"{n_cells} cells for a false-alarm probability of {false_alarm_probability:g}",
            need=f"so many that a factor can be calibrated within {_MOST_ERROR:.0%}",
            fix="Train over more cells, allow more false alarms, or choose cell-averaging.",
        )
    return Factor(value=alarms.factor, error=alarms.error)


class _Alarms:
    """The factor that draws so far ask for, and the error of its false-alarm probability."""

    factor = np.nan
    error = np.inf

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
        self._near, self._slope = np.nan, -1.0

    def add(self, amplitudes: np.ndarray, weights: np.ndarray) -> None:
        """Take more draws into account."""
        if not self._levels.size:
            self._near = self._about(amplitudes, weights)
        levels = self._raised(amplitudes, self._near)
        self._levels = np.append(self._levels, levels)
        self._weights = np.append(self._weights, weights)
        asked = self._asked(self._levels, self._weights)
        # Statistics are raised for the factor that the first draws ask for.
        self.factor = self._near * (asked / self._near) ** (-1 / self._slope)
        found = self._probabilities(asked, self._levels, self._weights)
        self.error = float(found.std() / found.mean() / np.sqrt(found.size))

    def _about(self, amplitudes: np.ndarray, weights: np.ndarray) -> float:
        """The factor that is asked for where statistics are raised for it; sets the slope."""
        power = np.sum(abs(amplitudes) ** 2, axis=1)
        without = math.log(self._asked(self._statistic(power).astype(float), weights))
        if not self._leak.any():
            return math.exp(without)

        def missing(log_factor: float) -> float:
            levels = self._raised(amplitudes, math.exp(log_factor))
            return math.log(self._asked(levels, weights)) - log_factor

        # Much leakage asks for a lower factor; a little may turn an order of cells either way.
        low, high = without - 0.1, without + 0.1
        while missing(low) < 0:
            low -= 0.5
        while missing(high) > 0:
            high += 0.5
        log_factor = brentq(missing, low, high, xtol=1e-3)
        self._slope = (missing(log_factor + 0.05) - missing(log_factor)) / 0.05
        return math.exp(log_factor)

    def _asked(self, levels: np.ndarray, weights: np.ndarray) -> float:
        """Factor for the false-alarm probability over statistics that do not change with it."""

        def excess(factor: float) -> float:
            found = self._probabilities(factor, levels, weights).mean()
            return math.log(max(float(found), 1e-320)) - self._log_pfa

        return falling_root(excess, start=1.0)

    def _probabilities(self, factor: float, levels: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Of an alarm in each draw, times the weight of the draw."""
        return np.asarray(weights * gammaincc(self._n_summed, factor * levels))

    def _raised(self, amplitudes: np.ndarray, factor: float) -> np.ndarray:
        """The statistic, (n_draws,), raised by the leakage of a cell that just exceeds it."""
        first, others = amplitudes[:, 0], np.sum(abs(amplitudes[:, 1:]) ** 2, axis=1)
        levels = self._statistic(others + abs(first) ** 2).astype(float)
        if not self._leak.any():
            return levels
        # Each pass leaves a few per cent of the error, more where much leaks; where a cell
        # raises its threshold as fast as itself there is no end, and no alarm.
        for _ in range(100):
            own = np.sqrt(np.minimum(factor * levels, 1e9)).astype(np.float32)
            raised = abs(first + own[:, None] * self._leak.astype(np.complex64)) ** 2
            before = levels
            levels = self._statistic(others + raised).astype(float)
            if np.all(abs(levels - before) <= 1e-4 * levels):
                break
        return levels


def _tilts(
    false_alarm_probability: float, covariance: np.ndarray, cells: np.ndarray, n_summed: int
) -> np.ndarray:
    """Diagonals of T, (n_tilts, n_training), for draws in which the marked cells are low.

    As low as alarms over their mean find them, and less. Where cells are few they must be very
    low, and a ladder of tilts leads from there to noise as it is.
    """
    n = int(np.count_nonzero(cells))
    n_independent = n**2 / np.sum(abs(covariance[np.ix_(cells, cells)]) ** 2)
    factor = cell_averaging_factor(
        false_alarm_probability, n_training=max(round(n_independent), 1), n_summed=n_summed
    )
    # How fast Q(K, x) falls with x, relative to itself: 1 for one power, less for more.
    terms = np.cumprod((n_summed - np.arange(1.0, n_summed)) / (factor * n_summed))
    falls = 1 / (1 + np.sum(terms))
    strongest = falls * factor / n
    n_tilts = 2 + max(math.ceil(math.log(strongest) / math.log(_STEP)), 0)
    return np.outer(strongest / _STEP ** np.arange(n_tilts), cells)


def _draws(
    covariance: np.ndarray, tilts: np.ndarray, n_summed: int
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Training cells without what leaks, (n_draws, n_summed, n_training), and their weights."""
    leak = covariance[:-1, -1]
    n = leak.size
    # A hair of white noise, for padding leaves the covariance singular.
    rest = covariance[:-1, :-1] - np.outer(leak, leak.conj()) + 1e-9 * np.eye(n)
    spread = np.linalg.cholesky(rest)
    roots, log_dets = [], np.empty(len(tilts))
    for i, tilt in enumerate(tilts):
        # (R^-1 + T)^-1 = B (I + B^H T B)^-1 B^H for R = B B^H: nothing near zero is inverted.
        lower = np.linalg.cholesky(np.eye(n) + (spread.conj().T * tilt) @ spread)
        log_dets[i] = 2 * np.sum(np.log(np.diag(lower).real))
        roots.append(solve_triangular(lower.conj(), spread.T, lower=True).astype(np.complex64))
    rng = np.random.default_rng(1)
    at_most = max(int(_AT_A_TIME / (2 * n * n_summed * len(tilts))), 50)
    at_most = min(at_most, _MOST_DRAWS // (4 * len(tilts)))
    n_most = min(_MOST_DRAWS, _MOST_NUMBERS / (2 * n * n_summed))
    n_draws, drawn = min(_FEWEST_DRAWS, at_most), 0
    while drawn < n_most:
        parts = []
        for root in roots:
            white = rng.standard_normal((n_draws * n_summed, 2 * n), np.float32)
            white *= np.float32(np.sqrt(0.5))
            parts.append((white.view(np.complex64) @ root).reshape(n_draws, n_summed, n))
            drawn += n_draws
        amplitudes = np.concatenate(parts)
        # Density of the noise over that of the mixture.
        power = np.sum(abs(amplitudes) ** 2, axis=1, dtype=float)
        yield amplitudes, 1 / np.mean(np.exp(n_summed * log_dets - power @ tilts.T), axis=1)
        n_draws = min(2 * n_draws, at_most)
