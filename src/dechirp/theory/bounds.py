"""Cramer-Rao bounds: the smallest standard deviations that an unbiased estimate can have.

`snr` is the ratio after integration over all samples and chirps without windows,
N M A^2 / E|w|^2 for complex samples, half of that for real ones: the bounds are then the
same for both. Amplitude, phase and both frequencies are unknown.

Below an `snr` of about 15 dB estimates jump to noise peaks now and then and are far worse
than the bound (Rife and Boorstyn 1974).
"""

import numpy as np
from numpy.typing import ArrayLike

from dechirp.core.units import SPEED_OF_LIGHT


def frequency_variance(*, snr: ArrayLike, n_points: int) -> np.ndarray:
    r"""Bound on the variance of a tone's frequency, (rad per sample)^2.

    .. math:: \mathrm{var}(\omega) \ge \frac{6}{\chi (N^2 - 1)}

    with N the points along the axis of this frequency; the other axes count in `snr` alone.

    References
    ----------
    D. C. Rife and R. R. Boorstyn, Single-tone parameter estimation from discrete-time
    observations, IEEE Trans. IT 20(5), 1974. S. M. Kay, Fundamentals of Statistical Signal
    Processing I: Estimation Theory, 1993, 3.11.
    """
    return 6.0 / (np.asarray(snr, dtype=float) * (float(n_points) ** 2 - 1.0))


def range_std_m(
    *, snr: ArrayLike, n_samples: int, sample_rate_hz: float, slope_hz_per_s: float
) -> np.ndarray:
    """Bound on the standard deviation of range, c fs / (4 pi S) times that of frequency.

    Of a target whose velocity is known; see `uncoupled_range_std_m` for one whose is not.
    """
    radians_to_m = SPEED_OF_LIGHT * sample_rate_hz / (4 * np.pi * slope_hz_per_s)
    return np.asarray(radians_to_m * np.sqrt(frequency_variance(snr=snr, n_points=n_samples)))


def velocity_std_m_per_s(
    *, snr: ArrayLike, n_chirps: int, interval_s: float, wavelength_m: ArrayLike
) -> np.ndarray:
    """Bound on the standard deviation of velocity, lambda / (4 pi T) times that of frequency.

    `wavelength_m` is the one at the middle of the sampling window.
    """
    radians_to_m_per_s = np.asarray(wavelength_m) / (4 * np.pi * interval_s)
    variance = frequency_variance(snr=snr, n_points=n_chirps)
    return np.asarray(radians_to_m_per_s * np.sqrt(variance))


def uncoupled_range_std_m(
    *,
    range_std_m: ArrayLike,
    velocity_std_m_per_s: ArrayLike,
    mid_window_frequency_hz: float,
    slope_hz_per_s: float,
) -> np.ndarray:
    """Bound for a range freed of range-Doppler coupling with the estimated velocity.

    The correction v f / S brings (f / S)^2 times the variance of velocity with it: 0.1 mm
    at -24 dB per sample in the reference scenario, where range has 11.6 mm.
    """
    coupling_s = mid_window_frequency_hz / slope_hz_per_s
    return np.hypot(range_std_m, coupling_s * np.asarray(velocity_std_m_per_s, dtype=float))
