"""Displacement of a chest over slow time, and its spectrum with the measured rates."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase

from dechirp.report.figures.common import add_legend, create_panels
from dechirp.report.figures.style import BLUE, GREEN, INK, ORANGE

_MAX_RATE_HZ = 2.5
_SIGN_COLORS = {"breathing": ORANGE, "heart": GREEN}


def draw_vital_signs(
    figure: FigureBase, displacement: xr.DataArray, spectrum: xr.DataArray, vital: xr.Dataset
) -> list[Axes]:
    """Draw the displacement over time, and below its spectrum with the intervals of the rates.

    Parameters
    ----------
    figure : FigureBase
        Figure to draw on.
    displacement : DataArray (time,)
        As `chest_displacement` returns it.
    spectrum : DataArray (frequency,)
        Its amplitude spectrum.
    vital : Dataset over `window`
        Rates with intervals.

    Returns
    -------
    list of Axes
        The panels.
    """
    upper, lower = create_panels(figure, 2, 1)[:, 0]
    return [draw_displacement(upper, displacement), _draw_spectrum(lower, spectrum, vital)]


def draw_displacement(axes: Axes, displacement: xr.DataArray) -> Axes:
    """Draw a displacement in mm over time, or a phase where the wavelength is unknown."""
    scale, label = _unit_of(displacement)
    axes.plot(displacement.time.values, scale * displacement.values, color=BLUE, linewidth=0.9)
    axes.set_xlabel("Time (s)")
    axes.set_ylabel(label)
    axes.set_label("Displacement of the chest over time")
    return axes


def _draw_spectrum(axes: Axes, spectrum: xr.DataArray, vital: xr.Dataset) -> Axes:
    shown = spectrum.isel(frequency=spectrum.frequency.values <= _MAX_RATE_HZ)
    scale, quantity = _unit_of(spectrum)
    axes.plot(60 * shown.frequency.values, scale * shown.values, color=INK, linewidth=0.9)
    for sign, color in _SIGN_COLORS.items():
        rates, lows, highs = (
            60 * vital[f"{sign}_rate{end}"].values for end in ("", "_low", "_high")
        )
        for number, index in enumerate(np.flatnonzero(np.isfinite(rates))):
            label = None if number else f"{sign}, {vital.attrs['confidence']:.0%} interval"
            axes.axvspan(lows[index], highs[index], color=color, alpha=0.3, label=label)
            axes.axvline(rates[index], color=color, linewidth=0.9)
    axes.set_xlim(0, 60 * _MAX_RATE_HZ)
    axes.set_ylim(bottom=0)
    axes.set_xlabel("Rate (1/min)")
    axes.set_ylabel(quantity)
    add_legend(axes)
    axes.set_label("Spectrum of the displacement, with the measured rates")
    return axes


def _unit_of(displacement: xr.DataArray) -> tuple[float, str]:
    if displacement.attrs.get("units") == "rad":
        return 1.0, "Phase (rad)"
    return 1e3, "Displacement (mm)"
