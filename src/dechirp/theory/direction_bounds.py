"""Directions of several sources: unit vectors, their slopes, and the Cramer-Rao bound.

The bound is the conditional one: amplitudes are unknown numbers, not random ones, so it holds
for one snapshot as well as for many.
"""

import numpy as np
from numpy.typing import ArrayLike

from dechirp.core.checks import numbers, positive_ratios
from dechirp.core.errors import InvalidSetting


def towards(azimuth_rad: ArrayLike, elevation_rad: ArrayLike = 0.0) -> np.ndarray:
    """Unit vectors to directions, (..., 3): forward, left, up."""
    azimuth, elevation = _together(azimuth_rad, elevation_rad)
    level = np.cos(elevation)
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=-1)


def slopes(azimuth_rad: ArrayLike, elevation_rad: ArrayLike = 0.0) -> np.ndarray:
    """Derivatives of `towards` by azimuth and by elevation, (..., 2, 3), each per rad."""
    azimuth, elevation = _together(azimuth_rad, elevation_rad)
    level, rise = np.cos(elevation), np.sin(elevation)
    forward, left = np.cos(azimuth), np.sin(azimuth)
    by_azimuth = np.stack([-level * left, level * forward, np.zeros_like(level)], axis=-1)
    by_elevation = np.stack([-rise * forward, -rise * left, level], axis=-1)
    return np.stack([by_azimuth, by_elevation], axis=-2)


def conditional_information(
    steering: np.ndarray,
    derivatives: np.ndarray,
    amplitudes: np.ndarray,
    noise_power: ArrayLike,
) -> np.ndarray:
    r"""Fisher information on the parameters of the sources, amplitudes being unknown.

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
    amplitudes : array (..., n_sources, n_looks), complex
        Of each source in each look, with one element.
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
    across = flat - basis @ (_adjoint(basis) @ flat)
    of_parameter = np.repeat(amplitudes, n_parameters, axis=-2)
    inner = (_adjoint(across) @ across) * (of_parameter @ _adjoint(of_parameter)).conj()
    return np.asarray(2 * inner.real / np.asarray(noise_power, float)[..., None, None])


def direction_std_rad(
    *,
    positions: ArrayLike,
    azimuth_rad: ArrayLike,
    elevation_rad: ArrayLike = 0.0,
    amplitudes: ArrayLike,
    noise_power: float,
    tells: tuple[bool, bool] = (True, False),
) -> np.ndarray:
    """Bound on the standard deviations of the directions of several sources.

    Parameters
    ----------
    positions : array (n_elements, 3)
        In wavelengths, anywhere; of a virtual array, transmitter plus receiver.
    azimuth_rad, elevation_rad : arrays (n_sources,)
        Of the sources; one number where they share it.
    amplitudes : array (n_sources,) or (n_sources, n_looks), complex
        In one element; looks are snapshots of the same directions.
    noise_power : float
        E|w|^2 in one element.
    tells : (bool, bool)
        Whether azimuth and elevation are unknown. The other one is known.

    Returns
    -------
    array (n_sources, 2), rad
        Of azimuth and elevation; 0 for what is known. Infinite where the elements, or too
        many sources for them, do not tell what is unknown.

    Raises
    ------
    InvalidSetting
        If a number is not finite, positions are no rows of three, or the noise is not above 0.

    References
    ----------
    See `conditional_information`; for one source on a line it is `bounds.angle_std_rad`.
    """
    at = numbers("positions", positions)
    if at.ndim != 2 or at.shape[1] != 3:
        raise InvalidSetting(
            "positions",
            got=f"an array {at.shape}",
            need="a row (x, y, z) for each element",
            fix="Give where each element is, in wavelengths.",
        )
    azimuth, elevation = _together(
        np.atleast_1d(numbers("azimuth_rad", azimuth_rad)), numbers("elevation_rad", elevation_rad)
    )
    positive_ratios("noise_power", noise_power)
    looks = np.asarray(amplitudes, complex).reshape(len(azimuth), -1)
    steering = np.exp(-2j * np.pi * (towards(azimuth, elevation) @ at.T))
    turns = np.moveaxis(slopes(azimuth, elevation)[:, list(tells)] @ at.T, -1, 0)
    information = conditional_information(
        steering.T, -2j * np.pi * turns * steering.T[..., None], looks, noise_power
    )
    out = np.zeros((len(azimuth), 2))
    out[:, list(tells)] = np.sqrt(variances(information)).reshape(len(azimuth), -1)
    return out


def variances(information: np.ndarray) -> np.ndarray:
    """Diagonals of inverses, (..., n) of (..., n, n); infinite where there is none.

    Rows are scaled to a unit diagonal first, so that neither units nor strengths of sources
    decide what counts as singular.
    """
    scale = np.sqrt(np.diagonal(information, axis1=-2, axis2=-1))
    outer = scale[..., :, None] * scale[..., None, :]
    with np.errstate(divide="ignore", invalid="ignore"):
        scaled = np.where(outer > 0, information / outer, np.eye(scale.shape[-1]))
        values, vectors = np.linalg.eigh(scaled)
        # Rounding of a singular matrix; what is told a million times worse is not told.
        inverse = np.where(values > 1e-12, 1 / values, np.inf)
        parts = np.where(vectors**2 > 1e-24, vectors**2 * inverse[..., None, :], 0.0)
        return np.asarray(np.where(scale > 0, parts.sum(axis=-1) / scale**2, np.inf))


def _together(azimuth_rad: ArrayLike, elevation_rad: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    azimuth, elevation = np.broadcast_arrays(
        np.asarray(azimuth_rad, float), np.asarray(elevation_rad, float)
    )
    return azimuth, elevation


def _adjoint(matrix: np.ndarray) -> np.ndarray:
    return np.swapaxes(matrix, -1, -2).conj()
