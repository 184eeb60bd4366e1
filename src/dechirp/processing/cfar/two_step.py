"""Two-step CFAR as in commercial sensors: a detection must pass in range and in velocity.

A cell exceeds the mean of a line along range and that of a line along velocity, with the same
factor: it exceeds the larger of the two. The false-alarm probability is that of both together.
"""

from dataclasses import replace

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.processing.cfar.base import Cells, NoiseEstimator, TrainingWindow
from dechirp.processing.cfar.window_means import scaled_window_means
from dechirp.theory.cfar import greatest_of_factor


@frozen_dataclass
class TwoStep(NoiseEstimator):
    """Larger of the means along range and along velocity through the cell under test."""

    def check_enough_training_cells(self, window: TrainingWindow) -> None:
        """Check that there are training cells along both axes."""
        for axis in ("range", "velocity"):
            if getattr(window.n_training, axis) == 0:
                raise InvalidSetting(
                    f"Cfar.n_training.{axis}",
                    value=0,
                    expected="at least 1: two steps need training cells along range and velocity",
                    fix="give some, or choose another estimator for one axis",
                )

    def statistic(self, cells: np.ndarray, offsets: np.ndarray) -> np.ndarray:
        return np.maximum(
            *(cells[..., line].mean(axis=-1) for line in _range_and_velocity_line_masks(offsets))
        )

    def threshold(
        self, power: np.ndarray, window: TrainingWindow, factors: np.ndarray
    ) -> np.ndarray:
        along_range = _window_along_one_axis(window, "range")
        along_velocity = _window_along_one_axis(window, "velocity")
        threshold = scaled_window_means(power, factors, *along_range.training_and_guard_counts)
        return np.maximum(
            threshold,
            scaled_window_means(power, factors, *along_velocity.training_and_guard_counts),
            out=threshold,
        )

    def independent_cells_threshold_factor(
        self, false_alarm_probability: float, offsets: np.ndarray, *, n_channels: int
    ) -> float:
        """Return the factor of the greatest of two halves, here the two lines."""
        along_range, along_velocity = np.count_nonzero(
            _range_and_velocity_line_masks(offsets), axis=1
        )
        return greatest_of_factor(
            false_alarm_probability,
            n_training=(int(along_range), int(along_velocity)),
            n_summed=n_channels,
        )

    def subsets_causing_false_alarms(self, offsets: np.ndarray) -> np.ndarray:
        """Return both lines as one set: a false alarm needs both low."""
        return np.any(_range_and_velocity_line_masks(offsets), axis=0, keepdims=True)


def _range_and_velocity_line_masks(offsets: np.ndarray) -> np.ndarray:
    """Return masks of the training cells on the line along range and on that along velocity."""
    return np.array([offsets[:, 0] == 0, offsets[:, 1] == 0])


def _window_along_one_axis(window: TrainingWindow, axis: str) -> TrainingWindow:
    """Return the part of the window along one axis."""
    training = Cells(**{"range": 0, "velocity": 0, axis: getattr(window.n_training, axis)})
    guard = Cells(**{"range": 0, "velocity": 0, axis: getattr(window.n_guard, axis)})
    return replace(window, n_training=training, n_guard=guard)
