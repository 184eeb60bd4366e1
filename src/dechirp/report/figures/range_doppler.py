"""Range-Doppler map with detections and true positions."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from dechirp.core.text import power_level_unit, power_to_dbm_or_dbfs
from dechirp.core.values import frozen_dataclass
from dechirp.report.figures.common import (
    AXIS_LABELS,
    add_colour_bar,
    add_legend,
    draw_detection_circles,
    draw_truth_marks,
    outer_cell_edges,
)
from dechirp.report.figures.style import COLORS
from dechirp.report.labels import POWER_OVER_NOISE_LABEL, power_label
from dechirp.scene.aliasing import RangeVelocity

_MAX_PIXELS = (220, 420)  # velocity, range: the resolution of a figure of 500 pixels
_MAX_CIRCLES, _FEW_CIRCLES = 200, 40
_LARGEST_SPAN_DB = 80.0
_CLOSE_UP_CELLS = (16, 24)  # to each side, velocity and range


@frozen_dataclass
class MarkedMap:
    """Range-Doppler map with the positions to mark."""

    power: xr.DataArray
    """Array (velocity, range)."""
    units: str
    """Units of the samples: sqrt(W), or full scale."""
    detections: RangeVelocity | None = None
    """Detections, strongest first."""
    truth: RangeVelocity | None = None
    scatterers: RangeVelocity | None = None
    """True positions of the scatterers of bodies."""


@frozen_dataclass
class _ColourScale:
    """Limits and label of a colour scale."""

    lowest_db: float
    highest_db: float
    zero_db: float
    """Level displayed as zero."""
    label: str


def draw_map(
    axes: Axes,
    marked: MarkedMap,
    *,
    colour_reference: MarkedMap | None = None,
    end_m: float | None = None,
) -> Axes:
    """Draw the map, with the strongest detections circled.

    Large maps are reduced to block maxima, so that no peak is lost.

    Parameters
    ----------
    axes : Axes
        Axes to draw on; the colour bar uses part of their space.
    marked : MarkedMap
        Map with the positions to mark.
    colour_reference : MarkedMap, optional
        Map that determines the colour scale, for a visual comparison.
    end_m : float, optional
        Range at which the axis ends; default: the whole map.

    Returns
    -------
    Axes
        The given axes.
    """
    scale = _absolute_power_colour_scale(marked if colour_reference is None else colour_reference)
    part = marked.power if end_m is None else marked.power.sel(range=slice(None, end_m))
    return _draw_marked_map(axes, marked, part, scale, name="Range-Doppler map", circle_points=11)


def draw_map_over_noise(axes: Axes, marked: MarkedMap, *, highest_db: float) -> Axes:
    """Draw the whole map relative to its mean noise, with colours up to `highest_db`.

    Maps with the same `highest_db` can be compared visually.

    Parameters
    ----------
    axes, marked
        See `draw_map`.
    highest_db : float
        Level of the darkest colour over the mean noise.

    Returns
    -------
    Axes
        The given axes.
    """
    scale = _ColourScale(
        lowest_db=-6.0,
        highest_db=highest_db,
        zero_db=_noise_level_db(marked),
        label=POWER_OVER_NOISE_LABEL,
    )
    name = "Range-Doppler map over the mean noise"
    return _draw_marked_map(axes, marked, marked.power, scale, name=name, circle_points=11)


def draw_close_up(axes: Axes, marked: MarkedMap, *, cell: tuple[int, int]) -> Axes:
    """Draw the surroundings of a cell: 16 cells in velocity and 24 in range to each side.

    Parameters
    ----------
    axes, marked
        See `draw_map`.
    cell : tuple of int
        Index (velocity, range) of the cell in the middle.

    Returns
    -------
    Axes
        The given axes.
    """
    sizes, (row, column) = marked.power.sizes, cell
    around = marked.power.isel(
        velocity=_centred_slice(row, sizes["velocity"], _CLOSE_UP_CELLS[0]),
        range=_centred_slice(column, sizes["range"], _CLOSE_UP_CELLS[1]),
    )
    name = "Range-Doppler map, close-up"
    return _draw_marked_map(
        axes, marked, around, _absolute_power_colour_scale(marked), name=name, circle_points=26
    )


def noise_power_from_median(power: np.ndarray) -> float:
    """Estimate the mean noise power of a map that is mostly noise."""
    # The median of exponentially distributed noise is ln 2 of its mean.
    return float(np.median(power) / np.log(2))


def block_maxima(power: np.ndarray, max_shape: tuple[int, int] = _MAX_PIXELS) -> np.ndarray:
    """Reduce a map to the maxima of at most `max_shape` blocks."""
    for axis, limit in enumerate(max_shape):
        size = power.shape[axis]
        if size > limit:
            starts = np.linspace(0, size, limit, endpoint=False, dtype=int)
            power = np.maximum.reduceat(power, starts, axis=axis)
    return power


def _noise_level_db(marked: MarkedMap) -> float:
    return float(
        power_to_dbm_or_dbfs(np.asarray(noise_power_from_median(marked.power.values)), marked.units)
    )


def _absolute_power_colour_scale(marked: MarkedMap) -> _ColourScale:
    """Return the colour scale from 6 dB below the noise to the peak, spanning 20 to 80 dB."""
    highest = float(power_to_dbm_or_dbfs(marked.power.values.max(), marked.units))
    lowest = max(_noise_level_db(marked) - 6, highest - _LARGEST_SPAN_DB)
    return _ColourScale(
        lowest_db=lowest,
        highest_db=max(highest, lowest + 20),
        zero_db=0.0,
        label=power_label(power_level_unit(marked.units)),
    )


def _centred_slice(centre: int, size: int, reach: int) -> slice:
    first = min(max(centre - reach, 0), max(size - 2 * reach - 1, 0))
    return slice(first, first + 2 * reach + 1)


def _draw_marked_map(
    axes: Axes,
    marked: MarkedMap,
    part: xr.DataArray,
    scale: _ColourScale,
    *,
    name: str,
    circle_points: float,
) -> Axes:
    part = part.transpose("velocity", "range")
    min_range, max_range = outer_cell_edges(part.range.values)
    bottom, top = outer_cell_edges(part.velocity.values)
    axes.grid(False)
    image = axes.imshow(
        power_to_dbm_or_dbfs(block_maxima(part.values), marked.units) - scale.zero_db,
        cmap=COLORS,
        vmin=scale.lowest_db,
        vmax=scale.highest_db,
        extent=(min_range, max_range, bottom, top),
        origin="lower",
        aspect="auto",
        interpolation="none",
    )
    add_colour_bar(axes, image, scale.label)
    axes.set_xlabel(AXIS_LABELS["range"])
    axes.set_ylabel(AXIS_LABELS["velocity"])
    axes.set(xlim=(min_range, max_range), ylim=(bottom, top), autoscale_on=False)
    _draw_truth_and_detection_marks(axes, marked, circle_points)
    map_legend = add_legend(axes, handletextpad=0.2)
    for handle in map_legend.legend_handles if map_legend is not None else ():
        assert isinstance(handle, Line2D)
        handle.set_markersize(8)
    axes.set_label(name)
    return axes


def _draw_truth_and_detection_marks(axes: Axes, marked: MarkedMap, circle_points: float) -> None:
    truth, scatterers = (
        _points_within_axes(axes, marked.truth),
        _points_within_axes(axes, marked.scatterers),
    )
    if truth.size:
        draw_truth_marks(axes, *truth)
    if scatterers.size:
        draw_truth_marks(axes, *scatterers, marker=".", size=3, name="truth, scatterers of bodies")
    detections = _points_within_axes(axes, marked.detections)[:, :_MAX_CIRCLES]
    if detections.size:
        crowded = detections.shape[1] > _FEW_CIRCLES
        size, width = (circle_points / 2, 1.0) if crowded else (circle_points, 1.4)
        draw_detection_circles(axes, *detections, size=size, width=width)


def _points_within_axes(axes: Axes, points: RangeVelocity | None) -> np.ndarray:
    """Return the coordinates (2, n) of the points within the axes."""
    if points is None:
        return np.empty((2, 0))
    x, y = points.range_m.ravel(), points.velocity_m_per_s.ravel()
    (min_range, max_range), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    return np.array([x, y])[:, (min_range <= x) & (x <= max_range) & (bottom <= y) & (y <= top)]
