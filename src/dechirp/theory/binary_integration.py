"""Binary integration: a target is declared when M of N looks detect it."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import betainc

from dechirp.core.checks import numbers, whole
from dechirp.core.errors import InvalidSetting


def m_of_n(probability: ArrayLike, *, m: int, n: int) -> np.ndarray:
    r"""Probability that at least M of N independent looks exceed their threshold.

    .. math:: P = \sum_{k=M}^{N} \binom{N}{k} p^k (1 - p)^{N-k}

    The same for detection and for false alarms: put in what one look has of either.

    Parameters
    ----------
    probability : array
        That one look exceeds its threshold, from 0 to 1; any shape.
    m : int
        Looks that must, from 1 to N.
    n : int
        Looks in all.

    Returns
    -------
    array
        The shape of `probability`. The sum is an incomplete beta function, so it keeps its
        digits however small it is.

    Raises
    ------
    InvalidSetting
        If a probability is not from 0 to 1, N not a whole number from 1 or M not from 1 to N.

    References
    ----------
    M. A. Richards, Fundamentals of Radar Signal Processing, 2nd ed., 2014.
    """
    whole("n", n, at_least=1)
    whole("m", m, at_least=1, at_most=n)
    p = numbers("probability", probability)
    wrong = ~((p >= 0) & (p <= 1))
    if np.any(wrong):
        raise InvalidSetting(
            "probability", got=p[wrong].flat[0], need="from 0 to 1", fix="Give probabilities."
        )
    return np.asarray(betainc(m, n - m + 1, p))
