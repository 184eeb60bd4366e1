"""CFAR with a target in the cell under test: detection probability, required SNR, loss.

All results follow from the events of `theory.swerling`: with M of them below the threshold,
noise summed over K powers and a target that contributes J events exceed it with

    Pd = P(M < K + J) = sum_m P(M = m) P(J > m - K).

The threshold is random, too. It makes M negative binomial for cell averaging, and a sum of k
geometric counts for the k-th smallest cell, as the steps from one cell in order to the next
are independent and exponential. No term is negative, so the sums lose no digits. Where the
target is exponential itself, it is noise 1 + snr times as strong: Pd is the false-alarm
probability of factor / (1 + snr).

Parameters of all functions: `n_training`, `n_summed` and `rank` are those of
`theory.cfar`, `factor` is one of its factors, and

snr : array
    Mean power of the target over that of noise, in each of the powers that are summed; finite,
    0 or more.
swerling : array of int
    0 for a steady target, 1 to 4 for Swerling's cases (`theory.swerling`).

Arrays broadcast against each other. Each function raises `InvalidSetting` if one of them is out of
bounds. For 2 to 10 000 training cells, false-alarm probabilities from 1e-12 to 0.1 and -30 to 40
dB, probabilities are good to 1e-9 of their value. Sums have about K snr terms for a steady target,
and at most 70 times as many for one that fluctuates; `InvalidSetting` is raised before more than
1e8 of them, or 1e6 for an ordered statistic, whose time grows with their square.

References
----------
Those of `theory.cfar`.
"""

import math
from collections.abc import Callable
from functools import cache

import numpy as np
import scipy
from numpy.typing import ArrayLike

from dechirp.core.checks import (
    LARGEST_MAGNITUDE,
    check_detection_probability,
    check_non_negative_ratios,
    check_number,
)
from dechirp.core.elementwise import elementwise
from dechirp.core.errors import InvalidSetting
from dechirp.theory.cfar import (
    cell_averaging_factor,
    cell_averaging_false_alarm_probability,
    greatest_of_false_alarm_probability,
    ordered_statistic_false_alarm_probability,
    smallest_of_false_alarm_probability,
)
from dechirp.theory.detection import required_snr
from dechirp.theory.swerling import (
    NEGLIGIBLE,
    likely_count_range,
    probability_count_at_least,
    swerling_shape,
)
from dechirp.theory.training_cells import (
    count_training_powers,
    n_training_of_each_half,
    noise_sum_below_probability,
    noise_sum_exceeds_probability,
    order_statistic_step_rates,
)

__all__ = [
    "cell_averaging_detection_probability",
    "cell_averaging_loss",
    "cell_averaging_required_snr",
    "greatest_of_detection_probability",
    "ordered_statistic_detection_probability",
    "smallest_of_detection_probability",
]


@elementwise
def cell_averaging_detection_probability(
    snr: ArrayLike, factor: float, *, n_training: int, n_summed: int = 1, swerling: int = 0
) -> np.ndarray:
    """Return the probability that a target exceeds factor times the mean of the cells.

    Parameters
    ----------
    snr : array
        Mean power of the target over that of noise in each summed power, a ratio, 0 or more.
    factor : array
        Ratio of the threshold to the mean of the training cells, above 0.
    n_training : array of int
        Training cells N, at least 1.
    n_summed : array of int
        Powers K that are summed in each cell, at least 1.
    swerling : array of int
        0 for a steady target, 1 to 4 for Swerling's cases.
    """
    chi, target_shape = check_non_negative_ratios("snr", snr), swerling_shape(swerling, n_summed)
    noise_shape = count_training_powers(n_training, n_summed)
    factor = check_number("factor", factor, above=0, at_most=LARGEST_MAGNITUDE)
    a = factor / n_training
    if target_shape == n_summed:  # exponential in each power, as noise is
        return cell_averaging_false_alarm_probability(
            factor / (1 + chi), n_training=n_training, n_summed=n_summed
        )
    if (target_shape, n_summed) == (2, 1):
        c = 1 + chi / 2
        exceedance = cell_averaging_false_alarm_probability(factor / c, n_training=n_training)
        return np.asarray(exceedance * (1 + (c - 1) / c * n_training * a / (c + a)))
    return _detection_probability_from_event_counts(
        n_summed * chi,
        target_shape,
        lambda n: _negative_binomial_pmf(n, noise_shape, a),
        likely_count_range(noise_shape * a, noise_shape)[1],
        n_summed=n_summed,
    )


@elementwise
def ordered_statistic_detection_probability(
    snr: ArrayLike, factor: float, *, n_training: int, rank: int, swerling: int = 0
) -> np.ndarray:
    """Return the probability that a target exceeds factor times the k-th smallest cell.

    A steady target of 40 dB takes some 50 ms in the worst case, where the rank is 1 or 2, and
    ten times that for every 5 dB more.

    Parameters
    ----------
    snr : array
        Mean power of the target over that of noise in a cell, a ratio, 0 or more.
    factor : array
        Ratio of the threshold to the k-th smallest cell, above 0.
    n_training : array of int
        Training cells N, at least 1.
    rank : array of int
        Place k of a training cell in order of power, 1 for the smallest to N for the largest.
    swerling : array of int
        0 for a steady target, 1 to 4 for Swerling's cases.
    """
    chi, target_shape = check_non_negative_ratios("snr", snr), swerling_shape(swerling, 1)
    factor = check_number("factor", factor, above=0, at_most=LARGEST_MAGNITUDE)
    rates = order_statistic_step_rates(n_training, rank)
    if target_shape == 1:
        return ordered_statistic_false_alarm_probability(
            factor / (1 + chi), n_training=n_training, rank=rank
        )
    if target_shape == 2:
        c = 1 + chi / 2
        exceedance = ordered_statistic_false_alarm_probability(
            factor / c, n_training=n_training, rank=rank
        )
        steps = [np.sum(factor / (scale * rates + factor)) for scale in c.flat]
        return np.asarray(exceedance * (1 + (c - 1) / c * np.reshape(steps, c.shape)))
    # The largest expected statistic: -ln of a beta variate.
    longest = -math.log(scipy.special.betaincinv(n_training - rank + 1, rank, NEGLIGIBLE))
    return _detection_probability_from_event_counts(
        chi,
        target_shape,
        lambda n: _geometric_sum_pmf(n, factor / rates),
        likely_count_range(longest * factor, math.inf)[1],
        max_terms=10**6,
    )


@elementwise
def greatest_of_detection_probability(
    snr: ArrayLike, factor: float, *, n_training: int | tuple[int, int], swerling: int = 0
) -> np.ndarray:
    """Return the probability that a target exceeds factor times the larger half mean.

    Parameters
    ----------
    snr : array
        Mean power of the target over that of noise in a cell, a ratio, 0 or more.
    factor : array
        Ratio of the threshold to the larger mean, above 0.
    n_training : array of int, or a pair
        Training cells of both halves, an even number; or a pair, those in each half.
    swerling : array of int
        0 for a steady target, 1 to 4 for Swerling's cases.
    """
    alarms = greatest_of_false_alarm_probability
    return _greatest_or_smallest_of_detection_probability(
        snr,
        factor,
        n_training,
        swerling,
        false_alarm_probability=alarms,
        selection_probability=noise_sum_exceeds_probability,
    )


@elementwise
def smallest_of_detection_probability(
    snr: ArrayLike, factor: float, *, n_training: int | tuple[int, int], swerling: int = 0
) -> np.ndarray:
    """Return the probability that a target exceeds factor times the smaller half mean.

    Parameters
    ----------
    snr : array
        Mean power of the target over that of noise in a cell, a ratio, 0 or more.
    factor : array
        Ratio of the threshold to the smaller mean, above 0.
    n_training : array of int, or a pair
        Training cells of both halves, an even number; or a pair, those in each half.
    swerling : array of int
        0 for a steady target, 1 to 4 for Swerling's cases.
    """
    alarms = smallest_of_false_alarm_probability
    return _greatest_or_smallest_of_detection_probability(
        snr,
        factor,
        n_training,
        swerling,
        false_alarm_probability=alarms,
        selection_probability=noise_sum_below_probability,
    )


@elementwise
def cell_averaging_required_snr(
    detection_probability: float,
    false_alarm_probability: float,
    *,
    n_training: int,
    n_summed: int = 1,
    swerling: int = 0,
) -> float:
    """Return the mean SNR in each summed power that reaches a detection probability.

    The inverse of `cell_averaging_detection_probability` with the factor of that
    false-alarm probability, to 1e-10 of its value up to a detection probability of 1 - 1e-6,
    and 1e-7 at 1 - 1e-9. Raises `InvalidSetting` too unless false-alarm probability <
    detection probability <= 1 - 1e-9.

    Takes milliseconds; where a steady target needs 65 dB or more, as over two training cells
    at 1e-12, a second, and several for a detection probability near 1.

    Parameters
    ----------
    detection_probability : array
        Probability that the target is detected, above that of a false alarm and at most 1 - 1e-9.
    false_alarm_probability : array
        Probability of a false alarm in a cell, from 1e-300, below the detection probability.
    n_training : array of int
        Training cells N, at least 1.
    n_summed : array of int
        Powers K that are summed in each cell, at least 1.
    swerling : array of int
        0 for a steady target, 1 to 4 for Swerling's cases.
    """
    check_detection_probability(detection_probability, false_alarm_probability)
    if detection_probability > 1 - 1e-9:
        raise InvalidSetting(
            "detection_probability",
            value=detection_probability,
            expected="at most 1 - 1e-9",
            fix="lower it: no target always exceeds an estimated threshold",
        )
    law = {"n_training": n_training, "n_summed": n_summed}
    factor = cell_averaging_factor(false_alarm_probability, **law)

    @cache
    def excess(log_snr: float) -> float:
        try:
            probability = cell_averaging_detection_probability(
                math.exp(log_snr), factor, swerling=swerling, **law
            )
        except InvalidSetting as error:
            raise InvalidSetting(
                "false_alarm_probability",
                value=f"{false_alarm_probability:g} with {n_training} training cells, which needs"
                f" an SNR of {math.exp(log_snr):.3g}",
                expected=f"a threshold that the target exceeds at {error.mistakes[0].expected}",
                fix="allow more false alarms, or train over more cells",
            ) from error
        return float(probability) - detection_probability

    # Start, since high ratios take long: the SNR in known noise, or that of a steady target
    # without noise (good to 1e-6 for two training cells at 1e-12).
    snr_in_known_noise = required_snr(
        detection_probability, false_alarm_probability, n_summed=n_summed, swerling=swerling
    )
    limit = (
        factor
        / n_training
        * scipy.special.gammaincinv(n_training * n_summed, detection_probability)
    )
    low = high = math.log(max(snr_in_known_noise, limit / n_summed))
    step = 0.01
    while excess(high) < 0:
        low, high, step = high, high + step, 2 * step
    while excess(low) >= 0:
        if low < -60:  # both probabilities agree up to the last digit
            return math.exp(low)
        low, high, step = low - step, low, 2 * step
    return math.exp(scipy.optimize.brentq(excess, low, high, xtol=1e-12))


@elementwise
def cell_averaging_loss(
    detection_probability: float,
    false_alarm_probability: float,
    *,
    n_training: int,
    n_summed: int = 1,
    swerling: int = 0,
) -> float:
    """Return the CFAR loss: SNR for cell averaging over that in known noise, at least 1.

    For 0.9 at 1e-6 and a steady target: 2.05 dB for 16 training cells, 0.98 for 32, 0.047
    for 644. Bounds and time are those of `cell_averaging_required_snr`.

    Parameters
    ----------
    detection_probability : array
        Probability that the target is detected, above that of a false alarm and below 1.
    false_alarm_probability : array
        Probability of a false alarm in a cell, from 1e-300, below the detection probability.
    n_training : array of int
        Training cells N, at least 1.
    n_summed : array of int
        Powers K that are summed in each cell, at least 1.
    swerling : array of int
        0 for a steady target, 1 to 4 for Swerling's cases.
    """
    adaptive = cell_averaging_required_snr(
        detection_probability,
        false_alarm_probability,
        n_training=n_training,
        n_summed=n_summed,
        swerling=swerling,
    )
    snr_in_known_noise = required_snr(
        detection_probability, false_alarm_probability, n_summed=n_summed, swerling=swerling
    )
    return float(adaptive / snr_in_known_noise)


def _greatest_or_smallest_of_detection_probability(
    snr: ArrayLike,
    factor: float,
    n_training: int | tuple[int, int],
    swerling: int,
    *,
    false_alarm_probability: Callable[..., np.ndarray],
    selection_probability: Callable[..., np.ndarray],
) -> np.ndarray:
    """Return the detection probability over the mean of the half that wins the comparison of sums.

    `selection_probability` is the probability of that outcome, `false_alarm_probability` that of an
    alarm.
    """
    chi, target_shape = check_non_negative_ratios("snr", snr), swerling_shape(swerling, 1)
    sizes = n_training_of_each_half(n_training)
    factor = check_number("factor", factor, above=0, at_most=LARGEST_MAGNITUDE)
    if target_shape == 1:
        return false_alarm_probability(factor / (1 + chi), n_training=n_training)

    def counts(n: int) -> np.ndarray:
        # Sum over both halves. The sum of a half, weighted by m events, is again a gamma variate
        # of half + m, 1 + T times smaller, and must still win the comparison with the other.
        pmf = np.zeros(n)
        for n_own, n_other in (sizes, sizes[::-1]):
            t = factor / n_own
            comparison_probability = selection_probability(
                n_own + np.arange(n), (1 + t) * n_own / n_other, n_other
            )
            pmf += _negative_binomial_pmf(n, n_own, t) * comparison_probability
        return pmf

    longest = max(likely_count_range(factor, n_own)[1] for n_own in sizes)
    return _detection_probability_from_event_counts(chi, target_shape, counts, longest)


def _detection_probability_from_event_counts(
    target_mean_counts: np.ndarray,
    target_shape: float,
    threshold_count_pmf: Callable[[int], np.ndarray],
    max_threshold_count: int,
    *,
    n_summed: int = 1,
    max_terms: int = 10**8,
) -> np.ndarray:
    """Return P(M < K + J) for each mean of J; `threshold_count_pmf(n)` holds P(M = m) for m < n."""
    spans = [likely_count_range(count_mean, target_shape) for count_mean in target_mean_counts.flat]
    n = n_summed + min(max_threshold_count, max((last for _, last in spans), default=0))
    if n > max_terms:
        raise InvalidSetting(
            "snr",
            value=f"{target_mean_counts.max() / n_summed:.3g} over a threshold that needs"
            f" {n:.3g} terms",
            expected=f"an SNR whose sum has at most {max_terms:.0e} terms",
            fix="lower it, train over more cells, or allow more false alarms",
        )
    pmf = threshold_count_pmf(n)
    probabilities = []
    for count_mean, (first, last) in zip(target_mean_counts.flat, spans, strict=True):
        # J exceeds m - K certainly, possibly, or practically never.
        certain, uncertain = np.split(pmf[: n_summed + last], [n_summed + first])
        j = first + 1.0 + np.arange(uncertain.size)
        probabilities.append(
            certain.sum() + uncertain @ probability_count_at_least(j, count_mean, target_shape)
        )
    return np.minimum(np.reshape(probabilities, target_mean_counts.shape), 1.0)


def _negative_binomial_pmf(n_counts: int, shape: int, a: float) -> np.ndarray:
    """Return P(M = m) for m < n; M is Poisson with mean a times a gamma variate of `shape`."""
    m = np.arange(1, n_counts)
    # ln of a / (1 + a): a rounding error of the quotient would count once in every term.
    go = -float(np.logaddexp(0, -math.log(a)))
    growth = np.log((shape + m - 1) / m) + go
    return np.exp(np.concatenate([[0], np.cumsum(growth)]) - shape * math.log1p(a))


def _geometric_sum_pmf(n_counts: int, means: np.ndarray) -> np.ndarray:
    """Return P(M = m) for m < n; M is a sum of independent geometric counts.

    m p_m = sum_i s_i p_(m - i), with s_i the sum of the i-th powers of the probabilities
    that a count continues; all terms are positive.
    """
    goes_on = means / (1 + means)
    powers, sums = np.ones_like(means), np.empty(n_counts)
    for i in range(n_counts):
        sums[-1 - i] = powers.sum()  # s_i, the last first
        powers *= goes_on
    pmf = np.zeros(n_counts)
    pmf[0], log_scale = 1.0, -np.sum(np.log1p(means))
    for m in range(1, n_counts):
        # einsum, since the threads of `@` cost more than they save.
        pmf[m] = np.einsum("i,i", sums[n_counts - 1 - m : n_counts - 1], pmf[:m]) / m
        if pmf[m] > 1e200:  # a factor so large that p_0 is no float
            pmf *= 1e-200
            log_scale += 200 * math.log(10)
    return pmf * np.exp(log_scale)
