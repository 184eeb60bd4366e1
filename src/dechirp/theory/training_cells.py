"""Training cells: checks of their number, and the comparison of sums of their noise.

Noise is independent from cell to cell, its power exponential.
"""

import numpy as np
from scipy.special import betainc, betaincc

from dechirp.core.checks import check_integer
from dechirp.core.errors import InvalidSetting


def count_powers(n_training: int, n_summed: int) -> int:
    """Return the number of powers in the training cells, N K; check that both are at least 1."""
    check_integer("n_training", n_training, at_least=1)
    check_integer("n_summed", n_summed, at_least=1)
    return n_training * n_summed


def half_size(n_training: int) -> int:
    """Return the training cells of one half; raise `InvalidSetting` if N is not even."""
    check_integer("n_training", n_training, at_least=2)
    if n_training % 2:
        raise InvalidSetting(
            "n_training",
            value=n_training,
            expected="an even number",
            fix="use equally many training cells before and after the cell under test",
        )
    return n_training // 2


def half_sizes(n_training: int | tuple[int, int]) -> tuple[int, int]:
    """Return the training cells of each half, from a pair or an even total.

    Raises `InvalidSetting` if a half has no cell, or the number is not even.
    """
    if not isinstance(n_training, tuple):
        half = half_size(n_training)
        return half, half
    for count in n_training:
        check_integer("n_training", count, at_least=1)
    first, second = n_training
    return first, second


def order_step_rates(n_training: int, rank: int) -> np.ndarray:
    """Return the rate of each step between successive training cells in order of power, (rank,).

    The steps are independent and exponential. Raises `InvalidSetting` if the rank is not from
    1 to N.
    """
    check_integer("n_training", n_training, at_least=1)
    check_integer("rank", rank, at_least=1, at_most=n_training)
    return n_training - np.arange(rank, dtype=float)


def sum_exceeds_probability(
    n: int | np.ndarray, a: float | np.ndarray, n_others: int
) -> np.ndarray:
    """Return the probability that a sum of n noise powers exceeds a times a sum of n_others."""
    fraction = a / (1 + np.asarray(a))
    # The smaller fraction keeps all its digits.
    return np.where(
        fraction < 0.5,
        betaincc(n, n_others, fraction),
        betainc(n_others, n, 1 / (1 + np.asarray(a))),
    )


def sum_below_probability(n: int | np.ndarray, a: float | np.ndarray, n_others: int) -> np.ndarray:
    """Return the probability that a sum of n noise powers is below a times a sum of n_others."""
    return np.asarray(betainc(n, n_others, a / (1 + np.asarray(a))))
