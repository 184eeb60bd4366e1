"""Split training windows: halves before and after the cell under test, and their means.

Halves lie along range, or along velocity where there are no training cells along range. The
middle is the median row of the window: that of the cell under test, whose cells are left out; at
the ends of the range, where the window moves off the cell, the middle moves as well, so that the
halves stay about equally large.
"""

from abc import abstractmethod
from functools import lru_cache
from typing import ClassVar

import numpy as np

from dechirp.core.compiled_kernels import IN_CALLER, can_compile, kernel
from dechirp.core.values import frozen_dataclass
from dechirp.processing.cfar.base import NoiseEstimator, TrainingWindow
from dechirp.processing.cfar.window_means import (
    initial_guard_and_training_column_sums,
    slide_column_sums,
    write_moving_sums,
)


@frozen_dataclass
class SplitWindowEstimator(NoiseEstimator):
    """CFAR estimator that selects one of the means of the two halves by its size."""

    select_mean: ClassVar[np.ufunc]
    """Function that selects one of two means."""

    @abstractmethod
    def halves_threshold_factor(
        self, false_alarm_probability: float, *, n_training: tuple[int, int], n_summed: int
    ) -> float:
        """Return the factor for independent cells and halves of any size."""

    def statistic(self, cells: np.ndarray, offsets: np.ndarray) -> np.ndarray:
        return np.asarray(self.select_mean(*half_window_means(cells, offsets)))

    def threshold(
        self, power: np.ndarray, window: TrainingWindow, factors: np.ndarray
    ) -> np.ndarray:
        if not can_compile():
            return super().threshold(power, window, factors)
        first, second = half_window_mean_maps(power, window)
        self.select_mean(first, second, out=first)
        return np.multiply(first, factors, out=first)

    def independent_cells_threshold_factor(
        self, false_alarm_probability: float, offsets: np.ndarray, *, n_channels: int
    ) -> float:
        sizes = half_window_sizes(offsets)
        return self.halves_threshold_factor(
            false_alarm_probability, n_training=sizes, n_summed=n_channels
        )


def half_window_masks(offsets: np.ndarray) -> np.ndarray:
    """Return masks of the training cells in the first and in the second half, (2, n_training)."""
    along_range = np.any(offsets[:, 0] == 0)  # otherwise guard cells fill the whole column
    positions = offsets[:, 1 if along_range else 0]
    middle = np.median(positions)
    return np.array([positions < middle, positions > middle])


def half_window_means(cells: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """Return the means of both halves of training cells (..., n_training), (2, ...)."""
    return np.array([cells[..., half].mean(axis=-1) for half in half_window_masks(offsets)])


def half_window_sizes(offsets: np.ndarray) -> tuple[int, int]:
    """Return the number of cells in each half."""
    first, second = np.count_nonzero(half_window_masks(offsets), axis=1)
    return int(first), int(second)


def half_window_mean_maps(
    power: np.ndarray, window: TrainingWindow
) -> tuple[np.ndarray, np.ndarray]:
    """Return the means of both halves of the window about each cell of a map (velocity, range)."""
    train_r, train_v, guard_r, guard_v = window.training_and_guard_counts
    if train_r == 0:
        first, second = _half_means_along_velocity(power, train_v, guard_r, guard_v)
        # At the ends of the range the box has rows beyond the guard, in few columns of the map.
        box_rows, velocity = (
            window.tested_rows_in_training_box(power.shape[1]),
            np.arange(len(power))[:, None],
        )
        for j in np.flatnonzero(box_rows != window.half_range):
            offsets = window.training_cell_offsets(int(box_rows[j]))
            cells = power[(velocity + offsets[:, 0]) % len(power), j + offsets[:, 1]]
            first[:, j], second[:, j] = half_window_means(cells, offsets)
        return first, second
    return _half_means_along_range(
        power, train_r, train_v, guard_r, guard_v, *_half_window_splits_and_weights(window)
    )


@lru_cache(maxsize=64)
def _half_window_splits_and_weights(
    window: TrainingWindow,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return box rows where the first half stops and the second starts, and 1 / size of both.

    Each for every row of the cell under test in the box, along the last axis. Cached, since they
    take as long as the means of a map.
    """
    windows = [
        window.training_cell_offsets(box_row) for box_row in range(2 * window.half_range + 1)
    ]
    middles = [np.median(offsets[:, 1]) + box_row for box_row, offsets in enumerate(windows)]
    per_cell = np.array(
        [[1 / size for size in half_window_sizes(offsets)] for offsets in windows]
    ).T
    return np.ceil(middles).astype(int), np.floor(middles).astype(int) + 1, per_cell


@kernel(plain=IN_CALLER, fastmath={"contract", "reassoc"})
def _half_means_along_range(
    power: np.ndarray,
    train_r: int,
    train_v: int,
    guard_r: int,
    guard_v: int,
    stops: np.ndarray,
    starts: np.ndarray,
    per_cell: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Compute means of the rows before and after the middle with sliding column sums."""
    n_v, n_r = power.shape
    half_v, half_r = train_v + guard_v, train_r + guard_r
    width, n_middle = 2 * half_r + 1, n_r - 2 * half_r
    first, second = np.empty((n_v, n_r), np.float32), np.empty((n_v, n_r), np.float32)
    slide_in, slide_out = initial_guard_and_training_column_sums(power, half_v, guard_v)
    outer, all_columns = np.empty(n_r, np.float32), np.empty(n_r, np.float32)
    side_sums, near_sums = np.zeros(n_r + 1, np.float32), np.zeros(n_r + 1, np.float32)
    work = np.empty((32, n_r + 1), np.float32)
    left_sums, left_near = side_sums[:n_middle], near_sums[train_r:]
    right_sums, right_near = side_sums[half_r + guard_r + 1 :], near_sums[half_r + 1 :]
    scale = np.float32(per_cell[0, half_r])
    ends = ((0, 0), (n_r - width, half_r + 1))  # start of the box, first place in it
    cumulative_all, cumulative_guard = np.zeros(width + 1), np.zeros(width + 1)
    for v in range(n_v):
        slide_column_sums(power, v, half_v, guard_v, slide_in, slide_out, outer, all_columns)
        write_moving_sums(all_columns, train_r, side_sums, work)
        write_moving_sums(outer, guard_r, near_sums, work)
        first_row, second_row = first[v, half_r:], second[v, half_r:]
        for j in range(n_middle):
            first_row[j] = (left_sums[j] + left_near[j]) * scale
            second_row[j] = (right_sums[j] + right_near[j]) * scale
        for start, first_box_row in ends:
            # Cumulative sums over the box: all cells, and those in guard columns.
            for i in range(width):
                cumulative_all[i + 1] = (
                    cumulative_all[i] + slide_in[start + i] + slide_out[start + i]
                )
                cumulative_guard[i + 1] = cumulative_guard[i] + slide_in[start + i]
            for box_row in range(first_box_row, first_box_row + half_r):
                low, high = max(box_row - guard_r, 0), min(box_row + guard_r + 1, width)
                stop, begin = stops[box_row], starts[box_row]
                total = (
                    cumulative_all[stop]
                    - cumulative_guard[min(high, stop)]
                    + cumulative_guard[min(low, stop)]
                )
                first[v, start + box_row] = total * per_cell[0, box_row]
                total = cumulative_all[width] - cumulative_all[begin]
                total -= cumulative_guard[max(high, begin)] - cumulative_guard[max(low, begin)]
                second[v, start + box_row] = total * per_cell[1, box_row]
    return first, second


@kernel(plain=IN_CALLER)
def _half_means_along_velocity(
    power: np.ndarray, train_v: int, guard_r: int, guard_v: int
) -> tuple[np.ndarray, np.ndarray]:
    """Compute means of the columns before and after the guard, away from the ends of the range."""
    n_v, n_r = power.shape
    half_v, width = train_v + guard_v, 2 * guard_r + 1
    first, second = np.empty((n_v, n_r), np.float32), np.empty((n_v, n_r), np.float32)
    sums_before, sums_after = np.zeros(n_r), np.zeros(n_r)
    for dv in range(1, train_v + 1):  # start one row before the first
        for j in range(n_r):
            sums_before[j] += power[(-1 - guard_v - dv) % n_v, j]
            sums_after[j] += power[(-1 + guard_v + dv) % n_v, j]
    scale = 1.0 / (train_v * width)
    for v in range(n_v):
        entering, leaving = power[(v - guard_v - 1) % n_v], power[(v - half_v - 1) % n_v]
        entering_after, leaving_after = power[(v + half_v) % n_v], power[(v + guard_v) % n_v]
        for j in range(n_r):
            sums_before[j] += np.float64(entering[j]) - np.float64(leaving[j])
            sums_after[j] += np.float64(entering_after[j]) - np.float64(leaving_after[j])
        for j in range(guard_r, n_r - guard_r):
            rows = slice(j - guard_r, j + guard_r + 1)
            first[v, j] = sums_before[rows].sum() * scale
            second[v, j] = sums_after[rows].sum() * scale
    return first, second
