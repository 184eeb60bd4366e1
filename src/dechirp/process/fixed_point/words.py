"""Word lengths: how many bits each number of the machine has, and what happens to the others."""

from typing import Literal, get_args

from dechirp.core.checks import count
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value

Scaling = Literal["block", "halving", "none"]
Rounding = Literal["convergent", "half-up", "truncate"]


@value
class WordLengths:
    """Bits of the words from the converter to the detector, in the order in which they act.

    Samples stand at the top of the first word, so that bits which a word has more than the one
    before are below the point. All are two's complement, powers and logarithms without a sign.
    Coefficients have two bits before the point, so that 1 is a number.
    """

    sample_bits: int = 16
    """Of I and of Q, or of real samples, 2 to 24."""
    window_bits: int = 16
    """Of the weights of both windows, 4 to 24."""
    twiddle_bits: int = 16
    """Of cosines and sines in both transforms, 4 to 24."""
    range_bits: int = 16
    """In the range transform, of the real and of the imaginary part, 4 to 24."""
    doppler_bits: int = 16
    """In the Doppler transform, of the real and of the imaginary part, 4 to 24."""
    power_bits: int = 48
    """Of the power of a cell, channels summed, 8 to 48: transforms of several exponents come to the
    largest there, so it has bits below the square of a word."""
    log_fraction_bits: int = 8
    """Behind the point of the logarithm of the power to base 2, 1 to 10."""
    log_table_bits: int = 8
    """Address of the table of logarithms: it has 2^bits entries, 1 to 12."""
    factor_bits: int = 16
    """Of the factor between the sum of the training cells and the threshold, 4 to 24."""
    scaling: Scaling = "block"
    """What keeps transforms from overflowing. Block: before each stage all words of a transform
    are shifted together as far as that stage could need. Halving: by one bit at every stage.
    None: nothing."""
    rounding: Rounding = "convergent"
    """Of what falls below a word. Convergent: to the nearest, halves to the even neighbour;
    half-up: halves up; truncate: down."""

    def __post_init__(self) -> None:
        count(self, "sample_bits", at_least=2, at_most=24)
        for name in ("window_bits", "twiddle_bits", "range_bits", "doppler_bits", "factor_bits"):
            count(self, name, at_least=4, at_most=24)
        count(self, "power_bits", at_least=8, at_most=48)
        count(self, "log_fraction_bits", at_most=10)
        count(self, "log_table_bits", at_most=12)
        for name, choices in (("scaling", get_args(Scaling)), ("rounding", get_args(Rounding))):
            if getattr(self, name) not in choices:
                raise InvalidSetting(
                    f"WordLengths.{name}",
                    got=getattr(self, name),
                    need=" or ".join(choices),
                    fix="Choose one of them.",
                )

    @property
    def log_bits(self) -> int:
        """Of the logarithm of the power, before and behind the point."""
        return (self.power_bits - 1).bit_length() + self.log_fraction_bits
