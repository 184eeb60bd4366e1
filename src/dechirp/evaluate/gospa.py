"""GOSPA: one error of a frame, and its parts: localisation, missed targets, false tracks."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import linear_sum_assignment

from dechirp.core.checks import number
from dechirp.evaluate.points import distances_m

_LARGEST_ORDER = 100  # beyond, a thousandth of the cut-off is below all floats


class Gospa(NamedTuple):
    """The error in metres, and what it is made of."""

    error_m: float
    localisation: float
    """Sum over assigned pairs of their distance to the order p, m^p."""
    n_missed: int
    n_false: int


def gospa(
    found_m: ArrayLike,
    truth_m: ArrayLike,
    *,
    cutoff_m: float,
    order: float = 2,
    alpha: float = 2,
) -> Gospa:
    r"""Generalised optimal subpattern assignment.

    .. math:: \Bigl(\min_\gamma \sum_{(i,j) \in \gamma} d(x_i, y_j)^p
              + \frac{c^p}{\alpha} (n_{missed} + n_{false})\Bigr)^{1/p}

    That is for alpha = 2, over all assignments: a pair further apart than the cut-off is a miss
    and a false track. With alpha below 2 as many pairs as possible are made, each at most at the
    cut-off; the sum over the pairs counts as localisation.

    Parameters
    ----------
    found_m, truth_m : array (n, d), m
        Positions, in any order.
    cutoff_m : float
        c.
    order : float
        p, from 1 to 100.
    alpha : float
        From above 0 to 2.

    Raises
    ------
    InvalidSetting
        If a position is not finite, axes differ, or a number cannot be.

    References
    ----------
    A. S. Rahmathullah, A. F. Garcia-Fernandez, L. Svensson, Generalized Optimal Sub-Pattern
    Assignment Metric, FUSION 2017.
    """
    cutoff_m = number("cutoff_m", cutoff_m, above=0)
    order = number("order", order, at_least=1, at_most=_LARGEST_ORDER)
    alpha = number("alpha", alpha, above=0, at_most=2)
    apart_m = np.minimum(distances_m(found_m, truth_m), cutoff_m)
    n_found, n_truth = apart_m.shape
    cost = (apart_m / cutoff_m) ** order  # over the cut-off, so that high orders overflow nowhere
    pairs = linear_sum_assignment(cost)
    made = cost[pairs]
    if alpha == 2:  # a pair at the cut-off costs what leaving both out costs
        made = made[made < 1]
    n_false, n_missed = n_found - len(made), n_truth - len(made)
    total = made.sum() + (n_false + n_missed) / alpha
    return Gospa(
        error_m=float(cutoff_m * total ** (1 / order)),
        localisation=float(made.sum() * cutoff_m**order),
        n_missed=n_missed,
        n_false=n_false,
    )
