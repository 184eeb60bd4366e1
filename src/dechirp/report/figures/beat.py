"""Figures of the beat signal of the first chirp, and of its spectrum."""

import math
from typing import Literal

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase

from dechirp.core.display import format_count_with_noun
from dechirp.core.text import (
    format_power_of_ten,
    power_level_unit,
    power_to_dbm_or_dbfs,
    sample_unit_symbol,
)
from dechirp.processing.chain import Chain
from dechirp.processing.spectrum import range_profiles
from dechirp.radar.chirp import Chirp
from dechirp.report.figures.common import AXIS_LABELS, add_legend, create_panels
from dechirp.report.figures.style import BLUE, INK, reduce_line_to_extremes
from dechirp.report.labels import TIME_SINCE_RAMP_START_LABEL, power_label

SignalPart = Literal["real", "imaginary"]

_COLORS: dict[SignalPart, str] = {"real": "#8fbbdb", "imaginary": "#e5b08c"}
_REAL_SAMPLES_COLOR = "#4d94c6"
_MAX_CHIRPS = 256  # averaged for the spectrum, which is then smooth to 0.3 dB


def draw_first_chirp_signal(
    axes: Axes,
    cube: xr.DataArray,
    *,
    part: SignalPart = "real",
    doppler_frequency_hz: float | None = None,
) -> Axes:
    """Draw the samples of the first chirp at the first receiver over fast time.

    Parameters
    ----------
    axes : Axes
        Axes to draw on.
    cube : DataArray (frame, chirp, rx, sample)
        Complex or real samples, sqrt(W) or full scale; chirps of one slot if slots differ.
    part : real or imaginary
        Part of complex samples to draw.
    doppler_frequency_hz : float, optional
        Doppler frequency of a detection, to draw its echo as well: the mean over the chirps, each
        corrected by its Doppler phase. Complex samples only.

    Returns
    -------
    Axes
        The given axes.
    """
    first = cube.isel(frame=0, chirp=0, rx=0)
    samples, time_us = first.values, first["sample"].values * 1e6
    is_complex = np.iscomplexobj(samples)
    part_function = np.real if part == "real" else np.imag
    exponent = engineering_exponent(float(abs(samples).max()))
    scaled = samples / 10.0**exponent
    axes.plot(
        *reduce_line_to_extremes(time_us, part_function(scaled)),
        color=_COLORS[part] if is_complex else _REAL_SAMPLES_COLOR,
        linewidth=0.7,
    )
    if doppler_frequency_hz is not None and is_complex:
        chirps = cube.isel(frame=0, rx=0, chirp=slice(_MAX_CHIRPS)).transpose("chirp", "sample")
        phasors = np.exp(-2j * np.pi * doppler_frequency_hz * chirps["chirp"].values)
        echo = phasors @ chirps.values / phasors.size
        axes.plot(
            *reduce_line_to_extremes(time_us, part_function(echo) / 10.0**exponent),
            color=INK,
            linewidth=0.8,
        )
    reach = 1.1 * float(max(abs(scaled.real).max(), abs(scaled.imag).max())) or 1.0
    axes.set(ylim=(-reach, reach), xlim=(time_us[0], time_us[-1]))
    unit = sample_unit_symbol(cube.attrs.get("units"))
    unit = unit if exponent == 0 else f"{format_power_of_ten(exponent)} {unit}"
    name = f"{part.capitalize()} part" if is_complex else "Samples"
    axes.set_ylabel(f"{name}\n({unit})")
    axes.set_xlabel(TIME_SINCE_RAMP_START_LABEL)
    part_text = f", {part} part" if is_complex else ""
    axes.set_label(f"Beat signal of the first chirp over time{part_text}")
    return axes


def draw_first_chirp_signal_parts(
    figure: FigureBase, cube: xr.DataArray, *, doppler_frequency_hz: float | None = None
) -> list[Axes]:
    """Draw the real and imaginary part of complex samples one above the other, or real samples.

    Parameters
    ----------
    figure : Figure or SubFigure
        Figure to fill.
    cube, doppler_frequency_hz
        See `draw_first_chirp_signal`.

    Returns
    -------
    list of Axes
        Axes of the real and of the imaginary part.
    """
    parts: tuple[SignalPart, ...] = ("real", "imaginary") if np.iscomplexobj(cube) else ("real",)
    rows = create_panels(figure, len(parts), 1, sharex=True)[:, 0].tolist()
    for axes, part in zip(rows, parts, strict=True):
        draw_first_chirp_signal(axes, cube, part=part, doppler_frequency_hz=doppler_frequency_hz)
        axes.label_outer()
    return rows


def draw_beat_spectrum_over_range(
    axes: Axes,
    cube: xr.DataArray,
    chirp: Chirp,
    chain: Chain,
    *,
    truth_m: np.ndarray | None = None,
    end_m: float | None = None,
) -> Axes:
    """Draw power over range of the first chirp, and the mean power over the chirps.

    Parameters
    ----------
    axes : Axes
        Axes to draw on.
    cube : DataArray (frame, chirp, rx, sample)
        The first frame of the first receiver is shown; chirps of one slot if ramps differ.
    chirp : Chirp
        Transmitted chirp.
    chain : Chain
        Chain with the window and the length of the transform.
    truth_m : array (n,), optional
        True ranges of the echoes, marked below the line.
    end_m : float, optional
        Range at which the axis ends; default: the largest range of the spectrum.

    Returns
    -------
    Axes
        The given axes.
    """
    transform = chain.range_transform(chirp)
    chirps = cube.isel(frame=0, rx=0, chirp=slice(_MAX_CHIRPS))
    profiles = range_profiles(chirps, chirp, transform).transpose("chirp", "range")
    power, range_m = abs(profiles.values) ** 2, profiles.range.values
    end_m = float(range_m[-1]) if end_m is None else end_m
    n_shown = int(np.searchsorted(range_m, end_m, side="right"))
    power, range_m = power[:, :n_shown], range_m[:n_shown]
    units = cube.attrs.get("units", "")
    first, mean = (
        power_to_dbm_or_dbfs(power[0], units),
        power_to_dbm_or_dbfs(power.mean(axis=0), units),
    )
    # Single noise cells can be arbitrarily low: the axis ends 12 dB below their median, or below
    # all but 5 % of the mean power where strong echoes fill the axis.
    lowest = min(float(np.median(first)) - 12, float(np.quantile(mean, 0.05)) - 3)
    highest = float(max(first.max(), mean.max()))
    axes.plot(
        *reduce_line_to_extremes(range_m, np.maximum(first, lowest)),
        color="#b4bec8",
        linewidth=0.6,
        label="first chirp",
    )
    axes.plot(
        *reduce_line_to_extremes(range_m, mean),
        color=BLUE,
        linewidth=1.0,
        label=f"mean power of {format_count_with_noun(power.shape[0], 'chirp')}",
    )
    shown_m = np.asarray([] if truth_m is None else truth_m)
    shown_m = shown_m[shown_m <= end_m]
    if shown_m.size:
        axes.plot(
            shown_m,
            np.full(shown_m.size, lowest + 0.02 * (highest - lowest)),
            linestyle="",
            marker="^",
            markersize=5,
            color=INK,
            label="truth",
        )
    axes.set(xlim=(0, end_m), ylim=(lowest, highest + 0.05 * (highest - lowest) + 1))
    axes.set_xlabel(AXIS_LABELS["range"])
    axes.set_ylabel(power_label(power_level_unit(units)))
    add_legend(axes)
    axes.set_label("Spectrum of the beat signal over range")
    return axes


def engineering_exponent(largest: float) -> int:
    """Return the multiple of three by whose power of ten an amplitude becomes 1 to 1000."""
    if not (math.isfinite(largest) and largest > 0):
        return 0
    return 3 * math.floor(math.log10(largest) / 3)
