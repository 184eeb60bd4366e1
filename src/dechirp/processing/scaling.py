"""Scaling of samples by powers of two, for powers within single precision, 1e-38 to 3e38.

Thermal noise of 1e-6 sqrt(W) is 1e-18 W in a cell of a map; samples a million times smaller, or of
1e20, would be zeros or infinite once squared. A power of two rounds nothing: detections do not
depend on the unit of a recording, to the bit.
"""

import math

import numpy as np

# Samples probed, one of every stretch: some lie outside lost chirps and silent receivers.
_N_PROBES = 4096
# Exponent of the largest sample up to which nothing is scaled. This leaves 2^68 up to the largest
# power of a float, and 2^64 down to the smallest normal number.
_MAX_EXPONENT = 30


def binary_scaling_exponent(samples: np.ndarray) -> int:
    """Return the binary exponent of the largest sample probed; 0 for samples of usual size.

    `samples` are contiguous, complex64 or float32.
    """
    numbers = samples.reshape(-1).view(np.float32)
    # An odd step takes real and imaginary parts in turn.
    largest = float(abs(numbers[:: numbers.size // _N_PROBES | 1]).max(initial=0.0))
    exponent = math.frexp(largest)[1] if math.isfinite(largest) else 0
    return exponent if abs(exponent) > _MAX_EXPONENT else 0


def divide_by_power_of_two(numbers: np.ndarray, exponent: int) -> np.ndarray:
    """Divide numbers, complex64 or float32, by 2^exponent; returns the same array for 0."""
    if exponent == 0:
        return numbers
    with np.errstate(over="ignore", under="ignore"):
        return np.ldexp(numbers.view(np.float32), -exponent).view(numbers.dtype)
