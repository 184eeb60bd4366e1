"""Fixed-point FFT, radix 2, with optional block scaling."""

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

    Decimation in time: samples are in bit-reversed order, and stage j = 1 ... log2 n combines
    neighbouring transforms of 2^(j-1) points, a and b, to those of 2^j, a + W b and a - W b. Each
    result is rounded once: products are exact until the sum is shifted by the fraction bits of W
    and the s of the stage.

    Block scaling uses the smallest s for which no result can overflow, from the largest part of any
    value of the transform: it grows by at most 1 + |Re W| + |Im W|, 2 in the first two stages and
    1 + sqrt 2 in the others.

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
    P. D. Welch, A fixed-point fast Fourier transform error analysis, IEEE Trans. Audio and
    Electroacoustics 17(2), 1969. A. V. Oppenheim, C. J. Weinstein, Effects of finite register
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
    """Return the sample index at each position before the first stage, (n,)."""
    order = np.zeros(1, np.int64)
    while order.size < n:
        order = np.concatenate([2 * order, 2 * order + 1])
    return order


def _shift_per_stage_or_by_block(scaling: Scaling) -> int:
    return {"block": _BY_BLOCK, "halving": 1, "none": 0}[scaling]


def max_growth_per_stage(twiddles: np.ndarray, n: int, bits: int) -> np.ndarray:
    """Return the largest growth of a part in each stage, in words of W."""
    sizes = np.abs(twiddles).sum(axis=-1)
    halves = 2 ** np.arange(n.bit_length() - 1)
    largest = [sizes[:: n // (2 * half)].max() for half in halves]
    return 2 ** (bits - INTEGER_BITS) + np.array(largest, np.int64)


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
            re[k], im[k] = points[block, order[k], 0], points[block, order[k], 1]
            largest = max(largest, abs(re[k]), abs(im[k]))
        for stage in range(len(growth)):
            shift = shift_per_stage[stage]
            if shift == _BY_BLOCK:
                shift = np.int64(0)
                while largest * growth[stage] > top << (fraction + shift):
                    shift += 1
            shifts[block, stage] = shift
            total_shift = fraction + shift
            half = 1 << stage
            step = n >> (stage + 1)
            largest = np.int64(0)
            for first in range(0, n, 2 * half):
                for k in range(half):
                    a, b = first + k, first + k + half
                    c, s = twiddles[k * step, 0], twiddles[k * step, 1]
                    a_re, a_im = re[a] << fraction, im[a] << fraction
                    b_re, b_im = re[b] * c - im[b] * s, re[b] * s + im[b] * c
                    results = (
                        shift_right_rounded(a_re + b_re, total_shift, mode),
                        shift_right_rounded(a_im + b_im, total_shift, mode),
                        shift_right_rounded(a_re - b_re, total_shift, mode),
                        shift_right_rounded(a_im - b_im, total_shift, mode),
                    )
                    re[a], im[a] = saturate(results[0], bits), saturate(results[1], bits)
                    re[b], im[b] = saturate(results[2], bits), saturate(results[3], bits)
                    overflows[stage] += (
                        (re[a] != results[0])
                        + (im[a] != results[1])
                        + (re[b] != results[2])
                        + (im[b] != results[3])
                    )
                    largest = max(largest, abs(re[a]), abs(im[a]), abs(re[b]), abs(im[b]))
        for k in range(n):
            points[block, k, 0], points[block, k, 1] = re[k], im[k]
