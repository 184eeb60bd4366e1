"""Snapshots that have a given covariance, for the estimators of directions."""

import numpy as np
from numpy.typing import ArrayLike

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_finite_samples, check_integer
from dechirp.core.errors import InvalidSetting
from dechirp.core.memory import check_free_memory

__all__ = ["snapshots_from_covariance"]

# Of the largest element or eigenvalue: rounding errors of single precision.
_ROUNDING = 1e-5


@check_argument_types
def snapshots_from_covariance(
    covariance: ArrayLike, *, n_snapshots: int | None = None
) -> np.ndarray:
    r"""Compute snapshots whose sample covariance equals a given covariance matrix.

    .. math:: x_k = \sqrt{N \lambda_k}\, v_k, \quad
        \frac{1}{N} \sum_{k=1}^{N} x_k x_k^{\mathrm{H}} = R = V \Lambda V^{\mathrm{H}}

    with the eigenvalues and eigenvectors of R, and zeros from the n-th snapshot on. Estimators
    that depend on the covariance of snapshots alone give the same result as with the snapshots
    that the covariance was estimated from.

    Parameters
    ----------
    covariance : array (..., n_elements, n_elements)
        R, the mean of :math:`x x^{\mathrm{H}}`: Hermitian and non-negative, also of lower rank, as
        from few snapshots.
    n_snapshots : int, optional
        N, the number of snapshots that R was estimated from, on which `n_sources="mdl"` and
        standard errors depend; at least the rank of R. n_elements by default.

    Returns
    -------
    array (..., n_snapshots, n_elements), complex

    Raises
    ------
    InvalidSetting
        If R is not finite, not square, not Hermitian or negative in a direction, or has a higher
        rank than N.
    """
    matrices = check_finite_samples(
        "covariance",
        covariance,
        axes="(..., n_elements, n_elements)",
        fits=lambda array: array.ndim > 1 and array.shape[-1] == array.shape[-2],
    ).astype(complex)
    n_elements = matrices.shape[-1]
    if n_snapshots is None:
        n_snapshots = n_elements
    check_integer("n_snapshots", n_snapshots, at_least=1)
    adjoint = matrices.swapaxes(-1, -2).conj()
    largest = abs(matrices).max(axis=(-1, -2), keepdims=True)
    powers, vectors = np.linalg.eigh((matrices + adjoint) / 2)
    rounding = _ROUNDING * largest[..., 0]
    if np.any(abs(matrices - adjoint) > _ROUNDING * largest) or np.any(powers < -rounding):
        raise InvalidSetting(
            "covariance",
            value="a matrix that is no covariance",
            expected="Hermitian and non-negative",
            fix="give the mean of x x^H over the snapshots x",
        )
    n_used = min(n_snapshots, n_elements)
    if np.any(powers[..., : n_elements - n_used] > rounding):
        raise InvalidSetting(
            "n_snapshots",
            value=n_snapshots,
            expected=f"at least {np.count_nonzero(powers > rounding, axis=-1).max()}, the rank of"
            " the covariance",
            fix="give the number of snapshots that the covariance was estimated from",
        )
    check_free_memory(
        f"n_snapshots={n_snapshots} for each covariance",
        needed_bytes=16.0 * n_snapshots * matrices.size / n_elements,
        fix="give fewer covariances at once, or fewer snapshots",
    )
    strongest = slice(n_elements - n_used, n_elements)
    amplitudes = np.sqrt(n_snapshots * np.maximum(powers[..., strongest], 0))
    snapshots = np.zeros((*matrices.shape[:-2], n_snapshots, n_elements), complex)
    snapshots[..., :n_used, :] = (vectors[..., strongest] * amplitudes[..., None, :]).swapaxes(
        -1, -2
    )
    return snapshots
