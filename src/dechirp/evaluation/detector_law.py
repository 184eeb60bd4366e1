"""Detection probability of a CFAR detector at a given signal-to-noise ratio."""

from functools import lru_cache

import numpy as np
import scipy

from dechirp.core.values import frozen_dataclass
from dechirp.processing.cfar.base import Cfar, MapNoise
from dechirp.processing.cfar.cell_averaging import CellAveraging
from dechirp.processing.cfar.ordered_statistic import OrderedStatistic
from dechirp.theory.cfar import cell_averaging_factor, ordered_statistic_factor
from dechirp.theory.cfar_detection import (
    cell_averaging_detection_probability,
    ordered_statistic_detection_probability,
)
from dechirp.theory.training_cells import cell_count_from_setting


@frozen_dataclass
class DetectorLaw:
    """Cell averaging, or an ordered statistic, over independent training cells."""

    n_training: int
    factor: float
    """Threshold over the statistic."""
    n_summed: int = 1
    """Number of powers averaged in a cell."""
    rank: int | None = None
    """Rank of the training cell in order of power; None: mean of all."""

    def detection_probability(self, snr: np.ndarray, *, swerling: int = 0) -> np.ndarray:
        """Return the detection probability at the mean ratio of each power in the cell."""
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

    def probability_of_threshold_below(self, power: np.ndarray) -> np.ndarray:
        """Return the probability that the threshold is below a power over mean noise; any shape."""
        level = np.asarray(power) / self.factor
        if self.rank is not None:
            others = self.n_training - self.rank + 1
            return np.asarray(scipy.special.betainc(self.rank, others, -np.expm1(-level)))
        n_powers = self.n_training * self.n_summed
        return np.asarray(scipy.special.gammainc(n_powers, n_powers * level))


@lru_cache(maxsize=64)
def find_detector_law(
    cfar: Cfar, noise: MapNoise, training_row: int | None = None
) -> DetectorLaw | None:
    """Return the law of a CFAR with its equivalent number of independent cells; None without a law.

    644 in the reference window with rectangular tapers, 181 with Hann: see
    `theory.cfar_correlated_cells.CorrelatedWindow.n_independent`. There is a law of cell averaging,
    and of an ordered statistic in one channel. `training_row`: row of the training window of the
    cell under test; default: the middle.
    """
    window, n_summed = cfar.training_window, noise.n_channels
    correlated_window = window.noise_covariance_in_box(
        noise, window.half_range if training_row is None else training_row
    )
    n_training = max(round(correlated_window.n_independent), 1)
    pfa, factor, rank = cfar.false_alarm_probability, cfar.offset, None
    if isinstance(cfar.estimator, CellAveraging):
        if pfa is not None:
            factor = cell_averaging_factor(pfa, n_training=n_training, n_summed=n_summed)
    elif isinstance(cfar.estimator, OrderedStatistic) and n_summed == 1:
        rank_share = (
            cell_count_from_setting(np.array(correlated_window.n_training), cfar.estimator.rank)
            / correlated_window.n_training
        )
        if rank_share < 1:  # the largest has no variable number of cells above it
            n_training = max(
                round(correlated_window.n_independent_for_quantile(float(rank_share))), 1
            )
        rank = int(np.clip(round(float(rank_share) * n_training), 1, n_training))
        if pfa is not None:
            factor = ordered_statistic_factor(pfa, n_training=n_training, rank=rank)
    else:
        return None
    assert factor is not None
    return DetectorLaw(n_training=n_training, factor=factor, n_summed=n_summed, rank=rank)
