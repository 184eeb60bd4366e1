"""Plain power maps and detectors with NumPy, SciPy and numba."""

import numba
import numpy as np
import scipy.fft
from scipy.ndimage import uniform_filter

TRAINING, GUARD = (8, 10), (4, 4)  # velocity, range; cells on each side
WIDTH = tuple(2 * (t + g) + 1 for t, g in zip(TRAINING, GUARD, strict=True))
INNER = tuple(2 * g + 1 for g in GUARD)
N_TRAINING_CELLS = WIDTH[0] * WIDTH[1] - INNER[0] * INNER[1]


def window_weights(shape: tuple[int, int]) -> np.ndarray:
    hann = [0.5 - 0.5 * np.cos(2 * np.pi * np.arange(n) / n) for n in shape]
    return np.outer(*hann).astype(np.float32)


def plain_map(samples: np.ndarray, taper: np.ndarray, n_bins: int) -> np.ndarray:
    """Compute the power map of (chirp, sample) with SciPy, velocity transform first."""
    spectrum = scipy.fft.fft(samples * taper, axis=0, overwrite_x=True)
    spectrum = scipy.fft.fft(spectrum, n_bins, axis=1, overwrite_x=True)
    return np.asarray(scipy.fft.fftshift(spectrum.real**2 + spectrum.imag**2, axes=0))


def plain_chain(samples: np.ndarray, taper: np.ndarray, factor: float) -> np.ndarray:
    """Compute a CFAR mask from samples (chirp, channel, sample) with NumPy and SciPy."""
    spectrum = scipy.fft.fft(samples * taper[:, None], axis=2)
    spectrum = scipy.fft.fftshift(scipy.fft.fft(spectrum, axis=0), axes=0)
    power = (spectrum.real**2 + spectrum.imag**2).sum(axis=1)
    box = uniform_filter(power, WIDTH, mode="wrap") * (WIDTH[0] * WIDTH[1])
    guard = uniform_filter(power, INNER, mode="wrap") * (INNER[0] * INNER[1])
    return power > factor / N_TRAINING_CELLS * (box - guard)


@numba.njit
def box_sums(power: np.ndarray, n_v: int, n_r: int) -> np.ndarray:
    """Sum over boxes with running sums along each axis; zero for boxes that exceed the map."""
    rows, columns = power.shape
    row_sums = np.zeros((rows, columns), np.float32)
    for v in range(rows):
        total = np.float32(0.0)
        for j in range(n_r):
            total += power[v, j]
        row_sums[v, n_r // 2] = total
        for j in range(n_r, columns):
            total += power[v, j] - power[v, j - n_r]
            row_sums[v, j - n_r // 2] = total
    out = np.zeros((rows, columns), np.float32)
    running = np.zeros(columns, np.float32)
    for v in range(rows):
        for j in range(columns):
            running[j] += row_sums[v, j]
        if v >= n_v:
            for j in range(columns):
                running[j] -= row_sums[v - n_v, j]
        if v >= n_v - 1:
            for j in range(columns):
                out[v - n_v // 2, j] = running[j]
    return out


@numba.njit
def plain_cell_averaging(power: np.ndarray, factor: float) -> np.ndarray:
    """Compute the mask of a cell-averaging CFAR with running sums, without the edges."""
    n_v, n_r, g_v, g_r = 25, 29, 9, 9
    scale = np.float32(factor / (n_v * n_r - g_v * g_r))
    box, guard = box_sums(power, n_v, n_r), box_sums(power, g_v, g_r)
    mask = np.zeros(power.shape, np.bool_)
    for v in range(n_v // 2, power.shape[0] - n_v // 2):
        for j in range(n_r // 2, power.shape[1] - n_r // 2):
            mask[v, j] = power[v, j] > scale * (box[v, j] - guard[v, j])
    return mask


@numba.njit
def plain_ordered_statistic(power: np.ndarray, factor: float, rank: int) -> np.ndarray:
    """Compute the mask of an ordered-statistic CFAR by counting cells, without the edges."""
    half_v, half_r, g_v, g_r = 12, 14, 4, 4
    n_training_cells = 25 * 29 - 81
    mask = np.zeros(power.shape, np.bool_)
    for v in range(half_v, power.shape[0] - half_v):
        for j in range(half_r, power.shape[1] - half_r):
            limit = power[v, j] / np.float32(factor)
            n_under = n_over = 0
            for dv in range(-half_v, half_v + 1):
                for dr in range(-half_r, half_r + 1):
                    if abs(dv) <= g_v and abs(dr) <= g_r:
                        continue
                    if power[v + dv, j + dr] < limit:
                        n_under += 1
                    else:
                        n_over += 1
                if n_under >= rank or n_over > n_training_cells - rank:
                    break
            mask[v, j] = n_under >= rank
    return mask
