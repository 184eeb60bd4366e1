"""Positions of detections in resolution cells of a frame and an array."""

import numpy as np
from numpy.typing import ArrayLike

from dechirp.core.detection_columns import zero_where_unknown
from dechirp.radar.radar import Radar


def to_resolution_cells(
    range_m: ArrayLike,
    velocity_m_per_s: ArrayLike,
    azimuth_rad: ArrayLike,
    elevation_rad: ArrayLike,
    radar: Radar,
) -> np.ndarray:
    """Convert detections to beat and Doppler frequencies and direction sines in cells, (n, 4).

    A cell of the beat frequency is one over the sampling window, of the Doppler frequency one
    over the frame, of the sines one over the length of the virtual array in wavelengths. Beat
    frequencies replace ranges because velocity ambiguities do not change them. NaN where a
    quantity is not measured; a single chirp measures no velocity, and its beat frequencies are
    those of static targets. `radar` has a single interval, see `Radar.for_frame`.
    """
    frame, chirp = radar.frame, radar.frame.chirp
    velocity = np.asarray(velocity_m_per_s, dtype=float)
    beat_hz, doppler_hz = chirp.echo_frequencies_hz(
        np.asarray(range_m, dtype=float), zero_where_unknown(velocity)
    )
    elevation = np.asarray(elevation_rad, dtype=float)
    cos_elevation = np.cos(zero_where_unknown(elevation))
    aperture_wavelengths = np.ptp(radar.array.virtual_positions_m, axis=0)[1:] / chirp.wavelength_m
    return np.stack(
        [
            beat_hz / chirp.sample_rate_hz * chirp.n_samples,
            np.where(np.isnan(velocity), np.nan, doppler_hz * frame.duration_s),
            np.sin(azimuth_rad) * cos_elevation * aperture_wavelengths[0],
            np.sin(elevation_rad) * aperture_wavelengths[1],
        ],
        axis=-1,
    )


def alias_doppler_cells(cells: np.ndarray, n_chirps: float) -> np.ndarray:
    """Alias the Doppler cells into 0 to below n_chirps, so that ambiguities coincide, (n, 4)."""
    aliased = cells.copy()
    # The first modulo rounds the largest value below 0 to n_chirps, so it is applied twice.
    aliased[:, 1] = cells[:, 1] % n_chirps % n_chirps
    return aliased
