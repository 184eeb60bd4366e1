"""The law of a detector: how often a target of a ratio exceeds the threshold of its cell."""

from functools import lru_cache

import numpy as np
from scipy.special import betainc, gammainc

from dechirp.core.values import value
from dechirp.process.cfar.base import Cfar, Noise
from dechirp.process.cfar.cell_averaging import CellAveraging
from dechirp.process.cfar.ordered_statistic import OrderedStatistic
from dechirp.process.cfar.ranked import number_of
from dechirp.theory.cfar import cell_averaging_factor, ordered_statistic_factor
from dechirp.theory.cfar_detection import (
    cell_averaging_detection_probability,
    ordered_statistic_detection_probability,
)


@value
class Detector:
    """Cell averaging, or an ordered statistic, over training cells that are independent."""

    n_training: int
    factor: float
    """Threshold over the statistic."""
    n_summed: int = 1
    """Powers whose mean a cell is."""
    rank: int | None = None
    """Which training cell in order of power; none: their mean."""

    def probability(self, snr: np.ndarray, *, swerling: int = 0) -> np.ndarray:
        """Of detecting a target, over its mean ratio in the cell, in each of the powers."""
        if self.rank is not None:
            return ordered_statistic_detection_probability(
                snr, self.factor, n_training=self.n_training, rank=self.rank, swerling=swerling
            )
        return cell_averaging_detection_probability(
            snr,
            self.factor,
            n_training=self.n_training,
            n_summed=self.n_summed,
            swerling=swerling,
        )

    def passes(self, power: np.ndarray) -> np.ndarray:
        """Probability that the threshold lies below a power, over the mean noise; any shape."""
        level = np.asarray(power) / self.factor
        if self.rank is not None:
            others = self.n_training - self.rank + 1
            return np.asarray(betainc(self.rank, others, -np.expm1(-level)))
        n_powers = self.n_training * self.n_summed
        return np.asarray(gammainc(n_powers, n_powers * level))


@lru_cache(maxsize=64)
def detector(cfar: Cfar, noise: Noise, place: int | None = None) -> Detector | None:
    """That of a chain, over as many cells as those of its ring are worth; none: no law.

    644 in the reference ring under rectangular windows, 181 under Hann: see
    `theory.correlated.Box.n_independent`. There is a law of cell averaging, and of an ordered
    statistic in one channel. `place`: row of the box in which the cell under test is, the
    middle without it.
    """
    ring, n_summed = cfar.ring, noise.n_channels
    box = ring.box(noise, ring.half_range if place is None else place)
    n_training = max(round(box.n_independent), 1)
    pfa, factor, rank = cfar.false_alarm_probability, cfar.offset, None
    if isinstance(cfar.estimator, CellAveraging):
        if pfa is not None:
            factor = cell_averaging_factor(pfa, n_training=n_training, n_summed=n_summed)
    elif isinstance(cfar.estimator, OrderedStatistic) and n_summed == 1:
        share = number_of(np.array(box.n_training), cfar.estimator.rank) / box.n_training
        if share < 1:  # the largest has no cells above it whose number would vary
            n_training = max(round(box.n_independent_at(float(share))), 1)
        rank = int(np.clip(round(float(share) * n_training), 1, n_training))
        if pfa is not None:
            factor = ordered_statistic_factor(pfa, n_training=n_training, rank=rank)
    else:
        return None
    assert factor is not None
    return Detector(n_training=n_training, factor=factor, n_summed=n_summed, rank=rank)
