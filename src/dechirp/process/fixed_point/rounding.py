"""Shifts with rounding, and saturation: what a word does with what it cannot hold."""

import numba

from dechirp.process.fixed_point.words import Rounding

MODES: dict[Rounding, int] = {"convergent": 0, "half-up": 1, "truncate": 2}
"""How kernels are told."""

_MOST_SHIFT = 62  # of 64-bit words: beyond it all that is left is the sign


@numba.njit(cache=True, nogil=True, error_model="numpy")
def shifted(x: int, shift: int, mode: int) -> int:
    """Whole number next to x / 2^shift; x is below 2^61 where the shift is positive."""
    if shift <= 0:
        return x << -shift
    shift = min(shift, _MOST_SHIFT)
    if mode == 2:
        return x >> shift
    half = 1 << (shift - 1)
    if mode == 1:
        return (x + half) >> shift
    # Just below a half is added to even results, a half to odd ones.
    return (x + half - 1 + ((x >> shift) & 1)) >> shift


@numba.njit(cache=True, nogil=True, error_model="numpy")
def saturated(x: int, bits: int) -> int:
    """The nearest number that a word of so many bits holds."""
    top = (1 << (bits - 1)) - 1
    return min(max(x, -top - 1), top)
