r"""Range-walk correction: focuses targets that cross range cells within a frame.

In chirp m, counted from mid-frame, the beat of a target at R has at sample n the phase

.. math:: \frac{4\pi}{c} f_n (R + v m T)

with f_n the frequency sent at that sample. So its slow-time frequency grows with f_n: along
a frame the target walks v M T, and a Doppler transform at one frequency for all samples
spreads it over as many range cells. Above half a cell the loss matters: 4.3 dB for two cells,
7 dB for four, without windows. Here the transform over chirps uses for each sample its own
frequencies, scaled by f_n over their mean; the range is that at mid-frame.

White noise keeps its power in each cell. From bin to bin of velocity it is correlated as
after an ordinary transform, except that the bin width differs by f_n over the mean, up to a
few per cent.

The walk is corrected for the velocity of the cell: for an aliased target, that of the aliased
velocity, not its own.

References
----------
R. P. Perry, R. C. DiPietro and R. L. Fante, SAR imaging of moving targets, IEEE Trans. AES
35(1), 1999: the keystone. K. Fourmont, Non-equispaced fast Fourier transforms with applications
to tomography, J. Fourier Analysis and Applications 9(5), 2003: tapers of segments.
"""

from functools import partial
from typing import Literal

import numpy as np
import scipy

from dechirp.processing.spectrum import (
    FrameTransform,
    Transform,
    amplitude_range_weights,
    range_doppler_spectrum,
)
from dechirp.radar.chirp import Chirp, Sampling
from dechirp.radar.frame import Frame

# Largest size of a block of samples in the chirp transform, in complex numbers.
_BLOCK = 2**20
# Length of the taper of a segment in steps between segments, two to each range cell of the longest
# walk. From one segment to the next phases change by a quarter of a cycle at most. With this taper,
# lobes are 75 dB below a target.
_TAPER_LENGTH = 4.0
_TAPER_SHAPE = 0.75 * np.pi * _TAPER_LENGTH


RangeWalk = Literal["keystone", "segmented"]


def select_frame_transform(range_walk: RangeWalk | None, chirp: Chirp) -> FrameTransform:
    """Return the frame transform of a correction for a chirp; the plain one for None."""
    if range_walk is None:
        return range_doppler_spectrum
    return partial(
        {"keystone": keystone_range_doppler, "segmented": segmented_range_doppler}[range_walk],
        growth=slow_time_frequency_growth_per_sample(chirp),
    )


def slow_time_frequency_growth_per_sample(chirp: Chirp) -> float:
    """Return the growth of slow-time frequencies per sample, relative to their mean."""
    return chirp.slope_hz_per_s / chirp.sample_rate_hz / chirp.mean_sampled_frequency_hz


def sample_to_repetition_ratio(frame: Frame) -> float:
    """Return the sample interval over the repetition interval of a frame, dimensionless.

    The motion within a chirp relative to that from chirp to chirp, for samples in the order in
    which they were taken.
    """
    return 1 / (frame.chirp.sample_rate_hz * frame.repetition_s)


def keystone_range_doppler(
    samples: np.ndarray,
    sampling: Sampling,
    range_transform: Transform,
    doppler_transform: Transform,
    *,
    growth: float,
) -> np.ndarray:
    """Transform one frame with exact range-walk correction, to (velocity, channel, range).

    Like `spectrum.range_doppler_spectrum` except for the phase, which is that at mid-frame. The
    transform over chirps is a chirp transform (Bluestein 1970), exact at any scale of its
    frequencies: a forward and an inverse fast transform of more than twice the length.
    """
    tapered = _apply_windows(samples, sampling, range_transform, doppler_transform)
    n_chirps, n_bins = doppler_transform.n_points, doppler_transform.n_bins
    # Of k j = (k^2 + j^2 - (k - j)^2) / 2.
    rates = -np.pi / n_bins * _relative_frequency_per_sample(range_transform.n_points, growth)
    chirps, bins = _indices_from_middle(n_chirps), _signed_bins(n_bins)
    apart = bins[0] - chirps[-1] + np.arange(n_chirps + n_bins - 1)
    n_fft = scipy.fft.next_fast_len(apart.size)
    out = np.empty((n_bins, *samples.shape[1:]), np.complex64)
    step = max(1, _BLOCK // (n_fft * samples.shape[1]))
    for first in range(0, range_transform.n_points, step):
        block = slice(first, first + step)
        rate = rates[block]
        modulated = tapered[:, :, block] * _outer_phase_factors(chirps**2, rate)
        filtered = scipy.fft.fft(modulated, n_fft, axis=0, overwrite_x=True)
        filtered *= scipy.fft.fft(_outer_phase_factors(apart**2, -rate), n_fft, axis=0)
        spectrum = scipy.fft.ifft(filtered, axis=0, overwrite_x=True)[n_chirps - 1 : apart.size]
        np.multiply(spectrum, _outer_phase_factors(bins**2, rate), out=out[:, :, block])
    return _transform_range(out, sampling, range_transform)


def segmented_range_doppler(
    samples: np.ndarray,
    sampling: Sampling,
    range_transform: Transform,
    doppler_transform: Transform,
    *,
    growth: float,
) -> np.ndarray:
    r"""Transform one frame with range-walk correction segment by segment.

    Within a segment of chirps a target stays in its cell; segments are aligned for each
    velocity and added. They overlap with Kaiser-Bessel tapers h, whose transform is divided
    out, as in non-uniform Fourier transforms (Fourmont 2003):

    .. math:: e^{i \theta m} \approx \frac{1}{H(\theta)} \sum_s h(m - m_s) e^{i \theta m_s}

    Adjacent segments without overlap would have phase jumps, and so lobes 30 dB below a target
    at other velocities and ranges, instead of 75 dB. The time grows with the walk of the largest
    velocity: two fast transforms for each cell, and five more.
    """
    tapered = _apply_windows(samples, sampling, range_transform, doppler_transform)
    n_bins = doppler_transform.n_bins
    relative_frequency = _relative_frequency_per_sample(range_transform.n_points, growth) - 1
    chirps, bins = (
        _indices_from_middle(doppler_transform.n_points),
        np.fft.ifftshift(_signed_bins(n_bins)),
    )
    # At the largest velocity a target walks lambda M / 4 within the frame: M ptp(more) / 2 cells.
    apart = 1 / np.ptp(relative_frequency)
    n_sides = int(chirps[-1] / apart + _TAPER_LENGTH / 2)
    rates = -2 * np.pi / n_bins * relative_frequency
    out = np.zeros((n_bins, *samples.shape[1:]), np.complex64)
    segment = np.empty_like(tapered)
    for middle in apart * np.arange(-n_sides, n_sides + 1):
        np.multiply(
            tapered, _kaiser_bessel_taper((chirps - middle) / apart)[:, None, None], out=segment
        )
        spectrum = scipy.fft.fft(segment, n_bins, axis=0)
        spectrum *= _outer_phase_factors(bins, middle * rates)
        out += spectrum
    out /= _taper_transform(np.outer(bins, rates * apart))[:, None, :]
    out = np.fft.fftshift(out, axes=0)
    return _transform_range(out, sampling, range_transform)


def _kaiser_bessel_taper(distance: np.ndarray) -> np.ndarray:
    """Return the Kaiser-Bessel taper at distances from the middle, in steps between segments."""
    argument = np.maximum(1 - (2 * distance / _TAPER_LENGTH) ** 2, 0.0)
    return np.where(argument > 0, np.i0(_TAPER_SHAPE * np.sqrt(argument)), 0.0).astype(np.float32)


def _taper_transform(phase_step: np.ndarray) -> np.ndarray:
    """Return the gain of the sum of segments for a phase step between them, in rad."""
    root = np.sqrt(_TAPER_SHAPE**2 - (_TAPER_LENGTH / 2 * phase_step) ** 2)
    return np.asarray(_TAPER_LENGTH * np.sinh(root) / root, np.float32)


def _indices_from_middle(n: int) -> np.ndarray:
    return np.arange(n) - (n - 1) / 2


def _signed_bins(n_bins: int) -> np.ndarray:
    return np.arange(n_bins) - n_bins // 2


def _relative_frequency_per_sample(n_samples: int, growth: float) -> np.ndarray:
    """Return the frequency sent at each sample over the mean of all, (sample,)."""
    return np.asarray(1 + growth * _indices_from_middle(n_samples))


def _outer_phase_factors(factors: np.ndarray, rates: np.ndarray) -> np.ndarray:
    """Return exp(i factor rate), (factor, 1, sample); phases in double precision."""
    return np.exp(1j * np.outer(factors, rates)).astype(np.complex64)[:, None, :]


def _apply_windows(
    samples: np.ndarray,
    sampling: Sampling,
    range_transform: Transform,
    doppler_transform: Transform,
) -> np.ndarray:
    slow = (doppler_transform.weights / doppler_transform.weights.sum()).astype(np.float32)
    return np.asarray(
        samples * slow[:, None, None] * amplitude_range_weights(range_transform, sampling)
    )


def _transform_range(
    by_sample: np.ndarray, sampling: Sampling, range_transform: Transform
) -> np.ndarray:
    spectrum = scipy.fft.fft(by_sample, range_transform.n_bins, axis=-1, overwrite_x=True)
    if sampling == "real":  # the upper half is the mirror image, at minus the velocity
        spectrum = spectrum[..., : range_transform.n_bins // 2 + 1]
    return np.asarray(spectrum)
