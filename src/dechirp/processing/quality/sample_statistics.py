"""Sample statistics of a frame in one pass: extremes, means and steps."""

from dataclasses import dataclass

import numpy as np

from dechirp.core.compiled_kernels import kernel

SILENT = 1e-30
"""Largest magnitude of silence, in sqrt(W) or of full scale; squares of smaller values underflow
float32."""
_NO_STEP = 3e38  # exceeds any step
_N_STEP_CHIRPS = 64  # chirps that suffice to find the smallest step


@dataclass(frozen=True)
class SampleStatistics:
    """Statistics of each receiver and each part: I and Q, or the real part only."""

    mean: np.ndarray
    """Mean (rx, part)."""
    power: np.ndarray
    """Mean square about the mean, (rx, part)."""
    level: np.ndarray
    """Highest value and the next lower, lowest and the next higher, (rx, part, end, rank)."""
    count: np.ndarray
    """Occurrences of each of these values, (rx, part, end, rank)."""
    step: float
    """Smallest non-zero difference between successive samples, and between the same samples of
    successive chirps: a step of the converter. 0 if there is none."""
    n_numbers: int
    """Number of values of each receiver and part."""

    @property
    def largest_part_magnitude(self) -> float:
        """Largest magnitude of a real or imaginary part; 0 without samples."""
        return float(np.max(np.abs(self.level[..., 0]), initial=0.0)) if self.n_numbers else 0.0

    @property
    def constant_receiver_mask(self) -> np.ndarray:
        """Mask (rx,) of receivers with constant samples."""
        return np.all(self.level[:, :, 0, 0] == self.level[:, :, 1, 0], axis=1)


def compute_sample_statistics(
    numbers: np.ndarray, is_lost: np.ndarray, n_parts: int
) -> SampleStatistics:
    """Compute statistics of values (chirp, rx, parts of one sample after those of another).

    `is_lost` (chirp,) marks chirps to leave out. Counts are exact; sums are double precision.
    """
    n_rx, n_kept = numbers.shape[1], int(np.count_nonzero(~is_lost))
    level = np.empty((n_rx, n_parts, 2, 2), np.float32)
    level[:, :, 0], level[:, :, 1] = -np.inf, np.inf
    count = np.zeros(level.shape, np.int64)
    step = _write_extreme_levels_and_find_step(numbers, is_lost, n_parts, level, count)
    n_numbers = n_kept * numbers.shape[2] // n_parts
    largest = float(np.max(np.abs(level[..., 0]))) if n_kept else 0.0
    # Differences from an occurring value keep the variance accurate under a large mean; dividing by
    # the largest value avoids overflow of its square in float32.
    origin, inverse = level[:, :, 0, 0], np.float32(1 / max(largest, SILENT))
    sums = _centred_sums_and_squares(numbers, is_lost, n_parts, origin, inverse) / max(n_numbers, 1)
    power = np.maximum(sums[..., 1] - sums[..., 0] ** 2, 0.0) / float(inverse) ** 2
    return SampleStatistics(
        mean=(origin + sums[..., 0] / float(inverse)) if n_kept else np.zeros((n_rx, n_parts)),
        power=power,
        level=level,
        count=count,
        step=float(step) if step < _NO_STEP else 0.0,
        n_numbers=n_numbers,
    )


def _centred_sums_and_squares_in_numpy(
    numbers: np.ndarray,
    is_lost: np.ndarray,
    n_parts: int,
    origin: np.ndarray,
    inverse_scale: np.float32,
) -> np.ndarray:
    kept = numbers[~is_lost].reshape(-1, numbers.shape[1], numbers.shape[2] // n_parts, n_parts)
    centred = kept * inverse_scale - (origin * inverse_scale)[:, None]
    sums = [np.sum(x, axis=(0, 2), dtype=float) for x in (centred, centred**2)]
    return np.stack(sums, axis=-1)


@kernel(plain=_centred_sums_and_squares_in_numpy, fastmath={"contract", "reassoc"})
def _centred_sums_and_squares(
    numbers: np.ndarray,
    is_lost: np.ndarray,
    n_parts: int,
    origin: np.ndarray,
    inverse_scale: np.float32,
) -> np.ndarray:
    """Return sums of differences from the origin, in units of 1 / inverse, and of their squares."""
    n_chirps, n_rx, n_numbers = numbers.shape
    out = np.zeros((n_rx, n_parts, 2))
    for m in range(n_chirps):
        if is_lost[m]:
            continue
        for k in range(n_rx):
            for part in range(n_parts):
                total, squares = np.float32(0), np.float32(0)
                start = origin[k, part] * inverse_scale
                for i in range(part, n_numbers, n_parts):
                    x = numbers[m, k, i] * inverse_scale - start
                    total += x
                    squares += x * x
                out[k, part, 0] += total
                out[k, part, 1] += squares
    return out


def _write_extreme_levels_and_find_step_in_numpy(
    numbers: np.ndarray, is_lost: np.ndarray, n_parts: int, level: np.ndarray, count: np.ndarray
) -> np.float32:
    kept = numbers[~is_lost]
    if kept.size:
        values = kept.reshape(len(kept), len(level), -1, n_parts).transpose(1, 3, 0, 2)
        for end, sign in enumerate((1, -1)):
            rest = (sign * values).reshape(*level.shape[:2], -1)
            for rank in range(2):
                highest = rest.max(axis=2, keepdims=True)
                is_highest = rest == highest
                level[:, :, end, rank] = sign * highest[..., 0]
                count[:, :, end, rank] = is_highest.sum(axis=2)
                rest[is_highest] = -np.inf
        count[np.isinf(level)] = 0
    first, is_first_lost = numbers[:_N_STEP_CHIRPS], is_lost[:_N_STEP_CHIRPS]
    within = first[~is_first_lost]
    steps = [
        abs(within[..., n_parts:] - within[..., :-n_parts]),
        abs(first[1:] - first[:-1])[~(is_first_lost[1:] | is_first_lost[:-1])],
    ]
    nonzero = np.concatenate([step[step > 0] for step in steps])
    return np.float32(nonzero.min(initial=_NO_STEP))


@kernel(plain=_write_extreme_levels_and_find_step_in_numpy, fastmath={"contract", "nnan", "nsz"})
def _write_extreme_levels_and_find_step(
    numbers: np.ndarray, is_lost: np.ndarray, n_parts: int, level: np.ndarray, count: np.ndarray
) -> np.float32:
    """Fill levels and their counts; return the smallest step."""
    n_chirps, n_rx, _ = numbers.shape
    step = np.float32(_NO_STEP)
    for m in range(n_chirps):
        if is_lost[m]:
            continue
        for k in range(n_rx):
            row = numbers[m, k]
            for part in range(n_parts):
                _update_extreme_levels(row, part, n_parts, level[k, part], count[k, part])
            if m < _N_STEP_CHIRPS:
                step = min(step, _smallest_nonzero_difference(row[:-n_parts], row[n_parts:]))
            if 0 < m < _N_STEP_CHIRPS and not is_lost[m - 1]:
                step = min(step, _smallest_nonzero_difference(row, numbers[m - 1, k]))
    return step


@kernel(fastmath={"contract", "nnan", "nsz"})
def _smallest_nonzero_difference(row: np.ndarray, other: np.ndarray) -> np.float32:
    """Return the smallest non-zero difference; branch-free, so that eight are vectorised."""
    smallest = np.float32(_NO_STEP)
    for i in range(row.size):
        difference = abs(row[i] - other[i])
        smallest = min(smallest, difference if difference > 0 else np.float32(_NO_STEP))
    return smallest


@kernel()
def _update_extreme_levels(
    row: np.ndarray, part: int, n_parts: int, level: np.ndarray, count: np.ndarray
) -> None:
    """Update the two highest and the two lowest distinct values, and their counts.

    Two comparisons a value, which nearly always fail.
    """
    high, low = level[0, 1], level[1, 1]
    for i in range(part, row.size, n_parts):
        x = row[i]
        if x >= high:
            _insert_extreme_level(x, x > level[0, 0], level[0], count[0])
            high = level[0, 1]
        if x <= low:
            _insert_extreme_level(x, x < level[1, 0], level[1], count[1])
            low = level[1, 1]


@kernel()
def _insert_extreme_level(x: float, is_beyond: bool, level: np.ndarray, count: np.ndarray) -> None:
    if is_beyond:
        level[1], count[1] = level[0], count[0]
        level[0], count[0] = x, 1
    elif x == level[0]:
        count[0] += 1
    elif x == level[1]:
        count[1] += 1
    else:
        level[1], count[1] = x, 1
