"""Directions from plain arrays, without a `Radar`: nine estimators, and spectra over directions."""

import math
from dataclasses import replace
from typing import Literal, NamedTuple, TypedDict, Unpack, cast

import numpy as np
from numpy.typing import ArrayLike

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import (
    broadcast_arguments,
    check_axes,
    check_finite_array,
    check_finite_samples,
    check_non_negative_ratios,
)
from dechirp.core.compiled_kernels import SAMPLES_PER_AMPLITUDE, plain_twins_in_first_calls
from dechirp.core.elementwise import scalar_results
from dechirp.core.errors import InvalidSetting
from dechirp.core.memory import check_free_memory
from dechirp.processing.angle.aperture import MIN_EXTENT, Aperture, FieldOfView
from dechirp.processing.angle.base import DirectionEstimator, Directions, SpectralEstimator
from dechirp.processing.angle.music import Music

__all__ = [
    "bartlett",
    "capon",
    "direction_spectrum",
    "esprit",
    "estimate_directions",
    "fft",
    "iterative_adaptive",
    "maximum_likelihood",
    "monopulse",
    "music",
    "root_music",
]

# Measured peaks: the least of all estimators.
_BYTES_PER_STEERING_VALUE, _BYTES_PER_SPECTRUM_VALUE = 40, 16
# Wavelengths; eight directions are searched in each beam, and a longer array has more of them.
_MAX_POSITION = 1e5

NumberOfSources = int | Literal["mdl", "aic"]


class _Options(TypedDict, total=False):
    axis: int
    noise_power: ArrayLike | None
    field_of_view: FieldOfView | None


@check_argument_types
def bartlett(
    snapshots: ArrayLike,
    positions: ArrayLike,
    n_sources: NumberOfSources = 1,
    **options: Unpack[_Options],
) -> Directions:
    """Find the highest powers in beams (Bartlett).

    Result and errors as of `estimate_directions`.

    Parameters
    ----------
    snapshots : array (..., n_snapshots, n_elements) or (n_elements,), complex
        Amplitudes of the elements; leading axes are cells.
    positions : array (n_elements,) or (n_elements, 3)
        In wavelengths: along y, positive to the left, or in three dimensions.
    n_sources : int or "mdl" or "aic"
        Directions in each cell, or the criterion that estimates their number, which requires
        `noise_power`.
    axis : int
        Axis of the elements, the last by default.
    noise_power : array (...), optional
        Noise power in one element, E|w|^2, of all cells or of each.
    field_of_view : FieldOfView, optional
        Directions that are searched; by default +-90 degrees of azimuth and +-30 of elevation.
    """
    return estimate_directions(snapshots, positions, n_sources, "bartlett", **options)


@check_argument_types
def capon(
    snapshots: ArrayLike,
    positions: ArrayLike,
    n_sources: NumberOfSources = 1,
    **options: Unpack[_Options],
) -> Directions:
    """Find the highest powers of beams with least interference (Capon, MVDR).

    Result and errors as of `estimate_directions`.

    Parameters
    ----------
    snapshots : array (..., n_snapshots, n_elements) or (n_elements,), complex
        Amplitudes of the elements; leading axes are cells.
    positions : array (n_elements,) or (n_elements, 3)
        In wavelengths: along y, positive to the left, or in three dimensions.
    n_sources : int or "mdl" or "aic"
        Directions in each cell, or the criterion that estimates their number, which requires
        `noise_power`.
    axis : int
        Axis of the elements, the last by default.
    noise_power : array (...), optional
        Noise power in one element, E|w|^2, of all cells or of each.
    field_of_view : FieldOfView, optional
        Directions that are searched; by default +-90 degrees of azimuth and +-30 of elevation.
    """
    return estimate_directions(snapshots, positions, n_sources, "capon", **options)


@check_argument_types
def esprit(
    snapshots: ArrayLike,
    positions: ArrayLike,
    n_sources: NumberOfSources = 1,
    **options: Unpack[_Options],
) -> Directions:
    """Find directions by rotational invariance (ESPRIT), on uniform linear arrays.

    Result and errors as of `estimate_directions`.

    Parameters
    ----------
    snapshots : array (..., n_snapshots, n_elements) or (n_elements,), complex
        Amplitudes of the elements; leading axes are cells.
    positions : array (n_elements,) or (n_elements, 3)
        In wavelengths, equally spaced on a line: along y, positive to the left, or in three
        dimensions.
    n_sources : int or "mdl" or "aic"
        Directions in each cell, or the criterion that estimates their number, which requires
        `noise_power`.
    axis : int
        Axis of the elements, the last by default.
    noise_power : array (...), optional
        Noise power in one element, E|w|^2, of all cells or of each.
    field_of_view : FieldOfView, optional
        Directions that are searched; by default +-90 degrees of azimuth and +-30 of elevation.
    """
    return estimate_directions(snapshots, positions, n_sources, "esprit", **options)


@check_argument_types
def fft(
    snapshots: ArrayLike,
    positions: ArrayLike,
    n_sources: NumberOfSources = 1,
    **options: Unpack[_Options],
) -> Directions:
    """Find the highest powers in beams by an FFT over the elements.

    Result and errors as of `estimate_directions`.

    Parameters
    ----------
    snapshots : array (..., n_snapshots, n_elements) or (n_elements,), complex
        Amplitudes of the elements; leading axes are cells.
    positions : array (n_elements,) or (n_elements, 3)
        In wavelengths: along y, positive to the left, or in three dimensions.
    n_sources : int or "mdl" or "aic"
        Directions in each cell, or the criterion that estimates their number, which requires
        `noise_power`.
    axis : int
        Axis of the elements, the last by default.
    noise_power : array (...), optional
        Noise power in one element, E|w|^2, of all cells or of each.
    field_of_view : FieldOfView, optional
        Directions that are searched; by default +-90 degrees of azimuth and +-30 of elevation.
    """
    return estimate_directions(snapshots, positions, n_sources, "fft", **options)


@check_argument_types
def iterative_adaptive(
    snapshots: ArrayLike,
    positions: ArrayLike,
    n_sources: NumberOfSources = 1,
    **options: Unpack[_Options],
) -> Directions:
    """Find directions by the iterative adaptive approach (IAA).

    Result and errors as of `estimate_directions`.

    Parameters
    ----------
    snapshots : array (..., n_snapshots, n_elements) or (n_elements,), complex
        Amplitudes of the elements; leading axes are cells.
    positions : array (n_elements,) or (n_elements, 3)
        In wavelengths: along y, positive to the left, or in three dimensions.
    n_sources : int or "mdl" or "aic"
        Directions in each cell, or the criterion that estimates their number, which requires
        `noise_power`.
    axis : int
        Axis of the elements, the last by default.
    noise_power : array (...), optional
        Noise power in one element, E|w|^2, of all cells or of each.
    field_of_view : FieldOfView, optional
        Directions that are searched; by default +-90 degrees of azimuth and +-30 of elevation.
    """
    return estimate_directions(snapshots, positions, n_sources, "iterative-adaptive", **options)


@check_argument_types
def maximum_likelihood(
    snapshots: ArrayLike,
    positions: ArrayLike,
    n_sources: NumberOfSources = 1,
    **options: Unpack[_Options],
) -> Directions:
    """Find the one or two directions of largest likelihood.

    Result and errors as of `estimate_directions`.

    Parameters
    ----------
    snapshots : array (..., n_snapshots, n_elements) or (n_elements,), complex
        Amplitudes of the elements; leading axes are cells.
    positions : array (n_elements,) or (n_elements, 3)
        In wavelengths: along y, positive to the left, or in three dimensions.
    n_sources : int or "mdl" or "aic"
        1 or 2 directions in each cell, or the criterion that estimates their number, which requires
        `noise_power`.
    axis : int
        Axis of the elements, the last by default.
    noise_power : array (...), optional
        Noise power in one element, E|w|^2, of all cells or of each.
    field_of_view : FieldOfView, optional
        Directions that are searched; by default +-90 degrees of azimuth and +-30 of elevation.
    """
    return estimate_directions(snapshots, positions, n_sources, "maximum-likelihood", **options)


@check_argument_types
def monopulse(
    snapshots: ArrayLike,
    positions: ArrayLike,
    n_sources: NumberOfSources = 1,
    **options: Unpack[_Options],
) -> Directions:
    """Find one direction by the phase between displaced elements.

    Result and errors as of `estimate_directions`.

    Parameters
    ----------
    snapshots : array (..., n_snapshots, n_elements) or (n_elements,), complex
        Amplitudes of the elements; leading axes are cells.
    positions : array (n_elements,) or (n_elements, 3)
        In wavelengths: along y, positive to the left, or in three dimensions.
    n_sources : int
        1, the only number that it finds.
    axis : int
        Axis of the elements, the last by default.
    noise_power : array (...), optional
        Noise power in one element, E|w|^2, of all cells or of each.
    field_of_view : FieldOfView, optional
        Directions that are searched; by default +-90 degrees of azimuth and +-30 of elevation.
    """
    return estimate_directions(snapshots, positions, n_sources, "monopulse", **options)


@check_argument_types
def music(
    snapshots: ArrayLike,
    positions: ArrayLike,
    n_sources: NumberOfSources = 1,
    **options: Unpack[_Options],
) -> Directions:
    """Find the directions in the signal subspace (MUSIC).

    Result and errors as of `estimate_directions`.

    Parameters
    ----------
    snapshots : array (..., n_snapshots, n_elements) or (n_elements,), complex
        Amplitudes of the elements; leading axes are cells.
    positions : array (n_elements,) or (n_elements, 3)
        In wavelengths: along y, positive to the left, or in three dimensions.
    n_sources : int or "mdl" or "aic"
        Directions in each cell, or the criterion that estimates their number, which requires
        `noise_power`.
    axis : int
        Axis of the elements, the last by default.
    noise_power : array (...), optional
        Noise power in one element, E|w|^2, of all cells or of each.
    field_of_view : FieldOfView, optional
        Directions that are searched; by default +-90 degrees of azimuth and +-30 of elevation.
    """
    return estimate_directions(snapshots, positions, n_sources, "music", **options)


@check_argument_types
def root_music(
    snapshots: ArrayLike,
    positions: ArrayLike,
    n_sources: NumberOfSources = 1,
    **options: Unpack[_Options],
) -> Directions:
    """Find directions as roots of a polynomial (root-MUSIC), on uniform linear arrays.

    Result and errors as of `estimate_directions`.

    Parameters
    ----------
    snapshots : array (..., n_snapshots, n_elements) or (n_elements,), complex
        Amplitudes of the elements; leading axes are cells.
    positions : array (n_elements,) or (n_elements, 3)
        In wavelengths, equally spaced on a line: along y, positive to the left, or in three
        dimensions.
    n_sources : int or "mdl" or "aic"
        Directions in each cell, or the criterion that estimates their number, which requires
        `noise_power`.
    axis : int
        Axis of the elements, the last by default.
    noise_power : array (...), optional
        Noise power in one element, E|w|^2, of all cells or of each.
    field_of_view : FieldOfView, optional
        Directions that are searched; by default +-90 degrees of azimuth and +-30 of elevation.
    """
    return estimate_directions(snapshots, positions, n_sources, "root-music", **options)


@check_argument_types
def estimate_directions(
    snapshots: ArrayLike,
    positions: ArrayLike,
    n_sources: NumberOfSources = 1,
    kind: str | DirectionEstimator = "music",
    *,
    axis: int = -1,
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
    axis : int
        Axis of the elements; the snapshots are on the last of the others.
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
        a cell of zeros beside others. Snapshots of no cell, (0, n_snapshots, n_elements), as of a
        frame without detections, give empty arrays.

    Raises
    ------
    InvalidSetting
        If snapshots are not finite, all zero or do not match the positions, elements share one
        position, the sources are too many for the array or the estimator, or a kind is unknown.
    """
    estimator = _direction_estimator(kind, n_sources)
    if noise_power is None and n_sources in ("mdl", "aic"):
        raise InvalidSetting(
            "noise_power",
            value="missing",
            expected=f"the noise in one element, on which {n_sources} depends",
            fix="give noise_power, or a number of sources",
        )
    cells = _array_cells(snapshots, positions, axis, noise_power, field_of_view)
    if not len(cells.snapshots):
        n_columns = n_sources if isinstance(n_sources, int) else 0
        return Directions(*(np.empty((*cells.shape, n_columns)) for _ in Directions._fields))
    with plain_twins_in_first_calls(SAMPLES_PER_AMPLITUDE * cells.snapshots.size):
        directions = estimator.find_directions(cells.snapshots, cells.aperture, cells.noise_power)
    if noise_power is None:
        directions.azimuth_std_rad.fill(np.nan)
        directions.elevation_std_rad.fill(np.nan)
    directions.power[:] = np.ldexp(directions.power, 2 * cells.exponents[:, None])
    return Directions(*(values.reshape(*cells.shape, -1) for values in directions))


@check_argument_types
@scalar_results
def direction_spectrum(
    snapshots: ArrayLike,
    positions: ArrayLike,
    azimuth_rad: ArrayLike,
    elevation_rad: ArrayLike = 0.0,
    *,
    n_sources: int = 1,
    kind: str | SpectralEstimator = "bartlett",
    axis: int = -1,
    noise_power: ArrayLike | None = None,
) -> np.ndarray:
    """Compute the spectrum of each cell over directions.

    Parameters
    ----------
    snapshots, positions, axis, noise_power
        As of `estimate_directions`.
    azimuth_rad, elevation_rad : array
        Directions, from -pi to pi and from -pi/2 to pi/2, broadcast against each other.
    n_sources : int
        Sources in each cell; only for `music`.
    kind : str or SpectralEstimator
        `bartlett`, `capon`, `fft`, `iterative-adaptive` or `music`, or one with its settings.

    Returns
    -------
    array (..., *directions)
        Power of one element, for a single source in its direction; of `music` the pseudospectrum,
        one over the squared distance of the steering vector from the signal subspace. That of
        `iterative-adaptive` peaks at its grid, eight directions to a beam. NaN in cells of zeros.

    Raises
    ------
    InvalidSetting
        As `estimate_directions`, and if directions are not finite or the kind has no spectrum.
    """
    azimuth, elevation = broadcast_arguments(
        azimuth_rad=check_finite_array("azimuth_rad", azimuth_rad),
        elevation_rad=check_finite_array("elevation_rad", elevation_rad),
    )
    _check_radians("azimuth", azimuth, largest=np.pi, bound="pi")
    _check_radians("elevation", elevation, largest=np.pi / 2, bound="pi/2")
    estimator = _direction_estimator(kind, n_sources)
    if not isinstance(estimator, SpectralEstimator) or not isinstance(n_sources, int):
        raise InvalidSetting(
            "kind",
            value=kind,
            expected="an estimator with a spectrum, and a number of sources",
            fix="choose bartlett, capon, fft, iterative-adaptive or music",
        )
    cells = _array_cells(snapshots, positions, axis, noise_power, None)
    check_free_memory(
        f"the spectrum over {azimuth.size} directions",
        needed_bytes=float(azimuth.size)
        * (
            _BYTES_PER_STEERING_VALUE * cells.aperture.n_elements
            + _BYTES_PER_SPECTRUM_VALUE * len(cells.snapshots)
        ),
        fix="give fewer directions at once",
    )
    steering = cells.aperture.steering_vectors(np.ravel(azimuth), np.ravel(elevation))
    has_signal = np.any(cells.snapshots != 0, axis=(1, 2))
    spectrum = np.full((len(cells.snapshots), azimuth.size), np.nan)
    if has_signal.any() and azimuth.size:
        with plain_twins_in_first_calls(SAMPLES_PER_AMPLITUDE * cells.snapshots.size):
            data = estimator.precompute_for_spectrum(
                cells.snapshots[has_signal], cells.aperture, cells.noise_power[has_signal]
            )
            spectrum[has_signal] = estimator.spectrum_at(data, steering)
    if not isinstance(estimator, Music):  # a pseudospectrum has no unit
        spectrum = np.ldexp(spectrum, 2 * cells.exponents[:, None])
    return spectrum.reshape((*cells.shape, *azimuth.shape))


def _check_radians(angle: str, values: np.ndarray, *, largest: float, bound: str) -> None:
    """Raise `InvalidSetting` for angles beyond a bound, as degrees are."""
    wrong = values[abs(values) > np.float32(largest)]  # above pi, as single precision rounds it
    if wrong.size:
        raise InvalidSetting(
            f"{angle}_rad",
            value=wrong.flat[0],
            expected=f"radians, from -{bound} to {bound}",
            fix=f"convert degrees with np.radians({angle}_deg)",
        )


class _ArrayCells(NamedTuple):
    snapshots: np.ndarray
    """Amplitudes (n, n_snapshots, n_elements), complex, divided by 2^exponents."""
    noise_power: np.ndarray
    """Noise power (n,), divided by 4^exponents."""
    exponents: np.ndarray
    """Exponents (n,) of the powers of two by which the amplitudes are divided."""
    aperture: Aperture
    shape: tuple[int, ...]
    """Shape of the cells, of product n."""


def _array_cells(
    snapshots: ArrayLike,
    positions: ArrayLike,
    axis: int,
    noise_power: ArrayLike | None,
    field_of_view: FieldOfView | None,
) -> _ArrayCells:
    """Check the arguments that all functions share, and flatten the cells."""
    elements = _element_positions(positions)
    amplitudes = check_finite_samples(
        "snapshots",
        snapshots,
        axes=f"(..., n_snapshots, {len(elements)}), one for each of the positions",
        # No cells, as of a frame without detections, but all of their axes.
        fits=lambda array: array.ndim > 2 or array.size > 0 < array.ndim,
        may_be_empty=True,
    )
    amplitudes = np.moveaxis(amplitudes, check_axes("axis", axis, amplitudes, n_axes=(1,)), [-1])
    if amplitudes.shape[-1] != len(elements):
        raise InvalidSetting(
            "snapshots",
            value=f"an array of {amplitudes.shape[-1]} elements on axis {axis}",
            expected=f"{len(elements)} elements, one for each of the positions",
            fix="give a position for each element, or the axis of the elements",
        )
    amplitudes = np.atleast_2d(amplitudes).astype(complex, order="C")
    if amplitudes.shape[-2] == 0:
        raise InvalidSetting(
            "snapshots",
            value=f"an array {np.shape(snapshots)} without snapshots",
            expected="one snapshot or more in each cell",
            fix="give (..., n_snapshots, n_elements)",
        )
    cells = amplitudes.shape[:-2]
    noise = check_non_negative_ratios(
        "noise_power", 0.0 if noise_power is None else noise_power, may_be_empty=True
    )
    try:
        noise = np.broadcast_to(noise, cells)
    except ValueError:
        raise InvalidSetting(
            "noise_power",
            value=f"an array {noise.shape}",
            expected=f"one value, or {cells}: one for each cell",
            fix="give the noise of one element",
        ) from None
    amplitudes = amplitudes.reshape(math.prod(cells), *amplitudes.shape[-2:])
    # Spectra are computed in single precision, which holds powers of 1e-38 to 1e38.
    largest = abs(amplitudes.view(float)).max(axis=(1, 2), initial=0.0)
    if largest.size and not largest.any():
        raise InvalidSetting(
            "snapshots",
            value=f"an array {np.shape(snapshots)} of zeros",
            expected="at least one cell with amplitudes other than 0",
            fix="leave out what has no echo",
        )
    # Beyond -1000, the inverse of the power of two would overflow.
    exponents = np.maximum(np.frexp(largest)[1], -1000)
    is_weak = (largest > 0) & (np.log2(np.maximum(np.ravel(noise), 5e-324)) - 2 * exponents > 100)
    if is_weak.any():
        raise InvalidSetting(
            "snapshots",
            value=f"amplitudes up to {largest[is_weak][0]:.3g}",
            expected=f"at most 300 dB below noise_power, {np.ravel(noise)[is_weak][0]:.3g}",
            fix="give both in the same unit, noise_power in its square",
        )
    return _ArrayCells(
        amplitudes * np.ldexp(1.0, -exponents)[:, None, None],
        np.ldexp(np.ravel(noise), -2 * exponents),
        exponents,
        Aperture(elements, field_of_view or FieldOfView()),
        cells,
    )


def _element_positions(positions: ArrayLike) -> np.ndarray:
    """Return positions (n_elements, 3), or raise `InvalidSetting`."""
    array = check_finite_array("positions", positions, above=-_MAX_POSITION, below=_MAX_POSITION)
    if array.ndim == 1 and array.size:
        array = np.stack([np.zeros_like(array), array, np.zeros_like(array)], axis=1)
    if (
        array.ndim != 2
        or array.shape[1] != 3
        or not len(array)
        or np.ptp(array[:, 1:], axis=0).max() < MIN_EXTENT
    ):
        raise InvalidSetting(
            "positions",
            value=f"an array {np.shape(positions)}, largest {abs(array).max(initial=0.0):.3g}",
            expected="(n_elements,) or (n_elements, 3), at two or more places across the line of"
            " sight",
            fix="give positions in wavelengths, along y or as rows of x, y and z",
        )
    return array


def _direction_estimator(
    kind: str | DirectionEstimator, n_sources: NumberOfSources
) -> DirectionEstimator:
    if isinstance(kind, DirectionEstimator):
        if kind.n_sources not in (1, n_sources):
            raise InvalidSetting(
                "n_sources",
                value=n_sources,
                expected=f"{kind.n_sources}, as in kind",
                fix="give n_sources to the function, and leave it out in kind",
            )
        return replace(kind, n_sources=n_sources)
    members = DirectionEstimator.members()
    if not isinstance(kind, str) or kind not in members:
        raise InvalidSetting(
            "kind", value=kind, expected=" or ".join(members), fix="choose one of them"
        )
    return cast("DirectionEstimator", members[kind](n_sources=n_sources))
