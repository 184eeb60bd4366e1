"""OSPA: one distance between what was found and what is there, a metric on sets of points."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import linear_sum_assignment

from dechirp.core.checks import number
from dechirp.evaluate.points import distances_m

_LARGEST_ORDER = 100  # beyond, a thousandth of the cut-off is below all floats


def ospa_m(found_m: ArrayLike, truth_m: ArrayLike, *, cutoff_m: float, order: float = 1) -> float:
    r"""Optimal subpattern assignment, a mean error per target in metres.

    .. math:: \Bigl(\frac1n \bigl(\min_\pi \sum_{i=1}^m \min(c, |x_i - y_{\pi(i)}|)^p
              + c^p (n - m)\bigr)\Bigr)^{1/p}, \quad m \le n

    Parameters
    ----------
    found_m, truth_m : array (n, d), m
        Positions, in any order; 0 if there are none in either.
    cutoff_m : float
        c: a miss or a false track counts as an error of that size.
    order : float
        p, from 1 to 100: the larger, the more outliers count.

    Raises
    ------
    InvalidSetting
        If a position is not finite, axes differ, or cut-off or order cannot be.

    References
    ----------
    D. Schuhmacher, B.-T. Vo, B.-N. Vo, A Consistent Metric for Performance Evaluation of
    Multi-Object Filters, IEEE Trans. Signal Processing 56(8), 2008.
    """
    cutoff_m = number("cutoff_m", cutoff_m, above=0)
    order = number("order", order, at_least=1, at_most=_LARGEST_ORDER)
    apart_m = np.minimum(distances_m(found_m, truth_m), cutoff_m)
    fewer, more = sorted(apart_m.shape)
    if more == 0:
        return 0.0
    # Over the cut-off, so that high orders overflow nowhere.
    cost = (apart_m / cutoff_m) ** order
    total = cost[linear_sum_assignment(cost)].sum() + (more - fewer)
    return float(cutoff_m * (total / more) ** (1 / order))
