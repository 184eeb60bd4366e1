"""Ordered-statistic CFAR: a quantile of the training cells.

Other targets among the training cells, up to the share above the quantile, do not raise it. H.
Rohling, Radar CFAR thresholding in clutter and multiple target situations, IEEE Trans. AES 19(4),
1983.
"""

import numpy as np

from dechirp.core.checks import check_positive_fields
from dechirp.core.compiled_kernels import IN_CALLER, can_compile, kernel
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.processing.cfar.base import NoiseEstimator, TrainingWindow
from dechirp.processing.cfar.rank_kernels import (
    SideCounts,
    candidate_detection_cells,
    order_statistic_map,
)
from dechirp.theory.cfar import ordered_statistic_factor
from dechirp.theory.training_cells import DEFAULT_RANK, cell_count_from_setting


@frozen_dataclass
class OrderedStatistic(NoiseEstimator):
    """The k-th smallest training cell."""

    rank: float = DEFAULT_RANK
    """Rank k of the cell in order of power, 1 for the smallest; below 1, a share of the cells."""

    def __post_init__(self) -> None:
        check_positive_fields(self, "rank")
        if self.rank >= 1 and self.rank != int(self.rank):
            raise InvalidSetting(
                "OrderedStatistic.rank",
                value=self.rank,
                expected="a share below 1, or a whole number of cells",
                fix="give 0.75 for the cell that three quarters do not exceed",
            )

    def check_enough_training_cells(self, window: TrainingWindow) -> None:
        """Check that there are as many training cells as the rank."""
        n_cells = len(window.training_cell_offsets(window.half_range))
        if self.rank > n_cells:
            raise InvalidSetting(
                "Cfar.estimator.rank",
                value=self.rank,
                expected=f"at most {n_cells}, the training cells",
                fix="lower it, or give a share below 1",
            )

    def statistic(self, cells: np.ndarray, offsets: np.ndarray) -> np.ndarray:
        k = int(cell_count_from_setting(np.array(cells.shape[-1]), self.rank))
        return np.partition(cells, k - 1, axis=-1)[..., k - 1]

    def threshold(
        self, power: np.ndarray, window: TrainingWindow, factors: np.ndarray
    ) -> np.ndarray:
        if not can_compile():
            return super().threshold(power, window, factors)
        threshold = order_statistic_map(
            power,
            window.training_and_guard_counts,
            self._training_counts_and_ranks_per_row(power, window)[1],
        )
        return np.multiply(threshold, factors, out=threshold)

    def exceeds_threshold(
        self, power: np.ndarray, window: TrainingWindow, factors: np.ndarray
    ) -> np.ndarray:
        """Test for each candidate cell if k training cells are below it by the factor.

        The k-th smallest is no less than the mean of the k smallest, which few cells of noise
        exceed by the factor: training cells are counted only for those.
        """
        if not can_compile():
            return super().exceeds_threshold(power, window, factors)
        n_cells, ranks = self._training_counts_and_ranks_per_row(power, window)
        candidates = candidate_detection_cells(
            power, window.training_and_guard_counts, factors, n_cells, ranks
        )
        return _mask_of_exceeding_candidates(
            power, candidates, window.training_and_guard_counts, factors, ranks
        )

    def independent_cells_threshold_factor(
        self, false_alarm_probability: float, offsets: np.ndarray, *, n_channels: int
    ) -> float:
        """Return Rohling's product, or its integral for several channels."""
        return ordered_statistic_factor(
            false_alarm_probability,
            n_training=len(offsets),
            rank=int(cell_count_from_setting(np.array(len(offsets)), self.rank)),
            n_summed=n_channels,
        )

    def _training_counts_and_ranks_per_row(
        self, power: np.ndarray, window: TrainingWindow
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the training cells of each row of a map, and the rank among them, (range,)."""
        n_cells = window.n_training_cells_per_row(power.shape[1])
        return n_cells, cell_count_from_setting(n_cells, self.rank)


@kernel(plain=IN_CALLER)
def _mask_of_exceeding_candidates(
    power: np.ndarray,
    candidates: np.ndarray,
    side_counts: SideCounts,
    factors: np.ndarray,
    ranks: np.ndarray,
) -> np.ndarray:
    """Return a mask of the candidates that exceed at least `rank` training cells by the factor."""
    train_r, train_v, guard_r, guard_v = side_counts
    n_v, n_r = power.shape
    half_v, width = train_v + guard_v, 2 * (train_r + guard_r) + 1
    mask = np.zeros((n_v, n_r), np.bool_)
    for c in range(len(candidates)):
        v, j = candidates[c, 0], candidates[c, 1]
        level, factor = power[v, j], factors[j]
        start = min(max(j - width // 2, 0), n_r - width)
        guard_start, guard_end = max(j - guard_r, start), min(j + guard_r + 1, start + width)
        n, n_remaining = (
            np.int64(0),
            (2 * half_v + 1) * width - (2 * guard_v + 1) * (guard_end - guard_start),
        )
        for dv in range(-half_v, half_v + 1):
            row = power[(v + dv) % n_v, start : start + width]
            n_row = np.int32(0)
            for i in range(width):
                n_row += np.int32(row[i] * factor < level)
            n_remaining -= width
            if abs(dv) <= guard_v:
                for i in range(guard_start - start, guard_end - start):
                    n_row -= np.int32(row[i] * factor < level)
                n_remaining += guard_end - guard_start
            n += n_row
            if n >= ranks[j] or n + n_remaining < ranks[j]:
                break
        mask[v, j] = n >= ranks[j]
    return mask
