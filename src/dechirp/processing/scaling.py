"""Scaling of samples by powers of two, for powers within single precision, 1e-38 to 3e38.

Thermal noise of 1e-6 sqrt(W) is 1e-18 W in a cell of a map; samples a million times smaller, or of
1e20, would be zeros or infinite once squared. A power of two rounds nothing: detections do not
depend on the unit of a recording, to the bit.
"""

import math

import numpy as np

from dechirp.core.checks import largest_part
from dechirp.core.errors import InvalidSetting

# Samples probed, one of every stretch: some lie outside lost chirps and silent receivers.
_N_PROBES = 4096
# Exponent of the largest sample up to which nothing is scaled. This leaves 2^68 up to the largest
# power of a float, and 2^64 down to the smallest normal number.
_MAX_EXPONENT = 30
_SINGLE_LARGEST = float(np.finfo(np.float32).max)
# Down to 2^-26 of this largest sample (-157 dB), numbers have their 24 bits.
_SINGLE_SMALLEST = 2.0**-100


def check_fits_single_precision(samples: np.ndarray, *, setting: str = "cube") -> None:
    """Raise `InvalidSetting` if samples would become infinite, or lose noise, by conversion."""
    if not samples.size or samples.dtype.itemsize <= (8 if np.iscomplexobj(samples) else 4):
        return
    largest = largest_part(samples)
    if 0 < largest < _SINGLE_SMALLEST or _SINGLE_LARGEST < largest < math.inf:
        raise InvalidSetting(
            setting,
            value=f"samples of up to {largest:.3g}",
            expected=f"largest samples of {_SINGLE_SMALLEST:.1g} to {_SINGLE_LARGEST:.1g},"
            " the numbers of single precision",
            fix=f"divide all samples by {largest:.1g}",
        )


def to_single_precision(
    samples: np.ndarray, *, is_complex: bool, setting: str = "cube"
) -> np.ndarray:
    """Return samples contiguous in single precision; the given array if it already is.

    Raises
    ------
    InvalidSetting
        If samples would become infinite, or lose noise.
    """
    samples = np.asarray(samples)
    check_fits_single_precision(samples, setting=setting)
    with np.errstate(over="ignore"):
        return np.ascontiguousarray(samples, np.complex64 if is_complex else np.float32)


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
