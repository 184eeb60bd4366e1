"""Diagnosis of beat samples, range profiles, maps and thresholds that other programs made."""

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import (
    check_false_alarm_probability,
    check_finite_array,
    check_finite_samples,
    check_integer,
    check_number,
    check_real_array,
)
from dechirp.core.errors import InvalidSetting
from dechirp.core.units import from_decibels
from dechirp.processing.diagnosis.axis_scales import diagnose_range_axis, diagnose_velocity_axis
from dechirp.processing.diagnosis.diagnosis import (
    NOTHING_FOUND,
    Diagnosis,
    cannot_be_told,
    mistake_found,
)
from dechirp.processing.diagnosis.echo_positions import (
    MIRRORED,
    diagnose_axis_order,
    diagnose_fftshift,
    diagnose_iq_order,
    diagnose_mirror_image,
    has_static_row,
    measure_mirror_similarity,
)
from dechirp.processing.diagnosis.known_target import (
    UnambiguousSpan,
    diagnose_known_target,
)
from dechirp.processing.diagnosis.map_peaks import MapPeaks, find_map_peaks
from dechirp.processing.diagnosis.noise_law import diagnose_noise_scale, measure_noise_scale
from dechirp.processing.diagnosis.range_rates import diagnose_range_rates, measure_range_rates
from dechirp.processing.diagnosis.threshold_factor import diagnose_factor
from dechirp.processing.diagnosis.window_leakage import diagnose_window, measure_leakage
from dechirp.processing.maps import pair_of, range_doppler_map, unity_exponent
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar

__all__ = ["Diagnosis", "diagnose_map", "diagnose_samples", "diagnose_threshold"]

Scale = Literal["power", "amplitude", "decibels"]
_MIN_CELLS = 16
_MIN_CHIRPS = 4


@check_argument_types
def diagnose_samples(
    samples: ArrayLike,
    radar: Radar,
    *,
    target_range_m: float | None = None,
    target_velocity_m_per_s: float | None = None,
) -> Diagnosis:
    """Look for well-known mistakes in beat samples that another program made or decoded.

    Parameters
    ----------
    samples : array (..., chirp, sample)
        One frame, real or complex; all other axes are channels, such as receivers.
    radar : Radar
        Settings with which the samples were made. Transmitters that take turns: all their chirps
        in the order sent.
    target_range_m, target_velocity_m_per_s : float, optional
        Range and velocity of a known target; receding is positive.

    Returns
    -------
    Diagnosis
        Settings `axes`, `iq`, `samples.phase` and `velocity_m_per_s.sign`.

    Raises
    ------
    InvalidSetting
        If the samples are not finite or do not fit the radar.
    """
    array = check_finite_samples(
        "samples",
        samples,
        axes=f"(..., chirp, sample), {_MIN_CHIRPS} of each or more",
        fits=lambda array: array.ndim >= 2 and min(array.shape[-2:]) >= _MIN_CHIRPS,
    )
    frame = radar.frame.for_frame(0)
    shape, n_chirps, n_samples = array.shape[-2:], frame.n_chirps_total, frame.chirp.n_samples
    if shape != (n_chirps, n_samples):
        if shape == (n_samples, n_chirps):
            return mistake_found(
                "axes",
                value=f"{shape[0]} chirps of {shape[1]} samples, exactly the reverse of the radar",
                expected=f"{n_chirps} chirps of {n_samples} samples",
                fix="exchange the last two axes: samples.swapaxes(-1, -2)",
            )
        raise InvalidSetting(
            "samples",
            value=f"an array {array.shape}",
            expected=f"(..., {n_chirps}, {n_samples}), the chirps and samples of the radar",
            fix="give one frame with its chirps and samples on the last axes, or correct the radar",
        )
    if (frame.chirp.sampling == "complex") != np.iscomplexobj(array):
        raise InvalidSetting(
            "samples",
            value=f"an array of {array.dtype}",
            expected=f"{frame.chirp.sampling} samples, as the radar has",
            fix="join I and Q to I + 1j Q, or correct radar.frame.chirp.sampling",
        )
    if not np.any(array):
        raise InvalidSetting(
            "samples", value="only zeros", expected="echoes and noise", fix="give a filled frame"
        )
    target = _check_target(target_range_m, target_velocity_m_per_s)
    chirps = _split_into_channels(array, frame)
    power = range_doppler_map(chirps, "hann", axes=(0, -1))
    is_complex = np.iscomplexobj(array)
    peaks = find_map_peaks(power, padding=(1, 1), is_windowed=(True, True))
    zero_row = power.shape[0] // 2
    order = diagnose_axis_order(peaks, power.shape, zero_row, (1, 1), content="samples")
    if order.findings or order.undetermined:  # all else depends on it
        return order
    if is_complex:
        mirror = diagnose_mirror_image(measure_mirror_similarity(power), content="samples")
        if mirror.findings:
            return mirror
        order = diagnose_iq_order(peaks, n_samples, 1, content="samples")
    if array.shape[-2] == array.shape[-1]:
        order += _diagnose_unconfirmed_order(peaks, power.shape, zero_row, (1, 1))
    if target is None:
        if order.findings:  # velocities have the wrong sign with it
            return order
        rates = measure_range_rates(chirps, peaks, frame)
        return order + diagnose_range_rates(rates, frame)
    return _with_known_target(
        order,
        diagnose_known_target(
            peaks,
            frame.chirp.range_bins_m(None if is_complex else n_samples)[: power.shape[1]],
            frame.velocity_bins_m_per_s(power.shape[0]),
            *target,
            span=UnambiguousSpan(frame.chirp.max_range_m, is_complex),
            content="samples",
            has_static_row=True,  # this map is shifted here
        ),
    )


def _split_into_channels(array: np.ndarray, frame: Frame) -> np.ndarray:
    """Return samples (chirp, channel, sample): the slots of a round and the receivers."""
    n_samples = array.shape[-1]
    rounds = array.reshape(-1, frame.n_chirps, frame.n_slots, n_samples)
    scaled = rounds * np.ldexp(1.0, -unity_exponent(array))
    return np.moveaxis(scaled, 1, 0).reshape(frame.n_chirps, -1, n_samples)


@check_argument_types
def diagnose_map(
    values: ArrayLike,
    range_m: ArrayLike,
    velocity_m_per_s: ArrayLike | None = None,
    *,
    scale: str = "power",
    n_summed: int | None = None,
    radar: Radar | None = None,
    target_range_m: float | None = None,
    target_velocity_m_per_s: float | None = None,
) -> Diagnosis:
    """Look for well-known mistakes in a range-Doppler map or a range profile with its axes.

    Parameters
    ----------
    values : array (velocity, range) or (range,)
        A map or a profile, with its noise; complex values are a spectrum.
    range_m, velocity_m_per_s : array
        Axes of the map in equal steps; none: a profile has no velocities.
    scale : str
        Scale that the map is said to have: `power`, `amplitude`, or `decibels` (of power).
    n_summed : int, optional
        Powers that were averaged in each cell, such as those of receivers; helps to judge the
        scale.
    radar : Radar, optional
        Settings of the radar; without it the steps of the axes cannot be judged.
    target_range_m, target_velocity_m_per_s : float, optional
        Range and velocity of a known target; receding is positive.

    Returns
    -------
    Diagnosis
        Settings `axes`, `range_m.scale`, `range_m.offset`, `range_m.mirror`,
        `velocity_m_per_s.scale`, `velocity_m_per_s.sign`, `window`, `fftshift`, `scale`, `iq`
        and `samples.phase`.

    Raises
    ------
    InvalidSetting
        If the map is not finite, has fewer than 16 ranges, does not fit its axes or its scale, or
        an axis has unequal steps.
    """
    power, noise_scale = _check_map(values, scale)
    is_profile = power.shape[0] == 1 and velocity_m_per_s is None
    ranges = _check_axis("range_m", range_m, power.shape, at_least=_MIN_CELLS)
    velocities = (
        None
        if velocity_m_per_s is None
        else _check_axis("velocity_m_per_s", velocity_m_per_s, power.shape, at_least=4)
    )
    if n_summed is not None:
        check_integer("n_summed", n_summed, at_least=1)
    target = _check_target(target_range_m, target_velocity_m_per_s)
    labels = (1 if velocities is None else velocities.size, ranges.size)
    if power.shape != labels:
        if power.shape == labels[::-1]:
            return mistake_found(
                "axes",
                value=f"{power.shape[0]} rows and {power.shape[1]} columns for {labels[0]}"
                f" velocities and {labels[1]} ranges, exactly the reverse",
                expected="a map (velocity, range)",
                fix="transpose the map",
            )
        raise InvalidSetting(
            "values",
            value=f"an array {np.shape(values)} with {labels[1]} ranges and"
            f" {0 if velocities is None else velocities.size} velocities",
            expected="a map (velocity, range), or a profile (range,) without velocities",
            fix="give an axis for each dimension, of its length",
        )
    if ranges[0] > ranges[-1]:
        power, ranges = power[:, ::-1], ranges[::-1]
    if velocities is not None and velocities[0] > velocities[-1]:
        power, velocities = power[::-1], velocities[::-1]
    diagnosis = NOTHING_FOUND
    if noise_scale:
        noise = measure_noise_scale(power, n_summed)
        diagnosis += diagnose_noise_scale(noise, scale)
        if np.isfinite(noise.factor):
            power = _rescale(power, 1 / noise.factor)
    if velocities is not None and radar is not None:
        order = _diagnose_exchanged_shape(power, velocities, radar.frame.for_frame(0))
        if order.findings or order.undetermined:  # steps and windows are those of other axes
            return order
    similarity = measure_mirror_similarity(power)
    diagnosis += diagnose_mirror_image(similarity, content="map")
    axes, padding = _diagnose_axes(
        power, ranges, velocities, radar, is_mirrored=bool(diagnosis.findings)
    )
    diagnosis += axes
    # Of a spectrum and its mirror image, the lines of one half: the lobes of both add up.
    half = power[:, : power.shape[1] // 2 + 1] if similarity >= MIRRORED else power
    leakages = {
        axis: measure_leakage(half if axis == 1 else power, axis, padding[axis])
        for axis in ((1,) if is_profile else (0, 1))
    }
    diagnosis += diagnose_window(leakages)
    is_windowed = tuple(axis in leakages and not leakages[axis].is_rectangular for axis in (0, 1))
    peaks = find_map_peaks(power, padding=padding, is_windowed=(is_windowed[0], is_windowed[1]))
    order, is_order_told = _diagnose_order(peaks, power.shape, velocities, radar, padding)
    if not is_order_told or (order.undetermined and _depends_on_axis_order(diagnosis, radar)):
        return order  # all else depends on it
    return diagnosis + _diagnose_positions(
        peaks, power.shape, ranges, velocities, radar, target, padding, diagnosis, order
    )


def _diagnose_exchanged_shape(power: np.ndarray, velocities: np.ndarray, frame: Frame) -> Diagnosis:
    """Judge the order of the axes of a map whose columns fit the chirps, and rows the samples."""
    padding = _exchanged_padding(power.shape, frame)
    if padding is None or _padding_of_ranges(power.shape[1], frame.chirp.n_samples):
        return NOTHING_FOUND
    leakages = [measure_leakage(power, axis, padding[axis]) for axis in (0, 1)]
    peaks = find_map_peaks(
        power,
        padding=padding,
        is_windowed=(not leakages[0].is_rectangular, not leakages[1].is_rectangular),
    )
    zero_row = int(np.argmin(abs(velocities)))
    order = diagnose_axis_order(peaks, power.shape, zero_row, padding, content="map")
    if order.findings or has_static_row(peaks, power.shape, zero_row, padding):
        return order
    return cannot_be_told(
        "axes",
        value=f"{power.shape[0]} rows and {power.shape[1]} columns fit the samples and the chirps"
        " of the radar, not the reverse, and few echoes are static",
        expected="a map (velocity, range), with static echoes at several ranges",
        fix="transpose the map if its rows are ranges, or give a frame with more static echoes",
    )


def _diagnose_order(
    peaks: MapPeaks,
    shape: tuple[int, int],
    velocities: np.ndarray | None,
    radar: Radar | None,
    padding: tuple[float, float],
) -> tuple[Diagnosis, bool]:
    """Judge the order of the axes, and return False if echoes contradict or blur it."""
    if velocities is None:
        return NOTHING_FOUND, True
    zero_row = int(np.argmin(abs(velocities)))
    order = diagnose_axis_order(peaks, shape, zero_row, padding, content="map")
    if order.findings or order.undetermined:
        return order, False
    if radar is None or _exchanged_padding(shape, radar.frame.for_frame(0)):
        order = _diagnose_unconfirmed_order(peaks, shape, zero_row, padding)
    return order, True


def _depends_on_axis_order(diagnosis: Diagnosis, radar: Radar | None) -> bool:
    """Return whether steps or windows judged by a radar are reported, as exchanged axes have."""
    return radar is not None and any(
        finding.setting.startswith(("range_m.", "velocity_m_per_s.", "window"))
        for finding in diagnosis.findings
    )


def _diagnose_unconfirmed_order(
    peaks: MapPeaks, shape: tuple[int, int], zero_row: int, padding: tuple[float, float]
) -> Diagnosis:
    """List the order of axes that fit in both orders, unless static echoes confirm it."""
    if has_static_row(peaks, shape, zero_row, padding):
        return NOTHING_FOUND
    return cannot_be_told(
        "axes",
        value="the shape fits both orders of the axes, and few echoes are static",
        expected="static echoes at several ranges, or a known target",
        fix="give a frame with walls or furniture, or the range and velocity of a target",
    )


def _exchanged_padding(shape: tuple[int, ...], frame: Frame) -> tuple[float, float] | None:
    """Return the cells per resolution cell if exchanged axes fit the radar, else None."""
    n_rows, n_columns = shape
    n_chirps, n_samples = frame.n_chirps, frame.chirp.n_samples
    if n_columns % n_chirps:
        return None
    padding = _padding_of_ranges(n_rows, n_samples)
    return (padding, n_columns / n_chirps) if padding else None


def _padding_of_ranges(n_cells: int, n_samples: int) -> int:
    """Return the whole number of cells per resolution cell of a range axis; 0 if none fits."""
    # The half of a real spectrum has n // 2 + 1 cells.
    for n_bins in (n_cells, 2 * n_cells - 2, 2 * n_cells - 1):
        if n_bins % n_samples == 0:
            return n_bins // n_samples
    return 0


def _diagnose_axes(
    power: np.ndarray,
    ranges: np.ndarray,
    velocities: np.ndarray | None,
    radar: Radar | None,
    *,
    is_mirrored: bool,
) -> tuple[Diagnosis, tuple[float, float]]:
    """Judge the axes, and return the cells per resolution cell of each."""
    if radar is None:
        missing = NOTHING_FOUND
        for axis in ("range_m", "velocity_m_per_s")[: 1 if velocities is None else 2]:
            missing += cannot_be_told(
                f"{axis}.scale",
                value="no radar is given",
                expected="the settings of the radar, from which the step of the axis follows",
                fix="give radar",
            )
        return missing, (1.0, 1.0)
    frame = radar.frame.for_frame(0)
    scale = diagnose_range_axis(ranges, power, frame, is_mirrored=is_mirrored)
    diagnosis, padding = scale.diagnosis, [1.0, _padding(scale.n_bins, frame.chirp.n_samples)]
    if velocities is not None:
        scale = diagnose_velocity_axis(velocities, power, frame)
        diagnosis += scale.diagnosis
        padding[0] = _padding(scale.n_bins, frame.n_chirps)
    return diagnosis, (padding[0], padding[1])


def _padding(n_bins: float, n_points: int) -> float:
    """Return the cells per resolution cell; 1 if unknown."""
    return max(n_bins / n_points, 1.0) if np.isfinite(n_bins) else 1.0


def _diagnose_positions(
    peaks: MapPeaks,
    shape: tuple[int, int],
    ranges: np.ndarray,
    velocities: np.ndarray | None,
    radar: Radar | None,
    target: tuple[float, float | None] | None,
    padding: tuple[float, float],
    earlier: Diagnosis,
    order: Diagnosis,
) -> Diagnosis:
    """Judge the positions of the echoes of a map, unless its axes are wrong already.

    `order` lists the order of the axes if only a known target can tell it.
    """
    diagnosis = order
    settings = {finding.setting for finding in earlier.findings}
    if velocities is not None:
        zero_row = int(np.argmin(abs(velocities)))
        diagnosis += diagnose_fftshift(peaks, shape, zero_row, padding)
    chirp = None if radar is None else radar.frame.chirp
    is_complex = chirp is not None and chirp.sampling == "complex"
    covers_span = chirp is not None and ranges.max() > 0.9 * chirp.max_range_m
    if is_complex and covers_span and not settings and ranges.min() >= 0:
        diagnosis += diagnose_iq_order(peaks, shape[1], padding[1], content="map")
    if target is None:
        if velocities is not None:
            diagnosis += cannot_be_told(
                "velocity_m_per_s.sign",
                value="a map of powers is the same in both conventions",
                expected="a known target, or the samples",
                fix="give the range and velocity of a target",
            )
        return diagnosis
    if any(setting.endswith(("scale", "offset", "mirror")) for setting in settings - {"scale"}):
        return diagnosis
    span = None if chirp is None else UnambiguousSpan(chirp.max_range_m, is_complex)
    return _with_known_target(
        diagnosis,
        diagnose_known_target(
            peaks,
            ranges,
            velocities,
            *target,
            span=span,
            content="map",
            has_static_row=velocities is not None
            and has_static_row(peaks, shape, int(np.argmin(abs(velocities))), padding),
        ),
    )


def _with_known_target(diagnosis: Diagnosis, by_target: Diagnosis) -> Diagnosis:
    """Return a diagnosis in which a known target has the last word on positions."""
    if by_target.undetermined:
        return diagnosis + by_target
    decided = ("axes", "iq", "fftshift")
    findings = tuple(finding for finding in diagnosis.findings if finding.setting not in decided)
    undetermined = tuple(note for note in diagnosis.undetermined if note.setting not in decided)
    return Diagnosis(findings=findings, undetermined=undetermined) + by_target


def _check_map(values: ArrayLike, scale: str) -> tuple[np.ndarray, bool]:
    """Return linear powers (velocity, range), and whether their scale can be judged."""
    if scale not in ("power", "amplitude", "decibels"):
        raise InvalidSetting(
            "scale", value=scale, expected="power, amplitude or decibels", fix="choose one"
        )
    array = check_finite_samples(
        "values",
        values,
        axes=f"(velocity, range) or (range,), with {_MIN_CELLS} ranges or more",
        fits=lambda array: array.ndim in (1, 2) and max(array.shape) >= _MIN_CELLS,
    )
    is_spectrum = np.iscomplexobj(array)
    if is_spectrum:
        power = (abs(array * np.ldexp(1.0, -unity_exponent(array)))) ** 2
    elif scale == "decibels":
        power = from_decibels(array.astype(float) - float(array.max()))
    else:
        if array.min() < 0:
            raise InvalidSetting(
                "values",
                value=f"{float(array.min()):.4g}, as {scale}",
                expected="0 or more",
                fix="if the map is in dB, give scale='decibels'",
            )
        power = (array / max(float(array.max()), 1e-300)) ** (2 if scale == "amplitude" else 1)
    if not power.max() > 0:
        raise InvalidSetting(
            "values", value="only zeros", expected="echoes and noise", fix="give a filled map"
        )
    return np.atleast_2d(power / power.max()), not is_spectrum


def _rescale(power: np.ndarray, factor: float) -> np.ndarray:
    """Multiply the decibels of a map by a factor."""
    return np.asarray(power**factor)


def _check_axis(
    setting: str, axis: ArrayLike, shape: tuple[int, ...], *, at_least: int
) -> np.ndarray:
    """Return an axis in equal steps, or raise `InvalidSetting`."""
    values = check_finite_array(setting, axis)
    steps = np.diff(values) if values.ndim == 1 and values.size >= at_least else np.zeros(1)
    if not (steps[0] and np.all(abs(steps / np.median(steps) - 1) < 0.01)):
        raise InvalidSetting(
            setting,
            value=f"an array {values.shape}"
            + (" with unequal steps" if values.size >= at_least else "")
            + f", for a map of {' x '.join(map(str, shape))}",
            expected=f"one axis of at least {at_least} different values in equal steps",
            fix="give the axis of the map, one value for each cell",
        )
    return values


def _check_target(
    range_m: float | None, velocity_m_per_s: float | None
) -> tuple[float, float | None] | None:
    """Return the known target, or None; raise `InvalidSetting` for a velocity without a range."""
    if range_m is None:
        if velocity_m_per_s is not None:
            raise InvalidSetting(
                "target_range_m",
                value="missing, with a velocity",
                expected="the range of the same target",
                fix="give target_range_m, too",
            )
        return None
    checked_m = check_number("target_range_m", range_m, above=0.0)
    if velocity_m_per_s is None:
        return checked_m, None
    return checked_m, check_number("target_velocity_m_per_s", velocity_m_per_s)


@check_argument_types
def diagnose_threshold(
    threshold: ArrayLike,
    power: ArrayLike,
    n_training: int | tuple[int, int],
    n_guard: int | tuple[int, int],
    pfa: float,
    *,
    n_summed: int = 1,
) -> Diagnosis:
    """Compare a cell-averaging threshold with the factor that its training cells require.

    Parameters
    ----------
    threshold, power : array (velocity, range) or (range,)
        Threshold and map of linear powers.
    n_training, n_guard : int or (int, int)
        Training and guard cells on each side of the cell under test; a pair for velocity and range.
        With single numbers for a map, a window over range or velocity alone is tried, too.
    pfa : float
        False-alarm probability that the threshold should give.
    n_summed : int
        Powers that were summed or averaged in each cell.

    Returns
    -------
    Diagnosis
        Setting `threshold`.

    Raises
    ------
    InvalidSetting
        If the powers are not finite, the threshold is NaN where all training cells lie within the
        map, the shapes differ, the cells do not fit into the map, or the probability is out of
        bounds.
    """
    check_false_alarm_probability("pfa", pfa)
    check_integer("n_summed", n_summed, at_least=1)
    power, threshold = check_finite_array("power", power), check_real_array("threshold", threshold)
    if power.ndim not in (1, 2) or power.shape != threshold.shape or not power.size:
        raise InvalidSetting(
            "threshold",
            value=f"an array {threshold.shape} for a map {power.shape}",
            expected="two maps (velocity, range), or two profiles (range,), of equal shape",
            fix="give a threshold for each cell",
        )
    training, guard = (
        _cells_of_axes(name, cells, power.ndim)
        for name, cells in (("n_training", n_training), ("n_guard", n_guard))
    )
    power, threshold = np.atleast_2d(power), np.atleast_2d(threshold)
    _check_window_fits(training, guard, power.shape)
    diagnosis = diagnose_factor(threshold, power, training, guard, pfa, n_summed)
    if not diagnosis.undetermined or isinstance(n_training, tuple) or isinstance(n_guard, tuple):
        return diagnosis
    lines = [
        diagnose_factor(
            *(threshold, power, (training[0] * v, training[1] * r), (guard[0] * v, guard[1] * r)),
            pfa,
            n_summed,
        )
        for v, r in ((0, 1), (1, 0))
    ]
    return next((line for line in lines if not line.undetermined), diagnosis)


def _check_window_fits(
    training: tuple[int, int], guard: tuple[int, int], shape: tuple[int, ...]
) -> None:
    """Raise `InvalidSetting` unless there are training cells and they fit into a map."""
    for axis, name in enumerate(("velocity", "range")):
        check_integer(f"n_guard.{name}", guard[axis], at_least=0)
        most = max((shape[axis] - 1) // 2 - guard[axis], 0)
        check_integer(f"n_training.{name}", training[axis], at_least=0, at_most=most)
    if not any(training):
        raise InvalidSetting(
            "n_training", value=training, expected="training cells", fix="give their number"
        )


def _cells_of_axes(setting: str, cells: int | tuple[int, int], n_axes: int) -> tuple[int, int]:
    """Return the cells over velocity and range; a profile has none over velocity."""
    if n_axes == 1:
        if isinstance(cells, tuple):
            raise InvalidSetting(
                setting, value=cells, expected="one number for a profile", fix="give one number"
            )
        return 0, cells
    over_velocity, over_range = pair_of(setting, cells)
    return over_velocity, over_range
