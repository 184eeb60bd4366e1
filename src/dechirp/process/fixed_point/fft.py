"""The fast Fourier transform in whole numbers, radix 2, with block scaling or without."""

from typing import NamedTuple

import numba
import numpy as np

from dechirp.core.checks import whole
from dechirp.core.errors import InvalidSetting
from dechirp.process.fixed_point.coefficients import POINT, twiddles
from dechirp.process.fixed_point.rounding import MODES, saturated, shifted
from dechirp.process.fixed_point.words import Scaling, WordLengths

_BY_BLOCK = -1  # in a schedule: as many bits as that block could need


class Transformed(NamedTuple):
    """Transforms in words: times 2^shifts.sum(-1) they are sums, not means."""

    points: np.ndarray
    """(..., n, 2), real and imaginary part, int32, bins in ascending order."""
    shifts: np.ndarray
    """(..., n_stages): bits that each stage was shifted right, int64."""
    overflows: np.ndarray
    """(n_stages,): how many parts of numbers each stage saturated in all transforms."""


def fft(points: np.ndarray, bits: int, words: WordLengths) -> Transformed:
    r"""Transform integers over their last but one axis, (..., n, 2).

    .. math:: X_k = 2^{-\sum s} \sum_i x_i\, e^{-2 \pi \mathrm{i} k i / n}

    Decimation in time: samples are taken in bit-reversed order, and stage j = 1 ... log2 n makes
    of neighbouring transforms of 2^(j-1) points, a and b, those of 2^j, a + W b and a - W b. Each
    result is rounded once: products are kept whole until all of it is shifted by the fraction
    bits of W and the s of the stage.

    Block scaling takes the smallest s for which no result can overflow, from the largest part of
    any number of the transform: it grows by 1 + |Re W| + |Im W| at most, 2 in the first two
    stages and 1 + sqrt 2 in the others.

    Parameters
    ----------
    points : integer array (..., n, 2)
        Real and imaginary parts, within `bits`; n is a power of two.
    bits : int
        Of each part of a number, 4 to 24.
    words : WordLengths
        Of the twiddle factors; scaling and rounding.

    Raises
    ------
    InvalidSetting
        If n is no power of two, or the points are no integers within `bits`.

    References
    ----------
    P. D. Welch, A fixed-point fast Fourier transform error analysis, IEEE Trans. Audio and
    Electroacoustics 17(2), 1969. A. V. Oppenheim, C. J. Weinstein, Effects of finite register
    length in digital filtering and the fast Fourier transform, Proc. IEEE 60(8), 1972.
    """
    whole("bits", bits, at_least=4, at_most=24)
    _must_be_words(points, bits)
    *blocks, n, _ = points.shape
    must_be_power_of_two("points", n, fix="Pad them with zeros.")
    turns = twiddles(n, words.twiddle_bits)
    n_stages = n.bit_length() - 1
    shifts = np.empty((*blocks, n_stages), np.int64)
    overflows = np.zeros(n_stages, np.int64)
    made = np.array(points, np.int32)
    _transform(
        made.reshape(-1, n, 2),
        bit_reversed(n),
        turns,
        _growth(turns, n, words.twiddle_bits),
        np.full(n_stages, _schedule(words.scaling)),
        np.array([bits, words.twiddle_bits - POINT, MODES[words.rounding]]),
        shifts.reshape(made.size // (2 * n), n_stages),
        overflows,
    )
    return Transformed(made, shifts, overflows)


def must_be_power_of_two(where: str, n: int, *, fix: str) -> None:
    """Raise `InvalidSetting`, about the setting `where`, for another number of points."""
    if n < 1 or n & (n - 1):
        raise InvalidSetting(
            where, got=f"{n} long", need="a power of two long in whole numbers", fix=fix
        )


def bit_reversed(n: int) -> np.ndarray:
    """Which sample stands at each place before the first stage, (n,)."""
    order = np.zeros(1, np.int64)
    while order.size < n:
        order = np.concatenate([2 * order, 2 * order + 1])
    return order


def _schedule(scaling: Scaling) -> int:
    return {"block": _BY_BLOCK, "halving": 1, "none": 0}[scaling]


def _growth(turns: np.ndarray, n: int, bits: int) -> np.ndarray:
    """How much the largest part of a number grows at most in each stage, in words of W."""
    sizes = np.abs(turns).sum(axis=-1)
    halves = 2 ** np.arange(n.bit_length() - 1)
    most = [sizes[:: n // (2 * half)].max() for half in halves]
    return 2 ** (bits - POINT) + np.array(most, np.int64)


def _must_be_words(points: np.ndarray, bits: int) -> None:
    half = 2 ** (bits - 1)
    fits = points.dtype.kind in "iu" and points.ndim >= 2 and points.shape[-1] == 2
    if not (fits and points.size and points.min() >= -half and points.max() < half):
        raise InvalidSetting(
            "points",
            got=f"of type {points.dtype} and shape {points.shape}",
            need=f"integers (..., n, 2) of {bits} bits",
            fix="Scale and round them first.",
        )


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _transform(
    points: np.ndarray,
    order: np.ndarray,
    turns: np.ndarray,
    growth: np.ndarray,
    schedule: np.ndarray,
    word: np.ndarray,
    shifts: np.ndarray,
    overflows: np.ndarray,
) -> None:
    """Transform each block of points, (n_blocks, n, 2), in place.

    `word`: bits of a part, bits of W behind its point, and how to round.
    """
    bits, fraction, mode = word
    n = points.shape[1]
    top = (np.int64(1) << (bits - 1)) - 1
    re, im = np.empty(n, np.int64), np.empty(n, np.int64)
    for block in range(len(points)):
        largest = np.int64(0)
        for k in range(n):
            re[k], im[k] = points[block, order[k], 0], points[block, order[k], 1]
            largest = max(largest, abs(re[k]), abs(im[k]))
        for stage in range(len(growth)):
            shift = schedule[stage]
            if shift == _BY_BLOCK:
                shift = np.int64(0)
                while largest * growth[stage] > top << (fraction + shift):
                    shift += 1
            shifts[block, stage] = shift
            down = fraction + shift
            half = 1 << stage
            step = n >> (stage + 1)
            largest = np.int64(0)
            for first in range(0, n, 2 * half):
                for k in range(half):
                    a, b = first + k, first + k + half
                    c, s = turns[k * step, 0], turns[k * step, 1]
                    a_re, a_im = re[a] << fraction, im[a] << fraction
                    b_re, b_im = re[b] * c - im[b] * s, re[b] * s + im[b] * c
                    results = (
                        shifted(a_re + b_re, down, mode),
                        shifted(a_im + b_im, down, mode),
                        shifted(a_re - b_re, down, mode),
                        shifted(a_im - b_im, down, mode),
                    )
                    re[a], im[a] = saturated(results[0], bits), saturated(results[1], bits)
                    re[b], im[b] = saturated(results[2], bits), saturated(results[3], bits)
                    overflows[stage] += (
                        (re[a] != results[0])
                        + (im[a] != results[1])
                        + (re[b] != results[2])
                        + (im[b] != results[3])
                    )
                    largest = max(largest, abs(re[a]), abs(im[a]), abs(re[b]), abs(im[b]))
        for k in range(n):
            points[block, k, 0], points[block, k, 1] = re[k], im[k]
