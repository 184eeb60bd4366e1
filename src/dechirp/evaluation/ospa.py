"""OSPA: a metric distance between two sets of positions."""

import numpy as np
import scipy
from numpy.typing import ArrayLike

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_finite_array, check_number
from dechirp.core.errors import InvalidSetting

_LARGEST_ORDER = 100  # above, a thousandth of the cut-off underflows


@check_argument_types
def ospa_m(
    estimate_m: ArrayLike, truth_m: ArrayLike, *, cutoff_m: float, order: float = 1
) -> float:
    r"""Compute the optimal subpattern assignment metric, a mean error per target in metres.

    .. math:: \Bigl(\frac1n \bigl(\min_\pi \sum_{i=1}^m \min(c, |x_i - y_{\pi(i)}|)^p
              + c^p (n - m)\bigr)\Bigr)^{1/p}, \quad m \le n

    Parameters
    ----------
    estimate_m, truth_m : array (n, d), m
        Positions, in any order; 0 if both are empty.
    cutoff_m : float
        c: error of a miss or a false track.
    order : float
        p, from 1 to 100: large values emphasise outliers.

    Raises
    ------
    InvalidSetting
        If a position is not finite, axes differ, or cut-off or order is out of range.

    References
    ----------
    D. Schuhmacher, B.-T. Vo, B.-N. Vo, A Consistent Metric for Performance Evaluation of
    Multi-Object Filters, IEEE Trans. Signal Processing 56(8), 2008.
    """
    cutoff_m = check_number("cutoff_m", cutoff_m, above=0)
    order = check_number("order", order, at_least=1, at_most=_LARGEST_ORDER)
    distances_m = np.minimum(pairwise_distances_m(estimate_m, truth_m), cutoff_m)
    fewer, more = sorted(distances_m.shape)
    if more == 0:
        return 0.0
    # Relative to the cut-off, to avoid overflow.
    cost = (distances_m / cutoff_m) ** order
    total = cost[scipy.optimize.linear_sum_assignment(cost)].sum() + (more - fewer)
    return float(cutoff_m * (total / more) ** (1 / order))


def pairwise_distances_m(estimate_m: ArrayLike, truth_m: ArrayLike) -> np.ndarray:
    """Return the distances between each of (n, d) and each of (m, d), (n, m); either may be empty.

    Raises
    ------
    InvalidSetting
        If a position is not finite, or the sets have different axes.
    """
    estimates = check_finite_array("estimate_m", estimate_m, may_be_empty=True)
    truth = check_finite_array("truth_m", truth_m, may_be_empty=True)
    filled = [points for points in (estimates, truth) if points.size]
    if any(points.ndim != 2 for points in filled) or len({x.shape[1] for x in filled}) > 1:
        raise InvalidSetting(
            "estimate_m",
            value=f"of shape {estimates.shape}, with a truth of shape {truth.shape}",
            expected="a row for each point, with as many coordinates as the truth",
            fix="give both as [[x, y], ...]",
        )
    if len(filled) < 2:
        return np.zeros((len(estimates), len(truth)))
    return np.asarray(scipy.spatial.distance.cdist(estimates, truth))
