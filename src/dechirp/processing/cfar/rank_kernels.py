"""Order statistics of training cells for every cell of a map, as compiled kernels.

`sizes` are those of a training window: training cells along range and velocity, then guard cells.
Velocity wraps round; the box stays within the map along range.
"""

import numpy as np

from dechirp.core.compiled_kernels import IN_CALLER, kernel
from dechirp.processing.cfar.window_means import scaled_window_means

SideCounts = tuple[int, int, int, int]

_BLOCK = 32  # columns of the map that share a level
_SAMPLES = 128  # cells of a block that determine its level: within 4 % of its rank


def candidate_detection_cells(
    power: np.ndarray,
    side_counts: SideCounts,
    factors: np.ndarray,
    n_training: np.ndarray,
    n_smallest: np.ndarray,
) -> np.ndarray:
    """Return cells that may exceed factor times the mean of their n_low smallest training cells.

    The result (n, 2) contains all cells that do. For any level q not below a box's clip level,

        mean of the smallest >= (sum of min(cell, q) - (N - n_low) q) / n_low,

    as each of the largest adds q at most. Sums of clipped cells are as fast as cell averaging,
    and where q is about the largest of the smallest, the bound is tight.

    `n_training`, N, and `n_smallest` are of the training cells of each row of the map, (range,).
    """
    highest = np.empty(power.shape[1], np.float32)
    share = n_smallest[power.shape[1] // 2] / n_training[power.shape[1] // 2]
    means = scaled_window_means(
        _clip_map_at_block_quantiles(power, share, side_counts, highest),
        np.ones(power.shape[1], np.float32),
        *side_counts,
    )
    # Sums are accurate to 5e-6; lowering the bound by 1e-5 of them keeps it a bound.
    sum_factors = (factors * n_training / n_smallest * (1 - 1e-5)).astype(np.float32)
    level_offsets = (factors * (n_training - n_smallest) / n_smallest * highest).astype(np.float32)
    return _cells_above_bound(power, means, sum_factors, level_offsets)


@kernel(plain=IN_CALLER)
def _clip_map_at_block_quantiles(
    power: np.ndarray, quantile: float, side_counts: SideCounts, box_clip_levels: np.ndarray
) -> np.ndarray:
    """Clip a map block by block at a quantile; write the clip level of each box."""
    n_v, n_r = power.shape
    n_blocks = (n_r + _BLOCK - 1) // _BLOCK
    levels = np.empty(n_blocks, np.float32)
    sample = np.empty(_SAMPLES, np.float32)
    for block in range(n_blocks):
        start = block * _BLOCK
        n = min(_BLOCK, n_r - start) * n_v
        n_taken = min(n, _SAMPLES)
        for i in range(n_taken):
            index = (i * n) // n_taken
            v = index // (n // n_v)
            sample[i] = power[v, start + (index + v) % (n // n_v)]  # every row, all columns in turn
        levels[block] = kth_smallest(sample, n_taken, max(int(quantile * n_taken), 1))
    width = 2 * (side_counts[0] + side_counts[2]) + 1
    for j in range(n_r):
        start = min(max(j - width // 2, 0), n_r - width)
        box_clip_levels[j] = levels[start // _BLOCK : (start + width - 1) // _BLOCK + 1].max()
    clipped = np.empty((n_v, n_r), np.float32)
    for v in range(n_v):
        for block in range(n_blocks):
            level = levels[block]
            row = power[v, block * _BLOCK : (block + 1) * _BLOCK]
            out = clipped[v, block * _BLOCK : (block + 1) * _BLOCK]
            for j in range(row.size):
                out[j] = min(row[j], level)
    return clipped


@kernel(plain=IN_CALLER, fastmath={"contract"})
def _cells_above_bound(
    power: np.ndarray, means: np.ndarray, sum_factors: np.ndarray, level_offsets: np.ndarray
) -> np.ndarray:
    """Return the cells above a row's multiple of the mean less its level, (n, 2)."""
    n_v, n_r = power.shape
    flat = np.empty(power.size, np.uint32)
    n = 0
    for v in range(n_v):
        for start in range(0, n_r, 64):
            line, mean = power[v, start : start + 64], means[v, start : start + 64]
            per_sum, offset = sum_factors[start : start + 64], level_offsets[start : start + 64]
            n_over = np.int32(0)
            for i in range(line.size):
                n_over += np.int32(line[i] > mean[i] * per_sum[i] - offset[i])
            if n_over:
                for i in range(line.size):
                    if line[i] > mean[i] * per_sum[i] - offset[i]:
                        flat[n] = v * n_r + start + i
                        n += 1
    cells = np.empty((n, 2), np.int32)
    for i in range(n):
        cells[i, 0], cells[i, 1] = flat[i] // n_r, flat[i] % n_r
    return cells


@kernel()
def gather_training_cells(
    power: np.ndarray, velocity_row: int, range_row: int, side_counts: SideCounts, cells: np.ndarray
) -> int:
    """Copy the training cells of a cell to the start of an array; return their number."""
    train_r, train_v, guard_r, guard_v = side_counts
    n_v, n_r = power.shape
    half_v, width = train_v + guard_v, 2 * (train_r + guard_r) + 1
    start = min(max(range_row - width // 2, 0), n_r - width)
    guard_start, guard_end = (
        max(range_row - guard_r, start),
        min(range_row + guard_r + 1, start + width),
    )
    n = 0
    for dv in range(-half_v, half_v + 1):
        row = power[(velocity_row + dv) % n_v]
        if abs(dv) > guard_v:
            row_guard_start, row_guard_end = start, start
        else:
            row_guard_start, row_guard_end = guard_start, guard_end
        for i in range(start, row_guard_start):
            cells[n] = row[i]
            n += 1
        for i in range(row_guard_end, start + width):
            cells[n] = row[i]
            n += 1
    return n


@kernel()
def kth_smallest(cells: np.ndarray, n: int, k: int) -> np.float32:
    """Return the k-th smallest of the first n cells, k from 1; reorders them."""
    low, high, target = 0, n - 1, k - 1
    while low < high:
        pivot = cells[(low + high) // 2]
        i, j = low, high
        while i <= j:
            while cells[i] < pivot:
                i += 1
            while cells[j] > pivot:
                j -= 1
            if i <= j:
                cells[i], cells[j] = cells[j], cells[i]
                i += 1
                j -= 1
        if target <= j:
            high = j
        elif target >= i:
            low = i
        else:
            break
    return cells[target]


def order_statistic_map(
    power: np.ndarray, side_counts: SideCounts, ranks: np.ndarray
) -> np.ndarray:
    """Return the ranks[j]-th smallest training cell of each cell in row j of the range.

    An eighth of the range at a time: the order of cells takes four times their memory.
    """
    n_r = power.shape[1]
    half = side_counts[0] + side_counts[2]
    width = 2 * half + 1
    out = np.empty(power.shape, np.float32)
    step = max(-(-n_r // 8), 2 * width)
    for first in range(0, n_r, step):
        last = min(first + step, n_r)
        # A block includes all cells of its boxes, at the ends of the range as in the whole map.
        low = min(max(first - half, 0), n_r - width)
        high = max(min(last + half, n_r), low + width)
        block = _order_statistic_of_range_part(
            np.ascontiguousarray(power[:, low:high]), side_counts, ranks[low:high]
        )
        out[:, first:last] = block[:, first - low : last - low]
    return out


def _order_statistic_of_range_part(
    power: np.ndarray, side_counts: SideCounts, ranks: np.ndarray
) -> np.ndarray:
    order = np.argsort(power, axis=None).astype(np.int32)
    rank_of_cell = np.empty(power.shape, np.int32)
    rank_of_cell.ravel()[order] = np.arange(power.size, dtype=np.int32)
    return _sliding_order_statistics(power, order, rank_of_cell, side_counts, ranks)


@kernel(plain=IN_CALLER)
def _sliding_order_statistics(
    power: np.ndarray,
    order: np.ndarray,
    rank_of_cell: np.ndarray,
    side_counts: SideCounts,
    ranks: np.ndarray,
) -> np.ndarray:
    """Slide a window along range and track its order statistic by marks in the cell order.

    From one cell to the next the statistic moves by a few marks (as in T. S. Huang, G. J. Yang
    and G. Y. Tang, A fast two-dimensional median filtering algorithm, IEEE Trans. ASSP 27(1),
    1979, with the order itself in place of classes of power, so that it is exact).
    """
    train_r, train_v, guard_r, guard_v = side_counts
    n_v, n_r = power.shape
    half_v, width = train_v + guard_v, 2 * (train_r + guard_r) + 1
    marks = np.zeros(power.size // 64 + 1, np.uint64)
    counts = np.zeros(marks.size, np.uint8)  # marks in each word of 64
    cells = power.ravel()
    out = np.empty((n_v, n_r), np.float32)
    for v in range(n_v):
        marks[:] = 0
        counts[:] = 0
        word, n_below = 0, 0  # word with the statistic, and marks below it
        start, first, last = 0, 0, 0  # start of the box; guard rows
        for j in range(n_r):
            next_start = min(max(j - width // 2, 0), n_r - width)
            next_first, next_last = (
                max(j - guard_r, next_start),
                min(j + guard_r + 1, next_start + width),
            )
            if j == 0:
                n_below += _update_marks_and_count_below(
                    rank_of_cell, marks, counts, v, half_v, (0, width), 1, word
                )
            elif next_start > start:
                end = start + width
                n_below += _update_marks_and_count_below(
                    rank_of_cell, marks, counts, v, half_v, (start, next_start), -1, word
                )
                n_below += _update_marks_and_count_below(
                    rank_of_cell, marks, counts, v, half_v, (end, next_start + width), 1, word
                )
            # One row leaves the guard and one enters, except at the ends of the range.
            n_below += _update_marks_and_count_below(
                rank_of_cell, marks, counts, v, guard_v, (first, min(next_first, last)), 1, word
            )
            n_below += _update_marks_and_count_below(
                rank_of_cell, marks, counts, v, guard_v, (max(last, 0), next_last), -1, word
            )
            start, first, last = next_start, next_first, next_last
            while n_below >= ranks[j]:
                word -= 1
                n_below -= counts[word]
            while n_below + counts[word] < ranks[j]:
                n_below += counts[word]
                word += 1
            bits = marks[word]
            for _ in range(ranks[j] - n_below - 1):
                bits &= bits - np.uint64(1)
            lowest = bits & (~bits + np.uint64(1))
            out[v, j] = cells[order[64 * word + int(np.log2(np.float64(lowest)))]]
    return out


@kernel()
def _update_marks_and_count_below(
    rank_of_cell: np.ndarray,
    marks: np.ndarray,
    counts: np.ndarray,
    v: int,
    half_width: int,
    rows: tuple[int, int],
    count_change: int,
    reference_word: int,
) -> int:
    """Set or clear the marks of cells; return the change in marks below the reference word."""
    n_below = 0
    for dv in range(-half_width, half_width + 1):
        # Wrapping by % would take as long as marking.
        u = v + dv
        if u < 0:
            u += rank_of_cell.shape[0]
        elif u >= rank_of_cell.shape[0]:
            u -= rank_of_cell.shape[0]
        line = rank_of_cell[u]
        for i in range(rows[0], rows[1]):
            word = line[i] >> 6
            marks[word] ^= np.uint64(1) << np.uint64(line[i] & 63)
            counts[word] += count_change
            n_below += word < reference_word
    return count_change * n_below
