"""Specific attenuation by gases, rain and fog: one-way loss in dB/km.

All arguments broadcast against each other.
"""

import math

import numpy as np

from dechirp.core.checks import check_number
from dechirp.core.elementwise import elementwise
from dechirp.theory.gas_lines import OXYGEN, WATER_VAPOUR
from dechirp.theory.water_permittivity import water_relative_permittivity

__all__ = [
    "fog_db_per_km",
    "gas_db_per_km",
    "oxygen_db_per_km",
    "rain_db_per_km",
    "rain_power_law",
    "vapour_db_per_km",
]

MAX_RAIN_RATE_M_PER_S = 5.56e-5
"""200 mm/h; more occurs only in cloudbursts of minutes."""

# Coefficients of P.838-3, tables 1 to 4: bells (a, b, c) over lg f, then slope and offset.
_K_H = (
    ((-5.33980, -0.10008, 1.13098), (-0.35351, 1.26970, 0.45400),
     (-0.23789, 0.86036, 0.15354), (-0.94158, 0.64552, 0.16817)),
    -0.18961, 0.71147,
)  # fmt: skip
_K_V = (
    ((-3.80595, 0.56934, 0.81061), (-3.44965, -0.22911, 0.51059),
     (-0.39902, 0.73042, 0.11899), (0.50167, 1.07319, 0.27195)),
    -0.16398, 0.63297,
)  # fmt: skip
_ALPHA_H = (
    ((-0.14318, 1.82442, -0.55187), (0.29591, 0.77564, 0.19822), (0.32177, 0.63773, 0.13164),
     (-5.37610, -0.96230, 1.47828), (16.1721, -3.29980, 3.43990)),
    0.67849, -1.95537,
)  # fmt: skip
_ALPHA_V = (
    ((-0.07771, 2.33840, -0.76284), (0.56727, 0.95545, 0.54039), (-0.20238, 1.14520, 0.26809),
     (-48.2991, 0.791669, 0.116226), (48.5833, 0.791459, 0.116479)),
    -0.053739, 0.83433,
)  # fmt: skip


@elementwise
def oxygen_db_per_km(
    frequency_hz: float,
    *,
    pressure_pa: float = 101_325.0,
    temperature_k: float = 288.15,
    vapour_kg_per_m3: float = 7.5e-3,
) -> float:
    r"""Return the attenuation by oxygen, and by nitrogen under pressure, line by line.

    .. math::
        \gamma = 0.1820 f \left( \sum_i S_i F_i + N_D \right),
        \quad F_i = \frac{f}{f_i} \left(
        \frac{w - \delta (f_i - f)}{(f_i - f)^2 + w^2} +
        \frac{w - \delta (f_i + f)}{(f_i + f)^2 + w^2} \right)

    with f in GHz, the strength S, width w and interference delta of each of 44 lines, and the
    dry continuum N_D.

    Parameters
    ----------
    frequency_hz : array
        From 1 GHz to 1 THz.
    pressure_pa : array
        Of the dry air; by default that of the standard atmosphere at sea level.
    temperature_k : array
        From 200 K to 330 K.
    vapour_kg_per_m3 : array
        Water vapour, which widens the lines of oxygen.

    Returns
    -------
    array, dB/km
        One way.

    Raises
    ------
    InvalidSetting
        Beyond these, or above 110 kPa or 0.1 kg/m^3.

    References
    ----------
    Recommendation ITU-R P.676-12, 2019, Annex 1.
    """
    f = _checked_frequency_ghz(frequency_hz, 1e9, 1e12)
    p, e, theta = _pressures_hpa_and_inverse_temperature(
        pressure_pa, temperature_k, vapour_kg_per_m3
    )
    f0, a1, a2, a3, a5, a6 = OXYGEN.T
    strength = a1 * 1e-7 * p * theta**3 * np.exp(a2 * (1 - theta))
    width = a3 * 1e-4 * (p * theta**0.8 + 1.1 * e * theta)
    width = np.sqrt(width**2 + 2.25e-6)  # split by the earth's magnetic field
    interference = (a5 + a6 * theta) * 1e-4 * (p + e) * theta**0.8
    continuum_width = 5.6e-4 * (p + e) * theta**0.8
    continuum = 6.14e-5 / (continuum_width * (1 + (f / continuum_width) ** 2))
    continuum += 1.4e-12 * p * theta**1.5 / (1 + 1.9e-5 * f**1.5)
    lines = (strength * _spectral_line_shapes(f, f0, width, interference)).sum()
    return float(0.1820 * f * (lines + f * p * theta**2 * continuum))


@elementwise
def vapour_db_per_km(
    frequency_hz: float,
    *,
    pressure_pa: float = 101_325.0,
    temperature_k: float = 288.15,
    vapour_kg_per_m3: float = 7.5e-3,
) -> float:
    """Return the attenuation by water vapour, like `oxygen_db_per_km`, from 35 lines.

    Parameters
    ----------
    frequency_hz : array
        From 1 GHz to 1 THz.
    pressure_pa : array
        Pressure of the dry air, above 0 and at most 110 kPa.
    temperature_k : array
        From 200 K to 330 K.
    vapour_kg_per_m3 : array
        Density of the water vapour, from 0 to 0.1 kg/m^3.
    """
    f = _checked_frequency_ghz(frequency_hz, 1e9, 1e12)
    p, e, theta = _pressures_hpa_and_inverse_temperature(
        pressure_pa, temperature_k, vapour_kg_per_m3
    )
    f0, b1, b2, b3, b4, b5, b6 = WATER_VAPOUR.T
    strength = b1 * 1e-1 * e * theta**3.5 * np.exp(b2 * (1 - theta))
    width = b3 * 1e-4 * (p * theta**b4 + b5 * e * theta**b6)
    # Broadened by the Doppler shift of the molecules.
    width = 0.535 * width + np.sqrt(0.217 * width**2 + 2.1316e-12 * f0**2 / theta)
    return float(
        0.1820 * f * (strength * _spectral_line_shapes(f, f0, width, np.zeros_like(f0))).sum()
    )


@elementwise
def gas_db_per_km(
    frequency_hz: float,
    *,
    pressure_pa: float = 101_325.0,
    temperature_k: float = 288.15,
    vapour_kg_per_m3: float = 7.5e-3,
) -> float:
    """Return the attenuation by clear air: `oxygen_db_per_km` plus `vapour_db_per_km`.

    Parameters
    ----------
    frequency_hz : array
        From 1 GHz to 1 THz.
    pressure_pa : array
        Pressure of the dry air, above 0 and at most 110 kPa.
    temperature_k : array
        From 200 K to 330 K.
    vapour_kg_per_m3 : array
        Density of the water vapour, from 0 to 0.1 kg/m^3.
    """
    oxygen, vapour = (
        attenuation(
            frequency_hz,
            pressure_pa=pressure_pa,
            temperature_k=temperature_k,
            vapour_kg_per_m3=vapour_kg_per_m3,
        )
        for attenuation in (oxygen_db_per_km, vapour_db_per_km)
    )
    return oxygen + vapour


@elementwise
def rain_db_per_km(frequency_hz: float, rate_m_per_s: float, *, tilt_rad: float = 0.0) -> float:
    r"""Return the attenuation by rain along a horizontal path, a power law of the rain rate.

    .. math::
        \gamma = k R^\alpha, \quad
        k = \frac{k_H + k_V + (k_H - k_V) \cos 2\tau}{2}, \quad
        \alpha = \frac{k_H \alpha_H + k_V \alpha_V
        + (k_H \alpha_H - k_V \alpha_V) \cos 2\tau}{2 k}

    with R in mm/h; k and alpha by `rain_power_law`. Flattened drops attenuate
    horizontal polarisation more.

    Parameters
    ----------
    frequency_hz : array
        From 1 GHz to 1 THz.
    rate_m_per_s : array
        Rain rate, up to 200 mm/h; 1 mm/h is 2.8e-7 m/s.
    tilt_rad : array
        Of the polarisation from horizontal: pi / 2 vertical, pi / 4 slanted or circular.

    Returns
    -------
    array, dB/km
        One way.

    Raises
    ------
    InvalidSetting
        Beyond these.

    References
    ----------
    Recommendation ITU-R P.838-3, 2005.
    """
    rate_mm_per_h = 3.6e6 * check_number(
        "rate_m_per_s", rate_m_per_s, at_least=0, at_most=MAX_RAIN_RATE_M_PER_S
    )
    cos_2tau = math.cos(2 * check_number("tilt_rad", tilt_rad, at_least=-math.pi, at_most=math.pi))
    (k_h, alpha_h), (k_v, alpha_v) = rain_power_law(frequency_hz)
    k = (k_h + k_v + (k_h - k_v) * cos_2tau) / 2
    alpha = (k_h * alpha_h + k_v * alpha_v + (k_h * alpha_h - k_v * alpha_v) * cos_2tau) / (2 * k)
    return float(k * rate_mm_per_h**alpha)


@elementwise
def rain_power_law(frequency_hz: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return (k, alpha) for horizontal and for vertical polarisation, by the fit of P.838-3.

    Parameters
    ----------
    frequency_hz : array
        From 1 GHz to 1 THz.
    """
    log_f = math.log10(_checked_frequency_ghz(frequency_hz, 1e9, 1e12))
    k_h, alpha_h, k_v, alpha_v = (
        sum(a * math.exp(-(((log_f - b) / c) ** 2)) for a, b, c in bells) + m * log_f + offset
        for bells, m, offset in (_K_H, _ALPHA_H, _K_V, _ALPHA_V)
    )
    return (10**k_h, alpha_h), (10**k_v, alpha_v)


@elementwise
def fog_db_per_km(
    frequency_hz: float, water_kg_per_m3: float, *, temperature_k: float = 283.15
) -> float:
    r"""Return the attenuation by fog or cloud, whose droplets are far smaller than the wavelength.

    .. math:: \gamma = \frac{0.819 f}{\epsilon'' (1 + \eta^2)} M,
              \quad \eta = \frac{2 + \epsilon'}{\epsilon''}

    Parameters
    ----------
    frequency_hz : array
        From 1 GHz to 200 GHz: droplets are below 0.1 mm.
    water_kg_per_m3 : array
        Liquid water in the air, M, up to 10 g/m^3: 5e-5 kg/m^3 for a visibility of 300 m,
        5e-4 for 50 m (P.840).
    temperature_k : array
        Of the droplets, from 243 K to 323 K.

    Returns
    -------
    array, dB/km
        One way.

    Raises
    ------
    InvalidSetting
        Beyond these.

    References
    ----------
    Recommendation ITU-R P.840-8, 2019, Annex 1.
    """
    f = _checked_frequency_ghz(frequency_hz, 1e9, 200e9)
    water = 1e3 * check_number("water_kg_per_m3", water_kg_per_m3, at_least=0, at_most=1e-2)
    epsilon = water_relative_permittivity(frequency_hz, temperature_k)
    eta = (2 + epsilon.real) / epsilon.imag
    return 0.819 * f / (epsilon.imag * (1 + eta**2)) * water


def _checked_frequency_ghz(frequency_hz: float, at_least: float, at_most: float) -> float:
    return check_number("frequency_hz", frequency_hz, at_least=at_least, at_most=at_most) / 1e9


def _pressures_hpa_and_inverse_temperature(
    pressure_pa: float, temperature_k: float, vapour_kg_per_m3: float
) -> tuple[float, float, float]:
    """Return the pressures of dry air and vapour in hPa, and 300 K over the temperature."""
    kelvins = check_number("temperature_k", temperature_k, at_least=200, at_most=330)
    vapour = check_number("vapour_kg_per_m3", vapour_kg_per_m3, at_least=0, at_most=0.1)
    pressure = check_number("pressure_pa", pressure_pa, above=0, at_most=110e3)
    return pressure / 100, 1e3 * vapour * kelvins / 216.7, 300 / kelvins


def _spectral_line_shapes(
    frequency_ghz: float,
    line_frequencies_ghz: np.ndarray,
    width: np.ndarray,
    interference: np.ndarray,
) -> np.ndarray:
    """Return the shape of each line, per GHz."""
    below, above = line_frequencies_ghz - frequency_ghz, line_frequencies_ghz + frequency_ghz
    shapes = (width - interference * below) / (below**2 + width**2)
    shapes += (width - interference * above) / (above**2 + width**2)
    return frequency_ghz / line_frequencies_ghz * shapes
