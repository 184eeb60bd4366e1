"""Outlier chirps, such as the first of a frame of an unsettled radar."""

from functools import lru_cache

import numpy as np

from dechirp.core.compiled_kernels import kernel
from dechirp.processing.quality.background import ROUNDING_POWER

_MIN_CHANGES = 4  # of one transmitter, for a meaningful median
_MIN_CHANGE_RATIO = 20.0  # over the changes near a chirp, 13 dB; noise reaches 1 dB
_N_SCATTERS = 4.0
_MEDIAN_LENGTH = 17  # changes of the local median: fewer than motion takes to begin


def measure_outlier_chirp_excess(
    samples: np.ndarray, is_lost: np.ndarray, *, n_slots: int, largest_value: float, adc_step: float
) -> np.ndarray:
    """Return the power by which each chirp differs from both neighbours, over a limit, (chirp,).

    Neighbours have the same transmitter. Moving echoes change by similar amounts from chirp to
    chirp; an outlier differs from both neighbours, and they from it alone. At the ends of a frame
    there is one neighbour. The limit is 20 times the median of changes near it, or exp(4 s) times
    if their logarithms scatter by s: for one echo that fluctuates from chirp to chirp, s is 1.2
    and the probability to exceed 120 medians 1e-36. NaN where chirps are lost or too few,
    infinite for an all-zero chirp. Parameters as in `measure_bursts`.
    """
    out = np.full(len(samples), np.nan, np.float32)
    changes, power = _chirp_changes_and_powers(
        samples.view(np.float32), is_lost, n_slots, np.float32(1 / largest_value)
    )
    mean_power = float(power[~is_lost].mean()) if not is_lost.all() else 0.0
    # Quantisation noise is a step squared over 12.
    smallest = max(ROUNDING_POWER * mean_power, (adc_step / largest_value) ** 2 / 12, 1e-300)
    for slot in range(n_slots):
        slot_changes = changes[slot::n_slots][:-1]
        is_known = np.isfinite(slot_changes)
        if np.count_nonzero(is_known) < _MIN_CHANGES:
            continue
        filled = np.where(is_known, slot_changes, np.median(slot_changes[is_known]))
        local_median = _moving_median(filled, min(_MEDIAN_LENGTH, filled.size))
        ratio = np.maximum(slot_changes, smallest) / np.maximum(local_median, smallest)
        # The median absolute logarithm is a standard deviation robust against outliers.
        scatter = 1.48 * float(np.median(np.abs(np.log(ratio[is_known]))))
        ratio /= max(_MIN_CHANGE_RATIO, np.exp(min(_N_SCATTERS * scatter, 100.0)))
        inner = np.minimum(ratio[:-1], ratio[1:])
        first = ratio[0] if ratio[1] < ratio[0] / 4 else 0.0
        last = ratio[-1] if ratio[-2] < ratio[-1] / 4 else 0.0
        out[slot::n_slots] = [first, *inner, last]
    out[~is_lost & (power == 0) & (mean_power > 0)] = np.inf
    return out


def _moving_median(values: np.ndarray, length: int) -> np.ndarray:
    """Return the medians of `length` values about each, mirrored at the ends.

    (As scipy.ndimage.median_filter, whose import takes 0.07 s.)
    """
    windows = values[_mirrored_window_indices(values.size, length)]
    windows.partition(length // 2, axis=-1)
    return windows[:, length // 2]


@lru_cache(maxsize=16)  # `sliding_window_view` takes 0.05 ms
def _mirrored_window_indices(n_values: int, length: int) -> np.ndarray:
    """Return the indices of `length` values about each of n, mirrored at the ends."""
    index = abs(np.arange(n_values)[:, None] + np.arange(length) - length // 2)
    return np.minimum(index, 2 * (n_values - 1) - index)


def _chirp_changes_and_powers_in_numpy(
    numbers: np.ndarray, is_lost: np.ndarray, n_slots: int, inverse_scale: np.float32
) -> tuple[np.ndarray, np.ndarray]:
    scaled = (numbers * inverse_scale).reshape(len(numbers), -1)
    changes = np.full(len(scaled), np.nan)
    differences = scaled[n_slots:] - scaled[:-n_slots]
    is_known = ~(is_lost[n_slots:] | is_lost[:-n_slots])
    changes[:-n_slots][is_known] = np.mean(differences**2, axis=1, dtype=float)[is_known]
    return changes, np.mean(scaled**2, axis=1, dtype=float)


@kernel(plain=_chirp_changes_and_powers_in_numpy, fastmath={"contract", "reassoc"})
def _chirp_changes_and_powers(
    numbers: np.ndarray, is_lost: np.ndarray, n_slots: int, inverse_scale: np.float32
) -> tuple[np.ndarray, np.ndarray]:
    """Return mean squares of the change to the transmitter's next chirp, and of each chirp.

    (chirp,) each; a change is NaN if one of the two is lost, or if there is no next.
    """
    n_chirps, n_rx, n_numbers = numbers.shape
    changes, power = np.full(n_chirps, np.nan), np.zeros(n_chirps)
    for m in range(n_chirps):
        following = m + n_slots
        if following >= n_chirps or is_lost[following]:
            following = m
        for k in range(n_rx):
            change, total = np.float32(0), np.float32(0)
            for i in range(n_numbers):
                x = numbers[m, k, i] * inverse_scale
                d = numbers[following, k, i] * inverse_scale - x
                change += d * d
                total += x * x
            power[m] += total / (n_rx * n_numbers)
            if following > m and not is_lost[m]:
                changes[m] = (0.0 if k == 0 else changes[m]) + change / (n_rx * n_numbers)
    return changes, power
