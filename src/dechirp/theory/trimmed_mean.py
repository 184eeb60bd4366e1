"""CFAR over a trimmed mean: the mean of the training cells but the smallest and the largest.

The steps from one of N exponential cells in order of power to the next are independent, and
exponential with rates N, N - 1, ... So the mean of n cells in the middle of the order, the
smallest and the largest left out, is a sum of independent exponentials of means w_i, and

    Pfa = prod_i 1 / (1 + factor w_i),

of which Rohling's product for one cell of the order, and the law of cell averaging for all of
them, are the ends. One power to a cell; noise independent from cell to cell. For powers that are
summed, and for cells that a window ties together, see `theory.calibrated`.

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

from dechirp.core.checks import false_alarms, positive_ratios, ratios, whole
from dechirp.theory.cfar import falling_root
from dechirp.theory.training import step_rates


def trimmed_mean_factor(
    false_alarm_probability: float, *, n_training: int, n_smallest: int, n_largest: int
) -> float:
    """Threshold over the mean of the training cells that are kept."""
    false_alarms("false_alarm_probability", false_alarm_probability)
    means = _step_means(n_training, n_smallest, n_largest)
    log_pfa = math.log(false_alarm_probability)
    return falling_root(
        lambda factor: -float(np.sum(np.log1p(factor * means))) - log_pfa, start=1.0
    )


def trimmed_mean_false_alarm_probability(
    factor: ArrayLike, *, n_training: int, n_smallest: int, n_largest: int
) -> np.ndarray:
    """Probability that noise exceeds factor times the mean of the training cells kept."""
    means = _step_means(n_training, n_smallest, n_largest)
    factors = positive_ratios("factor", factor)
    logs = [np.sum(np.log1p(one * means)) for one in factors.flat]
    return np.exp(-np.reshape(logs, factors.shape))


def trimmed_mean_detection_probability(
    snr: ArrayLike, factor: float, *, n_training: int, n_smallest: int, n_largest: int
) -> np.ndarray:
    """Probability that a target of Swerling's case 1 exceeds factor times that mean.

    Its power is exponential, as that of noise 1 + snr times as strong is.
    """
    return trimmed_mean_false_alarm_probability(
        factor / (1 + ratios("snr", snr)),
        n_training=n_training,
        n_smallest=n_smallest,
        n_largest=n_largest,
    )


def _step_means(n_training: int, n_smallest: int, n_largest: int) -> np.ndarray:
    """Mean of each step's share of the trimmed mean, (n_training - n_largest,)."""
    whole("n_training", n_training, at_least=1)
    whole("n_smallest", n_smallest, at_least=0, at_most=n_training - 1)
    whole("n_largest", n_largest, at_least=0, at_most=n_training - n_smallest - 1)
    last = n_training - n_largest
    # A step raises all cells after it: those that are kept, of which the first few cut none.
    n_raised = np.minimum(last - np.arange(last), last - n_smallest)
    return n_raised / ((last - n_smallest) * step_rates(n_training, last))
