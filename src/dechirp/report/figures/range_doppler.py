"""The range-Doppler map, with what was found and what is there."""

from collections.abc import Callable

import numpy as np
import xarray as xr
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from dechirp.core.values import value
from dechirp.report.figures.style import COLORS, INK, ORANGE, draw, picture
from dechirp.report.words import power_db, power_unit
from dechirp.scene.folding import Place

_MOST_PIXELS = (220, 420)  # velocity, range: as many as a figure of 500 pixels can show
_MOST_CIRCLES, _FEW_CIRCLES = 200, 40
_LARGEST_SPAN_DB = 80.0
_CLOSE_UP_CELLS = (16, 24)  # on each side, velocity and range


@value
class MarkedMap:
    """A map, and the places on it to mark."""

    power: xr.DataArray
    """(velocity, range)."""
    units: str
    """Of the samples."""
    found: Place
    """Detections, strongest first."""
    truth: Place | None
    scatterers: Place | None = None
    """Of bodies, besides the truth about targets that are points."""


@value
class _Scale:
    """What the colours stand for."""

    lowest_db: float
    highest_db: float
    zero_db: float
    """Level that is shown as zero."""
    label: str


def whole(marked: MarkedMap, *, in_colours_of: MarkedMap | None = None) -> Markup:
    """Draw the whole map, with the strongest detections circled.

    Large maps are drawn from the largest cell of each block, so that no peak is lost. In the
    colours of another map both can be compared by eye.
    """
    scale = _absolute(marked if in_colours_of is None else in_colours_of)
    return _drawn(marked, marked.power, scale, label="Range-Doppler map", circle_points=11)


def whole_picture(marked: MarkedMap, *, title: str) -> bytes:
    """Draw the whole map as PNG, under a title."""
    paint = _map(marked, marked.power, _absolute(marked), circle_points=11)

    def with_title(figure: Figure) -> None:
        paint(figure)
        figure.suptitle(title, fontsize=9)

    return picture(with_title, height_in=3.6)


def whole_over_noise(marked: MarkedMap, *, highest_db: float) -> Markup:
    """Draw the whole map over its mean noise, in colours that end `highest_db` above that.

    Maps drawn up to the same level can be compared by eye.
    """
    scale = _Scale(
        lowest_db=-6.0,
        highest_db=highest_db,
        zero_db=_noise_db(marked),
        label="power over the mean noise, dB",
    )
    label = "Range-Doppler map over the mean noise"
    return _drawn(marked, marked.power, scale, label=label, circle_points=11)


def close_up(marked: MarkedMap, *, cell: tuple[int, int]) -> Markup:
    """Draw the cells around one cell (velocity, range) of the map."""
    sizes, (row, column) = marked.power.sizes, cell
    around = marked.power.isel(
        velocity=_around(row, sizes["velocity"], _CLOSE_UP_CELLS[0]),
        range=_around(column, sizes["range"], _CLOSE_UP_CELLS[1]),
    )
    label = "Range-Doppler map, close-up"
    return _drawn(marked, around, _absolute(marked), label=label, circle_points=26)


def noise_power(power: np.ndarray) -> float:
    """Estimate the mean power of the noise in a map that is mostly noise."""
    # The median of exponentially distributed noise is ln 2 of its mean.
    return float(np.median(power) / np.log(2))


def reduced(power: np.ndarray, most: tuple[int, int] = _MOST_PIXELS) -> np.ndarray:
    """Keep the largest cell of each block of a map, at most `most` blocks along each axis."""
    for axis, limit in enumerate(most):
        size = power.shape[axis]
        if size > limit:
            starts = np.linspace(0, size, limit, endpoint=False, dtype=int)
            power = np.maximum.reduceat(power, starts, axis=axis)
    return power


def _noise_db(marked: MarkedMap) -> float:
    return float(power_db(np.asarray(noise_power(marked.power.values)), marked.units))


def _absolute(marked: MarkedMap) -> _Scale:
    """Colour scale: from 6 dB below the noise to the peak, 20 to 80 dB in all."""
    highest = float(power_db(marked.power.values.max(), marked.units))
    lowest = max(_noise_db(marked) - 6, highest - _LARGEST_SPAN_DB)
    return _Scale(
        lowest_db=lowest,
        highest_db=max(highest, lowest + 20),
        zero_db=0.0,
        label=f"power, {power_unit(marked.units)}",
    )


def _around(centre: int, size: int, reach: int) -> slice:
    first = min(max(centre - reach, 0), max(size - 2 * reach - 1, 0))
    return slice(first, first + 2 * reach + 1)


def _drawn(
    marked: MarkedMap, part: xr.DataArray, scale: _Scale, *, label: str, circle_points: float
) -> Markup:
    return draw(_map(marked, part, scale, circle_points=circle_points), label=label, height_in=3.6)


def _map(
    marked: MarkedMap, part: xr.DataArray, scale: _Scale, *, circle_points: float
) -> Callable[[Figure], None]:
    part = part.transpose("velocity", "range")
    level_db = power_db(reduced(part.values), marked.units) - scale.zero_db
    left, right = _edges(part.range.values)
    bottom, top = _edges(part.velocity.values)

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        axes.grid(False)
        image = axes.imshow(
            level_db,
            cmap=COLORS,
            vmin=scale.lowest_db,
            vmax=scale.highest_db,
            extent=(left, right, bottom, top),
            origin="lower",
            aspect="auto",
            interpolation="none",
        )
        bar = figure.colorbar(image, ax=axes, pad=0.02, aspect=28)
        bar.outline.set_visible(False)
        bar.set_label(scale.label)
        axes.set_xlabel("range, m")
        axes.set_ylabel("velocity, m/s (receding positive)")
        axes.set(xlim=(left, right), ylim=(bottom, top), autoscale_on=False)
        _mark(axes, marked, circle_points)
        if axes.get_legend_handles_labels()[0]:
            legend = figure.legend(loc="outside upper right", ncols=2, handletextpad=0.2)
            for handle in legend.legend_handles:
                assert isinstance(handle, Line2D)
                handle.set_markersize(8)

    return paint


def _mark(axes: Axes, marked: MarkedMap, circle_points: float) -> None:
    _mark_truth(axes, marked.truth, marker="+", size=7, name="truth")
    _mark_truth(axes, marked.scatterers, marker=".", size=3, name="truth, scatterers of bodies")
    circles = _inside(axes, marked.found)[:, :_MOST_CIRCLES]
    if circles.size:
        crowded = circles.shape[1] > _FEW_CIRCLES
        axes.plot(
            *circles,
            linestyle="",
            marker="o",
            markersize=circle_points / 2 if crowded else circle_points,
            markerfacecolor="none",
            markeredgecolor=ORANGE,
            markeredgewidth=1.0 if crowded else 1.4,
            label="detection",
        )


def _mark_truth(axes: Axes, truth: Place | None, *, marker: str, size: float, name: str) -> None:
    places = np.empty((2, 0)) if truth is None else _inside(axes, truth)
    if not places.size:
        return
    # Dark on a light rim, to be seen on the noise and on the peak.
    for color, width, label in (("#ffffff", 2.6, None), (INK, 1.1, name)):
        axes.plot(
            *places,
            linestyle="",
            marker=marker,
            markersize=size + width,
            color=color,
            markeredgewidth=width,
            label=label,
        )


def _inside(axes: Axes, place: Place) -> np.ndarray:
    """Coordinates (2, n) of those places that the axes show."""
    x, y = place.range_m.ravel(), place.velocity_m_per_s.ravel()
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    return np.array([x, y])[:, (left <= x) & (x <= right) & (bottom <= y) & (y <= top)]


def _edges(centres: np.ndarray) -> tuple[float, float]:
    half = (centres[-1] - centres[0]) / max(centres.size - 1, 1) / 2 or 0.5
    return float(centres[0] - half), float(centres[-1] + half)
