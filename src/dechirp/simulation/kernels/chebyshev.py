"""Economisation of power series by dropping high Chebyshev polynomials (Lanczos 1956)."""

import math

import numpy as np
from numpy.polynomial import Polynomial, chebyshev


def economised_monomials_and_rms_errors(
    n_kept: int, n_powers: int
) -> tuple[np.ndarray, np.ndarray]:
    """Express powers of s, from -1 to 1, by the first `n_kept` powers.

    Returns coefficients of the retained powers for each power, (n_kept, n_powers), and the root
    mean
    square over s of each remainder, (n_powers,).
    """
    retained, dropped = np.zeros((n_kept, n_powers)), np.zeros(n_powers)
    for power in range(n_powers):
        monomial = Polynomial.basis(power)
        economised = Polynomial(chebyshev.cheb2poly(chebyshev.poly2cheb(monomial.coef)[:n_kept]))
        retained[: len(economised), power] = economised.coef
        square = ((monomial - economised) ** 2).integ()
        dropped[power] = math.sqrt(max((square(1) - square(-1)) / 2, 0))
    return retained, dropped
