"""Encodings of samples as numbers, and their conversion to full scale 1."""

from dataclasses import replace

import numpy as np

from dechirp.recordings.arrays.lazy_array import ArrayPart, LazyArray

# Smallest and largest possible number of each encoding.
LIMITS = {
    "int16": (-32768, 32767),
    "uint16-wrapped": (0, 65535),
    "offset-binary": (0, 65535),
    "full-scale": (-np.finfo(np.float32).max, np.finfo(np.float32).max),
}

_INT16_STEP = np.float32(2**-15)


def scale_to_full_scale(
    numbers: np.ndarray, encoding: str, out: np.ndarray | None = None
) -> np.ndarray:
    """Convert real numbers of an encoding to float32, within -1 to 1 except for `full-scale`.

    `out` is an array of float32 for the result.

    int16: two's complement. uint16-wrapped: the same, but negative numbers passed through an
    unsigned type and are 65536 too large. offset-binary: 32768 stands for zero. full-scale: already
    scaled, unchanged.

    Raises
    ------
    ValueError
        If a number cannot occur in the encoding; the message gives the extremes.
    """
    least, most = LIMITS[encoding]
    is_int16 = numbers.dtype == np.int16
    if not (is_int16 and encoding in ("int16", "full-scale")):  # each int16 can occur there
        low, high = numbers.min(), numbers.max()
        if low < least or high > most:
            raise ValueError(f"numbers from {low:.6g} to {high:.6g}")
    if encoding == "uint16-wrapped":
        numbers = numbers.astype(np.int64).astype(np.int16)
    scaled = np.empty(numbers.shape, np.float32) if out is None else out
    # Products with a power of two are exact.
    if encoding == "offset-binary":
        scaled[...] = numbers
        scaled -= 32768
        scaled *= _INT16_STEP
    elif encoding == "full-scale":
        scaled[...] = numbers
    else:
        scaled[...] = numbers
        scaled *= _INT16_STEP
    return scaled


def scale_lazily_to_full_scale(codes: LazyArray) -> LazyArray:
    """Scale integers of any size to full scale 1 when they are read."""
    full_scale = np.float32(2.0 ** (8 * codes.dtype.itemsize - 1))

    def read(part: ArrayPart) -> np.ndarray:
        samples = codes.read(part).astype(np.float32)
        if codes.dtype.kind == "u":
            samples -= full_scale
        samples *= 1 / full_scale  # exact for a power of two
        return samples

    return replace(codes, dtype=np.dtype(np.float32), read=read)
