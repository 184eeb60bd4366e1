"""From peaks of a map to range, velocity and their standard errors."""

import numpy as np
from scipy.special import gammaincinv

from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.process.cfar.base import Noise, Ring
from dechirp.process.refine import Tones
from dechirp.radar.accuracy import standard_errors
from dechirp.radar.frame import Frame


def between_bins(
    power: np.ndarray, found: np.ndarray, noise: Noise
) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies of the peaks, rad per chirp and per sample, by a parabola through decibels.

    Within 0.2 of a bin of the truth for any of the windows: enough to start from.
    """
    velocity, row = found[:, 0], found[:, 1]
    (n_velocity, n_rows), n_bins = power.shape, noise.over_range.n_bins

    def level(at_velocity: np.ndarray, at_row: np.ndarray) -> np.ndarray:
        # Rows wrap round as velocities do; those of real samples end before they would.
        cells = power[at_velocity % n_velocity, np.minimum(at_row % n_bins, n_rows - 1)]
        return np.log(np.maximum(cells, np.finfo(np.float32).tiny))

    def vertex(before: np.ndarray, after: np.ndarray) -> np.ndarray:
        curve = 2 * level(velocity, row) - before - after
        return np.clip((after - before) / np.where(curve > 0, 2 * curve, np.inf), -0.5, 0.5)

    d_velocity = vertex(level(velocity - 1, row), level(velocity + 1, row))
    d_row = vertex(level(velocity, row - 1), level(velocity, row + 1))
    turn_velocity = 2 * np.pi / noise.over_velocity.n_bins
    turn_range = 2 * np.pi / noise.over_range.n_bins
    slow = (velocity - noise.over_velocity.n_bins // 2 + d_velocity) * turn_velocity
    return slow, (row + d_row) * turn_range


def noise_about(power: np.ndarray, found: np.ndarray, ring: Ring, n_channels: int) -> np.ndarray:
    """Mean noise power in the cells about each peak, (n,).

    The median of the ring's corners, over that of the mean of n_channels exponentials: the
    sidelobes of a separable window lie on the cross that the corners leave out, and other
    targets move a median little. A ring along one axis has no corners and is taken whole.
    """
    n_velocity, n_rows = power.shape
    median = gammaincinv(n_channels, 0.5) / n_channels
    guard, half_v = ring.n_guard, ring.half_velocity
    dv = np.arange(-half_v, half_v + 1)
    outside_v = abs(dv) > guard.velocity
    levels = np.empty(len(found))
    places = ring.places(n_rows)
    for i, (velocity, row) in enumerate(found):
        rows = row - places[row] + np.arange(2 * ring.half_range + 1)
        outside_r = abs(rows - row) > guard.range
        if outside_v.any() and outside_r.any():
            cells = power[np.ix_((velocity + dv[outside_v]) % n_velocity, rows[outside_r])]
        elif outside_r.any():
            cells = power[velocity, rows[outside_r]]
        else:
            cells = power[(velocity + dv[outside_v]) % n_velocity, row]
        levels[i] = np.median(cells) / median
    return levels


def estimates(tones: Tones, snr: np.ndarray, frame: Frame) -> dict[str, np.ndarray]:
    """Range and velocity of tones, with standard errors.

    With the delay tau at mid-window, the fast-time frequency is S tau + f_D and the
    slow-time frequency f_D = 2 v (f - S tau) / c, f the mean of the sampled frequencies. So
    their difference is free of range-Doppler coupling and of the residual video phase. One
    chirp alone tells no velocity: NaN, and the range is that of a target at rest.
    """
    chirp = frame.chirp
    doppler_hz = ((tones.slow + np.pi) % (2 * np.pi) - np.pi) / (2 * np.pi * frame.repetition_s)
    beat_hz = tones.fast * chirp.sample_rate_hz / (2 * np.pi) - doppler_hz
    wavelength_m = SPEED_OF_LIGHT / (chirp.mean_sampled_frequency_hz - beat_hz)
    range_std, velocity_std = standard_errors(frame, snr=snr, wavelength_m=wavelength_m)
    velocity = doppler_hz * wavelength_m / 2
    return {
        "range": chirp.range_m(1.0) * beat_hz,
        "velocity": velocity if frame.n_chirps > 1 else np.full_like(velocity, np.nan),
        "snr": snr,
        "range_std": range_std,
        "velocity_std": velocity_std,
    }
