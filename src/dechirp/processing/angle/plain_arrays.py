"""Directions from plain arrays, without a `Radar`."""

from dataclasses import replace
from typing import Literal, cast

import numpy as np
from numpy.typing import ArrayLike

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_finite_array, check_non_negative_ratios
from dechirp.core.errors import InvalidSetting
from dechirp.processing.angle.aperture import Aperture, FieldOfView
from dechirp.processing.angle.base import DirectionEstimator, Directions

__all__ = ["estimate_directions"]


@check_argument_types
def estimate_directions(
    snapshots: ArrayLike,
    positions: ArrayLike,
    n_sources: int | Literal["mdl", "aic"] = 1,
    kind: str | DirectionEstimator = "music",
    *,
    noise_power: ArrayLike | None = None,
    field_of_view: FieldOfView | None = None,
) -> Directions:
    r"""Estimate the directions of the sources of each cell from the amplitudes of an array.

    The response of an element to a far source is :math:`\exp(-2\pi\mathrm{i}\, \mathbf{u} \cdot
    \mathbf{p})`, with u the unit vector to the source (x forward, y left, z up): for elements
    along y, :math:`\exp(-2\pi\mathrm{i}\, p \sin\theta)`. Conjugate snapshots of the opposite sign.

    Parameters
    ----------
    snapshots : array (..., n_snapshots, n_elements) or (n_elements,), complex
        Amplitudes of the elements. Snapshots of a cell have the same sources; leading axes are
        cells.
    positions : array (n_elements,) or (n_elements, 3)
        Positions in wavelengths: along y, positive to the left, or in three dimensions. In a
        virtual array, transmitter plus receiver.
    n_sources : int or "mdl" or "aic"
        Directions in each cell, or the criterion that estimates their number, which requires
        `noise_power`.
    kind : str or DirectionEstimator
        A member of the family by its kind, such as `root-music`, `capon` or `maximum-likelihood`,
        or with its settings, as `dechirp.angle.Capon(loading=0.01)`.
    noise_power : array (...), optional
        Noise power in one element, E|w|^2, of all cells or of each. Without it, standard errors
        are NaN and adaptive beams are loaded with the least that keeps them stable.
    field_of_view : FieldOfView, optional
        Directions that are searched; +-90 degrees of azimuth and +-30 of elevation by default.

    Returns
    -------
    Directions
        `azimuth_rad`, `elevation_rad`, their standard errors and `power`, strongest source first,
        (..., n_sources). An angle that the array does not resolve is NaN, and so are all values of
        a cell of zeros.

    Raises
    ------
    InvalidSetting
        If snapshots are not finite or do not match the positions, elements share one position, the
        sources are too many for the array or the estimator, or a kind is unknown.
    """
    elements = _element_positions(positions)
    amplitudes = _checked_snapshots(snapshots, len(elements))
    cells = amplitudes.shape[:-2]
    if noise_power is None and n_sources in ("mdl", "aic"):
        raise InvalidSetting(
            "noise_power",
            value="missing",
            expected=f"the noise in one element, on which {n_sources} depends",
            fix="give noise_power, or a number of sources",
        )
    noise = check_non_negative_ratios("noise_power", 0.0 if noise_power is None else noise_power)
    try:
        noise = np.broadcast_to(noise, cells)
    except ValueError:
        raise InvalidSetting(
            "noise_power",
            value=f"an array {noise.shape}",
            expected=f"one value, or {cells}: one for each cell",
            fix="give the noise of one element",
        ) from None
    directions = _direction_estimator(kind, n_sources).find_directions(
        amplitudes.reshape(-1, *amplitudes.shape[-2:]),
        Aperture(elements, field_of_view or FieldOfView()),
        np.ravel(noise),
    )
    if noise_power is None:
        directions.azimuth_std_rad.fill(np.nan)
        directions.elevation_std_rad.fill(np.nan)
    return Directions(*(values.reshape(*cells, -1) for values in directions))


def _element_positions(positions: ArrayLike) -> np.ndarray:
    """Return positions (n_elements, 3), or raise `InvalidSetting`."""
    array = check_finite_array("positions", positions)
    if array.ndim == 1 and array.size:
        array = np.stack([np.zeros_like(array), array, np.zeros_like(array)], axis=1)
    if array.ndim != 2 or array.shape[1] != 3 or np.ptp(array[:, 1:], axis=0).max(initial=0) == 0:
        raise InvalidSetting(
            "positions",
            value=f"an array {np.shape(positions)}",
            expected="(n_elements,) or (n_elements, 3), at two or more places across the line of"
            " sight",
            fix="give positions in wavelengths, along y or as rows of x, y and z",
        )
    return array


def _checked_snapshots(snapshots: ArrayLike, n_elements: int) -> np.ndarray:
    """Return snapshots (..., n_snapshots, n_elements), or raise `InvalidSetting`."""
    array = np.asarray(snapshots)
    if array.dtype.kind not in "iufc" or not array.size or array.shape[-1:] != (n_elements,):
        raise InvalidSetting(
            "snapshots",
            value=f"an array {array.shape} of {array.dtype}",
            expected=f"(..., n_snapshots, {n_elements}): a number for each of the positions",
            fix="put the elements on the last axis, and give a position for each",
        )
    if not np.isfinite(array).all():
        raise InvalidSetting(
            "snapshots",
            value=f"{np.count_nonzero(~np.isfinite(array))} values that are not finite",
            expected="finite amplitudes",
            fix="leave those snapshots out",
        )
    return np.atleast_2d(array).astype(complex)


def _direction_estimator(
    kind: str | DirectionEstimator, n_sources: int | Literal["mdl", "aic"]
) -> DirectionEstimator:
    if isinstance(kind, DirectionEstimator):
        return replace(kind, n_sources=n_sources)
    members = DirectionEstimator.members()
    if not isinstance(kind, str) or kind not in members:
        raise InvalidSetting(
            "kind", value=kind, expected=" or ".join(members), fix="choose one of them"
        )
    return cast("DirectionEstimator", members[kind](n_sources=n_sources))
