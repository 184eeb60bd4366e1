"""Cramer-Rao bounds of range and velocity of one target in a frame."""

import numpy as np
from numpy.typing import ArrayLike

from dechirp.radar.frame import Frame
from dechirp.theory.bounds import crlb_range, crlb_velocity, decoupled_range_std_m


def range_and_velocity_crlb_std(frame: Frame, *, snr: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Return the smallest standard deviations of range (m) and velocity (m/s), both unknown.

    Parameters
    ----------
    frame : Frame
    snr : array
        Ratio after integration over all samples, chirps and channels; any shape.

    Notes
    -----
    A single chirp measures no velocity: its error is NaN, and that of range holds for a static
    target. A single triangle measures both from its two beats, with equal error shares.
    """
    chirp = frame.chirp
    range_std_at_known_velocity = crlb_range(
        snr=snr,
        n_samples=chirp.n_samples,
        sample_rate_hz=chirp.sample_rate_hz,
        slope_hz_per_s=chirp.slope_hz_per_s,
    )
    if not frame.can_measure_velocity:
        return range_std_at_known_velocity, np.full_like(range_std_at_known_velocity, np.nan)
    if frame.n_chirps == 1:
        doppler_hz = chirp.beat_frequency_hz(1.0) * range_std_at_known_velocity
        return range_std_at_known_velocity, np.asarray(doppler_hz * chirp.wavelength_m / 2)
    velocity_std = crlb_velocity(
        snr=snr,
        n_chirps=frame.n_chirps,
        interval_s=frame.repetition_s,
        wavelength_m=chirp.wavelength_m,
    )
    if frame.has_falling_ramps:  # the coupling of both ramps cancels
        return range_std_at_known_velocity, velocity_std
    range_std = decoupled_range_std_m(
        range_std_m=range_std_at_known_velocity,
        velocity_std_m_per_s=velocity_std,
        mid_window_frequency_hz=chirp.mid_window_frequency_hz,
        slope_hz_per_s=chirp.slope_hz_per_s,
    )
    return range_std, velocity_std
