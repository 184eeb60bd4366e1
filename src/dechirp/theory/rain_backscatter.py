"""Rain backscatter: drop sizes, fall speeds and radar reflectivity."""

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from dechirp.core.checks import check_number, check_positive_ratios
from dechirp.core.elementwise import elementwise, scalar_results
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.theory.attenuation import MAX_RAIN_RATE_M_PER_S
from dechirp.theory.mie import sphere_rcs_m2
from dechirp.theory.water_permittivity import water_relative_permittivity

__all__ = [
    "drop_fall_speed_m_per_s",
    "drop_size_density_per_m4",
    "rain_reflectivity_per_m",
    "rain_reflectivity_per_m4",
]

# Larger drops break up; drops below 0.1 mm contribute less than 1e-4 of the total.
DIAMETERS_M = np.arange(0.05e-3, 7.0e-3, 0.02e-3)
"""Diameters of the sum over drops, 0.02 mm apart."""


@elementwise
def drop_size_density_per_m4(diameter_m: ArrayLike, rate_m_per_s: float) -> np.ndarray:
    r"""Return the drop size distribution N(D): drops per volume and diameter interval, 1/m^4.

    .. math:: N = N_0 e^{-\Lambda D}, \quad N_0 = 8 \cdot 10^6 \, \mathrm{m}^{-4}, \quad
              \Lambda = 4100 \, R^{-0.21} \, \mathrm{m}^{-1}

    with the rain rate R in mm/h, here given in m/s, up to 200 mm/h. Measured for 1 to 23 mm/h;
    it overestimates the smallest drops.

    Parameters
    ----------
    diameter_m : array
        Diameter of a drop, above 0.
    rate_m_per_s : array
        Rain rate, above 0 and at most 5.56e-5 m/s (200 mm/h).

    References
    ----------
    J. S. Marshall, W. McK. Palmer, The distribution of raindrops with size, J. Meteorology
    5(4), 1948.
    """
    rate = check_number("rate_m_per_s", rate_m_per_s, above=0, at_most=MAX_RAIN_RATE_M_PER_S)
    steepness = 4100.0 * (3.6e6 * rate) ** -0.21
    return np.asarray(8e6 * np.exp(-steepness * check_positive_ratios("diameter_m", diameter_m)))


@scalar_results
def drop_fall_speed_m_per_s(diameter_m: ArrayLike) -> np.ndarray:
    """Return the fall speed of a drop in still air at sea level, 9.65 - 10.3 exp(-600 D), D in m.

    Within 2 % of what Gunn and Kinzer (1949) measured, from 0.6 mm to 5.8 mm; none below
    0.11 mm, where the formula ends.

    Parameters
    ----------
    diameter_m : array
        Diameter of a drop, above 0.

    References
    ----------
    D. Atlas, R. C. Srivastava, R. S. Sekhon, Doppler radar characteristics of precipitation at
    vertical incidence, Rev. Geophysics 11(1), 1973.
    """
    diameters_m = check_positive_ratios("diameter_m", diameter_m)
    return np.maximum(9.65 - 10.3 * np.exp(-600 * diameters_m), 0.0)


@elementwise
def rain_reflectivity_per_m4(
    frequency_hz: float, rate_m_per_s: float, *, temperature_k: float = 283.15
) -> np.ndarray:
    r"""Return the reflectivity of rain per diameter interval: sigma(D) N(D).

    At `DIAMETERS_M`, (n_diameters,), m^2 / m^4. Drops are independent spheres of pure water
    (Mie). The array is cached and read-only.

    Parameters
    ----------
    frequency_hz : array
        Carrier frequency, above 0 and at most 1 THz.
    rate_m_per_s : array
        Rain rate, above 0 and at most 5.56e-5 m/s (200 mm/h).
    temperature_k : array
        Temperature of the water, from 243 K to 323 K.

    Raises
    ------
    InvalidSetting
        Outside the validity of `drop_size_density_per_m4` and `water.water_relative_permittivity`.
    """
    return _cached_rain_reflectivity_per_m4(
        check_number("frequency_hz", frequency_hz),
        check_number("rate_m_per_s", rate_m_per_s),
        check_number("temperature_k", temperature_k),
    )


@lru_cache
def _cached_rain_reflectivity_per_m4(
    frequency_hz: float, rate_m_per_s: float, temperature_k: float
) -> np.ndarray:
    epsilon = water_relative_permittivity(frequency_hz, temperature_k)
    wavelength_m = SPEED_OF_LIGHT / frequency_hz
    cross_sections_m2 = sphere_rcs_m2(DIAMETERS_M / 2, wavelength_m, permittivity=epsilon)
    reflectivity = cross_sections_m2 * drop_size_density_per_m4(DIAMETERS_M, rate_m_per_s)
    reflectivity.flags.writeable = False
    return reflectivity


@elementwise
def rain_reflectivity_per_m(
    frequency_hz: float, rate_m_per_s: float, *, temperature_k: float = 283.15
) -> float:
    """Return the reflectivity eta of rain, m^2 / m^3: the sum over all drops.

    Parameters
    ----------
    frequency_hz : array
        Carrier frequency, above 0 and at most 1 THz.
    rate_m_per_s : array
        Rain rate, above 0 and at most 5.56e-5 m/s (200 mm/h).
    temperature_k : array
        Temperature of the water, from 243 K to 323 K.
    """
    reflectivity_by_diameter = rain_reflectivity_per_m4(
        frequency_hz, rate_m_per_s, temperature_k=temperature_k
    )
    return float(reflectivity_by_diameter.sum() * (DIAMETERS_M[1] - DIAMETERS_M[0]))
