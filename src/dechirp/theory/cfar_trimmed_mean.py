"""Trimmed-mean CFAR: the mean of the training cells without the smallest and the largest.

The steps from one of N exponential cells in order of power to the next are independent, and
exponential with rates N, N - 1, ... So the mean of n cells in the middle of the order, the
smallest and the largest left out, is a sum of independent exponentials of means w_i, and

    Pfa = prod_i 1 / (1 + factor w_i),

with the limits of Rohling's product for one cell of the order, and cell averaging for all cells.
One power per cell; noise independent from cell to cell. For summed powers and for correlated
cells see `theory.cfar_calibration`.

`n_smallest` and `n_largest` are the cells left out at each end, 0 or more; the other
parameters are those of `theory.cfar`, with its bounds and errors.

References
----------
P. P. Gandhi and S. A. Kassam, Analysis of CFAR processors in nonhomogeneous background, IEEE
Trans. AES 24(4), 1988.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from dechirp.core.checks import (
    check_false_alarm_probability,
    check_integer,
    check_non_negative_ratios,
    check_positive_ratios,
)
from dechirp.core.elementwise import elementwise
from dechirp.theory.cfar import find_decreasing_root
from dechirp.theory.training_cells import order_statistic_step_rates

__all__ = [
    "trimmed_mean_detection_probability",
    "trimmed_mean_factor",
    "trimmed_mean_false_alarm_probability",
]


@elementwise
def trimmed_mean_factor(
    false_alarm_probability: float, *, n_training: int, n_smallest: int, n_largest: int
) -> float:
    """Return the ratio of threshold to the trimmed mean of the training cells.

    Parameters
    ----------
    false_alarm_probability : array
        Probability of a false alarm in a cell, from 1e-300 to 1 - 1e-9.
    n_training : array of int
        Training cells N, at least 1; those that are left out count.
    n_smallest, n_largest : array of int
        Training cells left out at the low and at the high end, 0 or more; one must remain.
    """
    check_false_alarm_probability("false_alarm_probability", false_alarm_probability)
    means = _mean_step_contributions_to_trimmed_mean(n_training, n_smallest, n_largest)
    log_pfa = math.log(false_alarm_probability)
    return find_decreasing_root(
        lambda factor: -float(np.sum(np.log1p(factor * means))) - log_pfa, start=1.0
    )


@elementwise
def trimmed_mean_false_alarm_probability(
    factor: ArrayLike, *, n_training: int, n_smallest: int, n_largest: int
) -> np.ndarray:
    """Return the probability that noise exceeds factor times the trimmed mean.

    Parameters
    ----------
    factor : array
        Ratio of the threshold to the trimmed mean, above 0.
    n_training : array of int
        Training cells N, at least 1; those that are left out count.
    n_smallest, n_largest : array of int
        Training cells left out at the low and at the high end, 0 or more; one must remain.
    """
    means = _mean_step_contributions_to_trimmed_mean(n_training, n_smallest, n_largest)
    factors = check_positive_ratios("factor", factor)
    logs = [np.sum(np.log1p(value * means)) for value in factors.flat]
    return np.exp(-np.reshape(logs, factors.shape))


@elementwise
def trimmed_mean_detection_probability(
    snr: ArrayLike, factor: float, *, n_training: int, n_smallest: int, n_largest: int
) -> np.ndarray:
    """Return the probability that a Swerling 1 target exceeds factor times the trimmed mean.

    Its power is exponential, like that of noise 1 + snr times as strong.

    Parameters
    ----------
    snr : array
        Mean power of the target over that of noise in a cell, a ratio, 0 or more.
    factor : array
        Ratio of the threshold to the trimmed mean, above 0.
    n_training : array of int
        Training cells N, at least 1; those that are left out count.
    n_smallest, n_largest : array of int
        Training cells left out at the low and at the high end, 0 or more; one must remain.
    """
    check_positive_ratios("factor", factor)
    return trimmed_mean_false_alarm_probability(
        factor / (1 + check_non_negative_ratios("snr", snr)),
        n_training=n_training,
        n_smallest=n_smallest,
        n_largest=n_largest,
    )


def _mean_step_contributions_to_trimmed_mean(
    n_training: int, n_smallest: int, n_largest: int
) -> np.ndarray:
    """Return the mean contribution of each step to the trimmed mean, (n_training - n_largest,)."""
    check_integer("n_training", n_training, at_least=1)
    check_integer("n_smallest", n_smallest, at_least=0, at_most=n_training - 1)
    check_integer("n_largest", n_largest, at_least=0, at_most=n_training - n_smallest - 1)
    last = n_training - n_largest
    rates = order_statistic_step_rates(n_training, last)
    # A step raises all kept cells after it; the first steps raise all of them.
    n_raised = np.minimum(last - np.arange(last), last - n_smallest)
    return n_raised / ((last - n_smallest) * rates)
