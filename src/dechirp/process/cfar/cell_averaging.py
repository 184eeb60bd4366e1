"""Cell averaging: the most sensitive choice in homogeneous noise (Finn & Johnson 1968)."""

import numpy as np

from dechirp.core.values import value
from dechirp.process.cfar.base import NoiseEstimator, Ring
from dechirp.process.cfar.ring_means import above_rings, ring_means
from dechirp.theory.calibrated import Factor
from dechirp.theory.cfar import cell_averaging_factor
from dechirp.theory.correlated import Box, correlated_factor


@value
class CellAveraging(NoiseEstimator):
    """Mean of the training cells."""

    def statistic(self, cells: np.ndarray, offsets: np.ndarray) -> np.ndarray:
        """Mean of the cells."""
        return cells.mean(axis=-1)

    def threshold(self, power: np.ndarray, ring: Ring, factors: np.ndarray) -> np.ndarray:
        """Mean power of the ring about each cell, times the factor of its row."""
        return ring_means(power, factors, *ring.sizes)

    def exceeds(self, power: np.ndarray, ring: Ring, factors: np.ndarray) -> np.ndarray:
        """Which cells exceed that: row by row, without the map of the threshold."""
        return above_rings(power, factors, *ring.sizes)

    def independent_factor(
        self, false_alarm_probability: float, offsets: np.ndarray, *, n_channels: int
    ) -> float:
        """Closed form of Finn and Johnson, and its sum for several channels."""
        return cell_averaging_factor(
            false_alarm_probability, n_training=len(offsets), n_summed=n_channels
        )

    def factor(self, false_alarm_probability: float, box: Box, *, n_channels: int) -> Factor:
        """Exact factor: closed form for independent cells, quadratic form for others."""
        if box.is_white:
            return super().factor(false_alarm_probability, box, n_channels=n_channels)
        return Factor(value=correlated_factor(false_alarm_probability, box, n_summed=n_channels))
