"""Radar cross section of a sphere of any size, by the Mie series."""

import numpy as np
import scipy
from numpy.typing import ArrayLike

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_number, check_positive_ratios
from dechirp.core.elementwise import scalar_results
from dechirp.core.errors import InvalidSetting

__all__ = ["sphere_rcs_m2"]

# The number of terms grows with the sphere; the functions of the series stay finite up to here.
_MAX_SIZE_PARAMETER = 500.0


@check_argument_types
@scalar_results
def sphere_rcs_m2(
    radius_m: ArrayLike, wavelength_m: float, *, permittivity: complex | None = None
) -> np.ndarray:
    r"""Return the monostatic radar cross section of spheres, at any polarisation.

    .. math::
        \sigma = \frac{\lambda^2}{4\pi}
        \left| \sum_{n=1}^{N} (-1)^n (2n + 1) (a_n - b_n) \right|^2

    with Mie's coefficients from the logarithmic derivative of psi_n(m x), x the circumference
    over the wavelength, m the refractive index, and N = x + 4 x^(1/3) + 8 terms: right to 1e-9
    for x from 0.01 to 100.

    Parameters
    ----------
    radius_m : array, m
        Of any shape; the circumference is 500 wavelengths at most.
    wavelength_m : float
    permittivity : complex, optional
        Relative, with a non-negative imaginary part; None for a perfect conductor.

    Returns
    -------
    array, m^2
        The shape of the radius.

    Raises
    ------
    InvalidSetting
        Beyond these.

    References
    ----------
    C. F. Bohren, D. R. Huffman, Absorption and Scattering of Light by Small Particles, 1983,
    4.8.
    """
    radii_m = check_positive_ratios("radius_m", radius_m)
    wavelength_m = check_number("wavelength_m", wavelength_m, at_least=1e-30, at_most=1e30)
    x = (2 * np.pi * radii_m / wavelength_m).ravel()
    if x.size and x.max() > _MAX_SIZE_PARAMETER:
        raise InvalidSetting(
            "radius_m",
            value=f"{radii_m.max():g} m, {x.max():.4g} wavelengths around",
            expected=f"at most {_MAX_SIZE_PARAMETER:g} wavelengths around",
            fix="use pi r^2, which holds for a large metal sphere",
        )
    if permittivity is not None and not (np.isfinite(permittivity) and permittivity.imag >= 0):
        raise InvalidSetting(
            "permittivity",
            value=permittivity,
            expected="a finite number, its imaginary part 0 or more",
            fix="change the sign of the imaginary part: losses are positive",
        )
    needed = x + 4 * np.cbrt(x) + 8
    n_terms = int(needed.max(initial=1))
    orders = np.arange(n_terms + 1)[:, None]
    n = orders[1:]
    psi = x * scipy.special.spherical_jn(orders, x)

    def coefficient(slope: np.ndarray) -> np.ndarray:
        return (slope * psi[1:] - psi[:-1]) / (slope * xi[1:] - xi[:-1])

    # Terms beyond those of small spheres are infinite over infinite.
    with np.errstate(invalid="ignore", over="ignore"):
        xi = psi + 1j * x * scipy.special.spherical_yn(orders, x)
        if permittivity is None:
            difference = coefficient(n / x) - psi[1:] / xi[1:]
        else:
            index = np.sqrt(complex(permittivity))
            inner = _riccati_bessel_log_derivatives(index * x, n_terms)
            difference = coefficient(inner / index + n / x) - coefficient(inner * index + n / x)
    terms = np.where(n <= needed, (-1.0) ** n * (2 * n + 1) * difference, 0)
    sums = abs(terms.sum(axis=0)) ** 2
    return np.asarray(wavelength_m**2 / (4 * np.pi) * sums).reshape(radii_m.shape)


def _riccati_bessel_log_derivatives(z: np.ndarray, n_terms: int) -> np.ndarray:
    """Return psi_n'(z) / psi_n(z) for n = 1 to n_terms, (n_terms, n_spheres), from above."""
    derivatives = np.zeros((n_terms + 1, *z.shape), dtype=complex)
    derivative = np.zeros_like(z)
    max_size = abs(z).max(initial=0.0)
    # Beyond |z|, errors of the initial value, zero, shrink with each step.
    first = int(max(n_terms, max_size) + 8 * np.cbrt(max_size)) + 20
    for n in range(first, 0, -1):
        derivative = n / z - 1 / (derivative + n / z)
        if n - 1 <= n_terms:
            derivatives[n - 1] = derivative
    return derivatives[1:]
