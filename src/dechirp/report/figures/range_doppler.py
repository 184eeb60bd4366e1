"""The range-Doppler map, with what was found and what is there."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from dechirp.core.values import value
from dechirp.core.words import power_db, power_unit
from dechirp.report.figures.parts import (
    MAP_AXES,
    circles,
    colour_bar,
    crosses,
    edges,
    legend,
)
from dechirp.report.figures.style import COLORS
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
    """Of the samples: sqrt(W), or full scale."""
    found: Place | None = None
    """Detections, strongest first."""
    truth: Place | None = None
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


def whole(axes: Axes, marked: MarkedMap, *, in_colours_of: MarkedMap | None = None) -> Axes:
    """Draw the whole map, with the strongest detections circled.

    Large maps are drawn from the largest cell of each block, so that no peak is lost.

    Parameters
    ----------
    axes : Axes
        To draw on; a colour bar takes of their room.
    marked : MarkedMap
        The map, and what is marked on it.
    in_colours_of : MarkedMap, optional
        Another map that is to be compared with it by eye.

    Returns
    -------
    Axes
        Those given.
    """
    scale = _absolute(marked if in_colours_of is None else in_colours_of)
    return _map(axes, marked, marked.power, scale, name="Range-Doppler map", circle_points=11)


def whole_over_noise(axes: Axes, marked: MarkedMap, *, highest_db: float) -> Axes:
    """Draw the whole map over its mean noise, in colours that end `highest_db` above that.

    Maps drawn up to the same level can be compared by eye.

    Parameters
    ----------
    axes, marked
        See `whole`.
    highest_db : float
        Level of the darkest colour over the mean noise.

    Returns
    -------
    Axes
        Those given.
    """
    scale = _Scale(
        lowest_db=-6.0,
        highest_db=highest_db,
        zero_db=_noise_db(marked),
        label="power over the mean noise, dB",
    )
    name = "Range-Doppler map over the mean noise"
    return _map(axes, marked, marked.power, scale, name=name, circle_points=11)


def close_up(axes: Axes, marked: MarkedMap, *, cell: tuple[int, int]) -> Axes:
    """Draw the cells around one cell of the map, 16 to each side in velocity and 24 in range.

    Parameters
    ----------
    axes, marked
        See `whole`.
    cell : tuple of int
        (velocity, range) of the cell in the middle.

    Returns
    -------
    Axes
        Those given.
    """
    sizes, (row, column) = marked.power.sizes, cell
    around = marked.power.isel(
        velocity=_around(row, sizes["velocity"], _CLOSE_UP_CELLS[0]),
        range=_around(column, sizes["range"], _CLOSE_UP_CELLS[1]),
    )
    name = "Range-Doppler map, close-up"
    return _map(axes, marked, around, _absolute(marked), name=name, circle_points=26)


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


def _map(
    axes: Axes,
    marked: MarkedMap,
    part: xr.DataArray,
    scale: _Scale,
    *,
    name: str,
    circle_points: float,
) -> Axes:
    part = part.transpose("velocity", "range")
    left, right = edges(part.range.values)
    bottom, top = edges(part.velocity.values)
    axes.grid(False)
    image = axes.imshow(
        power_db(reduced(part.values), marked.units) - scale.zero_db,
        cmap=COLORS,
        vmin=scale.lowest_db,
        vmax=scale.highest_db,
        extent=(left, right, bottom, top),
        origin="lower",
        aspect="auto",
        interpolation="none",
    )
    colour_bar(axes, image, scale.label)
    axes.set_xlabel(MAP_AXES["range"])
    axes.set_ylabel(MAP_AXES["velocity"])
    axes.set(xlim=(left, right), ylim=(bottom, top), autoscale_on=False)
    _mark(axes, marked, circle_points)
    told = legend(axes, handletextpad=0.2)
    for handle in told.legend_handles if told is not None else ():
        assert isinstance(handle, Line2D)
        handle.set_markersize(8)
    axes.set_label(name)
    return axes


def _mark(axes: Axes, marked: MarkedMap, circle_points: float) -> None:
    truth, scatterers = _inside(axes, marked.truth), _inside(axes, marked.scatterers)
    if truth.size:
        crosses(axes, *truth)
    if scatterers.size:
        crosses(axes, *scatterers, marker=".", size=3, name="truth, scatterers of bodies")
    found = _inside(axes, marked.found)[:, :_MOST_CIRCLES]
    if found.size:
        crowded = found.shape[1] > _FEW_CIRCLES
        size, width = (circle_points / 2, 1.0) if crowded else (circle_points, 1.4)
        circles(axes, *found, size=size, width=width)


def _inside(axes: Axes, place: Place | None) -> np.ndarray:
    """Coordinates (2, n) of those places that the axes show."""
    if place is None:
        return np.empty((2, 0))
    x, y = place.range_m.ravel(), place.velocity_m_per_s.ravel()
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    return np.array([x, y])[:, (left <= x) & (x <= right) & (bottom <= y) & (y <= top)]
