"""Power over direction: range-azimuth map, and spectrum of one detection."""

from typing import NamedTuple

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.axis import Axis

from dechirp.core.text import format_fixed, power_level_unit, power_to_dbm_or_dbfs
from dechirp.core.units import to_decibels
from dechirp.core.values import frozen_dataclass
from dechirp.report.figures.common import (
    AXIS_LABELS,
    add_colour_bar,
    add_legend,
    draw_detection_circles,
    draw_truth_marks,
    outer_cell_edges,
)
from dechirp.report.figures.range_doppler import block_maxima
from dechirp.report.figures.style import BLUE, COLORS, INK, ORANGE
from dechirp.report.labels import (
    AZIMUTH_LABEL,
    ELEVATION_LABEL,
    POWER_RELATIVE_TO_PEAK_LABEL,
    power_label,
)

# The map is a maximum over velocity, so its median is a stable noise level.
_BELOW_NOISE_DB, _LARGEST_SPAN_DB, _LEAST_SPAN_DB = 3.0, 70.0, 20.0
_MOST_PIXELS = (400, 400)
_FLOOR_DB = -40.0
_DEGREES = np.array([-90, -60, -45, -30, -15, 0, 15, 30, 45, 60, 90])
_FINE_DEGREES = np.arange(-30, 31, 5)
_MOST_NAMED = 4


class Directions(NamedTuple):
    """Directions in rad, (n,) each; 0 if the array does not resolve the angle."""

    azimuth_rad: np.ndarray
    elevation_rad: np.ndarray


@frozen_dataclass
class RangeAzimuthMap:
    """Range-azimuth map with the positions to mark."""

    power: xr.DataArray
    """Power, (azimuth, range)."""
    units: str
    """Units of the samples."""
    detections: tuple[np.ndarray, np.ndarray] | None = None
    """Azimuths (rad) and ranges (m) of the detections."""
    truth: tuple[np.ndarray, np.ndarray] | None = None


def draw_range_azimuth_map(axes: Axes, marked: RangeAzimuthMap) -> Axes:
    """Draw the map over the sine of the azimuth, in which the beamwidth is constant.

    Parameters
    ----------
    axes : Axes
        Axes to draw on; the colour bar uses part of their space.
    marked : RangeAzimuthMap
        Map with the positions to mark.

    Returns
    -------
    Axes
        The given axes.
    """
    power = marked.power.transpose("range", "azimuth")
    level_db = power_to_dbm_or_dbfs(block_maxima(power.values, _MOST_PIXELS), marked.units)
    highest = float(level_db.max())
    lowest = max(float(np.median(level_db)) - _BELOW_NOISE_DB, highest - _LARGEST_SPAN_DB)
    sines, range_m = np.sin(power.azimuth.values), power.range.values
    ends_m = [
        marks[1].max(initial=0.0)
        for marks in (marked.detections, marked.truth)
        if marks is not None
    ]
    nearest, farthest = outer_cell_edges(range_m)
    # Only noise lies beyond the marked ranges.
    max_shown_m = min(farthest, 1.3 * max(ends_m)) if max(ends_m, default=0.0) > 0 else farthest
    min_sine, max_sine = outer_cell_edges(sines)
    image = axes.imshow(
        level_db,
        cmap=COLORS,
        vmin=min(lowest, highest - _LEAST_SPAN_DB),
        vmax=highest,
        extent=(min_sine, max_sine, nearest, farthest),
        origin="lower",
        aspect="auto",
        interpolation="bilinear",
    )
    add_colour_bar(axes, image, power_label(power_level_unit(marked.units)))
    _set_degree_ticks_on_sine_axis(axes.xaxis, sines)
    axes.grid(False)
    axes.set(xlim=(max_sine, min_sine), ylim=(0, max_shown_m), autoscale_on=False)
    axes.set_xlabel(AZIMUTH_LABEL)
    axes.set_ylabel(AXIS_LABELS["range"])
    if marked.truth is not None:
        draw_truth_marks(axes, np.sin(marked.truth[0]), marked.truth[1])
    if marked.detections is not None:
        draw_detection_circles(axes, np.sin(marked.detections[0]), marked.detections[1], size=9)
    add_legend(axes)
    axes.set_label("Range-azimuth map")
    return axes


def draw_angle_spectrum(
    axes: Axes, power: xr.DataArray, *, estimates: Directions, truth: Directions | None = None
) -> Axes:
    """Draw the spectrum of one detection as a line or as a map of both angles.

    The spectrum is in dB relative to its peak, with the estimated and the true directions.

    Parameters
    ----------
    axes : Axes
        Axes to draw on; the colour bar of a map uses part of their space.
    power : DataArray (elevation, azimuth)
        Result of `processing.angle_maps.angle_spectrum`; one of the axes may have a single value.
    estimates : Directions
        Estimated directions, rad.
    truth : Directions, optional
        True directions, rad.

    Returns
    -------
    Axes
        The given axes.
    """
    level = power.transpose("elevation", "azimuth").values
    level_db = np.maximum(to_decibels(np.maximum(level / level.max(), 1e-30)), _FLOOR_DB)
    azimuth, elevation = power.azimuth.values, power.elevation.values
    if len(azimuth) > 1 and len(elevation) > 1:
        _draw_spectrum_over_both_angles(axes, power, level_db, estimates, truth)
    elif len(azimuth) > 1:
        _draw_spectrum_over_one_angle(
            axes, azimuth, level_db[0], estimates.azimuth_rad, truth and truth.azimuth_rad
        )
        axes.invert_xaxis()
        axes.set_xlabel(AZIMUTH_LABEL)
    else:
        true_elevation_rad = truth and truth.elevation_rad
        _draw_spectrum_over_one_angle(
            axes, elevation, level_db[:, 0], estimates.elevation_rad, true_elevation_rad
        )
        axes.set_xlabel(ELEVATION_LABEL)
    add_legend(axes)
    axes.set_label("Spectrum over directions")
    return axes


def _draw_spectrum_over_one_angle(
    axes: Axes,
    angle_rad: np.ndarray,
    level_db: np.ndarray,
    estimated_rad: np.ndarray,
    truth_rad: np.ndarray | None,
) -> None:
    sines = np.sin(angle_rad)
    axes.plot(sines, level_db, color=BLUE, linewidth=1.2)
    for number, angle in enumerate(estimated_rad):
        label = "estimate" if number == 0 else None
        axes.axvline(np.sin(angle), color=ORANGE, linewidth=1.3, label=label)
        if number < _MOST_NAMED:
            axes.annotate(
                f"{format_fixed(np.degrees(angle), 1)}°",
                (np.sin(angle), 0),
                (4, 2),
                textcoords="offset points",
                color=ORANGE,
                annotation_clip=True,
            )
    for number, angle in enumerate(() if truth_rad is None else truth_rad):
        label = "truth" if number == 0 else None
        axes.axvline(np.sin(angle), color=INK, linewidth=0.9, linestyle=(0, (4, 3)), label=label)
    _set_degree_ticks_on_sine_axis(axes.xaxis, sines)
    margin = 0.0 if len(sines) > 1 else 0.01  # a field of view narrower than a beam is one point
    axes.set(xlim=(sines[0] - margin, sines[-1] + margin), ylim=(_FLOOR_DB, 3))
    axes.set_ylabel(POWER_RELATIVE_TO_PEAK_LABEL)


def _draw_spectrum_over_both_angles(
    axes: Axes,
    power: xr.DataArray,
    level_db: np.ndarray,
    estimates: Directions,
    truth: Directions | None,
) -> None:
    azimuth_sines, elevation_sines = np.sin(power.azimuth.values), np.sin(power.elevation.values)
    image = axes.imshow(
        level_db,
        cmap=COLORS,
        vmin=_FLOOR_DB / 2,
        vmax=0,
        extent=(*outer_cell_edges(azimuth_sines), *outer_cell_edges(elevation_sines)),
        origin="lower",
        aspect="auto",
        interpolation="bilinear",
    )
    add_colour_bar(axes, image, POWER_RELATIVE_TO_PEAK_LABEL)
    _set_degree_ticks_on_sine_axis(axes.xaxis, azimuth_sines)
    _set_degree_ticks_on_sine_axis(axes.yaxis, elevation_sines)
    axes.grid(False)
    axes.set(
        xlim=outer_cell_edges(azimuth_sines)[::-1],
        ylim=outer_cell_edges(elevation_sines),
        autoscale_on=False,
    )
    axes.set_xlabel(AZIMUTH_LABEL)
    axes.set_ylabel(ELEVATION_LABEL)
    if truth is not None:
        draw_truth_marks(axes, *np.sin(truth))
    draw_detection_circles(axes, *np.sin(estimates), size=9)


def _set_degree_ticks_on_sine_axis(axis: Axis, sines: np.ndarray) -> None:
    """Set ticks in degrees on an axis of sines."""
    largest_sine = abs(sines).max()
    degrees = _DEGREES if largest_sine > np.sin(np.radians(31)) else _FINE_DEGREES
    degrees = degrees[abs(np.sin(np.radians(degrees))) <= largest_sine]
    axis.set_ticks(
        np.sin(np.radians(degrees)), [format_fixed(float(angle), 0) for angle in degrees]
    )
