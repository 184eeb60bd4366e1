"""Two steps, as sensors do: range, then velocity; a detection must pass both.

A cell exceeds the mean of a line along range and that of a line along velocity, with the same
factor: it exceeds the larger of the two. The false-alarm probability is that of both together.
"""

from dataclasses import replace

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.process.cfar.base import Cells, NoiseEstimator, Ring
from dechirp.process.cfar.ring_means import ring_means
from dechirp.theory.cfar import greatest_of_factor


@value
class TwoStep(NoiseEstimator):
    """The larger of the means along range and along velocity, through the cell under test."""

    def check(self, ring: Ring) -> None:
        """There must be training cells along both axes."""
        for axis in ("range", "velocity"):
            if getattr(ring.n_training, axis) == 0:
                raise InvalidSetting(
                    f"Cfar.n_training.{axis}",
                    got=0,
                    need="at least 1: two steps need training cells along range and velocity",
                    fix="Give some, or choose another estimator for one axis.",
                )

    def statistic(self, cells: np.ndarray, offsets: np.ndarray) -> np.ndarray:
        """Larger mean of the two lines."""
        return np.maximum(*(cells[..., line].mean(axis=-1) for line in _lines(offsets)))

    def threshold(self, power: np.ndarray, ring: Ring, factors: np.ndarray) -> np.ndarray:
        """Larger mean of the two lines through each cell, times the factor of its row."""
        along_range = _along(ring, "range")
        along_velocity = _along(ring, "velocity")
        threshold = ring_means(power, factors, *along_range.sizes)
        return np.maximum(
            threshold, ring_means(power, factors, *along_velocity.sizes), out=threshold
        )

    def independent_factor(
        self, false_alarm_probability: float, offsets: np.ndarray, *, n_channels: int
    ) -> float:
        """That of the greatest of two halves, which the two lines are."""
        along_range, along_velocity = np.count_nonzero(_lines(offsets), axis=1)
        return greatest_of_factor(
            false_alarm_probability,
            n_training=(int(along_range), int(along_velocity)),
            n_summed=n_channels,
        )

    def low(self, offsets: np.ndarray) -> np.ndarray:
        """Both lines bring alarms when they are low together."""
        return np.any(_lines(offsets), axis=0, keepdims=True)


def _lines(offsets: np.ndarray) -> np.ndarray:
    """Which training cells lie on the line along range, and on that along velocity."""
    return np.array([offsets[:, 0] == 0, offsets[:, 1] == 0])


def _along(ring: Ring, axis: str) -> Ring:
    """The line of the ring along one axis."""
    training = Cells(**{"range": 0, "velocity": 0, axis: getattr(ring.n_training, axis)})
    guard = Cells(**{"range": 0, "velocity": 0, axis: getattr(ring.n_guard, axis)})
    return replace(ring, n_training=training, n_guard=guard)
