"""Figures of the contents of a data set."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from dechirp.report.figures.common import AXIS_LABELS, add_legend
from dechirp.report.figures.style import LINE_COLORS, LINE_MARKS

_COLORS, _MARKS = LINE_COLORS[:6], LINE_MARKS[:6]  # point clouds overlap more than lines
MAX_CLASSES = len(_COLORS)
"""Largest number of classes in a figure."""

_MAX_BINS = 40


def draw_target_velocity_over_range(
    axes: Axes, targets_by_class: Mapping[str, tuple[np.ndarray, np.ndarray]]
) -> Axes:
    """Draw velocity over range of the targets, by class.

    Parameters
    ----------
    axes : Axes
        Axes to draw on.
    targets_by_class : mapping
        Ranges (m) and velocities (m/s) of each class, (n,) each; at most `MAX_CLASSES`.

    Returns
    -------
    Axes
        The given axes.
    """
    for (name, (x, y)), color, mark in zip(targets_by_class.items(), _COLORS, _MARKS, strict=False):
        axes.plot(x, y, mark, color=color, markersize=2.6, alpha=0.55, mew=0, label=name)
    axes.set_xlabel(AXIS_LABELS["range"])
    axes.set_ylabel(AXIS_LABELS["velocity"])
    _add_class_legend(axes, n_classes=len(targets_by_class))
    axes.set_label("Velocity over range of the targets")
    return axes


def draw_histogram(
    axes: Axes,
    values_by_class: Mapping[str, np.ndarray],
    *,
    label: str,
    counted_things: str,
    is_integer: bool = False,
) -> Axes:
    """Draw histograms of values by class.

    Parameters
    ----------
    axes : Axes
        Axes to draw on.
    values_by_class : mapping
        Values of each class, (n,); at most `MAX_CLASSES`.
    label : str
        Label of the values, with their unit.
    counted_things : str
        Label of the counted objects: targets, items.
    is_integer : bool
        Whether values are integers; bin edges then lie halfway between them.

    Returns
    -------
    Axes
        The given axes.
    """
    everything = np.concatenate([[], *values_by_class.values()])
    finite_values = everything[np.isfinite(everything)]
    low, high = (
        (float(finite_values.min()), float(finite_values.max()))
        if finite_values.size
        else (0.0, 1.0)
    )
    if is_integer:
        step = max(1, int(np.ceil((high - low + 1) / _MAX_BINS)))
        edges = np.arange(low, high + 1 + step, step) - 0.5
    else:
        n_bins = int(np.clip(np.sqrt(finite_values.size), 5, _MAX_BINS))
        edges = np.linspace(low, high if high > low else low + 1.0, n_bins + 1)
    for (name, values), color in zip(values_by_class.items(), _COLORS, strict=False):
        heights, _ = np.histogram(values[np.isfinite(values)], edges)
        axes.stairs(heights, edges, fill=True, color=color, alpha=0.22)
        axes.stairs(heights, edges, color=color, label=name)
    axes.set_xlabel(label)
    axes.set_ylabel(f"Number of {counted_things}")
    axes.set_ylim(bottom=0)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.grid(axis="x", visible=False)
    _add_class_legend(axes, n_classes=len(values_by_class))
    axes.set_label(f"Histogram: {label}")
    return axes


def _add_class_legend(axes: Axes, *, n_classes: int) -> None:
    class_legend = add_legend(axes) if n_classes > 1 else None
    for handle in class_legend.legend_handles if class_legend is not None else ():
        if handle is not None:
            handle.set_alpha(1.0)
