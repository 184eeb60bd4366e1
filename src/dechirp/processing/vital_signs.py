r"""Breathing and heart rate of a person, from the slow-time values of range cells.

For each window of time: the cell and channel with the largest movement, a circle fitted to its I/Q
values (`processing.arc_fit`), the displacement from the phase about its centre, and the strongest
lines of the displacement in the bands of breathing and heart (`processing.periodicity`). The
harmonics of breathing are fitted with it, and no heart rate is searched beside them. The noise of
a heart rate is fitted over the band of hearts alone, where white noise may exceed a random walk
that decides at lower rates. Where several parts of a body move in the cell, so that neither phase
nor I and Q have such a line, I and Q of all cells with a third of its movement are searched
together, decorrelated.

The cell is chosen by its power without the static part. Significance does not depend on power, so
the choice does not raise the false-alarm probability of white noise.

References
----------
C. Li, V. M. Lubecke, O. Boric-Lubecke and J. Lin, A review on recent advances in Doppler radar
sensors for noncontact healthcare monitoring, IEEE Trans. MTT 61(5), 2013.
"""

import itertools
import math
from dataclasses import replace
from typing import Literal, get_args

import numpy as np
import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_positive_fields, check_probability
from dechirp.core.errors import InvalidSetting
from dechirp.core.text import format_si
from dechirp.core.values import frozen_dataclass
from dechirp.processing.arc_fit import fit_arc
from dechirp.processing.periodicity import (
    Line,
    find_fundamental,
    find_line,
    fit_noise_slope,
    join_bases,
    rate_interval_hz,
    sinusoids,
    slow_functions,
)

__all__ = ["VitalSigns", "chest_displacement", "measure_vital_signs"]


def __dir__() -> list[str]:
    return __all__


# A chest that moves at 20 mm/s moves 0.4 mm between values at this rate: 0.08 of a cycle at 60 GHz.
_MAX_RATE_HZ = 50.0
_MAX_HARMONICS = 6
_DECORRELATION_LAG_S = 0.5
# Changes over half a second vanish at 2 Hz: decorrelated by them, random walks had 1.5 times the
# noise there. Those over 0.1 s grow up to 5 Hz, beyond hearts.
_HEART_DECORRELATION_LAG_S = 0.1
_MAX_PROBABILITY_OF_SAME_LINE = 0.2
_MIN_SHARE_OF_MOVEMENT = 1 / 3
_MIN_SHARE_OF_POWER = 1e-3  # of a decorrelated component: rounding, and copies of others, have less
# Distances from the circle, and error of its radius, over the radius: at 0.15 the phase is known to
# 0.15 rad, and its cycles are counted without an error. Noise alone has 0.5 and more.
_CLEAN_ARC_ERROR = 0.15
_LEAST_RATIO_OF_RATES = 1.2  # beyond the error of a rate
# Windows that share half of their time have the same rate there: means of both that differ by 1.5
# need a breathing that becomes twice as fast.
_LARGEST_RATIO_OF_NEIGHBOURS = 1.5
_Sign = Literal["breathing", "heart"]


@frozen_dataclass
class VitalSigns:
    """Settings of the measurement of breathing and heart rate."""

    range_m: tuple[float, float] = (0.2, 3.0)
    """Nearest and farthest range of a person."""
    breathing_hz: tuple[float, float] = (0.1, 0.7)
    heart_hz: tuple[float, float] = (0.8, 2.5)
    window_s: float = 20.0
    """Time of which each rate is measured."""
    step_s: float = 10.0
    """Time from one window to the next."""
    confidence: float = 0.95
    """Of the intervals of the rates."""
    false_alarm_probability: float = 1e-2
    """Probability that noise is taken for a breathing rate or for a heart rate, for each window."""

    def __post_init__(self) -> None:
        check_positive_fields(self, "window_s", "step_s")
        for name in ("confidence", "false_alarm_probability"):
            check_probability(f"VitalSigns.{name}", getattr(self, name))
        for name in ("range_m", "breathing_hz", "heart_hz"):
            low, high = getattr(self, name)
            if not (math.isfinite(high) and 0 <= low < high and (low > 0 or name == "range_m")):
                raise InvalidSetting(
                    f"VitalSigns.{name}",
                    value=f"{low} to {high}",
                    expected="a lower and a higher value, above 0 and finite",
                    fix="give the lowest, then the highest",
                )
        if self.heart_hz[0] < self.breathing_hz[1]:
            raise InvalidSetting(
                "VitalSigns.heart_hz",
                value=f"from {self.heart_hz[0]:g} Hz",
                expected=f"at least {self.breathing_hz[1]:g} Hz, the highest breathing rate",
                fix="separate the bands of breathing and heart",
            )
        if self.window_s * self.breathing_hz[0] < 2 * (1 - 1e-9):
            raise InvalidSetting(
                "VitalSigns.window_s",
                value=f"{self.window_s:g} s",
                expected=f"{2 / self.breathing_hz[0]:.3g} s or more: two periods of the slowest"
                " breathing",
                fix="raise VitalSigns.window_s or the lower end of VitalSigns.breathing_hz",
            )


@check_argument_types
def measure_vital_signs(trace: xr.DataArray, settings: VitalSigns | None = None) -> xr.Dataset:
    """Measure breathing and heart rate over time.

    Parameters
    ----------
    trace : DataArray (time, ...), complex
        Slow-time values of cells, from `range_traces`, `slow_time`, `frame_means` or
        `read_slow_time`. Times may be uneven, with gaps. Values of 0, as of lost chirps, are left
        out. A window with less than half its values is not measurable. With a
        coordinate `range`, the cells within the range interval of the settings are used. The
        attribute `wavelength_m` converts phase to displacement.
    settings : VitalSigns, optional

    Returns
    -------
    Dataset (window,)
        `time` (s): middle of each window; `range` (m) and `channel` of the chosen cell, if the
        trace has them; for breathing and heart `..._rate`, `..._rate_low` and `..._rate_high` (Hz):
        estimate and confidence interval of the mean rate in the window, by noise and unequal
        breaths (that of a steady heart beside breathing is too wide, see `periodicity`), NaN where
        not measurable, as where windows that share half of their time have breathing rates whose
        intervals are a factor of 1.5 apart; `..._amplitude` (m) of the
        fundamental, NaN where the values are no arc or the wavelength is unknown;
        `..._false_alarm_probability`: probability that noise alone has such a line.

    Raises
    ------
    InvalidSetting
        If the trace is not complex over increasing times, is shorter than half a window or too
        slow for breathing, has no cell in the range interval, or has values that are not finite.
    """
    settings = VitalSigns() if settings is None else settings
    cells, times_s, coordinates = _cells_of_trace(trace, settings)
    cells, times_s = _average_to_lower_rate(cells, times_s)
    _check_times_suit_settings(times_s, settings)
    wavelength_m = float(trace.attrs.get("wavelength_m", math.nan))
    rows = []
    for start_s in _window_starts_s(times_s, settings):
        inside = (start_s <= times_s) & (times_s < start_s + settings.window_s)
        if _has_too_few_values(times_s[inside], settings):
            row = dict.fromkeys(("time", *coordinates), math.nan)
            row["time"] = start_s + 0.5 * settings.window_s
            for sign in get_args(_Sign):
                row |= _row_of_line(sign, None, math.nan, settings)
        else:
            row = {"time": 0.5 * (times_s[inside][0] + times_s[inside][-1])}
            row |= _measure_window(
                cells[inside], times_s[inside], coordinates, wavelength_m, settings
            )
        rows.append(row)
    _withdraw_contradicting_rates(rows, settings)
    units = {"time": "s", "range": "m", "channel": "1"}
    columns = {
        name: (
            "window",
            np.array([row[name] for row in rows]),
            {"units": units.get(name, _units_of_sign(name))},
        )
        for name in rows[0]
    }
    return xr.Dataset(
        columns,
        attrs={
            "confidence": settings.confidence,
            "false_alarm_probability": settings.false_alarm_probability,
        },
    ).set_coords("time")


@check_argument_types
def chest_displacement(trace: xr.DataArray, settings: VitalSigns | None = None) -> xr.DataArray:
    """Compute the displacement of the cell that moves most, for figures.

    lambda / (4 pi) times the phase about the centre of the arc that I and Q describe, without
    motion slower than breathing. Where they are no arc, the amplitude is not that of the chest.

    Parameters
    ----------
    trace, settings
        As of `measure_vital_signs`; the cell is chosen over all times.

    Returns
    -------
    DataArray (time,), m
        Positive away from the radar; in rad if the trace has no `wavelength_m`. Times that are
        more than a step from their places in equal steps, as of short frames with several values
        each, are replaced by even ones.

    Raises
    ------
    InvalidSetting
        As `measure_vital_signs`.
    """
    settings = VitalSigns() if settings is None else settings
    cells, times_s, _ = _cells_of_trace(trace, settings)
    cells, times_s = _average_to_lower_rate(cells, times_s)
    _check_times_suit_settings(times_s, settings)
    values = cells[:, int(np.argmax(_moving_energies(cells, times_s, settings)))]
    is_present = values != 0
    values, times_s = values[is_present], times_s[is_present]
    phase = np.zeros(len(values))
    if np.ptp(values):
        phase = np.unwrap(np.angle(values - fit_arc(values).centre))
        trend = slow_functions(times_s, settings.breathing_hz[0] / 2)
        phase -= trend @ (trend.T @ phase)
    even_times_s = np.linspace(times_s[0], times_s[-1], len(times_s))
    if (abs(times_s - even_times_s) > np.ptp(times_s) / (len(times_s) - 1)).any():
        # Bursts of chirps: a line, since splines would continue the noise within each over the gap.
        phase, times_s = np.interp(even_times_s, times_s, phase), even_times_s
    wavelength_m = trace.attrs.get("wavelength_m")
    return xr.DataArray(
        phase if wavelength_m is None else wavelength_m / (4 * np.pi) * phase,
        dims=("time",),
        coords={"time": ("time", times_s, {"units": "s", "long_name": "time"})},
        attrs={
            "units": "rad" if wavelength_m is None else "m",
            "long_name": "phase" if wavelength_m is None else "displacement",
        },
    )


def _units_of_sign(name: str) -> str:
    if "probability" in name:
        return "1"
    return "m" if name.endswith("amplitude") else "Hz"


def _cells_of_trace(
    trace: xr.DataArray, settings: VitalSigns
) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Return values (time, cell), times, and the range and channel of each cell."""
    times_s = trace.coords["time"].values if "time" in trace.coords else np.zeros(0)
    if "time" not in trace.dims or not np.iscomplexobj(trace):
        raise InvalidSetting(
            "trace",
            value=f"an array of {dict(trace.sizes)} and type {trace.dtype}",
            expected="complex values over time",
            fix="pass what range_traces, slow_time or read_slow_time returns",
        )
    is_increasing = (
        times_s.size > 0 and np.isfinite(times_s).all() and (np.diff(times_s) >= 0).all()
    )
    if not is_increasing or not np.isfinite(trace.values).all():
        raise InvalidSetting(
            "trace",
            value=f"{trace.sizes['time']} times"
            + (" with values that are not finite" if is_increasing else ""),
            expected="finite values at times that do not decrease",
            fix="sort the values by time, and leave out the times of those that are missing",
        )
    if "range" in trace.dims and "range" in trace.coords:
        ranges_m = trace.coords["range"].values
        is_near = (settings.range_m[0] <= ranges_m) & (ranges_m <= settings.range_m[1])
        if not is_near.any():
            raise InvalidSetting(
                "VitalSigns.range_m",
                value=f"{settings.range_m[0]:g} to {settings.range_m[1]:g} m",
                expected=f"an interval with a cell of the trace, {ranges_m.min():.3g} to"
                f" {ranges_m.max():.3g} m",
                fix="give the nearest and the farthest range of the person",
            )
        trace = trace.isel(range=is_near)
    others = [name for name in trace.dims if name != "time"]
    values = trace.transpose("time", *others).values.reshape(len(times_s), -1)
    labels = [
        trace.coords[name].values if name in trace.coords else np.arange(trace.sizes[name])
        for name in others
    ]
    grids = np.meshgrid(*labels, indexing="ij") if others else []
    coordinates = {
        str(name): grid.ravel().astype(float)
        for name, grid in zip(others, grids, strict=True)
        if name in {"range", "channel"}
    }
    return values.astype(np.complex128), np.asarray(times_s, float), coordinates


def _average_to_lower_rate(cells: np.ndarray, times_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Average blocks of values that are closer in time than a chest needs."""
    rate_hz = (len(times_s) - 1) / max(np.ptp(times_s), np.finfo(float).tiny)
    block = int(min(rate_hz // _MAX_RATE_HZ, len(times_s)))
    if block < 2:
        return cells, times_s
    n_blocks = len(times_s) // block
    complete_blocks = slice(0, n_blocks * block)
    return (
        cells[complete_blocks].reshape(n_blocks, block, -1).mean(axis=1),
        times_s[complete_blocks].reshape(n_blocks, block).mean(axis=1),
    )


def _check_times_suit_settings(times_s: np.ndarray, settings: VitalSigns) -> None:
    duration_s = float(np.ptp(times_s))
    if duration_s < settings.window_s / 2:
        raise InvalidSetting(
            "trace",
            value=f"{format_si(duration_s, 's', 3)} long",
            expected=f"{settings.window_s / 2:g} s or more, half of VitalSigns.window_s",
            fix="record longer, with one value every 0.1 s or less",
        )
    rate_hz = (len(times_s) - 1) / duration_s
    if rate_hz < 2 * settings.breathing_hz[1]:
        raise InvalidSetting(
            "trace",
            value=f"{rate_hz:.3g} values a second",
            expected=f"{2 * settings.breathing_hz[1]:.3g} or more, twice the highest breathing"
            " rate",
            fix="record frames at a higher rate, or lower VitalSigns.breathing_hz",
        )


def _withdraw_contradicting_rates(rows: list[dict[str, float]], settings: VitalSigns) -> None:
    """Make breathing not measurable where windows that share half of their time contradict.

    A person who moves about has lines in the band of breathing that differ from window to window.
    """
    contradicting: set[int] = set()
    for index, (row, following) in enumerate(itertools.pairwise(rows)):
        if following["time"] - row["time"] > 0.55 * settings.window_s:
            continue
        slower, faster = sorted((row, following), key=lambda one: one["breathing_rate"])
        ratio = faster["breathing_rate_low"] / slower["breathing_rate_high"]
        if ratio > _LARGEST_RATIO_OF_NEIGHBOURS:
            contradicting |= {index, index + 1}
    for index in contradicting:
        for name in ("rate", "rate_low", "rate_high", "amplitude"):
            rows[index][f"breathing_{name}"] = math.nan


def _has_too_few_values(times_s: np.ndarray, settings: VitalSigns) -> bool:
    """Return whether a window spans a gap that leaves less than a trace needs at least."""
    least = settings.breathing_hz[1] * settings.window_s  # half a window at the Nyquist rate
    return len(times_s) < max(least, 2) or float(np.ptp(times_s)) < 0.45 * settings.window_s


def _window_starts_s(times_s: np.ndarray, settings: VitalSigns) -> np.ndarray:
    """Return the starts of the windows; one if the trace is not longer than a window."""
    step_s = np.ptp(times_s) / (len(times_s) - 1)
    spare_s = float(np.ptp(times_s)) + step_s - settings.window_s
    return times_s[0] + settings.step_s * np.arange(
        max(spare_s / settings.step_s + 1e-6, 0) // 1 + 1
    )


def _measure_window(
    cells: np.ndarray,
    times_s: np.ndarray,
    coordinates: dict[str, np.ndarray],
    wavelength_m: float,
    settings: VitalSigns,
) -> dict[str, float]:
    """Measure both rates of one window."""
    energies = _moving_energies(cells, times_s, settings)
    strongest_cell = int(np.argmax(energies))
    row = {name: float(values[strongest_cell]) for name, values in coordinates.items()}
    is_present = cells[:, strongest_cell] != 0
    values, times_s = cells[is_present, strongest_cell], times_s[is_present]
    is_moving = energies >= _MIN_SHARE_OF_MOVEMENT * energies[strongest_cell]
    moving = cells[np.ix_(is_present, is_moving)]
    breathing = heart = None
    amplitude_scale_m = math.nan
    if len(values) >= len(is_present) / 2 and np.ptp(values):
        breathing, heart, is_phase = _find_breathing_and_heart(values, moving, times_s, settings)
        amplitude_scale_m = wavelength_m / (4 * np.pi) if is_phase else math.nan
    row |= _row_of_line("breathing", breathing, amplitude_scale_m, settings)
    return row | _row_of_line("heart", heart, amplitude_scale_m, settings)


def _moving_energies(cells: np.ndarray, times_s: np.ndarray, settings: VitalSigns) -> np.ndarray:
    """Return the energy of each cell after removal of slow trends, (cell,)."""
    trend = slow_functions(times_s, settings.breathing_hz[0] / 2)
    changes = cells - trend @ (trend.T @ cells)
    return np.asarray(np.sum(abs(changes) ** 2, axis=0))


def _find_breathing_and_heart(
    values: np.ndarray, moving: np.ndarray, times_s: np.ndarray, settings: VitalSigns
) -> tuple[Line | None, Line | None, bool]:
    """Find both lines, in the phase about the centre of the arc or in I and Q.

    I and Q are periodic as the chest is, whatever their path. They replace the phase where they
    are not near a circle and show breathing with more significance. If neither has a significant
    line, those of all cells in `moving` (time, cell) replace them. Where I and Q have one, a faster
    significant rate of the phase or of all cells replaces it.
    """
    arc = fit_arc(values)
    phase = np.unwrap(np.angle(values - arc.centre))[:, None]
    error = max(arc.noise_std, arc.radius_std) / arc.radius
    of_phase = _find_lines(phase, times_s, settings)
    if error < _CLEAN_ARC_ERROR:
        return *of_phase, True
    of_quadratures = _find_lines(_in_phase_and_quadrature(values[:, None]), times_s, settings)
    choices = [of_quadratures]
    if arc.radius_std < _CLEAN_ARC_ERROR * arc.radius:
        choices.append(of_phase)
    chosen = min(choices, key=_breathing_probability)
    n_choices = 2 if moving.shape[1] == 1 else 3
    highest_probability = settings.false_alarm_probability / n_choices
    if _breathing_probability(chosen) > highest_probability:
        joint = _find_lines_of_all_cells(moving, times_s, settings)
        if _breathing_probability(joint) < _breathing_probability(chosen):
            chosen = _prefer_rate_of_strongest_cell(chosen, joint, float(np.ptp(times_s)))
    elif chosen is of_quadratures and _n_harmonics(chosen) > 1:
        if moving.shape[1] > 1:
            choices.append(_find_lines_of_all_cells(moving, times_s, settings))
        chosen = _prefer_rate_of_harmonic(chosen, choices[1:], highest_probability)
    breathing, heart = (_multiply_probability(line, n_choices) for line in chosen)
    return breathing, heart, chosen is of_phase


def _find_lines_of_all_cells(
    moving: np.ndarray, times_s: np.ndarray, settings: VitalSigns
) -> tuple[Line | None, Line | None]:
    """Find both lines in the decorrelated I and Q of cells (time, cell) together."""
    trend = slow_functions(times_s, settings.breathing_hz[0] / 2)
    quadratures = _in_phase_and_quadrature(moving)
    return _find_lines(
        _decorrelate(quadratures, trend, times_s, _DECORRELATION_LAG_S),
        times_s,
        settings,
        heart_movement=_decorrelate(quadratures, trend, times_s, _HEART_DECORRELATION_LAG_S),
    )


def _n_harmonics(lines: tuple[Line | None, Line | None]) -> int:
    breathing, _ = lines
    return 0 if breathing is None else breathing.n_harmonics


def _prefer_rate_of_harmonic(
    of_quadratures: tuple[Line | None, Line | None],
    others: list[tuple[Line | None, Line | None]],
    highest_probability: float,
) -> tuple[Line | None, Line | None]:
    """Return the lines of another description with a faster significant rate, or the given ones.

    I and Q rotate by more than a turn when a chest moves by half a wavelength. Breaths that differ
    by a twentieth of it then differ by half a radian, and a part of the rate has them all as
    harmonics: of two, or of five in twice the time. The phase and other cells show the rate itself.
    """
    breathing, _ = of_quadratures
    assert breathing is not None
    lowest_hz = _LEAST_RATIO_OF_RATES * breathing.frequency_hz
    highest_hz = breathing.n_harmonics * breathing.frequency_hz * _LEAST_RATIO_OF_RATES
    faster = [
        lines
        for lines in others
        if lines[0] is not None
        and _breathing_probability(lines) <= highest_probability
        and lowest_hz <= lines[0].frequency_hz <= highest_hz
    ]
    return min(faster, key=_breathing_probability, default=of_quadratures)


def _prefer_rate_of_strongest_cell(
    single: tuple[Line | None, Line | None],
    joint: tuple[Line | None, Line | None],
    duration_s: float,
) -> tuple[Line | None, Line | None]:
    """Return the lines of all cells, with the breathing of the strongest cell if it is the same.

    All cells together decide whether a person breathes. Their decorrelated components weigh every
    movement alike, so the rate of the cell that moves most is nearer to that of the chest.
    """
    breathing, of_all = single[0], joint[0]
    if (
        breathing is None
        or of_all is None
        or breathing.false_alarm_probability > _MAX_PROBABILITY_OF_SAME_LINE
        or abs(breathing.frequency_hz - of_all.frequency_hz) > 1 / duration_s
    ):
        return joint
    return replace(breathing, false_alarm_probability=of_all.false_alarm_probability), joint[1]


def _in_phase_and_quadrature(cells: np.ndarray) -> np.ndarray:
    """Return real and imaginary parts, (time, 2 cell)."""
    return np.concatenate([cells.real, cells.imag], axis=1)


def _decorrelate(
    components: np.ndarray, trend: np.ndarray, times_s: np.ndarray, lag_s: float
) -> np.ndarray:
    """Return components whose changes over a time are uncorrelated and of unit power.

    Neighbouring cells have correlated noise. Of slow noise, such as a random walk, the principal
    components of the values themselves would be sinusoids.
    """
    values = components - trend @ (trend.T @ components)
    step_s = float(np.ptp(times_s)) / (len(times_s) - 1)
    lag = max(round(lag_s / step_s), 1)
    changes = values[lag:] - values[:-lag]
    power, axes = np.linalg.eigh(changes.T @ changes)
    is_kept = power > _MIN_SHARE_OF_POWER * power[-1]
    return np.asarray(values @ axes[:, is_kept] / np.sqrt(power[is_kept]))


def _breathing_probability(lines: tuple[Line | None, Line | None]) -> float:
    breathing, _ = lines
    return 1.0 if breathing is None else breathing.false_alarm_probability


def _multiply_probability(line: Line | None, n_choices: int) -> Line | None:
    """Account for the choice between descriptions of the movement."""
    if line is None:
        return None
    probability = min(n_choices * line.false_alarm_probability, 1.0)
    return replace(line, false_alarm_probability=probability)


def _find_lines(
    movement: np.ndarray,
    times_s: np.ndarray,
    settings: VitalSigns,
    *,
    heart_movement: np.ndarray | None = None,
) -> tuple[Line | None, Line | None]:
    """Find the lines of breathing and heart, the heart apart from harmonics of breathing.

    `heart_movement` replaces the movement (time, component) where the heart is searched.
    """
    times_s = times_s - times_s.mean()
    trend = slow_functions(times_s, settings.breathing_hz[0] / 2)
    nyquist_hz = (len(times_s) - 1) / (2 * np.ptp(times_s))
    top_hz = min(settings.heart_hz[1], 0.9 * nyquist_hz)
    # Up to second harmonics. Over all of the heart's band, the slope of a random walk in white
    # noise of its power at 1 Hz is too low for breathing: 14 false of 200 below 1 %, not 2.
    slope_hz = settings.breathing_hz[0], min(2 * settings.breathing_hz[1], top_hz)
    slope = fit_noise_slope(movement, times_s, slope_hz, trend)
    max_harmonics = max(1, min(_MAX_HARMONICS, int(nyquist_hz / settings.breathing_hz[1])))

    def find_breathing(basis: np.ndarray) -> Line | None:
        return find_line(
            movement,
            times_s,
            settings.breathing_hz,
            basis=basis,
            noise_slope=slope,
            max_harmonics=max_harmonics,
        )

    breathing = find_breathing(trend)
    heart_hz = (settings.heart_hz[0], top_hz)
    if heart_hz[0] >= heart_hz[1]:
        return breathing, None
    basis, excluded_hz = trend, []
    if breathing is not None and breathing.false_alarm_probability < 0.1:
        rate_hz, std_hz = breathing.frequency_hz, breathing.frequency_std_hz
        orders = np.arange(1, math.floor(heart_hz[1] / rate_hz) + 1)
        basis = join_bases(trend, sinusoids(times_s, orders * rate_hz))
        for order in orders.tolist():
            half_hz = 1 / float(np.ptp(times_s)) + 3 * order * std_hz
            excluded_hz.append((order * rate_hz - half_hz, order * rate_hz + half_hz))
    if heart_movement is None:
        heart_movement = movement
    excluded = tuple(excluded_hz)
    heart_slope = fit_noise_slope(heart_movement, times_s, heart_hz, basis, excluded_hz=excluded)
    heart = find_line(
        heart_movement,
        times_s,
        heart_hz,
        basis=basis,
        noise_slope=heart_slope,
        excluded_hz=excluded,
    )
    highest_probability = settings.false_alarm_probability
    if heart is not None and heart.false_alarm_probability <= highest_probability:
        heart = find_fundamental(
            heart,
            heart_movement,
            times_s,
            heart_hz,
            basis=basis,
            noise_slope=heart_slope,
            excluded_hz=excluded,
            false_alarm_probability=highest_probability,
        )
    if (
        breathing is not None
        and heart is not None
        and heart.false_alarm_probability <= highest_probability
    ):
        # A heart of a tenth of the breathing would move the rate by some of its standard errors.
        with_heart = join_bases(trend, sinusoids(times_s, np.array([heart.frequency_hz])))
        probability = breathing.false_alarm_probability
        refined = find_breathing(with_heart) or breathing
        breathing = replace(refined, false_alarm_probability=probability)
    return breathing, heart


def _row_of_line(
    sign: _Sign, line: Line | None, amplitude_scale_m: float, settings: VitalSigns
) -> dict[str, float]:
    row = dict.fromkeys(
        [f"{sign}_rate", f"{sign}_rate_low", f"{sign}_rate_high", f"{sign}_amplitude"], math.nan
    )
    row[f"{sign}_false_alarm_probability"] = 1.0 if line is None else line.false_alarm_probability
    if line is not None and line.false_alarm_probability <= settings.false_alarm_probability:
        low_hz, high_hz = rate_interval_hz(line, settings.confidence)
        row |= {
            f"{sign}_rate": line.frequency_hz,
            f"{sign}_rate_low": low_hz,
            f"{sign}_rate_high": high_hz,
            f"{sign}_amplitude": line.amplitude * amplitude_scale_m,
        }
    return row
