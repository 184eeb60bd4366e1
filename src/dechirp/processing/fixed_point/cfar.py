"""Fixed-point cell averaging: exact sums of the training cells times an integer factor."""

import numpy as np

from dechirp.core.compiled_kernels import AS_WRITTEN, kernel


@kernel(plain=AS_WRITTEN)
def cell_averaging_thresholds(
    power: np.ndarray,
    factors: np.ndarray,
    shift: int,
    starts: np.ndarray,
    side_counts: tuple[int, int, int, int],
) -> np.ndarray:
    """Return the threshold of each cell of a map, floor(window sum x factor / 2^shift), int64.

    The training window is that of `processing.cfar.base.TrainingWindow`: velocity wraps round, the
    box stays within the map. An integer exceeds the threshold exactly where it exceeds the
    unrounded one.

    Parameters
    ----------
    power : int64 array (velocity, range)
        Sums over a training window are below 2^63.
    factors : int64 array (range,)
        Threshold over sum in each row, times 2^shift.
    shift : int
        0 or more.
    starts : int64 array (range,)
        First row of the box of each row.
    side_counts : four ints
        Training cells along range and velocity, then guard cells, on each side.
    """
    n_v, n_r = power.shape
    train_r, train_v, guard_r, guard_v = side_counts
    half_v, width = train_v + guard_v, 2 * (train_r + guard_r) + 1
    out = np.empty((n_v, n_r), np.int64)
    box, guard = np.zeros(n_r, np.int64), np.zeros(n_r, np.int64)
    for dv in range(-half_v, half_v + 1):
        for j in range(n_r):
            box[j] += power[(dv - 1) % n_v, j]
            if abs(dv) <= guard_v:
                guard[j] += power[(dv - 1) % n_v, j]
    # Cumulative sums over the columns of the box and of the guard. They may overflow 64 bits, but
    # their differences are exact.
    box_before, guard_before = np.zeros(n_r + 1, np.int64), np.zeros(n_r + 1, np.int64)
    for v in range(n_v):
        for j in range(n_r):
            box[j] += power[(v + half_v) % n_v, j] - power[(v - 1 - half_v) % n_v, j]
            guard[j] += power[(v + guard_v) % n_v, j] - power[(v - 1 - guard_v) % n_v, j]
            box_before[j + 1] = box_before[j] + box[j]
            guard_before[j + 1] = guard_before[j] + guard[j]
        for j in range(n_r):
            first, last = starts[j], starts[j] + width
            low, high = max(j - guard_r, first), min(j + guard_r + 1, last)
            window_sum = (
                box_before[last] - box_before[first] - guard_before[high] + guard_before[low]
            )
            out[v, j] = _product_shifted_right(window_sum, factors[j], shift)
    return out


@kernel(plain=AS_WRITTEN)
def _product_shifted_right(total: int, factor: int, shift: int) -> int:
    """Return floor(total x factor / 2^shift), total to 63 bits and factor to 24, in two halves.

    2^62 where it would be more: no power reaches it.
    """
    high, low = (total >> 32) * factor, (total & 0xFFFFFFFF) * factor
    if shift < 32:
        if high >> (30 + shift):
            return 1 << 62
        return (high << (32 - shift)) + (low >> shift)
    return (high + (low >> 32)) >> (shift - 32)
