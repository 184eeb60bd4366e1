"""Cramer-Rao bound on the directions of several sources, with unit vectors and derivatives.

The bound is the conditional one: amplitudes are unknown constants, not random, so it holds for
one snapshot as well as for many.
"""

import numpy as np
from numpy.typing import ArrayLike

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import (
    SMALLEST_MAGNITUDE,
    broadcast_arguments,
    check_finite_array,
    check_finite_samples,
    check_number,
)
from dechirp.core.errors import InvalidSetting

__all__ = ["direction_std_rad"]


def unit_vectors(azimuth_rad: ArrayLike, elevation_rad: ArrayLike = 0.0) -> np.ndarray:
    """Return unit vectors to directions, (..., 3): forward, left, up."""
    azimuth, elevation = _broadcast_angles(azimuth_rad, elevation_rad)
    level = np.cos(elevation)
    vectors = np.empty((*level.shape, 3))  # np.stack takes 6 us more, three times in derivatives
    vectors[..., 0] = level * np.cos(azimuth)
    vectors[..., 1] = level * np.sin(azimuth)
    vectors[..., 2] = np.sin(elevation)
    return vectors


def unit_vector_derivatives(azimuth_rad: ArrayLike, elevation_rad: ArrayLike = 0.0) -> np.ndarray:
    """Return derivatives of `unit_vectors` by azimuth and elevation, (..., 2, 3), per rad."""
    azimuth, elevation = _broadcast_angles(azimuth_rad, elevation_rad)
    level, rise = np.cos(elevation), np.sin(elevation)
    forward, sideways = np.cos(azimuth), np.sin(azimuth)
    derivatives = np.zeros((*level.shape, 2, 3))
    derivatives[..., 0, 0] = -level * sideways
    derivatives[..., 0, 1] = level * forward
    derivatives[..., 1, 0] = -rise * forward
    derivatives[..., 1, 1] = -rise * sideways
    derivatives[..., 1, 2] = level
    return derivatives


def conditional_fisher_information(
    steering: np.ndarray,
    derivatives: np.ndarray,
    amplitudes: np.ndarray,
    noise_power: ArrayLike,
) -> np.ndarray:
    r"""Return the Fisher information on the parameters of sources with unknown amplitudes.

    .. math::

        F = \frac{2}{\sigma^2} \mathrm{Re} \sum_l
            X_l^\mathsf{H} D^\mathsf{H} P_A^\perp D X_l

    with X_l the amplitude of its source for each parameter.

    Parameters
    ----------
    steering : array (..., n_elements, n_sources), complex
        A, a column for each source.
    derivatives : array (..., n_elements, n_sources, n_parameters), complex
        D, of each column by each parameter of its source, such as azimuth and elevation.
    amplitudes : array (..., n_sources, n_snapshots), complex
        Amplitude of each source in each snapshot in one element.
    noise_power : array (...)
        Sigma squared, E|w|^2 in one element.

    Returns
    -------
    array (..., n_sources x n_parameters, the same)
        Parameters of one source side by side. Its inverse bounds the covariance.

    References
    ----------
    P. Stoica and A. Nehorai, MUSIC, maximum likelihood, and Cramer-Rao bound, IEEE Trans.
    ASSP 37(5), 1989.
    """
    n_sources, n_parameters = derivatives.shape[-2:]
    basis = np.linalg.qr(steering)[0]
    flat = derivatives.reshape(*derivatives.shape[:-2], n_sources * n_parameters)
    projected = flat - basis @ (_adjoint(basis) @ flat)
    parameter_amplitudes = np.repeat(amplitudes, n_parameters, axis=-2)
    inner = (_adjoint(projected) @ projected) * (
        parameter_amplitudes @ _adjoint(parameter_amplitudes)
    ).conj()
    return np.asarray(2 * inner.real / np.asarray(noise_power, float)[..., None, None])


@check_argument_types
def direction_std_rad(
    *,
    positions: ArrayLike,
    azimuth_rad: ArrayLike,
    elevation_rad: ArrayLike = 0.0,
    amplitudes: ArrayLike,
    noise_power: float,
    unknown: tuple[bool, bool] = (True, False),
) -> np.ndarray:
    """Return the bound on the standard deviations of the directions of several sources.

    Parameters
    ----------
    positions : array (n_elements, 3)
        Positions in wavelengths; in a virtual array, transmitter plus receiver.
    azimuth_rad, elevation_rad : arrays (n_sources,)
        Directions of the sources; one number if they share it.
    amplitudes : array (n_sources,) or (n_sources, n_snapshots), complex
        Of each source in one element, for each snapshot.
    noise_power : float
        E|w|^2 in one element.
    unknown : (bool, bool)
        Flags for azimuth and elevation: unknown parameters are estimated, others known.

    Returns
    -------
    array (n_sources, 2), rad
        Of azimuth and elevation; 0 for known ones. Infinite if the elements cannot resolve
        them, or the sources are too many.

    Raises
    ------
    InvalidSetting
        If a number is not finite, positions are not rows of three, or the noise is not above 0.

    References
    ----------
    See `conditional_fisher_information`; for one source on a line it is `bounds.crlb_angle`.
    """
    element_positions = check_finite_array("positions", positions)
    if element_positions.ndim != 2 or element_positions.shape[1] != 3:
        raise InvalidSetting(
            "positions",
            value=f"an array {element_positions.shape}",
            expected="a row (x, y, z) for each element",
            fix="give the position of each element, in wavelengths",
        )
    azimuth, elevation = broadcast_arguments(
        azimuth_rad=np.atleast_1d(check_finite_array("azimuth_rad", azimuth_rad)),
        elevation_rad=check_finite_array("elevation_rad", elevation_rad),
    )
    if azimuth.ndim > 1:
        raise InvalidSetting(
            "azimuth_rad and elevation_rad",
            value=f"directions over {azimuth.shape}",
            expected="(n_sources,)",
            fix="give one row of directions",
        )
    check_number("noise_power", noise_power, at_least=SMALLEST_MAGNITUDE)
    snapshots = check_finite_samples(
        "amplitudes",
        amplitudes,
        axes=f"({len(azimuth)},) or ({len(azimuth)}, n_snapshots)",
        fits=lambda array: array.shape[:1] in {(), (len(azimuth),)},
    )
    snapshots = snapshots.astype(complex).reshape(len(azimuth), -1)
    steering = np.exp(-2j * np.pi * (unit_vectors(azimuth, elevation) @ element_positions.T))
    phase_derivatives = np.moveaxis(
        unit_vector_derivatives(azimuth, elevation)[:, list(unknown)] @ element_positions.T, -1, 0
    )
    information = conditional_fisher_information(
        steering.T, -2j * np.pi * phase_derivatives * steering.T[..., None], snapshots, noise_power
    )
    out = np.zeros((len(azimuth), 2))
    out[:, list(unknown)] = np.sqrt(crlb_variances(information)).reshape(len(azimuth), -1)
    return out


def crlb_variances(fisher_information: np.ndarray) -> np.ndarray:
    """Return the diagonals of the inverses, (..., n) from (..., n, n); infinite if singular.

    Rows are scaled to a unit diagonal first, so that neither units nor source powers affect
    the test for singularity.
    """
    scale = np.sqrt(np.diagonal(fisher_information, axis1=-2, axis2=-1))
    outer = scale[..., :, None] * scale[..., None, :]
    with np.errstate(divide="ignore", invalid="ignore"):
        scaled = np.where(outer > 0, fisher_information / outer, np.eye(scale.shape[-1]))
        values, vectors = np.linalg.eigh(scaled)
        # Smaller eigenvalues are rounding errors: a million times worse counts as unresolved.
        inverse = np.where(values > 1e-12, 1 / values, np.inf)
        parts = np.where(vectors**2 > 1e-24, vectors**2 * inverse[..., None, :], 0.0)
        return np.asarray(np.where(scale > 0, parts.sum(axis=-1) / scale**2, np.inf))


def _broadcast_angles(
    azimuth_rad: ArrayLike, elevation_rad: ArrayLike
) -> tuple[np.ndarray, np.ndarray]:
    azimuth, elevation = np.broadcast_arrays(
        np.asarray(azimuth_rad, float), np.asarray(elevation_rad, float)
    )
    return azimuth, elevation


def _adjoint(matrix: np.ndarray) -> np.ndarray:
    return np.swapaxes(matrix, -1, -2).conj()
