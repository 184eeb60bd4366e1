"""Alarms in noise that comes in clumps: cells that a window or padding ties together.

A clump of cells over threshold counts as one detection, its highest cell. High above the noise
clumps are rare and far apart, so their number is Poisson: the heuristic of Aldous.

References
----------
D. Aldous, Probability Approximations via the Poisson Clumping Heuristic, Springer, 1989.
"""

from functools import lru_cache

import numpy as np
from scipy.special import gammainccinv

from dechirp.core.checks import false_alarms, whole
from dechirp.core.values import value

_DRAWS = 20_000  # the share is known to 0.35 % at the most


@value
class Neighbours:
    """Correlation of the noise in cells that lie side by side, by lag, complex."""

    in_range: tuple[complex, complex]
    """One bin apart, and two."""
    in_velocity: tuple[complex, complex]


def highest_share(
    false_alarm_probability: float, neighbours: Neighbours, *, n_summed: int = 1
) -> float:
    """Share of the cells over threshold that are higher than their eight neighbours.

    By simulation of a fixed seed: the cell is over a fixed threshold, which is what an estimated
    one is over many training cells; its neighbours follow it as far as they are tied to it.
    Raises `InvalidSetting` unless the probability is from 1e-300 to 1 - 1e-9, `n_summed` at
    least 1.
    """
    false_alarms("false_alarm_probability", false_alarm_probability)
    whole("n_summed", n_summed, at_least=1)
    return _highest_share(false_alarm_probability, neighbours, n_summed)


@lru_cache(maxsize=256)
def _highest_share(false_alarm_probability: float, neighbours: Neighbours, n_summed: int) -> float:
    covariance = np.kron(_matrix(neighbours.in_velocity), _matrix(neighbours.in_range))
    others = np.delete(np.arange(9), 4)
    tie = covariance[others, 4]
    rest = covariance[np.ix_(others, others)] - np.outer(tie, tie.conj())
    # Padding leaves it singular: a negative eigenvalue is rounding.
    values, vectors = np.linalg.eigh(rest)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    rng = np.random.default_rng(1)
    power = gammainccinv(n_summed, false_alarm_probability * (1 - rng.random(_DRAWS)))
    # Channels may be turned so that all of the cell is in the first.
    normal = rng.standard_normal((2, _DRAWS, n_summed, 8))
    amplitude = (normal[0] + 1j * normal[1]) / np.sqrt(2) @ root.T
    amplitude[:, 0] += np.sqrt(power)[:, None] * tie
    beside = np.sum(np.abs(amplitude) ** 2, axis=1)
    return float(np.mean(beside.max(axis=1) < power))


def _matrix(by_lag: tuple[complex, complex]) -> np.ndarray:
    """Of three cells in a row."""
    one, two = by_lag
    upper = np.array([[0, one, two], [0, 0, one], [0, 0, 0]])
    return np.asarray(np.eye(3) + upper.conj() + upper.T)
