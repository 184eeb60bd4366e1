"""Trimmed mean: the mean of the training cells but the smallest and the largest.

Between cell averaging and an ordered statistic. P. P. Gandhi and S. A. Kassam, Analysis of CFAR
processors in nonhomogeneous background, IEEE Trans. AES 24(4), 1988.
"""

import numba
import numpy as np

from dechirp.core.checks import not_negative
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.process.cfar.base import NoiseEstimator, Ring
from dechirp.process.cfar.ranked import (
    Sizes,
    candidates,
    gather,
    kth_smallest,
    number_of,
    order_statistics,
)
from dechirp.theory.trimmed_mean import trimmed_mean_factor


@value
class TrimmedMean(NoiseEstimator):
    """Mean of the training cells that are left when some are cut off at each end."""

    n_smallest: float = 0.0
    """How many of the smallest are cut off; below 1, a share of the cells."""
    n_largest: float = 0.25
    """How many of the largest are cut off; below 1, a share of the cells."""

    def __post_init__(self) -> None:
        not_negative(self, "n_smallest", "n_largest")
        for name in ("n_smallest", "n_largest"):
            number = getattr(self, name)
            if number >= 1 and number != int(number):
                raise InvalidSetting(
                    f"TrimmedMean.{name}",
                    got=number,
                    need="a share below 1, or a whole number of cells",
                    fix="Give 0.25 for a quarter of them.",
                )

    def check(self, ring: Ring) -> None:
        """A training cell must be left."""
        n_cells = len(ring.offsets(ring.half_range))
        if sum(self._cut_off(n_cells)) >= n_cells:
            raise InvalidSetting(
                "Cfar.estimator.n_largest",
                got=f"{self.n_largest:g} beside {self.n_smallest:g} of the smallest",
                need=f"fewer than the {n_cells} training cells together",
                fix="Cut off fewer cells, or train over more.",
            )

    def statistic(self, cells: np.ndarray, offsets: np.ndarray) -> np.ndarray:
        """Mean of the cells that are kept."""
        n = cells.shape[-1]
        first, n_largest = self._cut_off(n)
        last = n - n_largest
        parted = np.partition(cells, sorted({first, last - 1}), axis=-1)
        return parted[..., first:last].mean(axis=-1)

    def threshold(self, power: np.ndarray, ring: Ring, factors: np.ndarray) -> np.ndarray:
        """Mean of the training cells that are kept about each cell, times the factor of its row."""
        n_cells, n_smallest, n_largest = self._cuts(power, ring)
        if n_smallest.any():
            lowest = order_statistics(power, ring.sizes, n_smallest + 1)
        else:
            lowest = np.zeros_like(power)
        highest = order_statistics(power, ring.sizes, n_cells - n_largest)
        return _of_map(power, ring.sizes, factors, n_smallest, n_largest, lowest, highest)

    def exceeds(self, power: np.ndarray, ring: Ring, factors: np.ndarray) -> np.ndarray:
        """Which cells exceed their threshold.

        The mean without the smallest is no less than with them, which few cells of noise exceed
        by the factor: only for those are training cells put in order.
        """
        n_cells, n_smallest, n_largest = self._cuts(power, ring)
        some = candidates(power, ring.sizes, factors, n_cells, n_cells - n_largest)
        return _exceeding(power, some, ring.sizes, factors, n_smallest, n_largest)

    def independent_factor(
        self, false_alarm_probability: float, offsets: np.ndarray, *, n_channels: int
    ) -> float | None:
        """Gandhi and Kassam's product; none for several channels."""
        if n_channels > 1:
            return None
        n_smallest, n_largest = self._cut_off(len(offsets))
        return trimmed_mean_factor(
            false_alarm_probability,
            n_training=len(offsets),
            n_smallest=n_smallest,
            n_largest=n_largest,
        )

    def _cut_off(self, n_cells: int) -> tuple[int, int]:
        """How many of so many training cells are cut off at both ends."""
        number = np.array(n_cells)
        return int(number_of(number, self.n_smallest)), int(number_of(number, self.n_largest))

    def _cuts(self, power: np.ndarray, ring: Ring) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Training cells of each row of a map, and how many are cut off at both ends, (range,)."""
        n_cells = ring.n_cells(power.shape[1])
        return (
            n_cells,
            number_of(n_cells, self.n_smallest),
            number_of(n_cells, self.n_largest),
        )


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _of_map(
    power: np.ndarray,
    sizes: Sizes,
    factors: np.ndarray,
    n_smallest: np.ndarray,
    n_largest: np.ndarray,
    lowest: np.ndarray,
    highest: np.ndarray,
) -> np.ndarray:
    """Thresholds from the smallest and the largest cell that is kept, written over the latter."""
    width, height = 2 * (sizes[0] + sizes[2]) + 1, 2 * (sizes[1] + sizes[3]) + 1
    cells = np.empty(width * height, np.float32)
    for v in range(power.shape[0]):
        for j in range(power.shape[1]):
            n = gather(power, v, j, sizes, cells)
            kept = _mean(cells[:n], n_smallest[j], n_largest[j], lowest[v, j], highest[v, j])
            highest[v, j] = kept * factors[j]
    return highest


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _exceeding(
    power: np.ndarray,
    some: np.ndarray,
    sizes: Sizes,
    factors: np.ndarray,
    n_smallest: np.ndarray,
    n_largest: np.ndarray,
) -> np.ndarray:
    """Mask of those cells that exceed their thresholds."""
    width, height = 2 * (sizes[0] + sizes[2]) + 1, 2 * (sizes[1] + sizes[3]) + 1
    cells, ordered = np.empty(width * height, np.float32), np.empty(width * height, np.float32)
    mask = np.zeros(power.shape, np.bool_)
    for c in range(len(some)):
        v, j = some[c, 0], some[c, 1]
        n = gather(power, v, j, sizes, cells)
        if _surely_not(cells[:n], n_largest[j], power[v, j] / factors[j]):
            continue
        ordered[:n] = cells[:n]
        lowest = kth_smallest(ordered, n, n_smallest[j] + 1)
        highest = kth_smallest(ordered, n, n - n_largest[j])
        kept = _mean(cells[:n], n_smallest[j], n_largest[j], lowest, highest)
        mask[v, j] = power[v, j] > kept * factors[j]
    return mask


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})
def _surely_not(cells: np.ndarray, n_largest: int, level: np.float32) -> bool:
    """Whether the mean without the largest is above a level, by the bound of `candidates`.

    A few of its levels nearly always tell, in a tenth of the time of putting cells in order.
    """
    q, enough = level, np.float32((cells.size - n_largest) * level * (1 + 1e-4))
    for _ in range(8):
        total = np.float32(0.0)
        for i in range(cells.size):
            total += min(cells[i], q)
        if total - n_largest * q > enough:
            return True
        q *= np.float32(1.7)
    return False


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _mean(
    cells: np.ndarray, n_smallest: int, n_largest: int, lowest: np.float32, highest: np.float32
) -> np.float32:
    """Mean of the cells in between: all cells as if cut off there, less those cut off."""
    total = np.float64(0.0)
    for i in range(cells.size):
        total += min(max(cells[i], lowest), highest)
    total -= n_smallest * np.float64(lowest) + n_largest * np.float64(highest)
    return np.float32(total / (cells.size - n_smallest - n_largest))
