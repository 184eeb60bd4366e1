"""One pass over the numbers of a frame: their ends, their means, their steps."""

from dataclasses import dataclass

import numba
import numpy as np

SILENT = 1e-30
"""In sqrt(W) or of full scale: samples that are all below are silence, and squares of smaller
ones would leave float32."""
_NONE = 3e38  # larger than any step
_FOR_STEP = 64  # chirps: enough to see the smallest step


@dataclass(frozen=True)
class Survey:
    """What one pass tells, of each receiver and each part: I and Q, or the real part alone."""

    mean: np.ndarray
    """(rx, part)."""
    power: np.ndarray
    """(rx, part), mean square about the mean."""
    level: np.ndarray
    """(rx, part, end, rank): highest number and the next lower, lowest and the next higher."""
    count: np.ndarray
    """(rx, part, end, rank): how often each of them occurs."""
    step: float
    """Smallest difference that is not zero, between samples in turn and between the same samples
    of chirps in turn: a step of the converter. 0 if there is none."""
    n_numbers: int
    """Numbers of each receiver and part."""

    @property
    def largest(self) -> float:
        """Largest magnitude; 0 without any samples."""
        return float(np.max(np.abs(self.level[..., 0]), initial=0.0)) if self.n_numbers else 0.0

    @property
    def constant(self) -> np.ndarray:
        """(rx,), True where all samples are the same."""
        return np.all(self.level[:, :, 0, 0] == self.level[:, :, 1, 0], axis=1)


def survey(numbers: np.ndarray, lost: np.ndarray, n_parts: int) -> Survey:
    """Survey of numbers (chirp, rx, parts of one sample after those of another).

    `lost` (chirp,) tells which chirps to leave out. Numbers are exact in what they count;
    sums are taken in double precision.
    """
    n_rx, n_kept = numbers.shape[1], int(np.count_nonzero(~lost))
    level = np.empty((n_rx, n_parts, 2, 2), np.float32)
    level[:, :, 0], level[:, :, 1] = -np.inf, np.inf
    count = np.zeros(level.shape, np.int64)
    step = _ends(numbers, lost, n_parts, level, count)
    n_numbers = n_kept * numbers.shape[2] // n_parts
    largest = float(np.max(np.abs(level[..., 0]))) if n_kept else 0.0
    # Sums are of differences from a number that occurs, so that a large mean takes no digits
    # from a small variance; and over the largest, whose square float32 might not hold.
    origin, inverse = level[:, :, 0, 0], np.float32(1 / max(largest, SILENT))
    sums = _sums(numbers, lost, n_parts, origin, inverse) / max(n_numbers, 1)
    power = np.maximum(sums[..., 1] - sums[..., 0] ** 2, 0.0) / float(inverse) ** 2
    return Survey(
        mean=(origin + sums[..., 0] / float(inverse)) if n_kept else np.zeros((n_rx, n_parts)),
        power=power,
        level=level,
        count=count,
        step=float(step) if step < _NONE else 0.0,
        n_numbers=n_numbers,
    )


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})
def _sums(
    numbers: np.ndarray, lost: np.ndarray, n_parts: int, origin: np.ndarray, inverse: np.float32
) -> np.ndarray:
    """Sums of differences from the origin, in units of 1 / inverse, and of their squares."""
    n_chirps, n_rx, n_numbers = numbers.shape
    out = np.zeros((n_rx, n_parts, 2))
    for m in range(n_chirps):
        if lost[m]:
            continue
        for k in range(n_rx):
            for part in range(n_parts):
                total, squares = np.float32(0), np.float32(0)
                start = origin[k, part] * inverse
                for i in range(part, n_numbers, n_parts):
                    x = numbers[m, k, i] * inverse - start
                    total += x
                    squares += x * x
                out[k, part, 0] += total
                out[k, part, 1] += squares
    return out


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nnan", "nsz"})
def _ends(
    numbers: np.ndarray, lost: np.ndarray, n_parts: int, level: np.ndarray, count: np.ndarray
) -> np.float32:
    """Fill levels and their counts; the smallest step."""
    n_chirps, n_rx, _ = numbers.shape
    step = np.float32(_NONE)
    for m in range(n_chirps):
        if lost[m]:
            continue
        for k in range(n_rx):
            row = numbers[m, k]
            for part in range(n_parts):
                _levels(row, part, n_parts, level[k, part], count[k, part])
            if m < _FOR_STEP:
                step = min(step, _least(row[:-n_parts], row[n_parts:]))
            if 0 < m < _FOR_STEP and not lost[m - 1]:
                step = min(step, _least(row, numbers[m - 1, k]))
    return step


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nnan", "nsz"})
def _least(row: np.ndarray, other: np.ndarray) -> np.float32:
    """Smallest difference that is not zero: no branches, so that eight are taken at once."""
    least = np.float32(_NONE)
    for i in range(row.size):
        apart = abs(row[i] - other[i])
        least = min(least, apart if apart > 0 else np.float32(_NONE))
    return least


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _levels(row: np.ndarray, part: int, n_parts: int, level: np.ndarray, count: np.ndarray) -> None:
    """Keep the two highest and the two lowest of different numbers, and count them.

    Two comparisons a number, which nearly always fail.
    """
    high, low = level[0, 1], level[1, 1]
    for i in range(part, row.size, n_parts):
        x = row[i]
        if x >= high:
            _enter(x, x > level[0, 0], level[0], count[0])
            high = level[0, 1]
        if x <= low:
            _enter(x, x < level[1, 0], level[1], count[1])
            low = level[1, 1]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _enter(x: float, is_beyond: bool, level: np.ndarray, count: np.ndarray) -> None:
    if is_beyond:
        level[1], count[1] = level[0], count[0]
        level[0], count[0] = x, 1
    elif x == level[0]:
        count[0] += 1
    elif x == level[1]:
        count[1] += 1
    else:
        level[1], count[1] = x, 1
