"""Smallest of two halves: keeps a target that another one, in one half, would mask.

G. V. Trunk, Range resolution of targets using automatic detectors, IEEE Trans. AES 14(5), 1978.
"""

import numpy as np

from dechirp.core.values import value
from dechirp.process.cfar.base import NoiseEstimator, Ring
from dechirp.process.cfar.halves import half_means, halves, mean_of_each, sizes_of_each
from dechirp.theory.cfar import smallest_of_factor


@value
class SmallestOf(NoiseEstimator):
    """The smaller mean of the two halves of the training cells."""

    def statistic(self, cells: np.ndarray, offsets: np.ndarray) -> np.ndarray:
        """Smaller mean of the two halves."""
        return np.asarray(mean_of_each(cells, offsets).min(axis=0))

    def threshold(self, power: np.ndarray, ring: Ring, factors: np.ndarray) -> np.ndarray:
        """Smaller mean of the two halves about each cell, times the factor of its row."""
        first, second = half_means(power, ring)
        np.minimum(first, second, out=first)
        return np.multiply(first, factors, out=first)

    def independent_factor(
        self, false_alarm_probability: float, offsets: np.ndarray, *, n_channels: int
    ) -> float:
        """Exact for halves of any size."""
        sizes = sizes_of_each(offsets)
        return smallest_of_factor(false_alarm_probability, n_training=sizes, n_summed=n_channels)

    def low(self, offsets: np.ndarray) -> np.ndarray:
        """Either half brings alarms when it alone is low."""
        return halves(offsets)
