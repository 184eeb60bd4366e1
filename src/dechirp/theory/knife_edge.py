r"""Diffraction by the edge of a screen that absorbs.

An edge at the height h above the line of sight, at the distances d1 and d2 from its ends, has the
parameter (Rec. ITU-R P.526-15, equation 26)

.. math:: v = h \sqrt{\frac{2}{\lambda} \left(\frac{1}{d_1} + \frac{1}{d_2}\right)}

and the field beyond it, relative to that without it, is (equations 27 to 30)

.. math:: F(v) = \frac{1 + i}{2} \int_v^\infty e^{-i \pi t^2 / 2} dt, \quad
    J(v) = -20 \log_{10} |F(v)|
"""

import numpy as np
import scipy
from numpy.typing import ArrayLike

from dechirp.core.checks import check_finite_array
from dechirp.core.elementwise import scalar_results

__all__ = ["knife_edge_field", "knife_edge_loss_db"]


# Differences of Fresnel integrals from 1/2 keep ten digits here; they fall as 1 / (pi v).
_MAX_PARAMETER = 1e5


@scalar_results
def knife_edge_field(v: ArrayLike) -> np.ndarray:
    """Return the complex field beyond an edge, relative to that without it.

    It is 1 far above the edge (v = -inf), 1/2 on its level, and 0 far below. Valid for distances
    of many wavelengths and small angles of diffraction, and for v between -1e5 and 1e5.

    Parameters
    ----------
    v : array_like
        Parameter of the edge, between -1e5 and 1e5: above 0 if the edge is above the line of sight.
    """
    return np.asarray(
        field_beyond_edge(check_finite_array("v", v, above=-_MAX_PARAMETER, below=_MAX_PARAMETER))
    )


def field_beyond_edge(v: np.ndarray) -> np.ndarray:
    """Return the same without a check, of infinite parameters too, such as at the edge itself."""
    s, c = scipy.special.fresnel(v)
    field: np.ndarray = (0.5 + 0.5j) * ((0.5 - c) - 1j * (0.5 - s))
    return field


@scalar_results
def knife_edge_loss_db(v: ArrayLike) -> np.ndarray:
    """Return the loss J(v) of a single edge, one way, dB; 6.02 dB at v = 0.

    Above v = -0.78, the approximation of P.526, equation 31, is within 0.13 dB of it.

    Parameters
    ----------
    v : array_like
        Parameter of the edge, between -1e5 and 1e5: above 0 if the edge is above the line of sight.
    """
    return np.asarray(-20 * np.log10(abs(knife_edge_field(v))))
