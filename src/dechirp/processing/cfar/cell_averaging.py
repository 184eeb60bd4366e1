"""Cell-averaging CFAR and its greatest-of and smallest-of variants.

Cell averaging is most sensitive in homogeneous noise. Greatest-of keeps its false-alarm rate at
clutter edges; smallest-of detects a target that another one in one half would mask.

References
----------
H. M. Finn and R. S. Johnson, Adaptive detection mode with threshold control as a function of
spatially sampled clutter-level estimates, RCA Review 29, 1968.
V. G. Hansen and J. H. Sawyers, Detectability loss due to greatest-of selection in a
cell-averaging CFAR, IEEE Trans. AES 16(1), 1980.
G. V. Trunk, Range resolution of targets using automatic detectors, IEEE Trans. AES 14(5), 1978.
"""

from typing import ClassVar

import numpy as np

from dechirp.core.values import frozen_dataclass
from dechirp.processing.cfar.base import NoiseEstimator, TrainingWindow
from dechirp.processing.cfar.split_window import SplitWindowEstimator, half_window_masks
from dechirp.processing.cfar.window_means import exceeds_scaled_window_means, scaled_window_means
from dechirp.theory.cfar import cell_averaging_factor, greatest_of_factor, smallest_of_factor
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
        return scaled_window_means(power, factors, *window.training_and_guard_counts)

    def exceeds_threshold(
        self, power: np.ndarray, window: TrainingWindow, factors: np.ndarray
    ) -> np.ndarray:
        """Compare row by row, without a map of the threshold."""
        return exceeds_scaled_window_means(power, factors, *window.training_and_guard_counts)

    def independent_cells_threshold_factor(
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


@frozen_dataclass
class GreatestOf(SplitWindowEstimator):
    """Larger mean of the two halves of the training cells."""

    select_mean: ClassVar[np.ufunc] = np.maximum
    halves_threshold_factor = staticmethod(greatest_of_factor)

    def subsets_causing_false_alarms(self, offsets: np.ndarray) -> np.ndarray:
        """Return both halves as one set: a false alarm needs both low."""
        return np.any(half_window_masks(offsets), axis=0, keepdims=True)


@frozen_dataclass
class SmallestOf(SplitWindowEstimator):
    """Smaller mean of the two halves of the training cells."""

    select_mean: ClassVar[np.ufunc] = np.minimum
    halves_threshold_factor = staticmethod(smallest_of_factor)

    def subsets_causing_false_alarms(self, offsets: np.ndarray) -> np.ndarray:
        """Return each half as a set: either causes false alarms if it is low."""
        return half_window_masks(offsets)
