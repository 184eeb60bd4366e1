"""Alignment of chirps that begin between two samples.

A recorder that is not synchronous with the ramps (a sound card, a software-defined radio) takes the
first sample up to half an interval T early or late. A beat of frequency f then turns by
2 pi f T per sample, differently in each chirp, so static echoes have images at other velocities:
at 1804.5 intervals between chirps they alternate, as targets near the largest velocity do. Band-
limited interpolation takes the samples at equal times of each ramp, by a Kaiser-windowed sinc: the
images are 60 dB below their echo up to 0.4 of the sample rate.
"""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

_HALF_LENGTH = 12  # taps on each side
_KAISER_BETA = 8.0
MIN_OFFSET = 0.01
"""Offset of which the images are 50 dB below an echo at a tenth of the sample rate, in samples."""


def align_chirps(samples: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """Return the samples `offsets` sample intervals later than given.

    Beyond the ends of a chirp its samples are mirrored in the first and last one, so a few samples
    at each end are less accurate.

    Parameters
    ----------
    samples : array (chirp, rx, sample)
    offsets : array (chirp,)
        From -1 to 1.
    """
    if samples.shape[2] <= _HALF_LENGTH or not np.any(abs(offsets) > MIN_OFFSET):
        return samples
    taps = np.arange(-_HALF_LENGTH, _HALF_LENGTH + 1)
    distance = taps - offsets[:, None]
    window = np.i0(_KAISER_BETA * np.sqrt(np.maximum(1 - (distance / (_HALF_LENGTH + 1)) ** 2, 0)))
    kernels = np.sinc(distance) * window
    # Beats of leakage, near zero, stay equal in all chirps to rounding.
    kernels = (kernels / kernels.sum(axis=1, keepdims=True)).astype(np.float32)
    ends = ((0, 0), (0, 0), (_HALF_LENGTH, _HALF_LENGTH))
    padded = np.pad(samples, ends, mode="reflect", reflect_type="odd")
    out = np.empty_like(samples)
    for chirp, kernel in enumerate(kernels):  # one at a time: the windows are 25 times the chirp
        out[chirp] = sliding_window_view(padded[chirp], taps.size, axis=-1) @ kernel
    return out
