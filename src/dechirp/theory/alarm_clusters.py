"""Clusters of false alarms in cells that a window or zero padding correlates.

A cluster of cells above the threshold counts as one detection, its highest cell. Far above the
noise, clusters are rare and far apart, so their number is Poisson (heuristic of Aldous).

References
----------
D. Aldous, Probability Approximations via the Poisson Clumping Heuristic, Springer, 1989.
"""

from functools import lru_cache

import numpy as np
import scipy

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import (
    as_tuple_or_none,
    check_false_alarm_probability,
    check_finite_samples,
    check_integer,
)
from dechirp.core.errors import InvalidSetting
from dechirp.core.memory import check_free_memory
from dechirp.core.values import frozen_dataclass

__all__ = ["NeighbourCorrelation", "local_maximum_fraction"]

_DRAWS = 20_000  # standard error of the fraction: at most 0.35 %


@frozen_dataclass
class NeighbourCorrelation:
    """Complex correlation of the noise in neighbouring cells, by lag.

    Raises `InvalidSetting` unless noise can have these correlations in three adjacent cells.
    """

    in_range: tuple[complex, complex]
    """At lags of one and two bins."""
    in_velocity: tuple[complex, complex]

    def __post_init__(self) -> None:
        for name in ("in_range", "in_velocity"):
            lags = as_tuple_or_none(getattr(self, name)) or ()
            setting = f"NeighbourCorrelation.{name}"
            array = check_finite_samples(
                setting, lags, axes="lags of one and two bins", fits=lambda x: x.shape == (2,)
            )
            correlation = complex(array[0]), complex(array[1])
            object.__setattr__(self, name, correlation)
            eigenvalues = np.linalg.eigvalsh(_covariance_of_three_adjacent_cells(correlation))
            if eigenvalues[0] < -1e-6:  # of 3; padding leaves them singular, up to rounding
                raise InvalidSetting(
                    setting,
                    value=correlation,
                    expected="correlations that noise can have in three adjacent cells",
                    fix="compute them with dechirp.windows.bin_correlation",
                )


@check_argument_types
def local_maximum_fraction(
    false_alarm_probability: float, neighbours: NeighbourCorrelation, *, n_summed: int = 1
) -> float:
    """Return the fraction of cells above the threshold that exceed their eight neighbours.

    Simulated with a fixed seed: the cell is above a fixed threshold, the limit of an estimated
    one for many training cells; its neighbours follow their correlation with it.
    Raises `InvalidSetting` unless the probability is from 1e-300 to 1 - 1e-9, `n_summed` at
    least 1.

    Parameters
    ----------
    false_alarm_probability : float
        Probability of a false alarm in a cell, from 1e-300 to 1 - 1e-9.
    neighbours : NeighbourCorrelation
        Correlation of the noise in neighbouring cells.
    n_summed : int
        Powers K that are summed in each cell, at least 1.
    """
    check_false_alarm_probability("false_alarm_probability", false_alarm_probability)
    check_integer("n_summed", n_summed, at_least=1)
    # Two real and one complex array, and the product of the latter with the root.
    check_free_memory(
        f"n_summed={n_summed}", needed_bytes=48.0 * 8 * _DRAWS * n_summed, fix="sum fewer powers"
    )
    return _simulate_local_maximum_fraction(false_alarm_probability, neighbours, n_summed)


@lru_cache(maxsize=256)
def _simulate_local_maximum_fraction(
    false_alarm_probability: float, neighbours: NeighbourCorrelation, n_summed: int
) -> float:
    covariance = np.kron(
        _covariance_of_three_adjacent_cells(neighbours.in_velocity),
        _covariance_of_three_adjacent_cells(neighbours.in_range),
    )
    others = np.delete(np.arange(9), 4)
    coupling = covariance[others, 4]
    conditional_covariance = covariance[np.ix_(others, others)] - np.outer(
        coupling, coupling.conj()
    )
    # Padding leaves it singular: a negative eigenvalue is rounding.
    values, vectors = np.linalg.eigh(conditional_covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    rng = np.random.default_rng(1)
    power = scipy.special.gammainccinv(n_summed, false_alarm_probability * (1 - rng.random(_DRAWS)))
    # Channels can be rotated so that the whole power of the cell is in the first.
    gaussian = rng.standard_normal((2, _DRAWS, n_summed, 8))
    amplitude = (gaussian[0] + 1j * gaussian[1]) / np.sqrt(2) @ root.T
    amplitude[:, 0] += np.sqrt(power)[:, None] * coupling
    neighbour_power = np.sum(np.abs(amplitude) ** 2, axis=1)
    return float(np.mean(neighbour_power.max(axis=1) < power))


def _covariance_of_three_adjacent_cells(
    correlation_at_lags_1_and_2: tuple[complex, complex],
) -> np.ndarray:
    """Return the covariance of three cells in a row."""
    lag_1, lag_2 = correlation_at_lags_1_and_2
    upper = np.array([[0, lag_1, lag_2], [0, 0, lag_1], [0, 0, 0]])
    return np.asarray(np.eye(3) + upper.conj() + upper.T)
