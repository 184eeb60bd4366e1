"""Swerling cases 0 to 4 as distributions of a number of events.

Let events come at random, on average one in each unit of noise power. Noise summed over K
powers reaches as far as the K-th event. A target in it makes the sum reach J events further:
J is Poisson, of mean K snr, for a steady target. A target that fluctuates as a gamma variate
makes J negative binomial, of the same mean and of the shape kappa of that variate. For a
steady target this is noncentral chi-square as a Poisson mixture of gamma variates: twice the
sum exceeds 2 T with the probability

    Q_K(sqrt(2 K snr), sqrt(2 T)) = sum_j e^(-K snr) (K snr)^j / j!  Q(K + j, T),

where Q_K is Marcum's function and Q the upper incomplete gamma function, regularised. The
shapes:

==========  =========  ================================================================
`swerling`  kappa      target
==========  =========  ================================================================
0           infinite   steady
1           1          many scatterers, constant over the powers that are summed
2           K          many scatterers, independent from power to power
3           2          one strong scatterer among many, constant over the powers
4           2 K        one strong scatterer among many, independent from power to power
==========  =========  ================================================================

References
----------
P. Swerling, Probability of detection for fluctuating targets, 1954 (IRE Trans. IT-6, 1960).
D. A. Shnidman, Expanded Swerling target models, IEEE Trans. AES 39(3), 2003.
"""

import math

import numpy as np
import scipy

from dechirp.core.checks import check_integer

NEGLIGIBLE = 1e-30
"""Sums omit counts less probable than this; a probability of 1e-12 keeps all its digits."""


def swerling_shape(swerling: int, n_summed: int) -> float:
    """Return kappa of a Swerling case; raise `InvalidSetting` if a number is out of bounds."""
    check_integer("swerling", swerling, at_least=0, at_most=4)
    check_integer("n_summed", n_summed, at_least=1)
    return (math.inf, 1, n_summed, 2, 2 * n_summed)[swerling]


def probability_count_at_least(min_count: np.ndarray, mean: float, shape: float) -> np.ndarray:
    """Return P(J >= j) for j > 0, any shape of array."""
    if math.isinf(shape):
        return np.asarray(scipy.special.gammainc(min_count, mean))
    return np.asarray(scipy.special.betainc(min_count, shape, mean / (shape + mean)))


def probability_count_below(upper_count: np.ndarray, mean: float, shape: float) -> np.ndarray:
    """Return P(J < j) for j > 0, any shape of array."""
    if math.isinf(shape):
        return np.asarray(scipy.special.gammaincc(upper_count, mean))
    return np.asarray(scipy.special.betainc(shape, upper_count, shape / (shape + mean)))


def likely_count_range(mean: float, shape: float) -> tuple[int, int]:
    """Return the range of J, up to a probability of `NEGLIGIBLE` at each end."""
    low = high = mean
    if shape < math.inf:
        low = mean / shape * float(scipy.special.gammaincinv(shape, NEGLIGIBLE))
        high = mean / shape * float(scipy.special.gammainccinv(shape, NEGLIGIBLE))
    # Chernoff's bounds of the two tails of a Poisson count.
    log_rare = -math.log(NEGLIGIBLE)
    below = math.sqrt(2 * log_rare * low)
    above = log_rare / 3 + math.sqrt(log_rare**2 / 9 + 2 * log_rare * high)
    return max(math.floor(low - below), 0), math.ceil(high + above)
