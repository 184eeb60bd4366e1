"""Training cells in order of power, for every cell of a map: kernels of several members.

`sizes` are those of a ring, training cells along range and velocity, then guard cells.
Velocity wraps round; the box stays within the map along range.
"""

import numba
import numpy as np

from dechirp.process.cfar.ring_means import ring_means

Sizes = tuple[int, int, int, int]

_BLOCK = 32  # columns of the map that have a level in common
_SAMPLES = 128  # of a block, from which its level is taken: within 4 % of its rank


def number_of(n_cells: np.ndarray, wanted: float) -> np.ndarray:
    """How many of so many cells a setting wants: a share of them below 1, or a number."""
    number = np.ceil(wanted * n_cells - 1e-9) if wanted < 1 else np.full_like(n_cells, wanted)
    return np.asarray(number, dtype=int)


def candidates(
    power: np.ndarray, sizes: Sizes, factors: np.ndarray, n_cells: np.ndarray, n_low: np.ndarray
) -> np.ndarray:
    """Cells that may exceed factor times the mean of their n_low smallest training cells, (n, 2).

    All that do are among them. For any level q of at least the largest of a box's,

        mean of the smallest >= (sum of min(cell, q) - (N - n_low) q) / n_low,

    as each of the largest adds q at most. Sums of cells cut off at a level are as fast as cell
    averaging, and where q is about the largest of the smallest, the bound is nearly reached.

    `n_cells`, N, and `n_low` are of the training cells of each row of the map, (range,).
    """
    highest = np.empty(power.shape[1], np.float32)
    share = n_low[power.shape[1] // 2] / n_cells[power.shape[1] // 2]
    means = ring_means(
        _cut(power, share, sizes, highest), np.ones(power.shape[1], np.float32), *sizes
    )
    # Sums are good to 5e-6; a bound that is too low by 1e-5 of them is one for certain.
    of_sum = (factors * n_cells / n_low * (1 - 1e-5)).astype(np.float32)
    of_level = (factors * (n_cells - n_low) / n_low * highest).astype(np.float32)
    return _above(power, means, of_sum, of_level)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _cut(power: np.ndarray, share: float, sizes: Sizes, highest: np.ndarray) -> np.ndarray:
    """Map cut off at the level that a share of the cells about is below; `highest` in the box."""
    n_v, n_r = power.shape
    n_blocks = (n_r + _BLOCK - 1) // _BLOCK
    levels = np.empty(n_blocks, np.float32)
    sample = np.empty(_SAMPLES, np.float32)
    for block in range(n_blocks):
        start = block * _BLOCK
        n = min(_BLOCK, n_r - start) * n_v
        n_taken = min(n, _SAMPLES)
        for i in range(n_taken):
            at = (i * n) // n_taken
            v = at // (n // n_v)
            sample[i] = power[v, start + (at + v) % (n // n_v)]  # every row, all columns in turn
        levels[block] = kth_smallest(sample, n_taken, max(int(share * n_taken), 1))
    width = 2 * (sizes[0] + sizes[2]) + 1
    for j in range(n_r):
        start = min(max(j - width // 2, 0), n_r - width)
        highest[j] = levels[start // _BLOCK : (start + width - 1) // _BLOCK + 1].max()
    cut = np.empty((n_v, n_r), np.float32)
    for v in range(n_v):
        for block in range(n_blocks):
            level = levels[block]
            row = power[v, block * _BLOCK : (block + 1) * _BLOCK]
            out = cut[v, block * _BLOCK : (block + 1) * _BLOCK]
            for j in range(row.size):
                out[j] = min(row[j], level)
    return cut


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _above(
    power: np.ndarray, means: np.ndarray, of_sum: np.ndarray, of_level: np.ndarray
) -> np.ndarray:
    """Cells above a row's multiple of the mean less its level, (n, 2)."""
    n_v, n_r = power.shape
    flat = np.empty(power.size, np.uint32)
    n = 0
    for v in range(n_v):
        for start in range(0, n_r, 64):
            line, mean = power[v, start : start + 64], means[v, start : start + 64]
            per_sum, less = of_sum[start : start + 64], of_level[start : start + 64]
            n_over = np.int32(0)
            for i in range(line.size):
                n_over += np.int32(line[i] > mean[i] * per_sum[i] - less[i])
            if n_over:
                for i in range(line.size):
                    if line[i] > mean[i] * per_sum[i] - less[i]:
                        flat[n] = v * n_r + start + i
                        n += 1
    found = np.empty((n, 2), np.int32)
    for i in range(n):
        found[i, 0], found[i, 1] = flat[i] // n_r, flat[i] % n_r
    return found


@numba.njit(cache=True, nogil=True, error_model="numpy")
def gather(power: np.ndarray, v: int, j: int, sizes: Sizes, cells: np.ndarray) -> int:
    """Copy the training cells of a cell to the start of an array; their number."""
    train_r, train_v, guard_r, guard_v = sizes
    n_v, n_r = power.shape
    half_v, width = train_v + guard_v, 2 * (train_r + guard_r) + 1
    start = min(max(j - width // 2, 0), n_r - width)
    before, after = max(j - guard_r, start), min(j + guard_r + 1, start + width)
    n = 0
    for dv in range(-half_v, half_v + 1):
        row = power[(v + dv) % n_v]
        if abs(dv) > guard_v:
            before_now, after_now = start, start
        else:
            before_now, after_now = before, after
        for i in range(start, before_now):
            cells[n] = row[i]
            n += 1
        for i in range(after_now, start + width):
            cells[n] = row[i]
            n += 1
    return n


@numba.njit(cache=True, nogil=True, error_model="numpy")
def kth_smallest(cells: np.ndarray, n: int, k: int) -> np.float32:
    """The k-th smallest of the first n cells, k from 1; reorders them."""
    low, high, want = 0, n - 1, k - 1
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
        if want <= j:
            high = j
        elif want >= i:
            low = i
        else:
            break
    return cells[want]


def order_statistics(power: np.ndarray, sizes: Sizes, ranks: np.ndarray) -> np.ndarray:
    """The ranks[j]-th smallest training cell of each cell in row j of the range.

    An eighth of the range at a time: the order of cells takes four times their memory.
    """
    n_r = power.shape[1]
    half = sizes[0] + sizes[2]
    width = 2 * half + 1
    out = np.empty(power.shape, np.float32)
    step = max(-(-n_r // 8), 2 * width)
    for first in range(0, n_r, step):
        last = min(first + step, n_r)
        # With all cells of their boxes, at the ends of the range as in the whole map.
        low = min(max(first - half, 0), n_r - width)
        high = max(min(last + half, n_r), low + width)
        found = _of_part(np.ascontiguousarray(power[:, low:high]), sizes, ranks[low:high])
        out[:, first:last] = found[:, first - low : last - low]
    return out


def _of_part(power: np.ndarray, sizes: Sizes, ranks: np.ndarray) -> np.ndarray:
    order = np.argsort(power, axis=None).astype(np.int32)
    place = np.empty(power.shape, np.int32)
    place.ravel()[order] = np.arange(power.size, dtype=np.int32)
    return _by_order(power, order, place, sizes, ranks)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _by_order(
    power: np.ndarray, order: np.ndarray, place: np.ndarray, sizes: Sizes, ranks: np.ndarray
) -> np.ndarray:
    """Marks the cells of a ring that slides along range in the order of all cells of the map.

    From one cell to the next the statistic moves on by a few marks (as in T. S. Huang,
    G. J. Yang and G. Y. Tang, A fast two-dimensional median filtering algorithm, IEEE Trans.
    ASSP 27(1), 1979, with the order itself in place of classes of power, so that it is exact).
    """
    train_r, train_v, guard_r, guard_v = sizes
    n_v, n_r = power.shape
    half_v, width = train_v + guard_v, 2 * (train_r + guard_r) + 1
    marks = np.zeros(power.size // 64 + 1, np.uint64)
    counts = np.zeros(marks.size, np.uint8)  # of the marks in each 64
    cells = power.ravel()
    out = np.empty((n_v, n_r), np.float32)
    for v in range(n_v):
        marks[:] = 0
        counts[:] = 0
        at, below = 0, 0  # the 64 that hold the statistic, and marks below them
        start, first, last = 0, 0, 0  # of the box; rows of the range that the guard takes
        for j in range(n_r):
            now = min(max(j - width // 2, 0), n_r - width)
            first_now, last_now = max(j - guard_r, now), min(j + guard_r + 1, now + width)
            if j == 0:
                below += _mark(place, marks, counts, v, half_v, (0, width), 1, at)
            elif now > start:
                end = start + width
                below += _mark(place, marks, counts, v, half_v, (start, now), -1, at)
                below += _mark(place, marks, counts, v, half_v, (end, now + width), 1, at)
            # One row leaves the guard, but for the ends of the range, and one comes in.
            below += _mark(place, marks, counts, v, guard_v, (first, min(first_now, last)), 1, at)
            below += _mark(place, marks, counts, v, guard_v, (max(last, 0), last_now), -1, at)
            start, first, last = now, first_now, last_now
            while below >= ranks[j]:
                at -= 1
                below -= counts[at]
            while below + counts[at] < ranks[j]:
                below += counts[at]
                at += 1
            found = marks[at]
            for _ in range(ranks[j] - below - 1):
                found &= found - np.uint64(1)
            lowest = found & (~found + np.uint64(1))
            out[v, j] = cells[order[64 * at + int(np.log2(np.float64(lowest)))]]
    return out


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _mark(
    place: np.ndarray,
    marks: np.ndarray,
    counts: np.ndarray,
    v: int,
    reach: int,
    rows: tuple[int, int],
    step: int,
    at: int,
) -> int:
    """Mark cells, or take their marks off; how many more are marked below the 64 of `at`."""
    below = 0
    for dv in range(-reach, reach + 1):
        # Not by %: dividing takes as long as marking.
        u = v + dv
        if u < 0:
            u += place.shape[0]
        elif u >= place.shape[0]:
            u -= place.shape[0]
        line = place[u]
        for i in range(rows[0], rows[1]):
            word = line[i] >> 6
            marks[word] ^= np.uint64(1) << np.uint64(line[i] & 63)
            counts[word] += step
            below += word < at
    return step * below
