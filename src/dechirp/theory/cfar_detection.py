"""CFAR with a target in the cell under test: detection probability, required snr, loss.

Everything follows from the events of `theory.fluctuation`: with M of them below the threshold,
noise summed over K powers and a target that is worth J events exceed it with

    Pd = P(M < K + J) = sum_m P(M = m) P(J > m - K).

The threshold is chance too. It makes M negative binomial for cell averaging, and a sum of k
geometric counts for the k-th smallest cell, as the steps from one cell in order to the next
are independent and exponential. No term is negative, so the sums lose no digits. Where the
target is exponential itself, it is noise 1 + snr times as strong: Pd is the false-alarm
probability of factor / (1 + snr).

The parameters mean the same in all functions. `n_training`, `n_summed` and `rank` are those of
`theory.cfar`, `factor` is one of its factors, one number, and

snr : array
    Mean power of the target over that of noise, in each of the powers that are summed; finite,
    0 or more; any shape, which the result has as well.
swerling : int
    0 for a steady target, 1 to 4 for Swerling's cases (`theory.fluctuation`).

Each function raises `InvalidSetting` if one of them is out of bounds. For 2 to 10 000 training
cells, false-alarm probabilities from 1e-12 to 0.1 and -30 to 40 dB, probabilities are good to
1e-9 of their value. Sums have about K snr terms for a steady target, and at most 70 times as
many for one that fluctuates; `InvalidSetting` is raised before more than 1e8 of them, or 1e6
for an ordered statistic, where the time goes with their square.

References
----------
Those of `theory.cfar`.
"""

import math
from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq
from scipy.special import betaincinv, gammaincinv

from dechirp.core.checks import detection_above_false_alarms, number, ratios
from dechirp.core.errors import InvalidSetting
from dechirp.theory.cfar import (
    cell_averaging_factor,
    cell_averaging_false_alarm_probability,
    greatest_of_false_alarm_probability,
    ordered_statistic_false_alarm_probability,
    smallest_of_false_alarm_probability,
)
from dechirp.theory.detection import required_snr
from dechirp.theory.fluctuation import RARE, at_least, shape_of, span
from dechirp.theory.training import exceeds, falls_below, halves_of, n_powers, step_rates


def cell_averaging_detection_probability(
    snr: ArrayLike, factor: float, *, n_training: int, n_summed: int = 1, swerling: int = 0
) -> np.ndarray:
    """Probability that a target exceeds factor times the mean of the training cells."""
    chi, of_target = ratios("snr", snr), shape_of(swerling, n_summed)
    of_noise = n_powers(n_training, n_summed)
    factor = number("factor", factor, above=0)
    a = factor / n_training
    if of_target == n_summed:  # exponential in each power, as noise is
        return cell_averaging_false_alarm_probability(
            factor / (1 + chi), n_training=n_training, n_summed=n_summed
        )
    if (of_target, n_summed) == (2, 1):
        c = 1 + chi / 2
        passed = cell_averaging_false_alarm_probability(factor / c, n_training=n_training)
        return np.asarray(passed * (1 + (c - 1) / c * n_training * a / (c + a)))
    return _detected(
        n_summed * chi,
        of_target,
        lambda n: _negative_binomial(n, of_noise, a),
        span(of_noise * a, of_noise)[1],
        n_summed=n_summed,
    )


def ordered_statistic_detection_probability(
    snr: ArrayLike, factor: float, *, n_training: int, rank: int, swerling: int = 0
) -> np.ndarray:
    """Probability that a target exceeds factor times the k-th smallest training cell.

    A steady target of 40 dB takes some 50 ms in the worst case, where the rank is 1 or 2, and
    ten times that for every 5 dB more.
    """
    chi, of_target = ratios("snr", snr), shape_of(swerling, 1)
    factor = number("factor", factor, above=0)
    rates = step_rates(n_training, rank)
    if of_target == 1:
        return ordered_statistic_false_alarm_probability(
            factor / (1 + chi), n_training=n_training, rank=rank
        )
    if of_target == 2:
        c = 1 + chi / 2
        passed = ordered_statistic_false_alarm_probability(
            factor / c, n_training=n_training, rank=rank
        )
        steps = [np.sum(factor / (one * rates + factor)) for one in c.flat]
        return np.asarray(passed * (1 + (c - 1) / c * np.reshape(steps, c.shape)))
    # The largest statistic to expect: -ln of a beta variate.
    longest = -math.log(betaincinv(n_training - rank + 1, rank, RARE))
    return _detected(
        chi,
        of_target,
        lambda n: _sum_of_geometrics(n, factor / rates),
        span(longest * factor, math.inf)[1],
        at_most=10**6,
    )


def greatest_of_detection_probability(
    snr: ArrayLike, factor: float, *, n_training: int | tuple[int, int], swerling: int = 0
) -> np.ndarray:
    """Probability that a target exceeds factor times the larger mean of the two halves."""
    alarms = greatest_of_false_alarm_probability
    return _over_a_half(snr, factor, n_training, swerling, alarms=alarms, of_other=exceeds)


def smallest_of_detection_probability(
    snr: ArrayLike, factor: float, *, n_training: int | tuple[int, int], swerling: int = 0
) -> np.ndarray:
    """Probability that a target exceeds factor times the smaller mean of the two halves."""
    alarms = smallest_of_false_alarm_probability
    return _over_a_half(snr, factor, n_training, swerling, alarms=alarms, of_other=falls_below)


def cell_averaging_required_snr(
    detection_probability: float,
    false_alarm_probability: float,
    *,
    n_training: int,
    n_summed: int = 1,
    swerling: int = 0,
) -> float:
    """Mean snr, in each of the summed powers, at which a target is detected so often.

    The inverse of `cell_averaging_detection_probability` with the factor of that
    false-alarm probability, to 1e-10 of its value up to a detection probability of 1 - 1e-6,
    and 1e-7 at 1 - 1e-9. Raises `InvalidSetting` too unless false-alarm probability <
    detection probability <= 1 - 1e-9.

    Takes milliseconds; where a steady target needs 65 dB or more, as over two training cells
    at 1e-12, a second, and several for a detection probability near 1.
    """
    detection_above_false_alarms(detection_probability, false_alarm_probability)
    if detection_probability > 1 - 1e-9:
        raise InvalidSetting(
            "detection_probability",
            got=detection_probability,
            need="at most 1 - 1e-9",
            fix="Ask for less: no target always exceeds an estimated threshold.",
        )
    law = {"n_training": n_training, "n_summed": n_summed}
    factor = cell_averaging_factor(false_alarm_probability, **law)

    @cache
    def excess(log_snr: float) -> float:
        found = cell_averaging_detection_probability(
            math.exp(log_snr), factor, swerling=swerling, **law
        )
        return float(found) - detection_probability

    # A first guess, since high ratios take long: that in known noise, or that of a steady
    # target without noise of its own (good to 1e-6 for two training cells at 1e-12).
    known = required_snr(
        detection_probability, false_alarm_probability, n_summed=n_summed, swerling=swerling
    )
    limit = factor / n_training * gammaincinv(n_training * n_summed, detection_probability)
    low = high = math.log(max(known, limit / n_summed))
    step = 0.01
    while excess(high) < 0:
        low, high, step = high, high + step, 2 * step
    while excess(low) >= 0:
        if low < -60:  # probabilities that differ in the last digit only
            return math.exp(low)
        low, high, step = low - step, low, 2 * step
    return math.exp(brentq(excess, low, high, xtol=1e-12))


def cell_averaging_loss(
    detection_probability: float,
    false_alarm_probability: float,
    *,
    n_training: int,
    n_summed: int = 1,
    swerling: int = 0,
) -> float:
    """The snr that cell averaging needs over that in known noise, a ratio of at least 1.

    For 0.9 at 1e-6 and a steady target: 2.05 dB for 16 training cells, 0.98 for 32, 0.047
    for 644. Bounds and time are those of `cell_averaging_required_snr`.
    """
    adaptive = cell_averaging_required_snr(
        detection_probability,
        false_alarm_probability,
        n_training=n_training,
        n_summed=n_summed,
        swerling=swerling,
    )
    known = required_snr(
        detection_probability, false_alarm_probability, n_summed=n_summed, swerling=swerling
    )
    return adaptive / known


def _over_a_half(
    snr: ArrayLike,
    factor: float,
    n_training: int | tuple[int, int],
    swerling: int,
    *,
    alarms: Callable[..., np.ndarray],
    of_other: Callable[..., np.ndarray],
) -> np.ndarray:
    """Detection over the mean of one half, taken for how its sum compares with the other's.

    `of_other` is the probability that sums compare so, `alarms` the false-alarm probability.
    """
    chi, of_target = ratios("snr", snr), shape_of(swerling, 1)
    sizes = halves_of(n_training)
    factor = number("factor", factor, above=0)
    if of_target == 1:
        return alarms(factor / (1 + chi), n_training=n_training)

    def counts(n: int) -> np.ndarray:
        # Either half is taken. Its sum, weighted by m events, is a gamma variate of half + m
        # again, 1 + T times smaller, and must still compare so with the other.
        found = np.zeros(n)
        for own, other in (sizes, sizes[::-1]):
            t = factor / own
            compares = of_other(own + np.arange(n), (1 + t) * own / other, other)
            found += _negative_binomial(n, own, t) * compares
        return found

    longest = max(span(factor, own)[1] for own in sizes)
    return _detected(chi, of_target, counts, longest)


def _detected(
    mean: np.ndarray,
    shape: float,
    counts: Callable[[int], np.ndarray],
    longest: int,
    *,
    n_summed: int = 1,
    at_most: int = 10**8,
) -> np.ndarray:
    """P(M < K + J) for every mean of J: `counts(n)` are P(M = m) for m < n, `longest` is rare."""
    spans = [span(one, shape) for one in mean.flat]
    n = n_summed + min(longest, max((last for _, last in spans), default=0))
    if n > at_most:
        raise InvalidSetting(
            "snr",
            got=f"{mean.max() / n_summed:.3g} over a threshold that needs {n:.3g} terms",
            need=f"so low that the sum has at most {at_most:.0e} terms",
            fix="Lower it, or train over more cells, or allow more false alarms.",
        )
    pmf = counts(n)
    found = []
    for one, (first, last) in zip(mean.flat, spans, strict=True):
        # J is more than m - K surely, perhaps, or hardly ever.
        surely, perhaps = np.split(pmf[: n_summed + last], [n_summed + first])
        j = first + 1.0 + np.arange(perhaps.size)
        found.append(surely.sum() + perhaps @ at_least(j, one, shape))
    return np.minimum(np.reshape(found, mean.shape), 1.0)


def _negative_binomial(n: int, shape: int, a: float) -> np.ndarray:
    """P(M = m) for m < n, where M is Poisson of mean a times a gamma variate of `shape`."""
    m = np.arange(1, n)
    # ln of a / (1 + a): a rounding error of the quotient would count once in every term.
    go = -float(np.logaddexp(0, -math.log(a)))
    growth = np.log((shape + m - 1) / m) + go
    return np.exp(np.concatenate([[0], np.cumsum(growth)]) - shape * math.log1p(a))


def _sum_of_geometrics(n: int, means: np.ndarray) -> np.ndarray:
    """P(M = m) for m < n, where M is the sum of independent geometric counts.

    m p_m = sum_i s_i p_(m - i), with s_i the sum of the i-th powers of the probabilities
    that a count goes on: nothing is subtracted.
    """
    goes_on = means / (1 + means)
    powers, sums = np.ones_like(means), np.empty(n)
    for i in range(n):
        sums[-1 - i] = powers.sum()  # s_i, the last first
        powers *= goes_on
    pmf = np.zeros(n)
    pmf[0], log_scale = 1.0, -np.sum(np.log1p(means))
    for m in range(1, n):
        # Not `@`, whose threads cost more than they save.
        pmf[m] = np.einsum("i,i", sums[n - 1 - m : n - 1], pmf[:m]) / m
        if pmf[m] > 1e200:  # a factor so large that p_0 is no float
            pmf *= 1e-200
            log_scale += 200 * math.log(10)
    return pmf * np.exp(log_scale)
