"""NEES: the normalised estimation error squared, a test of filter consistency."""

import numpy as np
import scipy
from numpy.typing import ArrayLike

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_finite_array, check_integer, check_probability
from dechirp.core.errors import InvalidSetting


@check_argument_types
def nees(error: ArrayLike, covariance: ArrayLike) -> np.ndarray:
    """Compute the normalised estimation error squared, e' P^-1 e.

    Its mean is the number of states n if the filter is consistent, chi-square of n degrees for
    Gaussian errors; larger: the filter underestimates its errors.

    Parameters
    ----------
    error : array (..., n)
        Estimate minus truth.
    covariance : array (..., n, n)
        Covariance of the filter, positive definite; one matrix serves all errors.

    Returns
    -------
    array (...)

    Raises
    ------
    InvalidSetting
        If shapes do not match, numbers are not finite, or a matrix is not positive definite.

    References
    ----------
    Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and
    Navigation, Wiley, 2001, 5.4.
    """
    errors, spreads = (
        check_finite_array("error", error),
        check_finite_array("covariance", covariance),
    )
    if spreads.shape not in {(*errors.shape, *errors.shape[-1:]), 2 * errors.shape[-1:]}:
        raise InvalidSetting(
            "covariance",
            value=f"of shape {spreads.shape}, for errors of shape {errors.shape}",
            expected="an n by n matrix for each error of n states, or one for all",
            fix="give (..., n, n) or (n, n) for (..., n)",
        )
    try:
        root = np.linalg.cholesky(spreads)
    except np.linalg.LinAlgError:
        raise InvalidSetting(
            "covariance",
            value="indefinite or singular",
            expected="positive definite",
            fix="leave out states that are known exactly, and correct its computation",
        ) from None
    whitened = np.linalg.solve(root, errors[..., None])[..., 0]
    return np.sum(whitened**2, axis=-1)


@check_argument_types
def mean_nees_interval(
    n_states: int, n_independent: int, *, outside_probability: float
) -> tuple[float, float]:
    """Return the two-sided interval of the mean NEES of a consistent filter.

    The mean is over `n_independent` independent errors: of different runs or targets, not of
    successive frames.

    Parameters
    ----------
    n_states : int
        Components of the state, at least 1.
    n_independent : int
        Independent errors in the mean, at least 1.
    outside_probability : float
        Probability that a consistent filter is outside, half of it at each end, in (0, 1).
    """
    check_integer("n_states", n_states, at_least=1)
    check_integer("n_independent", n_independent, at_least=1)
    check_probability("outside_probability", outside_probability)
    degrees = n_states * n_independent
    low, high = (
        scipy.special.chdtri(degrees, 1 - outside_probability / 2),
        scipy.special.chdtri(degrees, outside_probability / 2),
    )
    return float(low / n_independent), float(high / n_independent)
