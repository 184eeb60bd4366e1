"""Power of cells in whole numbers, and its logarithm to base 2."""

import numba
import numpy as np

from dechirp.process.fixed_point.rounding import shifted
from dechirp.process.fixed_point.words import WordLengths


@numba.njit(cache=True, nogil=True, error_model="numpy")
def powers(spectrum: np.ndarray, shifts: np.ndarray, mode: int) -> np.ndarray:
    """Squares of words (channel, range, velocity, 2), channels summed, (velocity, range) int64.

    `shifts` (channel, range): bits to shift the square of each right, for one exponent.
    """
    n_channels, n_range, n_velocity, _ = spectrum.shape
    out = np.zeros((n_velocity, n_range), np.int64)
    for channel in range(n_channels):
        for row in range(n_range):
            for v in range(n_velocity):
                re, im = int(spectrum[channel, row, v, 0]), int(spectrum[channel, row, v, 1])
                out[v, row] += shifted(re * re + im * im, shifts[channel, row], mode)
    return out


@numba.njit(cache=True, nogil=True, error_model="numpy")
def log2_words(
    power: np.ndarray, table: np.ndarray, table_bits: int, fraction_bits: int
) -> np.ndarray:
    """Logarithm to base 2 of each word, `fraction_bits` of it behind the point, uint16.

    The place of the leading one is the whole part; the `table_bits` behind it choose an entry of
    the `table` of log2(1 + f). Within `log2_error` of the true one; 0 for a word of 0.
    """
    out = np.empty(power.shape, np.uint16)
    for v in range(power.shape[0]):
        for row in range(power.shape[1]):
            word = power[v, row]
            place = np.int64(0)
            while word >> (place + 1):
                place += 1
            behind = word - (np.int64(1) << place) if word else np.int64(0)
            if place > table_bits:
                address = behind >> (place - table_bits)
            else:
                address = behind << (table_bits - place)
            whole = place << fraction_bits
            out[v, row] = whole + table[address] if word else 0
    return out


def log2_error(words: WordLengths) -> float:
    """Largest error of the logarithm to base 2 of a word above 0; times 3.01 in dB.

    Half an interval of the table, where it is steepest, and half a step behind the point.
    """
    return float(
        np.log2(1 + 2.0 ** -(words.log_table_bits + 1)) + 2.0 ** -(words.log_fraction_bits + 1)
    )
