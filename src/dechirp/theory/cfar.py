"""CFAR in noise: factors for false-alarm probabilities, and the inverse.

A factor is the ratio of the threshold to the statistic of the detector: the mean of the training
cells (cell averaging), the k-th smallest of them (ordered statistic), the larger or the smaller
of the means of their two halves (greatest of, smallest of); for trimmed means see
`theory.cfar_trimmed_mean`. Noise is independent from cell to
cell and its power exponential (square-law detector). For a window or zero padding, which
correlate cells, see `theory.cfar_correlated_cells` and `theory.cfar_calibration`.

Parameters of all functions:

false_alarm_probability : array
    For the cell under test, from 1e-300 to 1 - 1e-9.
factor : array
    A ratio of powers, above 0.
n_training : array of int
    Training cells, N, at least 1. Where there are halves, those in both together, an even
    number, or a pair: those in each.
n_summed : array of int
    Powers that are summed in each cell, K: receivers, or pulses; at most 1e7, except in the
    probability of cell averaging.
rank : array of int
    Which training cell in order of power, k: 1 for the smallest, N for the largest.

Arrays broadcast against each other. Each function raises `InvalidSetting` if one of them is out
of these bounds. For 2 to 10 000 training cells and false-alarm probabilities from 1e-12 to 0.1,
factors are good to 1e-12 of their value and probabilities to 1e-9 of theirs.

References
----------
H. M. Finn and R. S. Johnson, Adaptive detection mode with threshold control as a function of
spatially sampled clutter-level estimates, RCA Review 29, 1968. V. G. Hansen and
J. H. Sawyers, Detectability loss due to greatest-of selection in a cell-averaging CFAR, IEEE
Trans. AES 16(1), 1980. G. V. Trunk, Range resolution of targets using automatic detectors,
IEEE Trans. AES 14(5), 1978. H. Rohling, Radar CFAR thresholding in clutter and multiple
target situations, IEEE Trans. AES 19(4), 1983. P. P. Gandhi and S. A. Kassam, Analysis of
CFAR processors in nonhomogeneous background, IEEE Trans. AES 24(4), 1988.
"""

import math
from collections.abc import Callable

import numpy as np
import scipy
from numpy.typing import ArrayLike

from dechirp.core.checks import (
    LARGEST_MAGNITUDE,
    check_false_alarm_probability,
    check_integer,
    check_positive_ratios,
)
from dechirp.core.elementwise import elementwise
from dechirp.core.errors import InvalidSetting
from dechirp.theory.cfar_ordered_statistic import OrderedStatisticLaw
from dechirp.theory.training_cells import (
    count_training_powers,
    likely_event_counts,
    n_training_of_each_half,
    noise_sum_below_probability,
    noise_sum_exceeds_probability,
    order_statistic_step_rates,
)

__all__ = [
    "cell_averaging_factor",
    "cell_averaging_false_alarm_probability",
    "greatest_of_factor",
    "greatest_of_false_alarm_probability",
    "ordered_statistic_factor",
    "ordered_statistic_false_alarm_probability",
    "smallest_of_factor",
    "smallest_of_false_alarm_probability",
]

_MIN_POSITIVE = 5e-324  # the least float above 0: the root lies above 1e-300


@elementwise
def cell_averaging_factor(
    false_alarm_probability: float, *, n_training: int, n_summed: int = 1
) -> float:
    """Return the ratio of threshold to the mean of the training cells.

    One power: N (Pfa^(-1/N) - 1). K summed powers: the root of
    Pfa = sum_{j<K} C(NK + j - 1, j) a^j / (1 + a)^(NK + j), a = factor / N, relative to the
    mean of the summed cells (K = 8, N = 32, 1e-6: 3.807).

    Parameters
    ----------
    false_alarm_probability : array
        Probability of a false alarm in a cell, from 1e-300 to 1 - 1e-9.
    n_training : array of int
        Training cells N, at least 1.
    n_summed : array of int
        Powers K that are summed in each cell, from 1 to 1e7.
    """
    check_false_alarm_probability("false_alarm_probability", false_alarm_probability)
    shape = count_training_powers(n_training, n_summed)
    if n_summed == 1:
        return float(n_training * np.expm1(-np.log(false_alarm_probability) / n_training))
    event_counts = likely_event_counts(n_summed)
    log_ways = _log_ways(shape, event_counts)

    def excess(log_a: float) -> float:
        # Logarithms of a / (1 + a) and 1 / (1 + a), for the smallest probabilities as well.
        go, stop = -np.logaddexp(0, -log_a), -np.logaddexp(0, log_a)
        log_probability = shape * stop + scipy.special.logsumexp(log_ways + event_counts * go)
        return float(log_probability - np.log(false_alarm_probability))

    from scipy.optimize import brentq  # 0.2 s, unused by most commands

    # Counts are left out only where alarms are certain.
    low = math.log(_certain_alarm_factor(n_summed) / n_training) if event_counts[0] else -60.0
    return n_training * math.exp(brentq(excess, low, 700.0, xtol=1e-14))


@elementwise
def ordered_statistic_factor(
    false_alarm_probability: float, *, n_training: int, rank: int, n_summed: int = 1
) -> float:
    """Return the ratio of threshold to the k-th smallest cell (N = 24, k = 18, 1e-6: 16.293).

    One power: the root of Pfa = prod_{i<k} (N - i) / (N - i + factor). K summed powers: that
    of `theory.cfar_ordered_statistic`, relative to a summed cell.

    Parameters
    ----------
    false_alarm_probability : array
        Probability of a false alarm in a cell, from 1e-300 to 1 - 1e-9.
    n_training : array of int
        Training cells N, at least 1.
    rank : array of int
        Place k of a training cell in order of power, 1 for the smallest to N for the largest.
    n_summed : array of int
        Powers K that are summed in each cell, from 1 to 1e7.
    """
    check_false_alarm_probability("false_alarm_probability", false_alarm_probability)
    check_integer("n_summed", n_summed, at_least=1)
    rates = order_statistic_step_rates(n_training, rank)
    log_pfa = math.log(false_alarm_probability)
    if n_summed > 1:
        law = OrderedStatisticLaw(n_training=n_training, rank=rank, n_summed=n_summed)
        return find_decreasing_root(
            lambda factor: law.log_false_alarm_probability(factor) - log_pfa, start=1.0
        )
    # Bounds: every step as short as the first, or as long as the last.
    step = math.expm1(-log_pfa / rank)
    return _find_root_on_log_scale(
        lambda factor: float(np.sum(np.log1p(factor / rates))) + log_pfa,
        float(rates[-1]) * step,
        float(rates[0]) * step,
    )


@elementwise
def greatest_of_factor(
    false_alarm_probability: float, *, n_training: int | tuple[int, int], n_summed: int = 1
) -> float:
    """Return the ratio of threshold to the larger mean of both halves (N = 16, 1e-6: 19.356).

    The root of Pfa = 2 (1 + T)^-n I_{1 / (2 + T)}(n, n), with n = N / 2, T = factor / n and
    I the regularised incomplete beta function: the usual alternating sum without its
    cancellation. For halves of n and m cells, either the larger, and K summed powers

        Pfa = sum_{n, m} sum_{j<K} C(nK + j - 1, j) T^j (1 + T)^-(nK + j) P(j),

    with P(j) = I_{m / (m + n (1 + T))}(mK, nK + j), and T = factor / n again.

    Parameters
    ----------
    false_alarm_probability : array
        Probability of a false alarm in a cell, from 1e-300 to 1 - 1e-9.
    n_training : array of int, or a pair
        Training cells of both halves, an even number; or a pair, those in each half.
    n_summed : array of int
        Powers K that are summed in each cell, from 1 to 1e7.
    """
    return _find_factor_of_halves(
        greatest_of_false_alarm_probability, false_alarm_probability, n_training, n_summed
    )


@elementwise
def smallest_of_factor(
    false_alarm_probability: float, *, n_training: int | tuple[int, int], n_summed: int = 1
) -> float:
    """Return the ratio of threshold to the smaller mean of both halves (N = 16, 1e-6: 41.057).

    The root of Pfa = 2 sum_{k<n} C(n + k - 1, k) (2 + T)^-(n + k), with n = N / 2 and
    T = factor / n; for other halves and K summed powers as `greatest_of_factor` has it, with
    1 - P(j) instead of P(j).

    Parameters
    ----------
    false_alarm_probability : array
        Probability of a false alarm in a cell, from 1e-300 to 1 - 1e-9.
    n_training : array of int, or a pair
        Training cells of both halves, an even number; or a pair, those in each half.
    n_summed : array of int
        Powers K that are summed in each cell, from 1 to 1e7.
    """
    return _find_factor_of_halves(
        smallest_of_false_alarm_probability, false_alarm_probability, n_training, n_summed
    )


@elementwise
def cell_averaging_false_alarm_probability(
    factor: ArrayLike, *, n_training: int, n_summed: int = 1
) -> np.ndarray:
    """Return the probability that noise exceeds factor times the mean of the training cells.

    Parameters
    ----------
    factor : array
        Ratio of the threshold to the mean of the training cells, above 0.
    n_training : array of int
        Training cells N, at least 1.
    n_summed : array of int
        Powers K that are summed in each cell, at least 1.
    """
    shape = count_training_powers(n_training, n_summed)
    a = check_positive_ratios("factor", factor) / n_training
    if n_summed == 1:
        return np.exp(-n_training * np.log1p(a))
    return noise_sum_exceeds_probability(n_summed, a, shape)


@elementwise
def ordered_statistic_false_alarm_probability(
    factor: ArrayLike, *, n_training: int, rank: int, n_summed: int = 1
) -> np.ndarray:
    """Return the probability that noise exceeds factor times the k-th smallest training cell.

    Parameters
    ----------
    factor : array
        Ratio of the threshold to the k-th smallest cell, above 0.
    n_training : array of int
        Training cells N, at least 1.
    rank : array of int
        Place k of a training cell in order of power, 1 for the smallest to N for the largest.
    n_summed : array of int
        Powers K that are summed in each cell, from 1 to 1e7.
    """
    check_integer("n_summed", n_summed, at_least=1)
    rates = order_statistic_step_rates(n_training, rank)
    factors = check_positive_ratios("factor", factor)
    if n_summed > 1:
        law = OrderedStatisticLaw(n_training=n_training, rank=rank, n_summed=n_summed)
        logs = [-law.log_false_alarm_probability(value) for value in factors.flat]
    else:
        logs = [np.sum(np.log1p(value / rates)) for value in factors.flat]
    return np.exp(-np.reshape(logs, factors.shape))


@elementwise
def greatest_of_false_alarm_probability(
    factor: ArrayLike, *, n_training: int | tuple[int, int], n_summed: int = 1
) -> np.ndarray:
    """Return the probability that noise exceeds factor times the larger mean of both halves.

    Parameters
    ----------
    factor : array
        Ratio of the threshold to the larger mean, above 0.
    n_training : array of int, or a pair
        Training cells of both halves, an even number; or a pair, those in each half.
    n_summed : array of int
        Powers K that are summed in each cell, from 1 to 1e7.
    """
    return _greatest_or_smallest_of_false_alarm_probability(
        factor, n_training, n_summed, selection_probability=noise_sum_exceeds_probability
    )


@elementwise
def smallest_of_false_alarm_probability(
    factor: ArrayLike, *, n_training: int | tuple[int, int], n_summed: int = 1
) -> np.ndarray:
    """Return the probability that noise exceeds factor times the smaller mean of both halves.

    Parameters
    ----------
    factor : array
        Ratio of the threshold to the smaller mean, above 0.
    n_training : array of int, or a pair
        Training cells of both halves, an even number; or a pair, those in each half.
    n_summed : array of int
        Powers K that are summed in each cell, from 1 to 1e7.
    """
    return _greatest_or_smallest_of_false_alarm_probability(
        factor, n_training, n_summed, selection_probability=noise_sum_below_probability
    )


def _greatest_or_smallest_of_false_alarm_probability(
    factor: ArrayLike,
    n_training: int | tuple[int, int],
    n_summed: int,
    *,
    selection_probability: Callable[..., np.ndarray],
) -> np.ndarray:
    """Return the alarm probability over the mean of the half that wins the comparison of sums."""
    factors = check_positive_ratios("factor", factor)
    n, m = n_training_of_each_half(n_training)
    halves = [(n, 2)] if n == m else [(n, 1), (m, 1)]
    event_counts = likely_event_counts(n_summed)
    probability = np.zeros(factors.size)
    for n_own, n_equal in halves:
        n_other = n + m - n_own
        shape = count_training_powers(n_own, n_summed)
        log_ways = _log_ways(shape, event_counts)
        # The cell under test exceeds T x, x the sum of this half, if fewer than K events fall
        # into T x. Weighted by the probability of j events, x is again a gamma variate, of shape
        # + j and 1 + T times smaller, and must still win the comparison with the other half.
        for index, t in enumerate(factors.ravel() / n_own):
            comparison_probabilities = selection_probability(
                shape + event_counts,
                (1 + t) * n_own / n_other,
                count_training_powers(n_other, n_summed),
            )
            log_weights = log_ways - shape * np.log1p(t) - event_counts * np.log1p(1 / t)
            probability[index] += n_equal * (np.exp(log_weights) @ comparison_probabilities)
    if event_counts[0]:
        probability[factors.ravel() < _certain_alarm_factor(n_summed)] = 1.0
    return probability.reshape(factors.shape)


def _certain_alarm_factor(n_summed: int) -> float:
    """Return the factor, ten standard deviations below 1, below which alarms are certain.

    The ratio of sums of many powers deviates from 1 by at most sqrt(2 / K).
    """
    return 1 - 15 / math.sqrt(n_summed)


def _log_ways(shape: int, event_counts: np.ndarray) -> np.ndarray:
    """Return ln C(shape + j - 1, j) of event counts j that follow one another."""
    growth = np.log1p((shape - 1) / np.arange(1, event_counts[-1] + 1))
    log_first = np.sum(growth[: event_counts[0]])
    return np.asarray(log_first + np.concatenate([[0.0], np.cumsum(growth[event_counts[0] :])]))


def _find_factor_of_halves(
    probability_of_factor: Callable[..., float | np.ndarray],
    false_alarm_probability: float,
    n_training: int | tuple[int, int],
    n_summed: int,
) -> float:
    """Find the factor over the mean of one half, from that over the mean of both."""
    check_false_alarm_probability("false_alarm_probability", false_alarm_probability)
    log_pfa = math.log(false_alarm_probability)
    n_cells = sum(n_training_of_each_half(n_training))

    def excess(factor: float) -> float:
        if factor > LARGEST_MAGNITUDE:
            raise InvalidSetting(
                "false_alarm_probability",
                value=false_alarm_probability,
                expected=f"a factor up to {LARGEST_MAGNITUDE:g} with {n_cells} training cells",
                fix="give a larger probability, or more training cells",
            )
        probability = probability_of_factor(factor, n_training=n_training, n_summed=n_summed)
        return math.log(max(float(probability), _MIN_POSITIVE)) - log_pfa

    start = cell_averaging_factor(false_alarm_probability, n_training=n_cells, n_summed=n_summed)
    return find_decreasing_root(excess, start=start)


def find_decreasing_root(excess: Callable[[float], float], *, start: float) -> float:
    """Find the positive root of a decreasing function, however far from the start."""
    low = high = start
    while excess(low) < 0:
        low /= 2
    while excess(high) > 0:
        high *= 2
    return _find_root_on_log_scale(excess, low, high)


def _find_root_on_log_scale(excess: Callable[[float], float], low: float, high: float) -> float:
    """Find a positive root between bounds, which may equal the root up to rounding."""
    from scipy.optimize import brentq  # 0.2 s, unused by most commands

    log_root = brentq(
        lambda log: excess(math.exp(log)),
        math.log(low) - 1e-3,
        math.log(high) + 1e-3,
        xtol=1e-15,
    )
    return math.exp(log_root)
