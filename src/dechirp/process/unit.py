"""A unit of samples in which their powers stay within single precision, 1e-38 to 3e38.

Thermal noise of 1e-6 sqrt(W) is 1e-18 W in a cell of a map; samples a million times smaller, or of
1e20, would be zeros or infinite once squared. Their unit is a power of two, so that nothing is
rounded: what is found does not depend on the unit that a recording has, to the bit.
"""

import math

import numpy as np

# Samples looked at, one of every stretch: lost chirps and silent receivers are not all there is.
_LOOKS = 4096
# Beyond these sizes of the largest. Within, 2^68 is left up to the largest power of a float, and
# 2^64 down to the smallest with all its digits.
_FARTHEST = 30


def exponent_of(samples: np.ndarray) -> int:
    """Power of two about the largest of the samples looked at; 0 for those of usual size.

    `samples` are contiguous, complex64 or float32.
    """
    numbers = samples.reshape(-1).view(np.float32)
    # An odd step takes real and imaginary parts in turn.
    largest = float(abs(numbers[:: numbers.size // _LOOKS | 1]).max(initial=0.0))
    exponent = math.frexp(largest)[1] if math.isfinite(largest) else 0
    return exponent if abs(exponent) > _FARTHEST else 0


def in_unit(numbers: np.ndarray, exponent: int) -> np.ndarray:
    """Numbers over a power of two, complex64 or float32: the same ones where that is 1."""
    if exponent == 0:
        return numbers
    with np.errstate(over="ignore", under="ignore"):
        return np.ldexp(numbers.view(np.float32), -exponent).view(numbers.dtype)
