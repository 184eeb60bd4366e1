"""Training cells: how many there may be, and how sums of their noise compare.

Noise is independent from cell to cell, its power exponential.
"""

import numpy as np
from scipy.special import betainc, betaincc

from dechirp.core.checks import whole
from dechirp.core.errors import InvalidSetting


def n_powers(n_training: int, n_summed: int) -> int:
    """Powers in the training cells, N K; raises `InvalidSetting` if a count is below 1."""
    whole("n_training", n_training, at_least=1)
    whole("n_summed", n_summed, at_least=1)
    return n_training * n_summed


def half_of(n_training: int) -> int:
    """Training cells in one half; raises `InvalidSetting` if N is not even."""
    whole("n_training", n_training, at_least=2)
    if n_training % 2:
        raise InvalidSetting(
            "n_training",
            got=n_training,
            need="an even number",
            fix="Give as many training cells before the cell under test as after it.",
        )
    return n_training // 2


def halves_of(n_training: int | tuple[int, int]) -> tuple[int, int]:
    """Training cells in each half: given as a pair, or half of an even number each.

    Raises `InvalidSetting` if a half has no cell, or the number is not even.
    """
    if not isinstance(n_training, tuple):
        half = half_of(n_training)
        return half, half
    for count in n_training:
        whole("n_training", count, at_least=1)
    first, second = n_training
    return first, second


def step_rates(n_training: int, rank: int) -> np.ndarray:
    """Rate of each step from one training cell in order of power to the next, (rank,).

    The steps are independent and exponential. Raises `InvalidSetting` if the rank is not from
    1 to N.
    """
    whole("n_training", n_training, at_least=1)
    whole("rank", rank, at_least=1, at_most=n_training)
    return n_training - np.arange(rank, dtype=float)


def exceeds(n: int | np.ndarray, a: float | np.ndarray, n_others: int) -> np.ndarray:
    """Probability that a sum of n noise powers exceeds a times a sum of n_others of them."""
    part = a / (1 + np.asarray(a))
    # The smaller part of one keeps all its digits.
    return np.where(
        part < 0.5, betaincc(n, n_others, part), betainc(n_others, n, 1 / (1 + np.asarray(a)))
    )


def falls_below(n: int | np.ndarray, a: float | np.ndarray, n_others: int) -> np.ndarray:
    """Probability that a sum of n noise powers is less than a times a sum of n_others."""
    return np.asarray(betainc(n, n_others, a / (1 + np.asarray(a))))
