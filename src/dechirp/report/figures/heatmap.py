"""Heatmap of a score over two settings."""

import numpy as np
from matplotlib.axes import Axes

from dechirp.report.figures.common import add_colour_bar, set_decade_ticks
from dechirp.report.figures.study import AxisLabel, choose_axis_scale
from dechirp.report.figures.style import COLORS


def draw_heatmap(
    axes: Axes,
    x: np.ndarray,
    y: np.ndarray,
    values: np.ndarray,
    *,
    axis_labels: tuple[AxisLabel, AxisLabel],
    label: str,
    is_ratio: bool,
) -> Axes:
    """Draw a score over two settings as a map; cells without a value are grey.

    Parameters
    ----------
    axes : Axes
        Axes to draw on; the colour bar uses part of their space.
    x, y : array (n_x,), (n_y,)
        Values of the settings, ascending.
    values : array (n_y, n_x)
        The score.
    axis_labels : tuple of AxisLabel
        Labels of x and y.
    label : str
        Label of the score, with its unit.
    is_ratio : bool
        Whether values are proportions or probabilities.

    Returns
    -------
    Axes
        The given axes.
    """
    spread = choose_axis_scale(values, is_ratio=is_ratio)
    shown_values = np.where(values > 0, values, np.nan) if spread == "log" else values
    axes.grid(visible=False)
    axes.set_facecolor("#e3e6e9")
    mesh = axes.pcolormesh(
        _cell_edges(x, logarithmic=axis_labels[0].logarithmic),
        _cell_edges(y, logarithmic=axis_labels[1].logarithmic),
        np.ma.masked_invalid(shown_values),
        cmap=COLORS,
        norm="log" if spread == "log" else "linear",
        vmin=0.0 if spread == "shares" else None,
        vmax=1.0 if spread == "shares" else None,
        rasterized=values.size > 2000,
    )
    mesh.set_edgecolor("face")
    for scale, axis_label in zip((axes.set_xscale, axes.set_yscale), axis_labels, strict=True):
        if axis_label.logarithmic:
            scale("log")
            set_decade_ticks(axes.xaxis if axis_label is axis_labels[0] else axes.yaxis)
    axes.set_xlabel(axis_labels[0].text)
    axes.set_ylabel(axis_labels[1].text)
    bar = add_colour_bar(axes, mesh, label)
    if spread == "log":
        set_decade_ticks(bar.ax.yaxis)
    axes.set_label(f"{label} over {axis_labels[0].text} and {axis_labels[1].text}")
    return axes


def _cell_edges(centres: np.ndarray, *, logarithmic: bool) -> np.ndarray:
    """Return the edges of cells, (n + 1,), given their centres."""
    positions = np.log(centres) if logarithmic else np.asarray(centres, dtype=float)
    if positions.size == 1:
        inner = np.zeros(0)
        first, last = positions[0] - 0.5, positions[0] + 0.5
    else:
        inner = (positions[1:] + positions[:-1]) / 2
        first, last = (
            positions[0] - (positions[1] - positions[0]) / 2,
            positions[-1] + (positions[-1] - positions[-2]) / 2,
        )
    edges = np.concatenate([[first], inner, [last]])
    return np.exp(edges) if logarithmic else edges
