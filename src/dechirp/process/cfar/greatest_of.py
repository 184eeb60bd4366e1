"""Greatest of two halves: keeps its rate of false alarms where clutter begins.

V. G. Hansen and J. H. Sawyers, Detectability loss due to greatest-of selection in a
cell-averaging CFAR, IEEE Trans. AES 16(1), 1980.
"""

import numpy as np

from dechirp.core.values import value
from dechirp.process.cfar.base import NoiseEstimator, Ring
from dechirp.process.cfar.halves import half_means, halves, mean_of_each, sizes_of_each
from dechirp.theory.cfar import greatest_of_factor


@value
class GreatestOf(NoiseEstimator):
    """The larger mean of the two halves of the training cells."""

    def statistic(self, cells: np.ndarray, offsets: np.ndarray) -> np.ndarray:
        """Larger mean of the two halves."""
        return np.asarray(mean_of_each(cells, offsets).max(axis=0))

    def threshold(self, power: np.ndarray, ring: Ring, factors: np.ndarray) -> np.ndarray:
        """Larger mean of the two halves about each cell, times the factor of its row."""
        first, second = half_means(power, ring)
        np.maximum(first, second, out=first)
        return np.multiply(first, factors, out=first)

    def independent_factor(
        self, false_alarm_probability: float, offsets: np.ndarray, *, n_channels: int
    ) -> float:
        """Exact for halves of any size."""
        sizes = sizes_of_each(offsets)
        return greatest_of_factor(false_alarm_probability, n_training=sizes, n_summed=n_channels)

    def low(self, offsets: np.ndarray) -> np.ndarray:
        """Both halves bring alarms when they are low together."""
        return np.any(halves(offsets), axis=0, keepdims=True)
