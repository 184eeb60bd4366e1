"""NEES: whether a filter's errors are as large as it says."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtri

from dechirp.core.checks import numbers, probability, whole
from dechirp.core.errors import InvalidSetting


def nees(error: ArrayLike, covariance: ArrayLike) -> np.ndarray:
    r"""Normalised estimation error squared, e' P^-1 e.

    Its mean is the number of states n where the filter is consistent, chi-square of n degrees
    where errors are Gaussian; larger: the filter is too sure.

    Parameters
    ----------
    error : array (..., n)
        Estimate less truth.
    covariance : array (..., n, n)
        As the filter says, positive definite.

    Returns
    -------
    array (...)

    Raises
    ------
    InvalidSetting
        If shapes do not fit, numbers are not finite, or a matrix is not positive definite.

    References
    ----------
    Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and
    Navigation, Wiley, 2001, 5.4.
    """
    errors, spreads = numbers("error", error), numbers("covariance", covariance)
    if spreads.shape != (*errors.shape, *errors.shape[-1:]):
        raise InvalidSetting(
            "covariance",
            got=f"of shape {spreads.shape}, for errors of shape {errors.shape}",
            need="an n by n matrix for each error of n states",
            fix="Give (..., n, n) for (..., n).",
        )
    try:
        root = np.linalg.cholesky(spreads)
    except np.linalg.LinAlgError:
        raise InvalidSetting(
            "covariance",
            got="without a sign, or singular",
            need="positive definite",
            fix="Leave out states that are known exactly, and mend what made it.",
        ) from None
    whitened = np.linalg.solve(root, errors[..., None])[..., 0]
    return np.sum(whitened**2, axis=-1)


def mean_nees_interval(
    n_states: int, n_independent: int, *, outside_probability: float
) -> tuple[float, float]:
    """Where the mean NEES of a consistent filter lies, but for a probability on both sides.

    `n_independent` errors are averaged that do not depend on each other: of as many runs, or of
    other targets, not of frames that follow each other.
    """
    whole("n_states", n_states, at_least=1)
    whole("n_independent", n_independent, at_least=1)
    probability("outside_probability", outside_probability)
    degrees = n_states * n_independent
    low, high = (
        chdtri(degrees, 1 - outside_probability / 2),
        chdtri(degrees, outside_probability / 2),
    )
    return float(low / n_independent), float(high / n_independent)
