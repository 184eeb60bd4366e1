"""Cramer-Rao bounds on the directions of several sources, from their powers and correlations.

`direction_bounds` bounds directions for known amplitudes of each snapshot; here the sources are
known by their covariance. With uncorrelated sources, sparse arrays can resolve more sources than
they have elements.
"""

from collections.abc import Iterator
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import (
    SMALLEST_MAGNITUDE,
    check_finite_array,
    check_finite_samples,
    check_integer,
    check_number,
)
from dechirp.core.errors import InvalidSetting
from dechirp.theory.direction_bounds import conditional_fisher_information

__all__ = ["crlb_directions"]

SourceModel = Literal["deterministic", "stochastic", "uncorrelated"]
# Eigenvalues of the scaled information below it are rounding errors, as in `direction_bounds`.
_SINGULAR = 1e-12


@check_argument_types
def crlb_directions(
    positions: ArrayLike,
    azimuth_rad: ArrayLike,
    source_covariance: ArrayLike,
    noise_power: float,
    n_snapshots: int,
    model: SourceModel = "deterministic",
) -> np.ndarray:
    r"""Return the bound on the covariance of the directions of several sources.

    With the steering matrix A, its derivatives by azimuth, and the source covariance P, of the
    snapshots :math:`\mathbf{x} = \mathbf{A s} + \mathbf{w}`:

    .. math::

        F_{ij} = N \, \mathrm{tr}(\mathbf{R}^{-1} \partial_i \mathbf{R}
            \, \mathbf{R}^{-1} \partial_j \mathbf{R}), \quad
        \mathbf{R} = \mathbf{A P A}^\mathsf{H} + \sigma^2 \mathbf{I}

    for random sources (stochastic, uncorrelated), over directions, unknown elements of P and the
    noise power; for unknown constant amplitudes (deterministic), see
    `direction_bounds.conditional_fisher_information`.

    Parameters
    ----------
    positions : array (n_elements,)
        Positions along the y axis in wavelengths; in a virtual array, transmitter plus receiver.
        At y, the steering phase is -2 pi y sin(azimuth), to which complex correlations refer.
    azimuth_rad : array (n_sources,)
        Directions of the sources, between -pi/2 and pi/2.
    source_covariance : array (n_sources, n_sources) or (n_sources,)
        P, in one element; powers if the sources do not correlate.
    noise_power : float
        :math:`\sigma^2`, E|w|^2 in one element.
    n_snapshots : int
        N, independent snapshots.
    model : str
        Amplitudes that are unknown constants (deterministic), random with an unknown covariance
        (stochastic), or random and known to be uncorrelated, which allows more sources than
        elements (uncorrelated).

    Returns
    -------
    array (n_sources, n_sources), rad^2
        Infinite if the array does not resolve the sources.

    Raises
    ------
    InvalidSetting
        If an argument is not finite or has another shape, P is not Hermitian and non-negative, or
        the noise is not above 0.

    References
    ----------
    P. Stoica and A. Nehorai, Performance study of conditional and unconditional direction-of-
    arrival estimation, IEEE Trans. ASSP 38(10), 1990. M. Wang and A. Nehorai, Coarrays, MUSIC, and
    the Cramer-Rao bound, IEEE Trans. Signal Process. 65(4), 2017, for uncorrelated sources.
    """
    elements = _check_line("positions", positions)
    azimuth = _check_line("azimuth_rad", azimuth_rad, above=-np.pi / 2, below=np.pi / 2)
    covariance = _check_source_covariance(source_covariance, len(azimuth))
    noise_power = check_number("noise_power", noise_power, at_least=SMALLEST_MAGNITUDE)
    check_integer("n_snapshots", n_snapshots, at_least=1)
    if model not in get_args(SourceModel):
        raise InvalidSetting(
            "model",
            value=model,
            expected=" or ".join(get_args(SourceModel)),
            fix="choose one of them",
        )
    if model == "uncorrelated" and np.any(covariance != np.diag(np.diag(covariance))):
        raise InvalidSetting(
            "source_covariance",
            value="elements off the diagonal",
            expected="powers alone for uncorrelated sources",
            fix='give powers, or model="stochastic"',
        )
    steering = np.exp(-2j * np.pi * np.outer(elements, np.sin(azimuth)))
    derivatives = -2j * np.pi * np.outer(elements, np.cos(azimuth)) * steering
    if model == "deterministic":
        is_ambiguous = np.linalg.matrix_rank(steering) < len(azimuth)  # such as equal directions
        if len(azimuth) >= len(elements) or is_ambiguous:
            return np.full((len(azimuth), len(azimuth)), np.inf)
        powers, vectors = np.linalg.eigh(covariance)
        amplitudes = vectors * np.sqrt(n_snapshots * np.maximum(powers, 0))
        information = conditional_fisher_information(
            steering, derivatives[..., None], amplitudes, noise_power
        )
        return _invert_information(information)
    mixed = steering @ covariance
    gradients = [
        *(np.outer(derivatives[:, k], mixed[:, k].conj()) for k in range(len(azimuth))),
        *(steering @ change @ steering.conj().T for change in _covariance_changes(model, azimuth)),
        np.eye(len(elements)) / 2,
    ]
    inverse = np.linalg.inv(mixed @ steering.conj().T + noise_power * np.eye(len(elements)))
    # Half of each gradient and its adjoint: R is Hermitian.
    weighted = np.array([inverse @ (half + half.conj().T) for half in gradients])
    information = n_snapshots * np.einsum("iab,jba->ij", weighted, weighted).real
    return _invert_information(information)[: len(azimuth), : len(azimuth)]


def _covariance_changes(model: SourceModel, azimuth: np.ndarray) -> Iterator[np.ndarray]:
    """Yield half the change of P by each of its unknown real parameters."""
    n_sources = len(azimuth)
    for row in range(n_sources):
        for column in range(row + 1):
            change = np.zeros((n_sources, n_sources), complex)
            change[row, column] = 0.5 if row == column else 1.0
            if row == column:
                yield change
            elif model == "stochastic":
                yield from (change, 1j * change)


def _check_line(setting: str, values: ArrayLike, **limits: Any) -> np.ndarray:
    line = check_finite_array(setting, values, **limits)
    if line.ndim != 1:
        raise InvalidSetting(
            setting,
            value=f"an array {line.shape}",
            expected="one number for each element or source",
            fix="give a list of numbers",
        )
    return line


def _check_source_covariance(source_covariance: ArrayLike, n_sources: int) -> np.ndarray:
    covariance = check_finite_samples(
        "source_covariance",
        source_covariance,
        axes=f"({n_sources},) or ({n_sources}, {n_sources})",
        fits=lambda array: array.shape in {(n_sources,), (n_sources, n_sources)},
    ).astype(complex)
    if covariance.ndim == 1:
        covariance = np.diag(covariance)
    largest = np.abs(covariance).max()
    is_hermitian = np.abs(covariance - covariance.conj().T).max() <= 1e-9 * largest
    if not is_hermitian or np.linalg.eigvalsh(covariance).min() < -1e-9 * largest:
        raise InvalidSetting(
            "source_covariance",
            value="a matrix that is no covariance",
            expected="Hermitian and non-negative",
            fix="give E[s s^H], or the powers of sources that do not correlate",
        )
    return covariance


def _invert_information(information: np.ndarray) -> np.ndarray:
    """Return the inverse of a Fisher information, infinite if it is singular.

    Rows are scaled to a unit diagonal first, since directions and powers differ in size.
    """
    scale = np.sqrt(np.diagonal(information))
    if not np.all(scale > 0):
        return np.full_like(information, np.inf)
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    if values.min() < _SINGULAR:
        return np.full_like(information, np.inf)
    return np.asarray((vectors / values) @ vectors.T / np.outer(scale, scale))
