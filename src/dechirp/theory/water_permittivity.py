"""Permittivity of liquid water at millimetre waves, and the loss of a water film."""

import cmath
import math

from dechirp.core.checks import check_number
from dechirp.core.elementwise import elementwise
from dechirp.core.units import SPEED_OF_LIGHT

__all__ = ["water_film_loss", "water_relative_permittivity"]


@elementwise
def water_relative_permittivity(frequency_hz: float, temperature_k: float) -> complex:
    r"""Return the relative permittivity of pure water, with a positive imaginary part (absorption).

    .. math::
        \epsilon = \epsilon_2 + \frac{\epsilon_0 - \epsilon_1}{1 - i f / f_p}
        + \frac{\epsilon_1 - \epsilon_2}{1 - i f / f_s},
        \quad \epsilon_0 = 77.66 + 103.3 (\theta - 1), \quad \theta = 300 / T

    the double Debye model: epsilon_1 = 0.0671 epsilon_0, epsilon_2 = 3.52, and relaxation at
    f_p = 20.20 - 146 (theta - 1) + 316 (theta - 1)^2 GHz and f_s = 39.8 f_p.

    Parameters
    ----------
    frequency_hz : float
        Up to 1 THz.
    temperature_k : float
        From 243 K, supercooled, to 323 K.

    Raises
    ------
    InvalidSetting
        Beyond these.

    References
    ----------
    Recommendation ITU-R P.840-8, 2019, equations 4 to 10. H. J. Liebe, G. A. Hufford,
    T. Manabe, A model for the complex permittivity of water at frequencies below 1 THz,
    Int. J. Infrared and Millimeter Waves 12(7), 1991.
    """
    f_ghz = check_number("frequency_hz", frequency_hz, above=0, at_most=1e12) / 1e9
    cooler = 300 / check_number("temperature_k", temperature_k, at_least=243, at_most=323) - 1
    static = 77.66 + 103.3 * cooler
    first, second = 0.0671 * static, 3.52
    principal_ghz = 20.20 - 146 * cooler + 316 * cooler**2
    slow = (static - first) / (1 - 1j * f_ghz / principal_ghz)
    fast = (first - second) / (1 - 1j * f_ghz / (39.8 * principal_ghz))
    return complex(second + slow + fast)


@elementwise
def water_film_loss(frequency_hz: float, film_m: float, temperature_k: float) -> float:
    r"""Return the one-way power loss of a wave through a film of water at normal incidence.

    .. math::
        L = \left| \frac{1 - r^2 e^{2 i \delta}}{(1 - r^2) e^{i \delta}} \right|^2,
        \quad r = \frac{1 - n}{1 + n}, \quad n = \sqrt{\epsilon},
        \quad \delta = \frac{2 \pi f n d}{c}

    Includes all reflections within the film, with air on both sides; 1 without a film. Holds for
    an even film, not for drops.

    Parameters
    ----------
    frequency_hz, temperature_k : float
        As for `water_relative_permittivity`.
    film_m : float
        Thickness, 0 to 10 mm.

    Raises
    ------
    InvalidSetting
        Beyond these.

    References
    ----------
    M. Born, E. Wolf, Principles of Optics, 7th ed., 1999, 1.6.4 and 14.4.
    """
    n = cmath.sqrt(water_relative_permittivity(frequency_hz, temperature_k))
    r2 = ((1 - n) / (1 + n)) ** 2
    thickness_m = check_number("film_m", film_m, at_least=0, at_most=0.01)
    turn = cmath.exp(2j * math.pi * frequency_hz * n * thickness_m / SPEED_OF_LIGHT)
    return abs((1 - r2 * turn**2) / ((1 - r2) * turn)) ** 2
