"""Training cells: checks of their number, and the comparison of sums of their noise.

Noise is independent from cell to cell, its power exponential.
"""

import math

import numpy as np
import scipy

from dechirp.core.checks import check_integer
from dechirp.core.errors import InvalidSetting
from dechirp.core.memory import check_free_memory

_MAX_SUMMED = 10**7  # factors of a million take 0.7 to 4 s, except of cell averaging
_BYTES_PER_STEP = 64.0  # rates, their products and sums: 63 with ranks, 32 with trimmed means
# Settings of the detectors unless they are specified, as shares of the training cells.
DEFAULT_RANK = 0.75
DEFAULT_N_SMALLEST, DEFAULT_N_LARGEST = 0.0, 0.25


def cell_count_from_setting(n_cells: np.ndarray, share_or_count: float) -> np.ndarray:
    """Convert a setting to a number of cells: a share of them below 1, or a number."""
    number = (
        np.ceil(share_or_count * n_cells - 1e-9)
        if share_or_count < 1
        else np.full_like(n_cells, share_or_count)
    )
    return np.asarray(number, dtype=int)


def count_training_powers(n_training: int, n_summed: int) -> int:
    """Return the number of powers in the training cells, N K; check that both are at least 1."""
    check_integer("n_training", n_training, at_least=1)
    check_integer("n_summed", n_summed, at_least=1)
    return n_training * n_summed


def likely_event_counts(n_summed: int) -> np.ndarray:
    """Return the counts j < K of events that matter to the tail of a sum of K powers.

    Fewer than K events fall below the threshold if the cell exceeds it. Their mean is above K, or
    at most 6.5 standard deviations of sqrt(2 K) or less below it for probabilities up to 1 - 1e-9,
    so counts below K - 25 sqrt(K) are together less probable than 1e-16 of the others.
    """
    check_integer("n_summed", n_summed, at_least=1, at_most=_MAX_SUMMED)
    first = max(0, n_summed - 100 - math.ceil(25 * math.sqrt(n_summed)))
    return np.arange(first, n_summed)


def n_training_per_half(n_training: int) -> int:
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


def n_training_of_each_half(n_training: int | tuple[int, int]) -> tuple[int, int]:
    """Return the training cells of each half, from a pair or an even total.

    Raises `InvalidSetting` if a half has no cell, or the number is not even.
    """
    if not isinstance(n_training, tuple):
        half = n_training_per_half(n_training)
        return half, half
    for count in n_training:
        check_integer("n_training", count, at_least=1)
    if len(n_training) != 2:
        raise InvalidSetting(
            "n_training",
            value=n_training,
            expected="an even number, or the numbers of both halves",
            fix="give one number, or two",
        )
    return n_training


def order_statistic_step_rates(n_training: int, rank: int) -> np.ndarray:
    """Return the rate of each step between successive training cells in order of power, (rank,).

    The steps are independent and exponential. Raises `InvalidSetting` if the rank is not from
    1 to N, and `NotEnoughMemory` if sums over the steps exceed the memory.
    """
    check_integer("n_training", n_training, at_least=1)
    check_integer("rank", rank, at_least=1, at_most=n_training)
    check_free_memory(
        f"n_training={n_training}",
        needed_bytes=_BYTES_PER_STEP * rank,
        fix="give fewer training cells",
    )
    return n_training - np.arange(rank, dtype=float)


def noise_sum_exceeds_probability(
    n_powers: int | np.ndarray, ratio: float | np.ndarray, n_other_powers: int
) -> np.ndarray:
    """Return the probability that a sum of n noise powers exceeds a times a sum of n_others."""
    fraction = ratio / (1 + np.asarray(ratio))
    # The smaller fraction keeps all its digits.
    return np.where(
        fraction < 0.5,
        scipy.special.betaincc(n_powers, n_other_powers, fraction),
        scipy.special.betainc(n_other_powers, n_powers, 1 / (1 + np.asarray(ratio))),
    )


def noise_sum_below_probability(
    n_powers: int | np.ndarray, ratio: float | np.ndarray, n_other_powers: int
) -> np.ndarray:
    """Return the probability that a sum of n noise powers is below a times a sum of n_others."""
    return np.asarray(
        scipy.special.betainc(n_powers, n_other_powers, ratio / (1 + np.asarray(ratio)))
    )
