"""The range-Doppler map, with what was found and what is there."""

import numpy as np
import xarray as xr
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from dechirp.core.values import value
from dechirp.report.figures.style import COLORS, INK, ORANGE, draw
from dechirp.report.words import power_db, power_unit
from dechirp.scene.folding import Place

_MOST_PIXELS = (220, 420)  # velocity, range: as many as a figure of 500 pixels can show
_MOST_CIRCLES, _FEW_CIRCLES = 200, 20
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


def whole(marked: MarkedMap) -> Markup:
    """Draw the whole map, with the strongest detections circled.

    Large maps are drawn from the largest cell of each block, so that no peak is lost.
    """
    return _map(marked, marked.power, label="Range-Doppler map", circle_points=11)


def close_up(marked: MarkedMap, *, cell: tuple[int, int]) -> Markup:
    """Draw the cells around one cell (velocity, range) of the map."""
    sizes, (row, column) = marked.power.sizes, cell
    around = marked.power.isel(
        velocity=_around(row, sizes["velocity"], _CLOSE_UP_CELLS[0]),
        range=_around(column, sizes["range"], _CLOSE_UP_CELLS[1]),
    )
    return _map(marked, around, label="Range-Doppler map, close-up", circle_points=26)


def reduced(power: np.ndarray, most: tuple[int, int] = _MOST_PIXELS) -> np.ndarray:
    """Keep the largest cell of each block of a map, at most `most` blocks along each axis."""
    for axis, limit in enumerate(most):
        size = power.shape[axis]
        if size > limit:
            starts = np.linspace(0, size, limit, endpoint=False, dtype=int)
            power = np.maximum.reduceat(power, starts, axis=axis)
    return power


def _limits_db(marked: MarkedMap) -> tuple[float, float]:
    """Colour scale: from 6 dB below the noise to the peak, 20 to 80 dB in all."""
    power = marked.power.values
    # The median of exponentially distributed noise is ln 2 of its mean.
    noise_db = float(power_db(np.median(power) / np.log(2), marked.units))
    highest = float(power_db(power.max(), marked.units))
    lowest = max(noise_db - 6, highest - _LARGEST_SPAN_DB)
    return lowest, max(highest, lowest + 20)


def _around(centre: int, size: int, reach: int) -> slice:
    first = min(max(centre - reach, 0), max(size - 2 * reach - 1, 0))
    return slice(first, first + 2 * reach + 1)


def _map(marked: MarkedMap, part: xr.DataArray, *, label: str, circle_points: float) -> Markup:
    part = part.transpose("velocity", "range")
    level_db = power_db(reduced(part.values), marked.units)
    lowest_db, highest_db = _limits_db(marked)
    left, right = _edges(part.range.values)
    bottom, top = _edges(part.velocity.values)

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        axes.grid(False)
        image = axes.imshow(
            level_db,
            cmap=COLORS,
            vmin=lowest_db,
            vmax=highest_db,
            extent=(left, right, bottom, top),
            origin="lower",
            aspect="auto",
            interpolation="none",
        )
        bar = figure.colorbar(image, ax=axes, pad=0.02, aspect=28)
        bar.outline.set_visible(False)
        bar.set_label(f"power, {power_unit(marked.units)}")
        axes.set_xlabel("range, m")
        axes.set_ylabel("velocity, m/s (receding positive)")
        axes.set(xlim=(left, right), ylim=(bottom, top), autoscale_on=False)
        _mark(axes, marked, circle_points)
        if axes.get_legend_handles_labels()[0]:
            legend = figure.legend(loc="outside upper right", ncols=2, handletextpad=0.2)
            for handle in legend.legend_handles:
                assert isinstance(handle, Line2D)
                handle.set_markersize(8)

    return draw(paint, label=label, height_in=3.6)


def _mark(axes: Axes, marked: MarkedMap, circle_points: float) -> None:
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
    crosses = np.empty((2, 0)) if marked.truth is None else _inside(axes, marked.truth)
    if crosses.size:
        # Dark on a light rim, to be seen on the noise and on the peak.
        for color, width, name in (("#ffffff", 2.6, None), (INK, 1.1, "truth")):
            axes.plot(
                *crosses,
                linestyle="",
                marker="+",
                markersize=7 + width,
                markeredgecolor=color,
                markeredgewidth=width,
                label=name,
            )


def _inside(axes: Axes, place: Place) -> np.ndarray:
    """Coordinates (2, n) of those places that the axes show."""
    x, y = place.range_m.ravel(), place.velocity_m_per_s.ravel()
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    return np.array([x, y])[:, (left <= x) & (x <= right) & (bottom <= y) & (y <= top)]


def _edges(centres: np.ndarray) -> tuple[float, float]:
    half = (centres[-1] - centres[0]) / max(centres.size - 1, 1) / 2 or 0.5
    return float(centres[0] - half), float(centres[-1] + half)
