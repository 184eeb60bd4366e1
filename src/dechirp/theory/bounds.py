"""Cramer-Rao bounds: the smallest standard deviations that an unbiased estimate can have.

`snr` is the ratio after integration over all samples and chirps without windows,
N M A^2 / E|w|^2 for complex samples, half of that for real ones: the bounds are then the
same for both. Amplitude, phase and both frequencies are unknown. For an angle it is the
ratio in one element of the array.

Below an `snr` of about 15 dB estimates jump to noise peaks now and then and are far worse
than the bound (Rife and Boorstyn 1974).

Ratios are above 0, linear, of any shape; results have the shape to which arrays broadcast.
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


def angle_std_rad(
    *, snr: ArrayLike, positions_m: ArrayLike, wavelength_m: float, angle_rad: ArrayLike
) -> np.ndarray:
    r"""Bound on the standard deviation of the angle of one target, for elements on a line.

    .. math::

        \sigma_\theta = \frac{\lambda}{2 \pi \cos\theta \sqrt{2 \chi \sum_i (x_i - \bar x)^2}}

    which for L elements d apart is sqrt(6 / (chi L (L^2 - 1))) / (2 pi (d / lambda) cos theta).

    Parameters
    ----------
    snr : array
        Chi, the ratio in one element after range-Doppler processing.
    positions_m : array (n,)
        Along the line, in any order; of a virtual array, transmitter plus receiver.
    wavelength_m : float
        At the middle of the sampling window.
    angle_rad : array
        Theta, from the normal of the line.

    Returns
    -------
    array, rad
        Infinite where the elements share one position, since they then tell no angle.

    References
    ----------
    P. Stoica and A. Nehorai, MUSIC, maximum likelihood, and Cramer-Rao bound, IEEE Trans.
    ASSP 37(5), 1989, for one source. H. L. Van Trees, Optimum Array Processing, 2002.
    """
    positions = np.asarray(positions_m, dtype=float)
    spread_m2 = np.sum((positions - positions.mean()) ** 2)
    aperture = 2 * np.pi / wavelength_m * np.cos(angle_rad)
    with np.errstate(divide="ignore"):
        std = 1.0 / (aperture * np.sqrt(2 * np.asarray(snr, dtype=float) * spread_m2))
    return np.asarray(std)


def monopulse_std_rad(
    *, snr: ArrayLike, beamwidth_rad: ArrayLike, slope: float = 1.6
) -> np.ndarray:
    """Standard deviation of a monopulse angle near the axis, theta / (k sqrt(2 snr)).

    `snr` is the ratio in the sum beam, all elements included, `beamwidth_rad` its half-power
    width and `slope` that of the difference over the sum, times the width. With 1.6 a
    uniformly weighted line reaches `angle_std_rad`.

    References
    ----------
    D. K. Barton, Radar System Analysis and Modeling, 2005.
    """
    return np.asarray(np.asarray(beamwidth_rad) / (slope * np.sqrt(2 * np.asarray(snr))))
