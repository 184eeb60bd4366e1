r"""Interpolation of peaks between bins, from the cells beside the highest.

A tone d bins from its cell has in the cell beside it, on the nearer side, the amplitude

.. math:: \frac{|W(1 - d)|}{|W(d)|}, \quad W(d) = \sum_n w_n e^{2\pi\mathrm{i} d n / N}

relative to the highest: it rises with d from 0 to 1/2, for every window and padding, and is
inverted with the transform of the window. The only remaining bias is that of other tones: the image
of a real tone puts 0.005 of an unpadded bin where it is six bins off, under a rectangular
window. Noise moves it as little as a parabola through three cells, and under a rectangular window
without padding less, by a third at 30 dB: the cell on the other side may contain noise alone.
"""

from functools import lru_cache

import numpy as np

from dechirp.processing.cfar.base import MapNoise
from dechirp.processing.spectrum import Transform

# Steps of half a bin at which W is taken: between them ratios are straight within 1e-4 bins.
_STEPS = 64
_OFFSETS = np.linspace(0, 0.5, _STEPS + 1)
# A window whose transform falls less than this in a bin has one weight that counts: no lobe.
_FLAT = 1e-9


def interpolate_peak_frequencies(
    power: np.ndarray, cells: np.ndarray, noise: MapNoise
) -> tuple[np.ndarray, np.ndarray]:
    """Estimate the frequencies of peaks, rad per chirp and rad per sample, (n,) each.

    `power` is (velocity, range), `cells` (n, 2) the cells of the peaks.
    """
    velocity, row = cells[:, 0], cells[:, 1]
    (n_velocity, n_rows), n_bins = power.shape, noise.range_transform.n_bins

    def power_at(at_velocity: np.ndarray, at_row: np.ndarray) -> np.ndarray:
        # Rows wrap round as velocities do. Of real samples, half the rows are mirror images of the
        # other half, at the negative velocity.
        at_row = at_row % n_bins
        is_image = at_row >= n_rows
        at_velocity = np.where(is_image, 2 * (n_velocity // 2) - at_velocity, at_velocity)
        return power[at_velocity % n_velocity, np.where(is_image, n_bins - at_row, at_row)]

    top = power_at(velocity, row)
    velocity_offset = tone_bin_offsets(
        power_at(velocity - 1, row), top, power_at(velocity + 1, row), noise.doppler_transform
    )
    row_offset = tone_bin_offsets(
        power_at(velocity, row - 1), top, power_at(velocity, row + 1), noise.range_transform
    )
    turn_velocity = 2 * np.pi / noise.doppler_transform.n_bins
    turn_range = 2 * np.pi / noise.range_transform.n_bins
    slow = (velocity - noise.doppler_transform.n_bins // 2 + velocity_offset) * turn_velocity
    return slow, (row + row_offset) * turn_range


def tone_bin_offsets(
    lower: np.ndarray, centre: np.ndarray, upper: np.ndarray, transform: Transform
) -> np.ndarray:
    """Estimate the offsets of tones from their cells, -1/2 to 1/2 bins; 0 without power.

    `lower`, `centre` and `upper` are powers of three cells in a row, the highest in the middle.
    """
    ratios = _neighbour_amplitude_ratios_by_offset(transform)
    if ratios[0] > 1 - _FLAT:
        return np.zeros(centre.shape)
    power = np.maximum(lower, upper) / np.where(centre > 0, centre, np.inf)
    distance = np.interp(np.sqrt(power), ratios, _OFFSETS)
    return np.asarray(np.sign(upper - lower) * distance)


@lru_cache(maxsize=32)
def _neighbour_amplitude_ratios_by_offset(transform: Transform) -> np.ndarray:
    """Return the amplitude ratio of neighbour and peak cell, for offsets of 0 to 1/2 bin."""
    turns = 2j * np.pi / transform.n_bins * np.arange(transform.n_points)
    own_response, neighbour_response = (
        abs(np.exp(np.outer(off, turns)) @ transform.weights) for off in (_OFFSETS, 1 - _OFFSETS)
    )
    return np.asarray(neighbour_response / own_response)
