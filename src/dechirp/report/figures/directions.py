"""Power over directions: of all ranges, and of one detection."""

from typing import NamedTuple

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.axis import Axis

from dechirp.core.units import decibels
from dechirp.core.values import value
from dechirp.core.words import fixed, power_db, power_unit
from dechirp.report.figures.parts import (
    MAP_AXES,
    circles,
    colour_bar,
    crosses,
    edges,
    legend,
)
from dechirp.report.figures.range_doppler import reduced
from dechirp.report.figures.style import BLUE, COLORS, INK, ORANGE

# The map is the strongest of all velocities: its median is noise, and steady.
_BELOW_NOISE_DB, _LARGEST_SPAN_DB, _LEAST_SPAN_DB = 3.0, 70.0, 20.0
_MOST_PIXELS = (400, 400)
_FLOOR_DB = -40.0
_DEGREES = np.array([-90, -60, -45, -30, -15, 0, 15, 30, 45, 60, 90])
_FINE_DEGREES = np.arange(-30, 31, 5)
_MOST_NAMED = 4
_AZIMUTH, _ELEVATION = "azimuth, ° (left positive)", "elevation, ° (up positive)"


class Towards(NamedTuple):
    """Directions, in rad, (n,) each; 0 where the array does not tell one."""

    azimuth_rad: np.ndarray
    elevation_rad: np.ndarray


@value
class RangeAzimuth:
    """A map, and the places on it to mark: ranges as they lie on maps."""

    power: xr.DataArray
    """(azimuth, range)."""
    units: str
    """Of the samples."""
    found: tuple[np.ndarray, np.ndarray] | None = None
    """Azimuths (rad) and ranges (m) of the detections."""
    truth: tuple[np.ndarray, np.ndarray] | None = None


def range_azimuth(axes: Axes, marked: RangeAzimuth) -> Axes:
    """Draw the map in sines of the azimuth, over which a beam is equally wide everywhere.

    Parameters
    ----------
    axes : Axes
        To draw on; a colour bar takes of their room.
    marked : RangeAzimuth
        The map, and what is marked on it.

    Returns
    -------
    Axes
        Those given.
    """
    power = marked.power.transpose("range", "azimuth")
    level_db = power_db(reduced(power.values, _MOST_PIXELS), marked.units)
    highest = float(level_db.max())
    lowest = max(float(np.median(level_db)) - _BELOW_NOISE_DB, highest - _LARGEST_SPAN_DB)
    sines, range_m = np.sin(power.azimuth.values), power.range.values
    ends_m = [of[1].max(initial=0.0) for of in (marked.found, marked.truth) if of is not None]
    nearest, farthest = edges(range_m)
    # Beyond what was found there is noise.
    shown_m = min(farthest, 1.3 * max(ends_m)) if max(ends_m, default=0.0) > 0 else farthest
    left, right = edges(sines)
    image = axes.imshow(
        level_db,
        cmap=COLORS,
        vmin=min(lowest, highest - _LEAST_SPAN_DB),
        vmax=highest,
        extent=(left, right, nearest, farthest),
        origin="lower",
        aspect="auto",
        interpolation="bilinear",
    )
    colour_bar(axes, image, f"power, {power_unit(marked.units)}")
    _sine_axis(axes.xaxis, sines)
    axes.grid(False)
    axes.set(xlim=(right, left), ylim=(0, shown_m), autoscale_on=False)
    axes.set_xlabel(_AZIMUTH)
    axes.set_ylabel(MAP_AXES["range"])
    if marked.truth is not None:
        crosses(axes, np.sin(marked.truth[0]), marked.truth[1])
    if marked.found is not None:
        circles(axes, np.sin(marked.found[0]), marked.found[1], size=9)
    legend(axes)
    axes.set_label("Range-azimuth map")
    return axes


def spectrum(axes: Axes, of: xr.DataArray, *, found: Towards, truth: Towards | None = None) -> Axes:
    """Draw the spectrum of one detection, a line, or a map of both angles.

    In decibels relative to its peak; with the directions found, and those of the truth.

    Parameters
    ----------
    axes : Axes
        To draw on; a map has a colour bar, which takes of their room.
    of : DataArray (elevation, azimuth)
        Power over directions, as `process.angle_maps.angle_spectrum` gives it; one of the axes
        may have one value alone.
    found : Towards
        Directions found, rad.
    truth : Towards, optional
        True ones, rad.

    Returns
    -------
    Axes
        Those given.
    """
    level = of.transpose("elevation", "azimuth").values
    level_db = np.maximum(decibels(np.maximum(level / level.max(), 1e-30)), _FLOOR_DB)
    azimuth, elevation = of.azimuth.values, of.elevation.values
    if len(azimuth) > 1 and len(elevation) > 1:
        _both(axes, of, level_db, found, truth)
    elif len(azimuth) > 1:
        _line(axes, azimuth, level_db[0], found.azimuth_rad, truth and truth.azimuth_rad)
        axes.invert_xaxis()
        axes.set_xlabel(_AZIMUTH)
    else:
        at = truth and truth.elevation_rad
        _line(axes, elevation, level_db[:, 0], found.elevation_rad, at)
        axes.set_xlabel(_ELEVATION)
    legend(axes)
    axes.set_label("Spectrum over directions")
    return axes


def _line(
    axes: Axes,
    angle_rad: np.ndarray,
    level_db: np.ndarray,
    found_rad: np.ndarray,
    truth_rad: np.ndarray | None,
) -> None:
    sines = np.sin(angle_rad)
    axes.plot(sines, level_db, color=BLUE, linewidth=1.2)
    for number, at in enumerate(found_rad):
        label = "found" if number == 0 else None
        axes.axvline(np.sin(at), color=ORANGE, linewidth=1.3, label=label)
        if number < _MOST_NAMED:
            axes.annotate(
                f"{fixed(np.degrees(at), 1)}°",
                (np.sin(at), 0),
                (4, 2),
                textcoords="offset points",
                color=ORANGE,
                annotation_clip=True,
            )
    for number, at in enumerate(() if truth_rad is None else truth_rad):
        label = "truth" if number == 0 else None
        axes.axvline(np.sin(at), color=INK, linewidth=0.9, linestyle=(0, (4, 3)), label=label)
    _sine_axis(axes.xaxis, sines)
    beside = 0.0 if len(sines) > 1 else 0.01  # a field of view narrower than a beam is one point
    axes.set(xlim=(sines[0] - beside, sines[-1] + beside), ylim=(_FLOOR_DB, 3))
    axes.set_ylabel("spectrum relative to its peak, dB")


def _both(
    axes: Axes,
    of: xr.DataArray,
    level_db: np.ndarray,
    found: Towards,
    truth: Towards | None,
) -> None:
    left, up = np.sin(of.azimuth.values), np.sin(of.elevation.values)
    image = axes.imshow(
        level_db,
        cmap=COLORS,
        vmin=_FLOOR_DB / 2,
        vmax=0,
        extent=(*edges(left), *edges(up)),
        origin="lower",
        aspect="auto",
        interpolation="bilinear",
    )
    colour_bar(axes, image, "spectrum relative to its peak, dB")
    _sine_axis(axes.xaxis, left)
    _sine_axis(axes.yaxis, up)
    axes.grid(False)
    axes.set(xlim=edges(left)[::-1], ylim=edges(up), autoscale_on=False)
    axes.set_xlabel(_AZIMUTH)
    axes.set_ylabel(_ELEVATION)
    if truth is not None:
        crosses(axes, *np.sin(truth))
    circles(axes, *np.sin(found), size=9)


def _sine_axis(axis: Axis, sines: np.ndarray) -> None:
    """Put ticks in degrees on an axis of sines."""
    most = abs(sines).max()
    degrees = _DEGREES if most > np.sin(np.radians(31)) else _FINE_DEGREES
    degrees = degrees[abs(np.sin(np.radians(degrees))) <= most]
    axis.set_ticks(np.sin(np.radians(degrees)), [fixed(float(one), 0) for one in degrees])
