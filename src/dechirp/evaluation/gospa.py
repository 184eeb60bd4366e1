"""GOSPA: one error for a frame, composed of localisation, missed targets and false tracks."""

from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_number
from dechirp.evaluation.ospa import pairwise_distances_m

_LARGEST_ORDER = 100  # above, a thousandth of the cut-off underflows


class Gospa(NamedTuple):
    """Error in metres, and its components."""

    error_m: float
    localisation: float
    """Sum over assigned pairs of their distance to the power p, m^p."""
    n_missed: int
    n_false: int


@check_argument_types
def gospa(
    estimate_m: ArrayLike,
    truth_m: ArrayLike,
    *,
    cutoff_m: float,
    order: float = 2,
    alpha: float = 2,
) -> Gospa:
    r"""Compute the generalised optimal subpattern assignment metric.

    .. math:: \Bigl(\min_\gamma \sum_{(i,j) \in \gamma} d(x_i, y_j)^p
              + \frac{c^p}{\alpha} (n_{missed} + n_{false})\Bigr)^{1/p}

    This is for alpha = 2, over all assignments: a pair further apart than the cut-off is a miss and
    a false track. With alpha below 2 as many pairs as possible are assigned, each at most at the
    cut-off; the sum over the pairs counts as localisation.

    Parameters
    ----------
    estimate_m, truth_m : array (n, d), m
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
        If a position is not finite, axes differ, or a number is out of range.

    References
    ----------
    A. S. Rahmathullah, A. F. Garcia-Fernandez, L. Svensson, Generalized Optimal Sub-Pattern
    Assignment Metric, FUSION 2017.
    """
    cutoff_m = check_number("cutoff_m", cutoff_m, above=0)
    order = check_number("order", order, at_least=1, at_most=_LARGEST_ORDER)
    alpha = check_number("alpha", alpha, above=0, at_most=2)
    return gospa_of_distances(
        pairwise_distances_m(estimate_m, truth_m), cutoff_m=cutoff_m, order=order, alpha=alpha
    )


def gospa_of_distances(
    distances_m: np.ndarray, *, cutoff_m: float, order: float = 2, alpha: float = 2
) -> Gospa:
    """Compute `gospa` from the distances of all pairs, (n_estimates, n_truth)."""
    distances_m = np.minimum(distances_m, cutoff_m)
    n_estimates, n_truth = distances_m.shape
    cost = (distances_m / cutoff_m) ** order  # relative to the cut-off, to avoid overflow
    pairs = scipy.optimize.linear_sum_assignment(cost)
    pair_costs = cost[pairs]
    if alpha == 2:  # a pair at the cut-off costs as much as a miss and a false track
        pair_costs = pair_costs[pair_costs < 1]
    n_false, n_missed = n_estimates - len(pair_costs), n_truth - len(pair_costs)
    total = pair_costs.sum() + (n_false + n_missed) / alpha
    return Gospa(
        error_m=float(cutoff_m * total ** (1 / order)),
        localisation=float(pair_costs.sum() * cutoff_m**order),
        n_missed=n_missed,
        n_false=n_false,
    )
