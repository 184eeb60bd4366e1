"""Ordered statistic: the level that a share of the training cells is below.

Other targets among the training cells, up to the share above it, do not raise it. H. Rohling,
Radar CFAR thresholding in clutter and multiple target situations, IEEE Trans. AES 19(4), 1983.
"""

import numba
import numpy as np

from dechirp.core.checks import positive
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.process.cfar.base import NoiseEstimator, Ring
from dechirp.process.cfar.ranked import Sizes, candidates, number_of, order_statistics
from dechirp.theory.cfar import ordered_statistic_factor


@value
class OrderedStatistic(NoiseEstimator):
    """The k-th smallest training cell."""

    rank: float = 0.75
    """Which cell in order of power, k: 1 for the smallest; below 1, a share of the cells."""

    def __post_init__(self) -> None:
        positive(self, "rank")
        if self.rank >= 1 and self.rank != int(self.rank):
            raise InvalidSetting(
                "OrderedStatistic.rank",
                got=self.rank,
                need="a share below 1, or a whole number of cells",
                fix="Give 0.75 for the cell that three quarters of them reach.",
            )

    def check(self, ring: Ring) -> None:
        """There must be as many training cells as the rank."""
        n_cells = len(ring.offsets(ring.half_range))
        if self.rank > n_cells:
            raise InvalidSetting(
                "Cfar.estimator.rank",
                got=self.rank,
                need=f"at most {n_cells}, the training cells",
                fix="Lower it, or give a share below 1.",
            )

    def statistic(self, cells: np.ndarray, offsets: np.ndarray) -> np.ndarray:
        """The k-th smallest of the cells."""
        k = int(number_of(np.array(cells.shape[-1]), self.rank))
        return np.partition(cells, k - 1, axis=-1)[..., k - 1]

    def threshold(self, power: np.ndarray, ring: Ring, factors: np.ndarray) -> np.ndarray:
        """The k-th smallest training cell of each cell, times the factor of its row."""
        threshold = order_statistics(power, ring.sizes, self._ranks(power, ring)[1])
        return np.multiply(threshold, factors, out=threshold)

    def exceeds(self, power: np.ndarray, ring: Ring, factors: np.ndarray) -> np.ndarray:
        """Which cells exceed their threshold: those of which k training cells are that far under.

        The k-th smallest is no less than the mean of the k smallest, which few cells of noise
        exceed by the factor: only for those are training cells counted.
        """
        n_cells, ranks = self._ranks(power, ring)
        some = candidates(power, ring.sizes, factors, n_cells, ranks)
        return _exceeding(power, some, ring.sizes, factors, ranks)

    def independent_factor(
        self, false_alarm_probability: float, offsets: np.ndarray, *, n_channels: int
    ) -> float:
        """Rohling's product, or its integral for several channels."""
        return ordered_statistic_factor(
            false_alarm_probability,
            n_training=len(offsets),
            rank=int(number_of(np.array(len(offsets)), self.rank)),
            n_summed=n_channels,
        )

    def _ranks(self, power: np.ndarray, ring: Ring) -> tuple[np.ndarray, np.ndarray]:
        """Training cells of each row of a map, and the rank among them, (range,)."""
        n_cells = ring.n_cells(power.shape[1])
        return n_cells, number_of(n_cells, self.rank)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _exceeding(
    power: np.ndarray, some: np.ndarray, sizes: Sizes, factors: np.ndarray, ranks: np.ndarray
) -> np.ndarray:
    """Mask of those cells for which as many training cells as the rank lie a factor under."""
    train_r, train_v, guard_r, guard_v = sizes
    n_v, n_r = power.shape
    half_v, width = train_v + guard_v, 2 * (train_r + guard_r) + 1
    mask = np.zeros((n_v, n_r), np.bool_)
    for c in range(len(some)):
        v, j = some[c, 0], some[c, 1]
        level, factor = power[v, j], factors[j]
        start = min(max(j - width // 2, 0), n_r - width)
        before, after = max(j - guard_r, start), min(j + guard_r + 1, start + width)
        n, n_left = np.int64(0), (2 * half_v + 1) * width - (2 * guard_v + 1) * (after - before)
        for dv in range(-half_v, half_v + 1):
            row = power[(v + dv) % n_v, start : start + width]
            now = np.int32(0)
            for i in range(width):
                now += np.int32(row[i] * factor < level)
            n_left -= width
            if abs(dv) <= guard_v:
                for i in range(before - start, after - start):
                    now -= np.int32(row[i] * factor < level)
                n_left += after - before
            n += now
            if n >= ranks[j] or n + n_left < ranks[j]:
                break
        mask[v, j] = n >= ranks[j]
    return mask
