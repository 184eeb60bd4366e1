"""References for weather that share no code with the package: table values and plain formulas."""

from collections.abc import Callable

import numpy as np
import scipy

from dechirp.core.units import SPEED_OF_LIGHT

# Dry air and vapour in the validation examples of ITU's study group 3 for P.676-12: 1013.25 hPa,
# 288.15 K, 7.5 g/m^3.
_GAS_DB_PER_KM = {76.0: 0.353834900, 77.0: 0.348043514, 78.0: 0.344501016}
# Table 5 of ITU-R P.838-3: k and alpha, horizontal polarisation.
_RAIN_COEFFICIENTS = {77.0: (1.1320, 0.7177), 80.0: (1.1704, 0.7115)}


def interpolate_gas_table_db_per_km(frequency_hz: float) -> float:
    """Return the attenuation by standard air, interpolated; within 3e-4 dB/km."""
    table = np.array(list(_GAS_DB_PER_KM.items())).T
    return float(np.interp(frequency_hz / 1e9, *table))


def interpolate_rain_table_db_per_km(frequency_hz: float, rate_mm_per_h: float) -> float:
    """Return the attenuation by rain, k R^alpha, interpolated as P.838 prescribes.

    The logarithm of k and alpha are linear over the logarithm of the frequency.
    """
    gigahertz = np.log(list(_RAIN_COEFFICIENTS))
    k, alpha = np.array(list(_RAIN_COEFFICIENTS.values())).T
    frequency = np.log(frequency_hz / 1e9)
    exponent = np.interp(frequency, gigahertz, alpha)
    return float(np.exp(np.interp(frequency, gigahertz, np.log(k))) * rate_mm_per_h**exponent)


def water_permittivity_parts(frequency_hz: float, temperature_k: float) -> tuple[float, float]:
    """Return the real and the imaginary part of the permittivity, ITU-R P.840-8, eq. 4 to 10."""
    f, theta = frequency_hz / 1e9, 300 / temperature_k
    static = 77.66 + 103.3 * (theta - 1)
    middle, optical = 0.0671 * static, 3.52
    slow = f / (20.20 - 146 * (theta - 1) + 316 * (theta - 1) ** 2)
    fast = slow / 39.8
    real = (static - middle) / (1 + slow**2) + (middle - optical) / (1 + fast**2) + optical
    imaginary = slow * (static - middle) / (1 + slow**2)
    imaginary += fast * (middle - optical) / (1 + fast**2)
    return real, imaginary


def evaluate_fog_db_per_km(
    frequency_hz: float, water_g_per_m3: float, temperature_k: float
) -> float:
    """Return the attenuation by fog, ITU-R P.840-8, eq. 1 to 3: 0.819 f M / (e'' (1 + eta^2))."""
    real, imaginary = water_permittivity_parts(frequency_hz, temperature_k)
    eta = (2 + real) / imaginary
    return 0.819 * frequency_hz / 1e9 / (imaginary * (1 + eta**2)) * water_g_per_m3


def evaluate_film_loss(frequency_hz: float, film_m: float, temperature_k: float) -> float:
    """Return the one-way loss of a water film from its characteristic matrix.

    M. Born, E. Wolf, Principles of Optics, 7th ed., 1999, 1.6.2, eq. 39 and 48.
    """
    index = np.sqrt(complex(*water_permittivity_parts(frequency_hz, temperature_k)))
    phase = 2 * np.pi * frequency_hz / SPEED_OF_LIGHT * index * film_m
    matrix_sum = 2 * np.cos(phase) - 1j * (index + 1 / index) * np.sin(phase)
    return float(abs(matrix_sum / 2) ** 2)


def evaluate_rain_reflectivity_per_m(
    frequency_hz: float, rate_mm_per_h: float, temperature_k: float
) -> float:
    """Return the reflectivity of rain: Mie's series over the drop sizes of Marshall and Palmer.

    C. F. Bohren, D. R. Huffman, Absorption and Scattering of Light by Small Particles, 1983,
    eq. 4.53 and 4.82, with spherical Bessel functions.
    """
    wavelength_m = SPEED_OF_LIGHT / frequency_hz
    index = np.sqrt(complex(*water_permittivity_parts(frequency_hz, temperature_k)))
    diameter_m = np.linspace(1e-5, 7e-3, 1400)
    x = np.pi * diameter_m / wavelength_m
    amplitude = np.zeros(len(x), complex)
    for n in range(1, 26):
        psi, d_psi = _riccati_bessel(n, x, scipy.special.spherical_jn)
        chi, d_chi = _riccati_bessel(n, x, scipy.special.spherical_yn)
        inner, d_inner = _riccati_bessel(n, index * x, scipy.special.spherical_jn)
        xi, d_xi = psi + 1j * chi, d_psi + 1j * d_chi
        a = (index * inner * d_psi - psi * d_inner) / (index * inner * d_xi - xi * d_inner)
        b = (inner * d_psi - index * psi * d_inner) / (inner * d_xi - index * xi * d_inner)
        # Small drops have no higher terms, whose Bessel functions leave the range of numbers.
        amplitude += np.nan_to_num((2 * n + 1) * (-1) ** n * (a - b))
    cross_section_m2 = wavelength_m**2 / (4 * np.pi) * abs(amplitude) ** 2
    drops_per_m4 = 8e6 * np.exp(-4100 * rate_mm_per_h**-0.21 * diameter_m)
    return float(np.trapezoid(cross_section_m2 * drops_per_m4, diameter_m))


def _riccati_bessel(
    n: int, z: np.ndarray, bessel: Callable[..., np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Return z times a spherical Bessel function, and the derivative of this product."""
    value, slope = bessel(n, z), bessel(n, z, derivative=True)
    return z * value, value + z * slope
