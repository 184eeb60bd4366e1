"""Halves of the training cells, before and after their middle, and their means over a map.

Halves lie along range, or along velocity where there are no training cells along range. The
middle is the median row of the ring: that of the cell under test, whose cells are left out; at
the ends of the range, where the ring moves off the cell, it moves as well, so that the halves
stay about as large as each other.
"""

from abc import abstractmethod
from functools import lru_cache
from typing import ClassVar

import numba
import numpy as np

from dechirp.core.values import value
from dechirp.process.cfar.base import NoiseEstimator, Ring
from dechirp.process.cfar.ring_means import column_sums, runs, slide


@value
class OfHalves(NoiseEstimator):
    """Takes the mean of one of the two halves, whichever is chosen by its size."""

    chosen: ClassVar[np.ufunc]
    """Of two means, the one that is taken."""

    @abstractmethod
    def law(
        self, false_alarm_probability: float, *, n_training: tuple[int, int], n_summed: int
    ) -> float:
        """Factor for independent cells, of halves of any size."""

    def statistic(self, cells: np.ndarray, offsets: np.ndarray) -> np.ndarray:
        """The chosen one of the means of both halves."""
        return np.asarray(self.chosen(*mean_of_each(cells, offsets)))

    def threshold(self, power: np.ndarray, ring: Ring, factors: np.ndarray) -> np.ndarray:
        """The same about each cell, times the factor of its row."""
        first, second = half_means(power, ring)
        self.chosen(first, second, out=first)
        return np.multiply(first, factors, out=first)

    def independent_factor(
        self, false_alarm_probability: float, offsets: np.ndarray, *, n_channels: int
    ) -> float:
        """Exact for halves of any size."""
        sizes = sizes_of_each(offsets)
        return self.law(false_alarm_probability, n_training=sizes, n_summed=n_channels)


def halves(offsets: np.ndarray) -> np.ndarray:
    """Which training cells are in the first half and which in the second, (2, n_training)."""
    along_range = np.any(offsets[:, 0] == 0)  # otherwise the guard takes the whole column
    places = offsets[:, 1 if along_range else 0]
    middle = np.median(places)
    return np.array([places < middle, places > middle])


def mean_of_each(cells: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """Means of both halves of training cells (..., n_training), (2, ...)."""
    return np.array([cells[..., half].mean(axis=-1) for half in halves(offsets)])


def sizes_of_each(offsets: np.ndarray) -> tuple[int, int]:
    """Number of cells in each half."""
    first, second = np.count_nonzero(halves(offsets), axis=1)
    return int(first), int(second)


def half_means(power: np.ndarray, ring: Ring) -> tuple[np.ndarray, np.ndarray]:
    """Means of both halves of the ring about each cell of a map (velocity, range)."""
    train_r, train_v, guard_r, guard_v = ring.sizes
    if train_r == 0:
        first, second = _along_velocity(power, train_v, guard_r, guard_v)
        # At the ends of the range the box has rows beyond the guard: few columns of the map.
        places, velocity = ring.places(power.shape[1]), np.arange(len(power))[:, None]
        for j in np.flatnonzero(places != ring.half_range):
            offsets = ring.offsets(int(places[j]))
            cells = power[(velocity + offsets[:, 0]) % len(power), j + offsets[:, 1]]
            first[:, j], second[:, j] = mean_of_each(cells, offsets)
        return first, second
    return _along_range(power, train_r, train_v, guard_r, guard_v, *_limits(ring))


@lru_cache(maxsize=64)
def _limits(ring: Ring) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows of the box where the first half stops and the second starts, and 1 / size of both.

    Each for every place of the cell under test in the box, along the last axis. (Found anew,
    they would take as long as the means of a map.)
    """
    rings = [ring.offsets(place) for place in range(2 * ring.half_range + 1)]
    middles = [np.median(offsets[:, 1]) + place for place, offsets in enumerate(rings)]
    per_cell = np.array([[1 / size for size in sizes_of_each(offsets)] for offsets in rings]).T
    return np.ceil(middles).astype(int), np.floor(middles).astype(int) + 1, per_cell


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})
def _along_range(
    power: np.ndarray,
    train_r: int,
    train_v: int,
    guard_r: int,
    guard_v: int,
    stops: np.ndarray,
    starts: np.ndarray,
    per_cell: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Means of the rows before and after the middle; columns slide as in `ring_means`."""
    n_v, n_r = power.shape
    half_v, half_r = train_v + guard_v, train_r + guard_r
    width, n_middle = 2 * half_r + 1, n_r - 2 * half_r
    first, second = np.empty((n_v, n_r), np.float32), np.empty((n_v, n_r), np.float32)
    slide_in, slide_out = column_sums(power, half_v, guard_v)
    outer, both = np.empty(n_r, np.float32), np.empty(n_r, np.float32)
    sides, near = np.zeros(n_r + 1, np.float32), np.zeros(n_r + 1, np.float32)
    work = np.empty((32, n_r + 1), np.float32)
    left, left_near = sides[:n_middle], near[train_r:]
    right, right_near = sides[half_r + guard_r + 1 :], near[half_r + 1 :]
    scale = np.float32(per_cell[0, half_r])
    ends = ((0, 0), (n_r - width, half_r + 1))  # start of the box, first place in it
    of_all, of_guard = np.zeros(width + 1), np.zeros(width + 1)
    for v in range(n_v):
        slide(power, v, half_v, guard_v, slide_in, slide_out, outer, both)
        runs(both, train_r, sides, work)
        runs(outer, guard_r, near, work)
        before, after = first[v, half_r:], second[v, half_r:]
        for j in range(n_middle):
            before[j] = (left[j] + left_near[j]) * scale
            after[j] = (right[j] + right_near[j]) * scale
        for start, places in ends:
            # Up to each row of the box: all cells, and those in columns of the guard.
            for i in range(width):
                of_all[i + 1] = of_all[i] + slide_in[start + i] + slide_out[start + i]
                of_guard[i + 1] = of_guard[i] + slide_in[start + i]
            for place in range(places, places + half_r):
                low, high = max(place - guard_r, 0), min(place + guard_r + 1, width)
                stop, begin = stops[place], starts[place]
                total = of_all[stop] - of_guard[min(high, stop)] + of_guard[min(low, stop)]
                first[v, start + place] = total * per_cell[0, place]
                total = of_all[width] - of_all[begin]
                total -= of_guard[max(high, begin)] - of_guard[max(low, begin)]
                second[v, start + place] = total * per_cell[1, place]
    return first, second


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _along_velocity(
    power: np.ndarray, train_v: int, guard_r: int, guard_v: int
) -> tuple[np.ndarray, np.ndarray]:
    """Means of the columns before and after the guard, away from the ends of the range."""
    n_v, n_r = power.shape
    half_v, width = train_v + guard_v, 2 * guard_r + 1
    first, second = np.empty((n_v, n_r), np.float32), np.empty((n_v, n_r), np.float32)
    before, after = np.zeros(n_r), np.zeros(n_r)
    for dv in range(1, train_v + 1):  # about the row before the first
        for j in range(n_r):
            before[j] += power[(-1 - guard_v - dv) % n_v, j]
            after[j] += power[(-1 + guard_v + dv) % n_v, j]
    scale = 1.0 / (train_v * width)
    for v in range(n_v):
        enters, leaves = power[(v - guard_v - 1) % n_v], power[(v - half_v - 1) % n_v]
        enters_after, leaves_after = power[(v + half_v) % n_v], power[(v + guard_v) % n_v]
        for j in range(n_r):
            before[j] += np.float64(enters[j]) - np.float64(leaves[j])
            after[j] += np.float64(enters_after[j]) - np.float64(leaves_after[j])
        for j in range(guard_r, n_r - guard_r):
            rows = slice(j - guard_r, j + guard_r + 1)
            first[v, j] = before[rows].sum() * scale
            second[v, j] = after[rows].sum() * scale
    return first, second
