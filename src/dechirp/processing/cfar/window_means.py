"""Means of training windows for every cell of a map, as compiled kernels."""

import numpy as np

from dechirp.core.compiled_kernels import kernel


@kernel(fastmath={"contract", "reassoc"})
def initial_guard_and_training_column_sums(
    power: np.ndarray, half_v: int, guard_v: int
) -> tuple[np.ndarray, np.ndarray]:
    """Sum the columns of the box about the row before the first, as a start for sliding.

    One sum over the guard rows with the cell under test, one over the training rows on both
    sides.
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


@kernel(fastmath={"contract", "reassoc"})
def slide_column_sums(
    power: np.ndarray,
    velocity_row: int,
    half_v: int,
    guard_v: int,
    slide_in: np.ndarray,
    slide_out: np.ndarray,
    outer: np.ndarray,
    all_columns: np.ndarray,
) -> None:
    """Slide column sums to row v; `outer` and `all_columns` receive them in float32."""
    n_v, n_r = power.shape
    entering, leaving = (
        power[(velocity_row + half_v) % n_v],
        power[(velocity_row - 1 - half_v) % n_v],
    )
    to_guard, from_guard = (
        power[(velocity_row + guard_v) % n_v],
        power[(velocity_row - 1 - guard_v) % n_v],
    )
    for j in range(n_r):
        change = np.float64(to_guard[j]) - np.float64(from_guard[j])
        now_in = slide_in[j] + change
        now_out = slide_out[j] + (np.float64(entering[j]) - np.float64(leaving[j]) - change)
        slide_in[j] = now_in
        slide_out[j] = now_out
        outer[j] = now_out
        all_columns[j] = now_in + now_out


def _scaled_window_means_in_numpy(
    power: np.ndarray, factors: np.ndarray, train_r: int, train_v: int, guard_r: int, guard_v: int
) -> np.ndarray:
    """Plain twin of `scaled_window_means`: equal within 2e-6, without any subtraction."""
    half_v, half_r = train_v + guard_v, train_r + guard_r
    n_v, n_r = power.shape
    width = 2 * half_r + 1
    wrapped = power.take(np.arange(-half_v, n_v + half_v), axis=0, mode="wrap").astype(float)
    inner, outer = np.zeros((2, n_v, n_r))
    for row in range(2 * half_v + 1):
        (inner if abs(row - half_v) <= guard_v else outer)[:] += wrapped[row : row + n_v]
    both = inner + outer
    means = np.zeros((n_v, n_r))
    middle = means[:, half_r : n_r - half_r]
    for column in range(width):
        sums = outer if abs(column - half_r) <= guard_r else both
        middle += sums[:, column : column + n_r - 2 * half_r]
    n_rows = np.full(n_r, 2 * guard_r + 1)
    for row in range(half_r):  # the box stops at the ends of the map
        is_guard = abs(np.arange(width) - row) <= guard_r
        n_rows[row] = n_rows[n_r - 1 - row] = is_guard.sum()
        means[:, row] = outer[:, :width].sum(axis=1) + inner[:, :width] @ ~is_guard
        means[:, n_r - 1 - row] = (
            outer[:, n_r - width :].sum(axis=1) + inner[:, n_r - width :] @ ~is_guard[::-1]
        )
    n_cells = width * (2 * half_v + 1) - n_rows * (2 * guard_v + 1)
    return np.asarray(means / n_cells * factors, np.float32)


def _exceeds_scaled_window_means_in_numpy(
    power: np.ndarray, factors: np.ndarray, train_r: int, train_v: int, guard_r: int, guard_v: int
) -> np.ndarray:
    """Plain twin of `exceeds_scaled_window_means`."""
    return np.asarray(
        power > _scaled_window_means_in_numpy(power, factors, train_r, train_v, guard_r, guard_v)
    )


@kernel(plain=_scaled_window_means_in_numpy, fastmath={"contract", "reassoc"})
def scaled_window_means(
    power: np.ndarray, factors: np.ndarray, train_r: int, train_v: int, guard_r: int, guard_v: int
) -> np.ndarray:
    """Return the mean of the training window about each cell times the factor of its row.

    Velocity wraps round; the range box stays within the map. All are float32.

    Two limits: 2 MB moved (0.1 ms) and some 25 additions a cell, eight at a time. Columns slide
    in float64, in which a target 120 dB over the noise leaves the noise accurate to 0.1 %; in
    float32 it would leave an error of its own size. Rows are then added without any subtraction:
    run sums by doubling, a pass over a row that stays in L1.
    """
    n_v, n_r = power.shape
    out = np.empty((n_v, n_r), np.float32)
    sums = initial_guard_and_training_column_sums(power, train_v + guard_v, guard_v)
    work, scale = (
        _allocate_scratch_rows(n_r),
        _factors_per_training_cell(factors, train_r, train_v, guard_r, guard_v),
    )
    for v in range(n_v):
        _write_scaled_window_means_of_row(
            power, v, factors, scale, train_r, train_v, guard_r, guard_v, *sums, work, out[v]
        )
    return out


@kernel(plain=_exceeds_scaled_window_means_in_numpy, fastmath={"contract", "reassoc"})
def exceeds_scaled_window_means(
    power: np.ndarray, factors: np.ndarray, train_r: int, train_v: int, guard_r: int, guard_v: int
) -> np.ndarray:
    """Return a mask of the cells that exceed `scaled_window_means`, without a map of those."""
    n_v, n_r = power.shape
    out = np.empty((n_v, n_r), np.bool_)
    level = np.empty(n_r, np.float32)
    sums = initial_guard_and_training_column_sums(power, train_v + guard_v, guard_v)
    work, scale = (
        _allocate_scratch_rows(n_r),
        _factors_per_training_cell(factors, train_r, train_v, guard_r, guard_v),
    )
    for v in range(n_v):
        _write_scaled_window_means_of_row(
            power, v, factors, scale, train_r, train_v, guard_r, guard_v, *sums, work, level
        )
        row, exceeds = power[v], out[v]
        for j in range(n_r):
            exceeds[j] = row[j] > level[j]
    return out


@kernel()
def _allocate_scratch_rows(n_r: int) -> np.ndarray:
    return np.zeros((36, n_r + 1), np.float32)


@kernel()
def _factors_per_training_cell(
    factors: np.ndarray, train_r: int, train_v: int, guard_r: int, guard_v: int
) -> np.ndarray:
    """Return factors over the number of cells, for the rows with a complete window."""
    half_r = train_r + guard_r
    n_cells = 2 * train_v * (2 * half_r + 1) + 2 * train_r * (2 * guard_v + 1)
    return factors[half_r : factors.size - half_r] / np.float32(n_cells)


@kernel(fastmath={"contract", "reassoc"})
def _write_scaled_window_means_of_row(
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
    """Compute the means about the cells of one row into `out` (range,), sliding the column sums."""
    n_r = power.shape[1]
    half_v, half_r = train_v + guard_v, train_r + guard_r
    width, n_middle, n_corner = 2 * half_r + 1, n_r - 2 * half_r, 2 * train_v * (2 * half_r + 1)
    outer, all_columns, side_sums, middle, scratch = (
        work[0, :n_r],
        work[1, :n_r],
        work[2],
        work[3],
        work[4:],
    )
    slide_column_sums(power, v, half_v, guard_v, slide_in, slide_out, outer, all_columns)
    write_moving_sums(all_columns, train_r, side_sums, scratch)
    write_moving_sums(outer, 2 * guard_r + 1, middle, scratch)
    left_sums, right_sums, centre = (
        side_sums[:n_middle],
        side_sums[half_r + guard_r + 1 :],
        middle[train_r:],
    )
    line = out[half_r:]
    for j in range(n_middle):
        line[j] = (left_sums[j] + right_sums[j] + centre[j]) * scale[j]
    near_end, far_end = out[:half_r], out[n_r - half_r :]
    _write_window_means_at_map_end(
        slide_in[:width], outer[:width], near_end, 0, guard_r, guard_v, n_corner, scratch
    )
    first = half_r + 1  # box row of the first cell under test at the far end
    _write_window_means_at_map_end(
        slide_in[-width:], outer[-width:], far_end, first, guard_r, guard_v, n_corner, scratch
    )
    for j in range(half_r):
        near_end[j] *= factors[j]
        far_end[j] *= factors[n_r - half_r + j]


@kernel(fastmath={"contract", "reassoc"})
def _write_window_means_at_map_end(
    inner: np.ndarray,
    outer: np.ndarray,
    out: np.ndarray,
    first: int,
    guard_r: int,
    guard_v: int,
    n_corner: int,
    work: np.ndarray,
) -> None:
    """Compute means where the box stops at an end of the map, for box rows from `first` on.

    Sums from either side give the guard rows before and after the cell.
    """
    width = inner.size
    sums_before, sums_after = work[0], work[1]
    sums_before[0] = sums_after[width] = 0
    corners = np.float32(0.0)
    for i in range(width):
        sums_before[i + 1] = sums_before[i] + inner[i]
        sums_after[width - 1 - i] = sums_after[width - i] + inner[width - 1 - i]
        corners += outer[i]
    for i in range(out.size):
        low, high = max(first + i - guard_r, 0), min(first + i + guard_r + 1, width)
        n_sides = low + width - high
        total = corners + sums_before[low] + sums_after[high]
        out[i] = total / np.float32(n_corner + n_sides * (2 * guard_v + 1))


@kernel(fastmath={"contract", "reassoc"})
def write_moving_sums(row: np.ndarray, length: int, out: np.ndarray, work: np.ndarray) -> None:
    """Compute out[i] = row[i] + ... + row[i + length - 1] by doubling; the last ones are unused."""
    n = row.size
    if length == 0:
        out[:] = 0
        return
    current, run, level = row, 1, 0
    while not length & run:  # runs of 2, 4, 8 ... up to the lowest bit of the length
        longer, shifted = work[level], current[run:]
        for i in range(n - run):
            longer[i] = current[i] + shifted[i]
        current, run, level = longer, 2 * run, level + 1
    total, n_added = current, run
    while n_added < length:
        longer, shifted = work[level], current[run:]
        for i in range(n - run):
            longer[i] = current[i] + shifted[i]
        current, run, level = longer, 2 * run, level + 1
        if length & run:
            shifted = current[n_added:]
            for i in range(n - n_added):
                out[i] = total[i] + shifted[i]
            total, n_added = out, n_added + run
    if n_added == (n_added & -n_added):  # a power of two: the runs themselves
        for i in range(n):
            out[i] = total[i]
