"""Cuts through the strongest peak: power, threshold, and the cells it comes from."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from dechirp.core.words import power_db, power_unit
from dechirp.process.cfar.base import Cfar
from dechirp.report.figures.parts import MAP_AXES, Axis, cell_width, legend, line_through
from dechirp.report.figures.style import BLUE, ORANGE

_FEWEST_CELLS = 24  # shown on each side


def cut(
    axes: Axes,
    power: xr.DataArray,
    threshold: xr.DataArray,
    cfar: Cfar,
    *,
    along: Axis,
    cell: tuple[int, int],
    units: str,
) -> Axes:
    """Draw power and threshold along one axis through a cell of the map.

    Parameters
    ----------
    axes : Axes
        To draw on.
    power, threshold : DataArray (velocity, range)
        The map and its threshold, W or full scale squared.
    cfar : Cfar
        Its training and guard cells are shaded.
    along : range or velocity
        Which way to cut.
    cell : tuple of int
        (velocity, range) of the cell.
    units : str
        Of the samples: sqrt(W) gives dBm, all else dB relative to full scale.

    Returns
    -------
    Axes
        Those given.
    """
    row, column = cell
    centre = column if along == "range" else row
    line = line_through(power, cell, along=along)
    bins, power_w = line[along].values, line.values
    threshold_db = searched_db(line_through(threshold, cell, along=along).values, units)
    training, guard = cells_about(centre, bins.size, cfar, along=along)
    n_shown = max(3 * _reach(cfar, along), _FEWEST_CELLS)
    shown = slice(max(centre - n_shown, 0), centre + n_shown + 1)
    power_level_db = power_db(power_w, units)
    lowest = float(np.median(power_level_db)) - 15
    highest = float(max(power_level_db[shown].max(), np.nanmax(threshold_db, initial=-np.inf)))
    for name, cells, color in (("training", training, "#e0ecf5"), ("guard", guard, "#eef0f2")):
        for number, (left, right) in enumerate(stretches(bins[shown], cells[shown])):
            label = f"{name} cells" if number == 0 else None
            axes.axvspan(left, right, color=color, linewidth=0, label=label)
    axes.plot(
        bins[shown],
        np.maximum(power_level_db, lowest)[shown],
        color=BLUE,
        linewidth=1.1,
        drawstyle="steps-mid",
        label="power",
    )
    axes.plot(bins[shown], threshold_db[shown], color=ORANGE, linewidth=1.3, label="threshold")
    axes.plot(
        bins[centre],
        power_level_db[centre],
        marker="o",
        markersize=4,
        color=BLUE,
        linestyle="",
    )
    left, right = bins[shown][0], bins[shown][-1]
    axes.set(
        xlim=(left, right) if right > left else (left - 0.5, left + 0.5),  # one chirp: one bin
        ylim=(lowest, highest + 0.06 * (highest - lowest) + 1),
    )
    axes.set_xlabel(MAP_AXES[along])
    axes.set_ylabel(f"power, {power_unit(units)}")
    legend(axes)
    axes.set_label(f"Power and threshold along {along}")
    return axes


def searched_db(threshold: np.ndarray, units: str) -> np.ndarray:
    """Thresholds as `power_db` writes them; NaN where nothing is searched for."""
    is_searched = np.isfinite(threshold)
    return np.where(is_searched, power_db(np.where(is_searched, threshold, 1.0), units), np.nan)


def cells_about(
    centre: int, n_bins: int, cfar: Cfar, *, along: Axis
) -> tuple[np.ndarray, np.ndarray]:
    """Whether each cell of a line trains, and whether it is a guard cell, (n_bins,) each."""
    n_guard, reach = getattr(cfar.n_guard, along), _reach(cfar, along)
    index = np.arange(n_bins)
    offset = index - centre
    if along == "velocity":  # wraps round
        offset = (offset + n_bins // 2) % n_bins - n_bins // 2
        inside = abs(offset) <= reach
    else:  # at the ends the box stays within the map
        middle = min(max(centre, reach), max(n_bins - 1 - reach, 0))
        inside = abs(index - middle) <= reach
    return inside & (abs(offset) > n_guard), inside & (abs(offset) <= n_guard)


def _reach(cfar: Cfar, along: Axis) -> int:
    return int(getattr(cfar.n_guard, along) + getattr(cfar.n_training, along))


def stretches(bins: np.ndarray, cells: np.ndarray) -> list[tuple[float, float]]:
    """Both edges of each run of marked cells, in the unit of the bins; arrays (n_bins,)."""
    half = cell_width(bins) / 2
    steps = np.diff(np.concatenate([[0], cells.astype(int), [0]]))
    first, last = np.flatnonzero(steps == 1), np.flatnonzero(steps == -1) - 1
    return list(zip(bins[first] - half, bins[last] + half, strict=True))
