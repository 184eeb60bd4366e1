"""Cell-averaging CFAR: most sensitive in homogeneous noise (Finn & Johnson 1968)."""

import numpy as np

from dechirp.core.values import frozen_dataclass
from dechirp.processing.cfar.base import NoiseEstimator, TrainingWindow
from dechirp.processing.cfar.window_means import exceeds_window_means, window_means
from dechirp.theory.cfar import cell_averaging_factor
from dechirp.theory.cfar_calibration import CalibratedFactor
from dechirp.theory.cfar_correlated_cells import CorrelatedWindow, correlated_factor


@frozen_dataclass
class CellAveraging(NoiseEstimator):
    """Mean of the training cells."""

    def statistic(self, cells: np.ndarray, offsets: np.ndarray) -> np.ndarray:
        return cells.mean(axis=-1)

    def threshold(
        self, power: np.ndarray, window: TrainingWindow, factors: np.ndarray
    ) -> np.ndarray:
        return window_means(power, factors, *window.side_counts)

    def exceeds_threshold(
        self, power: np.ndarray, window: TrainingWindow, factors: np.ndarray
    ) -> np.ndarray:
        """Compare row by row, without a map of the threshold."""
        return exceeds_window_means(power, factors, *window.side_counts)

    def independent_cells_factor(
        self, false_alarm_probability: float, offsets: np.ndarray, *, n_channels: int
    ) -> float:
        """Return the closed form of Finn and Johnson, and its sum for several channels."""
        return cell_averaging_factor(
            false_alarm_probability, n_training=len(offsets), n_summed=n_channels
        )

    def threshold_factor(
        self, false_alarm_probability: float, box: CorrelatedWindow, *, n_channels: int
    ) -> CalibratedFactor:
        """Return the exact factor: closed form, or quadratic form for correlated cells."""
        if box.is_white:
            return super().threshold_factor(false_alarm_probability, box, n_channels=n_channels)
        return CalibratedFactor(
            value=correlated_factor(false_alarm_probability, box, n_summed=n_channels)
        )
