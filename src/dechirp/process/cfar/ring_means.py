"""Means over rings of cells, for every cell of a map: the kernel of several members."""

import numba
import numpy as np


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})
def column_sums(power: np.ndarray, half_v: int, guard_v: int) -> tuple[np.ndarray, np.ndarray]:
    """Sums over columns of the box about the row before the first, from which they `slide` on.

    Of the rows of the guard with the cell under test, and of the training rows on both sides.
    """
    n_v, n_r = power.shape
    inner, outer = np.zeros(n_r), np.zeros(n_r)
    for dv in range(-half_v, half_v + 1):
        row = power[(dv - 1) % n_v]
        if abs(dv) <= guard_v:
            for j in range(n_r):
                inner[j] += row[j]
        else:
            for j in range(n_r):
                outer[j] += row[j]
    return inner, outer


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})
def slide(
    power: np.ndarray,
    v: int,
    half_v: int,
    guard_v: int,
    slide_in: np.ndarray,
    slide_out: np.ndarray,
    outer: np.ndarray,
    both: np.ndarray,
) -> None:
    """Move column sums on to row v; `outer` and `both` (with the guard) get them in float32."""
    n_v, n_r = power.shape
    enters, leaves = power[(v + half_v) % n_v], power[(v - 1 - half_v) % n_v]
    to_guard, from_guard = power[(v + guard_v) % n_v], power[(v - 1 - guard_v) % n_v]
    for j in range(n_r):
        change = np.float64(to_guard[j]) - np.float64(from_guard[j])
        now_in = slide_in[j] + change
        now_out = slide_out[j] + (np.float64(enters[j]) - np.float64(leaves[j]) - change)
        slide_in[j] = now_in
        slide_out[j] = now_out
        outer[j] = now_out
        both[j] = now_in + now_out


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})
def ring_means(
    power: np.ndarray, factors: np.ndarray, train_r: int, train_v: int, guard_r: int, guard_v: int
) -> np.ndarray:
    """Mean over the ring about each cell times the factor of its row.

    Velocity wraps round; the range box stays within the map. All are float32.

    Two limits: 2 MB moved (0.1 ms) and some 25 additions a cell, eight at a time.
    Columns slide in float64, where a target 120 dB over the noise leaves the noise whole to
    0.1 %; in float32 it would leave an error of its own size. Rows are then added without
    any subtraction: runs of cells by doubling, a pass over a row that stays in L1.
    """
    n_v, n_r = power.shape
    out = np.empty((n_v, n_r), np.float32)
    sums = column_sums(power, train_v + guard_v, guard_v)
    work, scale = _work(n_r), _scale(factors, train_r, train_v, guard_r, guard_v)
    for v in range(n_v):
        _row(power, v, factors, scale, train_r, train_v, guard_r, guard_v, *sums, work, out[v])
    return out


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})
def above_rings(
    power: np.ndarray, factors: np.ndarray, train_r: int, train_v: int, guard_r: int, guard_v: int
) -> np.ndarray:
    """Whether each cell exceeds `ring_means`, bool: without a map of those, which is as large."""
    n_v, n_r = power.shape
    out = np.empty((n_v, n_r), np.bool_)
    level = np.empty(n_r, np.float32)
    sums = column_sums(power, train_v + guard_v, guard_v)
    work, scale = _work(n_r), _scale(factors, train_r, train_v, guard_r, guard_v)
    for v in range(n_v):
        _row(power, v, factors, scale, train_r, train_v, guard_r, guard_v, *sums, work, level)
        row, over = power[v], out[v]
        for j in range(n_r):
            over[j] = row[j] > level[j]
    return out


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _work(n_r: int) -> np.ndarray:
    return np.zeros((36, n_r + 1), np.float32)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _scale(
    factors: np.ndarray, train_r: int, train_v: int, guard_r: int, guard_v: int
) -> np.ndarray:
    """Factors over the cells of a whole ring, of the rows that have one."""
    half_r = train_r + guard_r
    n_cells = 2 * train_v * (2 * half_r + 1) + 2 * train_r * (2 * guard_v + 1)
    return factors[half_r : factors.size - half_r] / np.float32(n_cells)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})
def _row(
    power: np.ndarray,
    v: int,
    factors: np.ndarray,
    scale: np.ndarray,
    train_r: int,
    train_v: int,
    guard_r: int,
    guard_v: int,
    slide_in: np.ndarray,
    slide_out: np.ndarray,
    work: np.ndarray,
    out: np.ndarray,
) -> None:
    """Means about the cells of one row, into `out` (range,); column sums slide on to it."""
    n_r = power.shape[1]
    half_v, half_r = train_v + guard_v, train_r + guard_r
    width, n_middle, n_corner = 2 * half_r + 1, n_r - 2 * half_r, 2 * train_v * (2 * half_r + 1)
    outer, both, sides, middle, more = work[0, :n_r], work[1, :n_r], work[2], work[3], work[4:]
    slide(power, v, half_v, guard_v, slide_in, slide_out, outer, both)
    runs(both, train_r, sides, more)
    runs(outer, 2 * guard_r + 1, middle, more)
    left, right, centre = sides[:n_middle], sides[half_r + guard_r + 1 :], middle[train_r:]
    line = out[half_r:]
    for j in range(n_middle):
        line[j] = (left[j] + right[j] + centre[j]) * scale[j]
    near, far = out[:half_r], out[n_r - half_r :]
    _ends(slide_in[:width], outer[:width], near, 0, guard_r, guard_v, n_corner, more)
    first = half_r + 1  # place of the first row under test at the far end
    _ends(slide_in[-width:], outer[-width:], far, first, guard_r, guard_v, n_corner, more)
    for j in range(half_r):
        near[j] *= factors[j]
        far[j] *= factors[n_r - half_r + j]


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})
def _ends(
    inner: np.ndarray,
    outer: np.ndarray,
    out: np.ndarray,
    first: int,
    guard_r: int,
    guard_v: int,
    n_corner: int,
    work: np.ndarray,
) -> None:
    """Means of the ring where the box stops at an end of the map, for places from `first` on.

    The rows of the guard are those before it and those after it, by sums from either side.
    """
    width = inner.size
    before, after = work[0], work[1]
    before[0] = after[width] = 0
    corners = np.float32(0.0)
    for i in range(width):
        before[i + 1] = before[i] + inner[i]
        after[width - 1 - i] = after[width - i] + inner[width - 1 - i]
        corners += outer[i]
    for i in range(out.size):
        low, high = max(first + i - guard_r, 0), min(first + i + guard_r + 1, width)
        n_sides = low + width - high
        total = corners + before[low] + after[high]
        out[i] = total / np.float32(n_corner + n_sides * (2 * guard_v + 1))


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})
def runs(row: np.ndarray, length: int, out: np.ndarray, work: np.ndarray) -> None:
    """out[i] = row[i] + ... + row[i + length - 1], by doubling; the last ones are unused."""
    n = row.size
    if length == 0:
        out[:] = 0
        return
    now, run, level = row, 1, 0
    while not length & run:  # runs of 2, 4, 8 ... up to the lowest bit of the length
        longer, ahead = work[level], now[run:]
        for i in range(n - run):
            longer[i] = now[i] + ahead[i]
        now, run, level = longer, 2 * run, level + 1
    total, done = now, run
    while done < length:
        longer, ahead = work[level], now[run:]
        for i in range(n - run):
            longer[i] = now[i] + ahead[i]
        now, run, level = longer, 2 * run, level + 1
        if length & run:
            ahead = now[done:]
            for i in range(n - done):
                out[i] = total[i] + ahead[i]
            total, done = out, done + run
    if done == (done & -done):  # a power of two: the runs themselves
        for i in range(n):
            out[i] = total[i]
