"""Word lengths of the fixed-point chain, with rounding and saturation."""

from typing import Literal, get_args

from dechirp.core.checks import check_integer_fields
from dechirp.core.compiled_kernels import AS_WRITTEN, kernel
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass

__all__ = ["WordLengths"]

Scaling = Literal["block", "halving", "none"]
Rounding = Literal["convergent", "half-up", "truncate"]


@frozen_dataclass
class WordLengths:
    """Word lengths in bits from the converter to the detector, in processing order.

    Samples are aligned to the top of the first word, so that additional bits of a longer word are
    fraction bits. All are two's complement, powers and logarithms unsigned. Coefficients have two
    integer bits, so that 1 is representable.
    """

    sample_bits: int = 16
    """Bits of I and of Q, or of real samples, 2 to 24."""
    window_bits: int = 16
    """Bits of the weights of both windows, 4 to 24."""
    twiddle_bits: int = 16
    """Bits of cosines and sines in both transforms, 4 to 24."""
    range_bits: int = 16
    """Bits in the range transform, of the real and of the imaginary part, 4 to 24."""
    doppler_bits: int = 16
    """Bits in the Doppler transform, of the real and of the imaginary part, 4 to 24."""
    power_bits: int = 48
    """Bits of the power of a cell, channels summed, 8 to 48; block exponents are aligned to the
    largest there, so that it has bits below the square of a word."""
    log_fraction_bits: int = 8
    """Fraction bits of the logarithm of the power to base 2, 1 to 10."""
    log_table_bits: int = 8
    """Address bits of the table of logarithms, which has 2^bits entries, 1 to 12."""
    factor_bits: int = 16
    """Bits of the factor between the sum of the training cells and the threshold, 4 to 24."""
    scaling: Scaling = "block"
    """Protection of transforms from overflow. Block: before each stage all words of a transform
    are shifted together as far as that stage could need. Halving: by one bit at every stage.
    None: no protection."""
    rounding: Rounding = "convergent"
    """Rounding of bits below a word. Convergent: to the nearest, halves to even; half-up: halves
    up; truncate: down."""

    def __post_init__(self) -> None:
        check_integer_fields(self, "sample_bits", at_least=2, at_most=24)
        for name in ("window_bits", "twiddle_bits", "range_bits", "doppler_bits", "factor_bits"):
            check_integer_fields(self, name, at_least=4, at_most=24)
        check_integer_fields(self, "power_bits", at_least=8, at_most=48)
        check_integer_fields(self, "log_fraction_bits", at_most=10)
        check_integer_fields(self, "log_table_bits", at_most=12)
        for name, choices in (("scaling", get_args(Scaling)), ("rounding", get_args(Rounding))):
            if getattr(self, name) not in choices:
                raise InvalidSetting(
                    f"WordLengths.{name}",
                    value=getattr(self, name),
                    expected=" or ".join(choices),
                    fix="choose one of them",
                )

    @property
    def log_bits(self) -> int:
        """Bits of the logarithm of the power, integer and fraction."""
        return (self.power_bits - 1).bit_length() + self.log_fraction_bits


ROUNDING_CODES: dict[Rounding, int] = {"convergent": 0, "half-up": 1, "truncate": 2}
"""Codes of the roundings in compiled kernels."""

_MAX_SHIFT = 62  # of 64-bit words; beyond it only the sign remains


@kernel(plain=AS_WRITTEN)
def shift_right_rounded(x: int, shift: int, rounding_code: int) -> int:
    """Return the rounded integer x / 2^shift; x is below 2^61 where the shift is positive."""
    if shift <= 0:
        return x << -shift
    shift = min(shift, _MAX_SHIFT)
    if rounding_code == 2:
        return x >> shift
    half = 1 << (shift - 1)
    if rounding_code == 1:
        return (x + half) >> shift
    # Add just below a half to even results, a half to odd ones.
    return (x + half - 1 + ((x >> shift) & 1)) >> shift


@kernel(plain=AS_WRITTEN)
def saturate(x: int, bits: int) -> int:
    """Return the nearest value that a word of this many bits can hold."""
    top = (1 << (bits - 1)) - 1
    return min(max(x, -top - 1), top)
