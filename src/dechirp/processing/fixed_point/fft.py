"""Fixed-point FFT, radix 2^2, with optional block scaling."""

from typing import NamedTuple

import numpy as np

from dechirp.core.checks import check_integer
from dechirp.core.compiled_kernels import AS_WRITTEN, kernel
from dechirp.core.errors import InvalidSetting
from dechirp.processing.fixed_point.coefficients import INTEGER_BITS, integer_twiddle_factors
from dechirp.processing.fixed_point.word_lengths import (
    ROUNDING_CODES,
    Scaling,
    WordLengths,
    saturate,
    shift_right_rounded,
)

_BY_BLOCK = -1  # in place of a shift: block scaling


class FftResult(NamedTuple):
    """Fixed-point transforms: times 2^shifts.sum(-1) they are sums, not means."""

    points: np.ndarray
    """Real and imaginary parts (..., n, 2), int32, bins in ascending order."""
    shifts: np.ndarray
    """Right shift of each stage in bits, (..., n_stages) int64."""
    overflows: np.ndarray
    """Number of saturated parts of each stage in all transforms, (n_stages,)."""


def fft(points: np.ndarray, bits: int, words: WordLengths) -> FftResult:
    r"""Transform integers over their last but one axis, (..., n, 2).

    .. math:: X_k = 2^{-\sum s} \sum_i x_i\, e^{-2 \pi \mathrm{i} k i / n}

    Decimation in frequency: stage j = 1 ... log2 n splits each transform of n / 2^(j-1) points into
    two of half the points. Stages are paired. The first of a pair replaces points a and b, half a
    transform apart, by a + b and a - b. The second one does so within both halves, with -i b for b
    in the second half, and multiplies the results of the quarter (u, v), of halves u and then v,
    by W^(q (u + 2 v)), where W = exp(-2 pi i / m), m is the number of points of the pair and q is
    the position in the quarter. The last stage of an odd number is alone. So every other stage
    has neither products nor factors, and the turn by -i is exact. Each result is rounded once:
    products are exact until they are shifted by the fraction bits of W and the s of the stage.

    Block scaling uses the smallest s for which no result can overflow, from the largest part of any
    value of the transform: it grows by at most 2 in the first stage of a pair, and by at most
    2 (\|Re W\| + \|Im W\|), 2 sqrt 2, in the second one.

    Parameters
    ----------
    points : integer array (..., n, 2)
        Real and imaginary parts, within `bits`; n is a power of two.
    bits : int
        Bits of each part of a value, 4 to 24.
    words : WordLengths
        Bits of the twiddle factors, scaling and rounding.

    Raises
    ------
    InvalidSetting
        If n is no power of two, or the points are not integers within `bits`.

    References
    ----------
    S. He, M. Torkelson, A new approach to pipeline FFT processor, Proc. IPPS, 1996. P. D. Welch, A
    fixed-point fast Fourier transform error analysis, IEEE Trans. Audio and Electroacoustics 17(2),
    1969. A. V. Oppenheim, C. J. Weinstein, Effects of finite register
    length in digital filtering and the fast Fourier transform, Proc. IEEE 60(8), 1972.
    """
    check_integer("bits", bits, at_least=4, at_most=24)
    _check_points_fit_bits(points, bits)
    *blocks, n, _ = points.shape
    check_power_of_two("points", n, fix="pad them with zeros")
    twiddles = integer_twiddle_factors(n, words.twiddle_bits)
    n_stages = n.bit_length() - 1
    shifts = np.empty((*blocks, n_stages), np.int64)
    overflows = np.zeros(n_stages, np.int64)
    out = np.array(points, np.int32)
    _fft_in_place(
        out.reshape(-1, n, 2),
        bit_reversed_order(n),
        twiddles,
        max_growth_per_stage(twiddles, n, words.twiddle_bits),
        np.full(n_stages, _shift_per_stage_or_by_block(words.scaling)),
        np.array([bits, words.twiddle_bits - INTEGER_BITS, ROUNDING_CODES[words.rounding]]),
        shifts.reshape(out.size // (2 * n), n_stages),
        overflows,
    )
    return FftResult(out, shifts, overflows)


def check_power_of_two(setting: str, n: int, *, fix: str) -> None:
    """Check that a number of points is a power of two."""
    if n < 1 or n & (n - 1):
        raise InvalidSetting(
            setting, value=f"a length of {n}", expected="a power of two in fixed point", fix=fix
        )


def bit_reversed_order(n: int) -> np.ndarray:
    """Return the bin at each position after the last stage, (n,); it is its own inverse."""
    order = np.zeros(1, np.int64)
    while order.size < n:
        order = np.concatenate([2 * order, 2 * order + 1])
    return order


def _shift_per_stage_or_by_block(scaling: Scaling) -> int:
    return {"block": _BY_BLOCK, "halving": 1, "none": 0}[scaling]


def max_growth_per_stage(twiddles: np.ndarray, n: int, bits: int) -> np.ndarray:
    """Return the largest growth of a part in each stage, in words of W."""
    sizes = np.abs(twiddles).sum(axis=-1)
    largest = [
        sizes[:: 1 << (stage - 1)].max() if stage % 2 else 1 << (bits - INTEGER_BITS)
        for stage in range(n.bit_length() - 1)
    ]
    return 2 * np.array(largest, np.int64)


def turns_after_pair(n_points: int) -> np.ndarray:
    """Return the exponents of W after a pair of stages of this many points, by position, (m,)."""
    return np.outer([0, 2, 1, 3], np.arange(n_points // 4)).ravel()


def twiddles_after_pair(twiddles: np.ndarray, n_points: int) -> np.ndarray:
    """Return the twiddle factors after a pair of stages of this many points, by position, (m, 2).

    `twiddles` are those of a transform of n_points or more, see `integer_twiddle_factors`.
    """
    whole_turn = np.concatenate([twiddles, -twiddles])
    return whole_turn[turns_after_pair(n_points) * (len(whole_turn) // n_points)]


def _check_points_fit_bits(points: np.ndarray, bits: int) -> None:
    half = 2 ** (bits - 1)
    is_valid = points.dtype.kind in "iu" and points.ndim >= 2 and points.shape[-1] == 2
    if not (is_valid and points.size and points.min() >= -half and points.max() < half):
        raise InvalidSetting(
            "points",
            value=f"of type {points.dtype} and shape {points.shape}",
            expected=f"integers (..., n, 2) of {bits} bits",
            fix="scale and round them first",
        )


@kernel(plain=AS_WRITTEN)
def _fft_in_place(
    points: np.ndarray,
    order: np.ndarray,
    twiddles: np.ndarray,
    growth: np.ndarray,
    shift_per_stage: np.ndarray,
    bits_and_rounding: np.ndarray,
    shifts: np.ndarray,
    overflows: np.ndarray,
) -> None:
    """Transform each block of points, (n_blocks, n, 2), in place.

    `bits_and_rounding`: bits of a part, fraction bits of W, and the rounding code.
    """
    bits, fraction, mode = bits_and_rounding
    n = points.shape[1]
    top = (np.int64(1) << (bits - 1)) - 1
    re, im = np.empty(n, np.int64), np.empty(n, np.int64)
    for block in range(len(points)):
        largest = np.int64(0)
        for k in range(n):
            re[k], im[k] = points[block, k, 0], points[block, k, 1]
            largest = max(largest, abs(re[k]), abs(im[k]))
        for stage in range(len(growth)):
            shift = shift_per_stage[stage]
            if shift == _BY_BLOCK:
                shift = np.int64(0)
                while largest * growth[stage] > top << (fraction + shift):
                    shift += 1
            shifts[block, stage] = shift
            is_second = stage % 2 == 1
            total_shift = shift + (fraction if is_second else 0)
            half = n >> (stage + 1)
            largest = np.int64(0)
            for first in range(0, n, 2 * half):
                u = first // (2 * half) % 2 if is_second else 0
                for k in range(half):
                    a, b = first + k, first + k + half
                    b_re, b_im = (im[b], -re[b]) if u else (re[b], im[b])
                    results = (
                        (a, re[a] + b_re, im[a] + b_im, u * k),
                        (b, re[a] - b_re, im[a] - b_im, (u + 2) * k),
                    )
                    for position, sum_re, sum_im, turn in results:
                        x_re, x_im = sum_re, sum_im
                        if is_second:
                            c, s = _twiddle_factor(twiddles, turn << (stage - 1))
                            x_re, x_im = sum_re * c - sum_im * s, sum_re * s + sum_im * c
                        rounded_re = shift_right_rounded(x_re, total_shift, mode)
                        rounded_im = shift_right_rounded(x_im, total_shift, mode)
                        re[position] = saturate(rounded_re, bits)
                        im[position] = saturate(rounded_im, bits)
                        overflows[stage] += (re[position] != rounded_re) + (
                            im[position] != rounded_im
                        )
                        largest = max(largest, abs(re[position]), abs(im[position]))
        for k in range(n):
            points[block, k, 0], points[block, k, 1] = re[order[k]], im[order[k]]


@kernel(plain=AS_WRITTEN)
def _twiddle_factor(twiddles: np.ndarray, k: int) -> tuple[int, int]:
    """Return exp(-2 pi i k / n) for k < n, from a table of the first half."""
    n_half = len(twiddles)
    if k < n_half:
        return twiddles[k, 0], twiddles[k, 1]
    return -twiddles[k - n_half, 0], -twiddles[k - n_half, 1]
