"""Where detections lie in resolution cells: what a frame and an array can tell apart."""

import numpy as np
from numpy.typing import ArrayLike

from dechirp.radar.radar import Radar


def in_cells(
    range_m: ArrayLike,
    velocity_m_per_s: ArrayLike,
    azimuth_rad: ArrayLike,
    elevation_rad: ArrayLike,
    radar: Radar,
) -> np.ndarray:
    """Beat and Doppler frequencies and the sines of directions, in resolution cells, (n, 4).

    Of the beat frequency one over the sampling window, of the Doppler frequency one over the
    frame, of sines one over the length of the virtual array in wavelengths. Beats and not
    ranges: on them folds of the velocity make no odds. NaN for what is not told; one chirp
    tells no velocity, and its beats are those of targets at rest. `radar`: as it is in the
    frame, see `Radar.at`.
    """
    frame, chirp = radar.frame, radar.frame.chirp
    velocity = np.asarray(velocity_m_per_s, dtype=float)
    beat_hz, doppler_hz = chirp.echo_frequencies_hz(
        np.asarray(range_m, dtype=float), np.where(np.isnan(velocity), 0.0, velocity)
    )
    elevation = np.asarray(elevation_rad, dtype=float)
    level = np.cos(np.where(np.isnan(elevation), 0.0, elevation))  # nan_to_num takes 27 us more
    lengths = np.ptp(radar.array.virtual_m, axis=0)[1:] / chirp.wavelength_m
    return np.stack(
        [
            beat_hz / chirp.sample_rate_hz * chirp.n_samples,
            np.where(np.isnan(velocity), np.nan, doppler_hz * frame.duration_s),
            np.sin(azimuth_rad) * level * lengths[0],
            np.sin(elevation_rad) * lengths[1],
        ],
        axis=-1,
    )


def in_one_fold(cells: np.ndarray, n_chirps: float) -> np.ndarray:
    """The same with Doppler from 0 to below n_chirps: all folds at one place, (n, 4)."""
    folded = cells.copy()
    # Twice: what is the least below 0 becomes n_chirps the first time.
    folded[:, 1] = cells[:, 1] % n_chirps % n_chirps
    return folded
