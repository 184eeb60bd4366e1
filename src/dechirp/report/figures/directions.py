"""Power over directions: of all ranges, and of one detection."""

from typing import NamedTuple

import numpy as np
import xarray as xr
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure

from dechirp.core.units import decibels
from dechirp.core.values import value
from dechirp.report.figures.range_doppler import reduced
from dechirp.report.figures.style import BLUE, COLORS, INK, ORANGE, draw
from dechirp.report.words import fixed, power_db, power_unit

# The map is the strongest of all velocities: its median is noise, and steady.
_BELOW_NOISE_DB, _LARGEST_SPAN_DB, _LEAST_SPAN_DB = 3.0, 70.0, 20.0
_MOST_PIXELS = (400, 400)
_FLOOR_DB = -40.0
_DEGREES = np.array([-90, -60, -45, -30, -15, 0, 15, 30, 45, 60, 90])
_FINE_DEGREES = np.arange(-30, 31, 5)
_MOST_NAMED = 4


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
    found: tuple[np.ndarray, np.ndarray]
    """Azimuths (rad) and ranges (m) of the detections."""
    truth: tuple[np.ndarray, np.ndarray] | None


def range_azimuth(marked: RangeAzimuth) -> Markup:
    """Draw the map in sines of the azimuth, over which a beam is equally wide everywhere."""
    power = marked.power.transpose("range", "azimuth")
    level_db = power_db(reduced(power.values, _MOST_PIXELS), marked.units)
    highest = float(level_db.max())
    lowest = max(float(np.median(level_db)) - _BELOW_NOISE_DB, highest - _LARGEST_SPAN_DB)
    sines, range_m = np.sin(power.azimuth.values), power.range.values
    half = _half_step(range_m)
    ends_m = [of[1].max(initial=0.0) for of in (marked.found, marked.truth) if of is not None]
    farthest = float(range_m[-1]) + half
    # Beyond what was found there is noise.
    shown_m = min(farthest, 1.3 * max(ends_m)) if max(ends_m) > 0 else farthest

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        image = axes.imshow(
            level_db,
            cmap=COLORS,
            vmin=min(lowest, highest - _LEAST_SPAN_DB),
            vmax=highest,
            extent=(*_edges(sines), float(range_m[0]) - half, farthest),
            origin="lower",
            aspect="auto",
            interpolation="bilinear",
        )
        bar = figure.colorbar(image, ax=axes, pad=0.02, aspect=28)
        bar.outline.set_visible(False)
        bar.set_label(f"power, {power_unit(marked.units)}")
        _sine_axis(axes.xaxis, sines)
        axes.grid(False)
        left, right = _edges(sines)
        axes.set(xlim=(right, left), ylim=(0, shown_m), autoscale_on=False)
        axes.set_xlabel("azimuth, ° (left positive)")
        axes.set_ylabel("range, m")
        if marked.truth is not None:
            _crosses(axes, np.sin(marked.truth[0]), marked.truth[1])
        _circles(axes, np.sin(marked.found[0]), marked.found[1])
        figure.legend(loc="outside upper right", ncols=2, handletextpad=0.2)

    return draw(paint, label="Range-azimuth map", height_in=3.6)


def spectrum(of: xr.DataArray, *, found: Towards, truth: Towards | None) -> Markup:
    """Draw the spectrum of one detection, (elevation, azimuth): a line, or a map of both.

    In decibels below its highest point; with the directions found, and those of the truth.
    """
    level = of.transpose("elevation", "azimuth").values
    level_db = np.maximum(decibels(np.maximum(level / level.max(), 1e-30)), _FLOOR_DB)
    azimuth, elevation = of.azimuth.values, of.elevation.values

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        if len(azimuth) > 1 and len(elevation) > 1:
            _both(figure, axes, of, level_db, found, truth)
        elif len(azimuth) > 1:
            _line(axes, azimuth, level_db[0], found.azimuth_rad, truth and truth.azimuth_rad)
            axes.invert_xaxis()
            axes.set_xlabel("azimuth, ° (left positive)")
        else:
            at = truth and truth.elevation_rad
            _line(axes, elevation, level_db[:, 0], found.elevation_rad, at)
            axes.set_xlabel("elevation, ° (up positive)")
        figure.legend(loc="outside upper right", ncols=3, handletextpad=0.4)

    return draw(paint, label="Spectrum over directions", height_in=3.6)


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
    axes.set_ylabel("spectrum, dB below its highest point")


def _both(
    figure: Figure,
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
        extent=(*_edges(left), *_edges(up)),
        origin="lower",
        aspect="auto",
        interpolation="bilinear",
    )
    bar = figure.colorbar(image, ax=axes, pad=0.02, aspect=28)
    bar.outline.set_visible(False)
    bar.set_label("dB below the highest point")
    _sine_axis(axes.xaxis, left)
    _sine_axis(axes.yaxis, up)
    axes.grid(False)
    axes.set(xlim=_edges(left)[::-1], ylim=_edges(up), autoscale_on=False)
    axes.set_xlabel("azimuth, ° (left positive)")
    axes.set_ylabel("elevation, ° (up positive)")
    if truth is not None:
        _crosses(axes, *np.sin(truth))
    _circles(axes, *np.sin(found))


def _circles(axes: Axes, x: np.ndarray, y: np.ndarray) -> None:
    axes.plot(
        x,
        y,
        linestyle="",
        marker="o",
        markersize=9,
        markerfacecolor="none",
        markeredgecolor=ORANGE,
        markeredgewidth=1.3,
        label="detection",
    )


def _crosses(axes: Axes, x: np.ndarray, y: np.ndarray) -> None:
    # Dark on a light rim, to be seen on the noise and on the peak.
    for color, width, label in (("#ffffff", 2.6, None), (INK, 1.1, "truth")):
        axes.plot(
            x,
            y,
            linestyle="",
            marker="+",
            markersize=7 + width,
            color=color,
            markeredgewidth=width,
            label=label,
        )


def _sine_axis(axis: Axis, sines: np.ndarray) -> None:
    """Put ticks in degrees on an axis of sines."""
    most = abs(sines).max()
    degrees = _DEGREES if most > np.sin(np.radians(31)) else _FINE_DEGREES
    degrees = degrees[abs(np.sin(np.radians(degrees))) <= most]
    axis.set_ticks(np.sin(np.radians(degrees)), [fixed(float(one), 0) for one in degrees])


def _edges(centres: np.ndarray) -> tuple[float, float]:
    half = _half_step(centres)
    return float(centres[0]) - half, float(centres[-1]) + half


def _half_step(centres: np.ndarray) -> float:
    return float(centres[-1] - centres[0]) / max(centres.size - 1, 1) / 2 or 0.5
