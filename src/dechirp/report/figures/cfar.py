"""Cuts through the map with threshold, training cells and guard cells."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from dechirp.core.text import power_level_unit, power_to_dbm_or_dbfs
from dechirp.processing.cfar.base import Cfar
from dechirp.report.figures.common import (
    AXIS_LABELS,
    MapAxis,
    add_legend,
    line_through_cell,
    uniform_cell_width,
)
from dechirp.report.figures.style import BLUE, ORANGE
from dechirp.report.labels import power_label

_FEWEST_CELLS = 24  # minimum shown on each side


def draw_threshold_cut(
    axes: Axes,
    power: xr.DataArray,
    threshold: xr.DataArray,
    cfar: Cfar,
    *,
    along: MapAxis,
    cell: tuple[int, int],
    units: str,
) -> Axes:
    """Draw power and threshold along one axis through a cell of the map.

    Parameters
    ----------
    axes : Axes
        Axes to draw on.
    power, threshold : DataArray (velocity, range)
        Map and threshold, W or full scale squared.
    cfar : Cfar
        Detector whose training and guard cells are shaded.
    along : range or velocity
        Direction of the cut.
    cell : tuple of int
        Index (velocity, range) of the cell.
    units : str
        Units of the samples: sqrt(W) gives dBm, other units dB relative to full scale.

    Returns
    -------
    Axes
        The given axes.
    """
    row, column = cell
    centre = column if along == "range" else row
    line = line_through_cell(power, cell, along=along)
    bins, power_w = line[along].values, line.values
    threshold_db = threshold_level_db(line_through_cell(threshold, cell, along=along).values, units)
    training, guard = training_and_guard_masks(centre, bins.size, cfar, along=along)
    n_shown = max(3 * _half_window_cells(cfar, along), _FEWEST_CELLS)
    shown_cells = slice(max(centre - n_shown, 0), centre + n_shown + 1)
    power_level_db = power_to_dbm_or_dbfs(power_w, units)
    # Strong echoes may fill the cut, and raise its median over the threshold.
    lowest_threshold = float(np.nanmin(threshold_db[shown_cells], initial=np.inf))
    lowest = min(float(np.median(power_level_db)) - 15, lowest_threshold - 2)
    highest = float(
        max(power_level_db[shown_cells].max(), np.nanmax(threshold_db, initial=-np.inf))
    )
    for name, cells, color in (("training", training, "#e0ecf5"), ("guard", guard, "#eef0f2")):
        for number, (lower, upper) in enumerate(
            edges_of_marked_runs(bins[shown_cells], cells[shown_cells])
        ):
            label = f"{name} cells" if number == 0 else None
            axes.axvspan(lower, upper, color=color, linewidth=0, label=label)
    axes.plot(
        bins[shown_cells],
        np.maximum(power_level_db, lowest)[shown_cells],
        color=BLUE,
        linewidth=1.1,
        drawstyle="steps-mid",
        label="power",
    )
    axes.plot(
        bins[shown_cells], threshold_db[shown_cells], color=ORANGE, linewidth=1.3, label="threshold"
    )
    axes.plot(
        bins[centre],
        power_level_db[centre],
        marker="o",
        markersize=4,
        color=BLUE,
        linestyle="",
    )
    lower, upper = bins[shown_cells][0], bins[shown_cells][-1]
    axes.set(
        xlim=(lower, upper)
        if upper > lower
        else (lower - 0.5, lower + 0.5),  # a single chirp has one bin
        ylim=(lowest, highest + 0.06 * (highest - lowest) + 1),
    )
    axes.set_xlabel(AXIS_LABELS[along])
    axes.set_ylabel(power_label(power_level_unit(units)))
    add_legend(axes)
    axes.set_label(f"Power and threshold along {along}")
    return axes


def threshold_level_db(threshold: np.ndarray, units: str) -> np.ndarray:
    """Convert thresholds to dB as `power_to_dbm_or_dbfs`; NaN for cells that are not tested."""
    is_searched = np.isfinite(threshold)
    return np.where(
        is_searched, power_to_dbm_or_dbfs(np.where(is_searched, threshold, 1.0), units), np.nan
    )


def training_and_guard_masks(
    centre: int, n_bins: int, cfar: Cfar, *, along: MapAxis
) -> tuple[np.ndarray, np.ndarray]:
    """Return the masks of training and guard cells on a line through a cell, (n_bins,) each."""
    n_guard, reach = getattr(cfar.n_guard, along), _half_window_cells(cfar, along)
    index = np.arange(n_bins)
    offset = index - centre
    if along == "velocity":  # circular axis
        offset = (offset + n_bins // 2) % n_bins - n_bins // 2
        inside = abs(offset) <= reach
    else:  # at the ends the window stays within the map
        middle = min(max(centre, reach), max(n_bins - 1 - reach, 0))
        inside = abs(index - middle) <= reach
    return inside & (abs(offset) > n_guard), inside & (abs(offset) <= n_guard)


def _half_window_cells(cfar: Cfar, along: MapAxis) -> int:
    return int(getattr(cfar.n_guard, along) + getattr(cfar.n_training, along))


def edges_of_marked_runs(bins: np.ndarray, is_marked: np.ndarray) -> list[tuple[float, float]]:
    """Return both edges of each run of marked cells, in the unit of the bins (n_bins,)."""
    half = uniform_cell_width(bins) / 2
    steps = np.diff(np.concatenate([[0], is_marked.astype(int), [0]]))
    first, last = np.flatnonzero(steps == 1), np.flatnonzero(steps == -1) - 1
    return list(zip(bins[first] - half, bins[last] + half, strict=True))
