r"""Range walk: targets that cross range cells within a frame, kept in one.

In chirp m, counted from mid-frame, the beat of a target at R has at sample n the phase

.. math:: \frac{4\pi}{c} f_n (R + v m T)

with f_n the frequency sent at that sample. So its slow-time frequency grows with f_n: along
a frame the target walks v M T, and a Doppler transform at one frequency for all samples
spreads it over so many range cells. Above half a cell that costs: 4.3 dB for two cells, 7 dB
for four, without windows. Here the transform over chirps has for each sample the frequencies
of its own, scaled by f_n over their mean; the range is that at mid-frame.

White noise keeps its power in each cell. From bin to bin of velocity it is correlated as
after an ordinary transform, but for a bin width that differs by f_n over the mean, up to a
few per cent.

Velocities are those of the frame: of a target whose velocity folds, the walk of the folded
velocity is undone, not its own.

References
----------
R. P. Perry, R. C. DiPietro and R. L. Fante, SAR imaging of moving targets, IEEE Trans. AES
35(1), 1999: the keystone. K. Fourmont, Non-equispaced fast Fourier transforms with applications
to tomography, J. Fourier Analysis and Applications 9(5), 2003: tapers of segments.
"""

from functools import partial
from typing import Literal

import numpy as np
import scipy.fft

from dechirp.process.spectrum import FrameTransform, Transform, amplitude_weights, range_doppler
from dechirp.radar.chirp import Chirp, Sampling

# Complex numbers that one block of samples fills at most in the chirp transform.
_BLOCK = 2**20
# A segment reaches over so many middles of segments, two to each range cell of the farthest walk.
# Between middles phases turn by a quarter of a cycle at the most. With this taper that leaves
# lobes 75 dB below a target.
_REACH = 4.0
_TAPER = 0.75 * np.pi * _REACH


RangeWalk = Literal["keystone", "segmented"]


def undone_by(name: RangeWalk | None, chirp: Chirp) -> FrameTransform:
    """The transform of that name, for what a chirp sweeps; without one the ordinary."""
    if name is None:
        return range_doppler
    return partial({"keystone": keystone, "segmented": segmented}[name], growth=growth(chirp))


def growth(chirp: Chirp) -> float:
    """By how much slow-time frequencies grow from sample to sample, relative to their mean."""
    return chirp.slope_hz_per_s / chirp.sample_rate_hz / chirp.mean_sampled_frequency_hz


def keystone(
    samples: np.ndarray,
    sampling: Sampling,
    over_range: Transform,
    over_velocity: Transform,
    *,
    growth: float,
) -> np.ndarray:
    """Transform one frame, (chirp, channel, sample), to (velocity, channel, range), walk undone.

    As `spectrum.range_doppler`, but for the phase, which is that at mid-frame. The transform
    over chirps is a chirp transform (Bluestein 1970), exact at any scale of its frequencies:
    fast transforms of more than twice the length, there and back.
    """
    tapered = _tapered(samples, sampling, over_range, over_velocity)
    n_chirps, n_bins = over_velocity.n_points, over_velocity.n_bins
    # Of k j = (k^2 + j^2 - (k - j)^2) / 2.
    rates = -np.pi / n_bins * _scales(over_range.n_points, growth)
    chirps, bins = _from_middle(n_chirps), _bins(n_bins)
    apart = bins[0] - chirps[-1] + np.arange(n_chirps + n_bins - 1)
    n_fft = scipy.fft.next_fast_len(apart.size)
    out = np.empty((n_bins, *samples.shape[1:]), np.complex64)
    step = max(1, _BLOCK // (n_fft * samples.shape[1]))
    for first in range(0, over_range.n_points, step):
        block = slice(first, first + step)
        rate = rates[block]
        given = tapered[:, :, block] * _turns(chirps**2, rate)
        filtered = scipy.fft.fft(given, n_fft, axis=0, overwrite_x=True)
        filtered *= scipy.fft.fft(_turns(apart**2, -rate), n_fft, axis=0)
        found = scipy.fft.ifft(filtered, axis=0, overwrite_x=True)[n_chirps - 1 : apart.size]
        np.multiply(found, _turns(bins**2, rate), out=out[:, :, block])
    return _over_range(out, sampling, over_range)


def segmented(
    samples: np.ndarray,
    sampling: Sampling,
    over_range: Transform,
    over_velocity: Transform,
    *,
    growth: float,
) -> np.ndarray:
    r"""Transform one frame as `keystone`, undoing the walk in steps, segment by segment.

    Within a segment of chirps a target stays in its cell; segments are put in step for each
    velocity and added. They overlap under Kaiser-Bessel tapers h, whose transform is divided
    out, as in non-uniform Fourier transforms (Fourmont 2003):

    .. math:: e^{i \theta m} \approx \frac{1}{H(\theta)} \sum_s h(m - m_s) e^{i \theta m_s}

    Segments side by side would make jumps of phase, and those lobes 30 dB below a target at
    other velocities and ranges; of these 75 dB below are left. The time grows with the walk of
    the largest velocity: two fast transforms for each cell, and five more.
    """
    tapered = _tapered(samples, sampling, over_range, over_velocity)
    n_bins = over_velocity.n_bins
    more = _scales(over_range.n_points, growth) - 1
    chirps, bins = _from_middle(over_velocity.n_points), np.fft.ifftshift(_bins(n_bins))
    # At the largest velocity a target walks lambda M / 4 within the frame: M ptp(more) / 2 cells.
    apart = 1 / np.ptp(more)
    n_sides = int(chirps[-1] / apart + _REACH / 2)
    rates = -2 * np.pi / n_bins * more
    out = np.zeros((n_bins, *samples.shape[1:]), np.complex64)
    alone = np.empty_like(tapered)
    for middle in apart * np.arange(-n_sides, n_sides + 1):
        np.multiply(tapered, _taper((chirps - middle) / apart)[:, None, None], out=alone)
        spectrum = scipy.fft.fft(alone, n_bins, axis=0)
        spectrum *= _turns(bins, middle * rates)
        out += spectrum
    out /= _taper_sum(np.outer(bins, rates * apart))[:, None, :]
    out = np.fft.fftshift(out, axes=0)
    return _over_range(out, sampling, over_range)


def _taper(away: np.ndarray) -> np.ndarray:
    """Kaiser-Bessel taper of a segment, so many steps between segments from its middle."""
    within = np.maximum(1 - (2 * away / _REACH) ** 2, 0.0)
    return np.where(within > 0, np.i0(_TAPER * np.sqrt(within)), 0.0).astype(np.float32)


def _taper_sum(turn: np.ndarray) -> np.ndarray:
    """What a tone that turns so far from segment to segment, in rad, is raised by in their sum."""
    root = np.sqrt(_TAPER**2 - (_REACH / 2 * turn) ** 2)
    return np.asarray(_REACH * np.sinh(root) / root, np.float32)


def _from_middle(n: int) -> np.ndarray:
    return np.arange(n) - (n - 1) / 2


def _bins(n_bins: int) -> np.ndarray:
    return np.arange(n_bins) - n_bins // 2


def _scales(n_samples: int, growth: float) -> np.ndarray:
    """Frequency sent at each sample over the mean of all, (sample,)."""
    return np.asarray(1 + growth * _from_middle(n_samples))


def _turns(factors: np.ndarray, rates: np.ndarray) -> np.ndarray:
    """Phase factors exp(i factor rate), (factor, 1, sample); phases in double precision."""
    return np.exp(1j * np.outer(factors, rates)).astype(np.complex64)[:, None, :]


def _tapered(
    samples: np.ndarray, sampling: Sampling, over_range: Transform, over_velocity: Transform
) -> np.ndarray:
    slow = (over_velocity.weights / over_velocity.weights.sum()).astype(np.float32)
    return np.asarray(samples * slow[:, None, None] * amplitude_weights(over_range, sampling))


def _over_range(by_sample: np.ndarray, sampling: Sampling, over_range: Transform) -> np.ndarray:
    found = scipy.fft.fft(by_sample, over_range.n_bins, axis=-1, overwrite_x=True)
    if sampling == "real":  # the upper half is the mirror image, at minus the velocity
        found = found[..., : over_range.n_bins // 2 + 1]
    return np.asarray(found)
