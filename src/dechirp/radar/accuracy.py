"""How well a frame can measure: the Cramer-Rao bounds of range and velocity of one target."""

import numpy as np
from numpy.typing import ArrayLike

from dechirp.radar.frame import Frame
from dechirp.theory.bounds import range_std_m, uncoupled_range_std_m, velocity_std_m_per_s


def standard_errors(
    frame: Frame, *, snr: ArrayLike, wavelength_m: ArrayLike | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Smallest standard deviations of range (m) and velocity (m/s), neither known beforehand.

    Parameters
    ----------
    frame : Frame
    snr : array
        Ratio after integration over all samples, chirps and channels; any shape.
    wavelength_m : array, optional
        Of the echo; that of mid-window without it.

    Notes
    -----
    One chirp alone tells no velocity: its error is NaN, and that of range holds for a target
    at rest. One triangle tells both from its beats, whose errors are shared out evenly.
    """
    chirp = frame.chirp
    known_velocity = range_std_m(
        snr=snr,
        n_samples=chirp.n_samples,
        sample_rate_hz=chirp.sample_rate_hz,
        slope_hz_per_s=chirp.slope_hz_per_s,
    )
    wavelengths_m = np.asarray(chirp.wavelength_m if wavelength_m is None else wavelength_m)
    if not frame.tells_velocity:
        return known_velocity, np.full_like(known_velocity, np.nan)
    if frame.n_chirps == 1:
        doppler_hz = chirp.beat_frequency_hz(1.0) * known_velocity
        return known_velocity, np.asarray(doppler_hz * wavelengths_m / 2)
    velocity_std = velocity_std_m_per_s(
        snr=snr,
        n_chirps=frame.n_chirps,
        interval_s=frame.repetition_s,
        wavelength_m=wavelengths_m,
    )
    if frame.falls:  # the coupling of both ramps cancels
        return known_velocity, velocity_std
    range_std = uncoupled_range_std_m(
        range_std_m=known_velocity,
        velocity_std_m_per_s=velocity_std,
        mid_window_frequency_hz=chirp.mid_window_frequency_hz,
        slope_hz_per_s=chirp.slope_hz_per_s,
    )
    return range_std, velocity_std
