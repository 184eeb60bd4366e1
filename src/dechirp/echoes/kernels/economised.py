"""Powers of s from -1 to 1 in fewer of them: high Chebyshev polynomials dropped (Lanczos 1956)."""

import math

import numpy as np
from numpy.polynomial import Polynomial, chebyshev


def economised(n_kept: int, n_powers: int) -> tuple[np.ndarray, np.ndarray]:
    """How each power is kept in the first `n_kept`, and what is dropped of it.

    (n_kept, n_powers): coefficients of the kept powers in each power; and (n_powers,): root
    mean square over s of what is dropped.
    """
    kept, dropped = np.zeros((n_kept, n_powers)), np.zeros(n_powers)
    for power in range(n_powers):
        whole = Polynomial.basis(power)
        low = Polynomial(chebyshev.cheb2poly(chebyshev.poly2cheb(whole.coef)[:n_kept]))
        kept[: len(low), power] = low.coef
        square = ((whole - low) ** 2).integ()
        dropped[power] = math.sqrt(max((square(1) - square(-1)) / 2, 0))
    return kept, dropped
