"""What rain sends back: its drops, how fast they fall, and their cross section in a volume."""

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from dechirp.core.checks import number, positive_ratios
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.theory.attenuation import MOST_RAIN_M_PER_S
from dechirp.theory.mie import sphere_rcs_m2
from dechirp.theory.water import permittivity

# Larger drops break; smaller ones than 0.1 mm send back less than 1e-4 of the whole.
DIAMETERS_M = np.arange(0.05e-3, 7.0e-3, 0.02e-3)
"""At which drops are summed, 0.02 mm apart."""


def drops_per_m4(diameter_m: ArrayLike, rate_m_per_s: float) -> np.ndarray:
    r"""Drops in a volume of air, for each width of diameters: N(D), 1/m^4.

    .. math:: N = N_0 e^{-\Lambda D}, \quad N_0 = 8 \cdot 10^6 \, \mathrm{m}^{-4}, \quad
              \Lambda = 4100 \, R^{-0.21} \, \mathrm{m}^{-1}

    with the rain rate R in mm/h, here given in m/s, up to 200 mm/h. Measured for 1 to 23 mm/h;
    it has too many of the smallest drops.

    References
    ----------
    J. S. Marshall, W. McK. Palmer, The distribution of raindrops with size, J. Meteorology
    5(4), 1948.
    """
    rate = number("rate_m_per_s", rate_m_per_s, above=0, at_most=MOST_RAIN_M_PER_S)
    steepness = 4100.0 * (3.6e6 * rate) ** -0.21
    return np.asarray(8e6 * np.exp(-steepness * positive_ratios("diameter_m", diameter_m)))


def fall_speed_m_per_s(diameter_m: ArrayLike) -> np.ndarray:
    """Speed of a falling drop in still air at sea level, 9.65 - 10.3 exp(-600 D), D in m.

    Within 2 % of what Gunn and Kinzer (1949) measured, from 0.6 mm to 5.8 mm; none below
    0.11 mm, where the formula ends.

    References
    ----------
    D. Atlas, R. C. Srivastava, R. S. Sekhon, Doppler radar characteristics of precipitation at
    vertical incidence, Rev. Geophysics 11(1), 1973.
    """
    diameters_m = positive_ratios("diameter_m", diameter_m)
    return np.maximum(9.65 - 10.3 * np.exp(-600 * diameters_m), 0.0)


@lru_cache
def reflectivity_per_m4(
    frequency_hz: float, rate_m_per_s: float, *, temperature_k: float = 283.15
) -> np.ndarray:
    r"""Cross section of the rain in a volume, for each width of diameters: sigma(D) N(D).

    At `DIAMETERS_M`, (n_diameters,), m^2 / m^4. Drops are spheres of pure water (Mie), each for
    itself. Do not change it: it is kept.

    Raises
    ------
    InvalidSetting
        Where the parts of it have no answer: see `drops_per_m4` and `water.permittivity`.
    """
    epsilon = permittivity(frequency_hz, temperature_k)
    wavelength_m = SPEED_OF_LIGHT / frequency_hz
    cross_sections_m2 = sphere_rcs_m2(DIAMETERS_M / 2, wavelength_m, permittivity=epsilon)
    found = cross_sections_m2 * drops_per_m4(DIAMETERS_M, rate_m_per_s)
    found.flags.writeable = False
    return found


def reflectivity_per_m(
    frequency_hz: float, rate_m_per_s: float, *, temperature_k: float = 283.15
) -> float:
    """Cross section of rain in a volume, eta, m^2 / m^3: the sum over all drops."""
    of_each = reflectivity_per_m4(frequency_hz, rate_m_per_s, temperature_k=temperature_k)
    return float(of_each.sum() * (DIAMETERS_M[1] - DIAMETERS_M[0]))
