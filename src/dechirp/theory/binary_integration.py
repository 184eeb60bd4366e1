"""Binary integration: detection in at least M of N looks."""

import numpy as np
import scipy
from numpy.typing import ArrayLike

from dechirp.core.checks import check_finite_array, check_integer
from dechirp.core.elementwise import elementwise
from dechirp.core.errors import InvalidSetting

__all__ = ["binary_integration_probability"]


@elementwise
def binary_integration_probability(probability: ArrayLike, *, m: int, n: int) -> np.ndarray:
    r"""Return the probability that at least M of N independent looks exceed their threshold.

    .. math:: P = \sum_{k=M}^{N} \binom{N}{k} p^k (1 - p)^{N-k}

    Holds for detections and for false alarms, given the probability of a single look.

    Parameters
    ----------
    probability : array
        Probability that one look exceeds its threshold, from 0 to 1; any shape.
    m : array of int
        Required looks, from 1 to N.
    n : array of int
        Total number of looks.

    Returns
    -------
    array
        The shape to which all arguments broadcast. The sum is computed as an incomplete beta
        function, which is accurate for small results, too.

    Raises
    ------
    InvalidSetting
        If a probability is not from 0 to 1, N not a whole number from 1 or M not from 1 to N.

    References
    ----------
    M. A. Richards, Fundamentals of Radar Signal Processing, 2nd ed., 2014.
    """
    check_integer("n", n, at_least=1)
    check_integer("m", m, at_least=1, at_most=n)
    p = check_finite_array("probability", probability)
    wrong = ~((p >= 0) & (p <= 1))
    if np.any(wrong):
        raise InvalidSetting(
            "probability", value=p[wrong].flat[0], expected="from 0 to 1", fix="give probabilities"
        )
    return np.asarray(scipy.special.betainc(m, n - m + 1, p))
