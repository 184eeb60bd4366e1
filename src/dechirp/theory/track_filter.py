"""Steady state of a tracking filter, and its gates.

References
----------
P. R. Kalata, The tracking index: a generalized parameter for alpha-beta and alpha-beta-gamma
target trackers, IEEE Trans. AES 20(2), 1984. Y. Bar-Shalom, X. R. Li and T. Kirubarajan,
Estimation with Applications to Tracking and Navigation, 2001.
"""

from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from dechirp.core.checks import check_finite_array, check_integer, check_probabilities
from dechirp.core.elementwise import elementwise

__all__ = ["alpha_beta_gains", "gate_threshold"]


class AlphaBetaGains(NamedTuple):
    """Gains of an alpha-beta filter in its steady state."""

    alpha: np.ndarray
    """Share of the residual that corrects the position."""
    beta: np.ndarray
    """Share of the residual over the interval that corrects the velocity."""


def alpha_beta_gains(tracking_index: ArrayLike) -> AlphaBetaGains:
    r"""Return the steady-state gains of the Kalman filter with white acceleration steps.

    .. math::

        r = \frac{4 + \Lambda - \sqrt{8 \Lambda + \Lambda^2}}{4}, \quad
        \alpha = 1 - r^2, \quad \beta = 2 (2 - \alpha) - 4 \sqrt{1 - \alpha}

    Parameters
    ----------
    tracking_index : array
        Lambda = T^2 sigma_a / sigma_m: the standard deviation of the acceleration, constant over
        an interval T and independent of the next, over that of a measured position; above 0.

    Returns
    -------
    AlphaBetaGains
        Arrays `alpha` and `beta`, in the shape of the index.
    """
    index = check_finite_array("tracking_index", tracking_index, above=0)
    # Expanded by 4 + index + root: the difference itself loses digits of a large index.
    r = 4 / (4 + index + np.sqrt(8 * index + index**2))
    alpha = (1 - r) * (1 + r)
    return AlphaBetaGains(alpha[()], (2 * (1 - r) ** 2)[()])


@elementwise
def gate_threshold(gate_probability: ArrayLike, n_dimensions: int) -> np.ndarray:
    """Return the squared Mahalanobis distance that a true measurement exceeds with 1 - Pg.

    The quantile of chi-square with as many degrees of freedom as the measurement has dimensions:
    9.21 for 0.99 and two. `gate_probability` is Pg, between 0 and 1, of any shape.

    Parameters
    ----------
    gate_probability : array
        Probability Pg that the gate contains a true measurement, between 0 and 1, both excluded.
    n_dimensions : array of int
        Dimensions of the measurement, at least 1.
    """
    probability = check_probabilities("gate_probability", gate_probability)
    check_integer("n_dimensions", n_dimensions, at_least=1)
    return np.asarray(2 * scipy.special.gammaincinv(n_dimensions / 2, probability))
