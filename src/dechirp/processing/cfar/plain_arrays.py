"""CFAR thresholds and peaks of plain arrays, without a `Radar`."""

from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import (
    as_tuple_or_none,
    check_axes,
    check_false_alarm_probability,
    check_integer,
    check_non_negative_ratios,
    largest_part,
)
from dechirp.core.compiled_kernels import plain_twins_in_first_calls
from dechirp.core.errors import InvalidSetting
from dechirp.core.memory import check_free_memory
from dechirp.processing.cfar.base import Cells, Cfar, MapNoise, NoiseEstimator
from dechirp.processing.maps import pair_of, pair_of_windows, unity_exponent
from dechirp.processing.peaks import find_local_maxima
from dechirp.processing.spectrum import Transform, circular_noise_rows
from dechirp.radar.chirp import Sampling
from dechirp.theory.windows import WindowSpec, is_pair_of_windows

__all__ = ["cfar_threshold", "find_peaks"]


@check_argument_types
def cfar_threshold(
    power: ArrayLike,
    n_training: int | tuple[int, int],
    n_guard: int | tuple[int, int],
    pfa: float,
    kind: str | NoiseEstimator = "cell-averaging",
    *,
    axis: int | tuple[int, int] | None = None,
    n_summed: int = 1,
    window: WindowSpec | tuple[WindowSpec, WindowSpec] = "rectangular",
    n_points: tuple[int, int] | int | None = None,
    sampling: Sampling = "complex",
) -> np.ndarray:
    """Compute the CFAR threshold of every cell of a power spectrum or a range-Doppler map.

    A cell is detected where `power` exceeds the result. Noise alone does so with the probability
    `pfa` in every cell, edges included, as in `dechirp.threshold_map`: velocity wraps round, and at
    the ends of range the training cells are the nearest that exist. Spectra of real samples have
    real noise at zero frequency and at half the rate, whose power is chi-square with one degree of
    freedom: in a single spectrum with 32 training cells it exceeds the threshold 13 times as often
    at 1e-4, 50 times at 1e-6. So with `sampling="real"` the threshold is infinite there, and with
    windows in the next cell as well, as `dechirp.detect` omits these ranges.

    Parameters
    ----------
    power : array (range,), (velocity, range), or any number of them
        Powers of a square-law detector, not in dB: 0 or more.
    n_training, n_guard : int or (int, int)
        Training and guard cells on each side of the cell under test; a pair for velocity and range.
    pfa : float
        False-alarm probability of a cell.
    kind : str or NoiseEstimator
        A member of the family by its kind, or with its settings, as
        `dechirp.cfar.OrderedStatistic(rank=0.9)`.
    axis : int or (int, int), optional
        Axis of the spectra, as range, or axes of the maps, as velocity and range; spectra or maps
        along all other axes are independent. By default the last two, or the only one.
    n_summed : int
        Powers that were summed or averaged in each cell: receivers, or pulses.
    window : str, tuple or array, or a pair of them
        Window before the transform of each axis, as of `dechirp.maps.range_doppler_map`.
        A window and zero padding correlate neighbouring cells; the factor includes that, and
        detectors without a closed form for it are calibrated by simulation, once.
    n_points : int or (int, int), optional
        Samples of each axis before zero padding; as many as bins by default.
    sampling : str
        "real" for spectra of real samples, whose n // 2 + 1 cells of range are those of an even
        number n of bins; otherwise "complex".

    Returns
    -------
    array
        Thresholds in the shape and the unit of `power`. Computed in single precision, like those
        of the chain.

    Raises
    ------
    InvalidSetting
        If powers are not finite, below 0 or in no such shape, the cells with the guard do not fit
        on an axis, the probability is out of bounds, or a kind, a window or the sampling is
        unknown.
    """
    cells = _check_power(power)
    check_false_alarm_probability("pfa", pfa)
    check_integer("n_summed", n_summed, at_least=1)
    axes = check_axes(
        "axis", (-2, -1)[-cells.ndim :] if axis is None else axis, cells, n_axes=(1, 2)
    )
    last_axes = tuple(range(-len(axes), 0))
    maps = np.moveaxis(cells, axes, last_axes)
    # Spectra become maps of a single velocity.
    shape = maps.shape[-2:] if len(axes) == 2 else (1, maps.shape[-1])
    n_bins = shape[0], _range_bins(sampling, shape[1])
    slow_points, fast_points = _pair_of_axes("n_points", n_points, axes, when_none=n_bins)
    if len(axes) == 1 and is_pair_of_windows(window):
        raise _error_of_pair("window", window)
    slow_window, fast_window = pair_of_windows(window)
    if len(axes) == 1:
        slow_window = "rectangular"
    noise = MapNoise(
        range_transform=_transform_of_axis(fast_window, fast_points, n_bins[1]),
        doppler_transform=_transform_of_axis(slow_window, slow_points, n_bins[0]),
        n_channels=n_summed,
    )
    training, guard = _training_and_guard_cells(n_training, n_guard, axes, shape)
    detector = Cfar(
        estimator=_noise_estimator(kind),
        n_training=training,
        n_guard=guard,
        false_alarm_probability=float(pfa),
    )
    is_searched = np.zeros(shape[1], bool)
    is_searched[circular_noise_rows(sampling, noise.range_transform)] = True
    check_free_memory(
        f"thresholds of {maps.size} cells",
        needed_bytes=24.0 * maps.size,
        fix="give fewer maps at once",
    )
    thresholds = np.empty(maps.shape)
    for values, threshold in zip(
        maps.reshape(-1, *shape), thresholds.reshape(-1, *shape), strict=True
    ):
        exponent = unity_exponent(values)
        single = (values * np.ldexp(1.0, -exponent)).astype(np.float32)
        with np.errstate(over="ignore"), plain_twins_in_first_calls(single.size):
            single_threshold = detector.threshold(single, noise)
            np.ldexp(single_threshold, exponent, out=threshold, dtype=float)
    if not np.isfinite(thresholds).all():
        raise InvalidSetting(
            "pfa and power",
            value=f"{pfa} and powers up to {largest_part(cells):.3g}",
            expected="thresholds up to 3e38 times the largest power, and up to 1e308",
            fix="give a larger pfa or more training cells, and powers in a larger unit",
        )
    thresholds[..., ~is_searched] = np.inf
    return np.moveaxis(thresholds, last_axes, axes)


@check_argument_types
def find_peaks(power: ArrayLike, threshold: ArrayLike) -> np.ndarray:
    """Find the cells over threshold that no neighbour exceeds: one for each echo, not all it fills.

    Parameters
    ----------
    power : array (range,) or (velocity, range)
        A power spectrum or a range-Doppler map.
    threshold : array
        Threshold of each cell, as of `cfar_threshold`, or a number; infinite for cells to leave
        out.

    Returns
    -------
    array (n, 1) or (n, 2)
        Indices of the peaks on the axes of `power`, strongest first. Of the eight neighbours of a
        cell, or the two in a spectrum, those over the ends of velocity are on the other side. Of
        equal neighbours the first is the peak. Sidelobes of strong echoes are peaks of their own:
        choose a window whose sidelobes stay below the threshold.

    Raises
    ------
    InvalidSetting
        If powers are not finite, below 0 or on more than two axes, or the threshold does not fit.
    """
    cells = _check_power(power)
    if cells.ndim > 2:
        raise InvalidSetting(
            "power",
            value=f"an array {cells.shape}",
            expected="one spectrum (range,) or one map (velocity, range)",
            fix="call the function for each of them",
        )
    limits = check_non_negative_ratios("threshold", threshold, at_most=np.inf)
    if limits.shape not in ((), cells.shape):
        raise InvalidSetting(
            "threshold",
            value=f"an array {limits.shape}",
            expected=f"a number, or the shape of power, {cells.shape}",
            fix="compute it from the same map",
        )
    with plain_twins_in_first_calls(cells.size):
        peaks = find_local_maxima(np.atleast_2d(cells), np.atleast_2d(cells > limits))
    order = np.argsort(-cells[tuple(peaks[:, -cells.ndim :].T)], kind="stable")
    return peaks[order, -cells.ndim :]


def _range_bins(sampling: Sampling, n_cells: int) -> int:
    """Return the bins of the range transform, of which spectra of real samples keep half."""
    if sampling not in ("complex", "real"):
        raise InvalidSetting(
            "sampling", value=sampling, expected="complex or real", fix="choose one of them"
        )
    if sampling == "complex":
        return n_cells
    if n_cells < 2:
        raise InvalidSetting(
            "power",
            value=f"{n_cells} cell of range",
            expected="two or more of real samples",
            fix="give the whole spectrum, n // 2 + 1 cells of n bins",
        )
    return 2 * (n_cells - 1)


def _check_power(power: ArrayLike) -> np.ndarray:
    cells = check_non_negative_ratios("power", power, at_most=np.finfo(float).max)
    if cells.size == 0 or cells.ndim == 0:
        raise InvalidSetting(
            "power",
            value=f"an array {cells.shape}",
            expected="cells over (range,) or (velocity, range)",
            fix="give spectra or maps, with filled axes",
        )
    return cells


def _pair_of_axes(
    setting: str, value: Any, axes: tuple[int, ...], *, when_none: tuple[Any, Any]
) -> tuple[Any, Any]:
    """Return a setting of velocity and range; a spectrum has a single velocity, without window."""
    if value is None:
        return when_none
    if len(axes) == 2:
        return pair_of(setting, value)
    if as_tuple_or_none(value) is not None:
        raise _error_of_pair(setting, value)
    return when_none[0], value


def _error_of_pair(setting: str, pair: object) -> InvalidSetting:
    return InvalidSetting(
        setting, value=pair, expected="one value for a single axis", fix="give one value"
    )


def _transform_of_axis(window: Any, n_points: int, n_bins: int) -> Transform:
    check_integer("n_points", n_points, at_least=min(n_bins, 2), at_most=n_bins)
    return Transform(window=window, n_points=n_points, n_bins=n_bins)


def _training_and_guard_cells(
    n_training: Any, n_guard: Any, axes: tuple[int, ...], shape: tuple[int, int]
) -> tuple[Cells, Cells]:
    """Return the numbers of training and guard cells, after a check that they fit on each axis."""
    pairs = []
    for setting, value in (("n_training", n_training), ("n_guard", n_guard)):
        pair = _pair_of_axes(setting, value, axes, when_none=(0, None))
        for number in pair:
            check_integer(setting, number, at_least=0)
        pairs.append(cast("tuple[int, int]", pair))
    for training, guard, size in zip(*pairs, shape, strict=True):
        if 2 * (training + guard) + 1 > size:
            raise InvalidSetting(
                "n_training",
                value=f"{training} training and {guard} guard cells on each side",
                expected=f"at most {size} cells on this axis, with the cell under test",
                fix="lower n_training or n_guard, or give a pair for velocity and range",
            )
    (slow_training, fast_training), (slow_guard, fast_guard) = pairs
    if slow_training + fast_training == 0:
        raise InvalidSetting(
            "n_training", value=0, expected="training cells on an axis", fix="give at least one"
        )
    return (
        Cells(range=int(fast_training), velocity=int(slow_training)),
        Cells(range=int(fast_guard), velocity=int(slow_guard)),
    )


def _noise_estimator(kind: str | NoiseEstimator) -> NoiseEstimator:
    if isinstance(kind, NoiseEstimator):
        return kind
    members = NoiseEstimator.members()
    if not isinstance(kind, str) or kind not in members:
        raise InvalidSetting(
            "kind", value=kind, expected=" or ".join(members), fix="choose one of them"
        )
    return cast("NoiseEstimator", members[kind]())
