"""What is in a data set: where its targets are, how strong they are, how many are detected."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from dechirp.report.figures.parts import MAP_AXES, legend
from dechirp.report.figures.style import LINE_COLORS, LINE_MARKS

_COLORS, _MARKS = LINE_COLORS[:6], LINE_MARKS[:6]  # clouds hide each other sooner than lines
MOST_CLASSES = len(_COLORS)
"""That one figure tells apart."""

_MOST_BINS = 40


def places(axes: Axes, of: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> Axes:
    """Draw velocity over range of targets, by class.

    Parameters
    ----------
    axes : Axes
        To draw on.
    of : mapping
        For each class ranges (m) and velocities (m/s), (n,) each; at most `MOST_CLASSES`.

    Returns
    -------
    Axes
        Those given.
    """
    for (name, (x, y)), color, mark in zip(of.items(), _COLORS, _MARKS, strict=False):
        axes.plot(x, y, mark, color=color, markersize=2.6, alpha=0.55, mew=0, label=name)
    axes.set_xlabel(MAP_AXES["range"])
    axes.set_ylabel(MAP_AXES["velocity"])
    _legend(axes, n=len(of))
    axes.set_label("Velocity over range of the targets")
    return axes


def spread(
    axes: Axes,
    classes: Mapping[str, np.ndarray],
    *,
    words: str,
    of: str,
    whole: bool = False,
) -> Axes:
    """Draw how often values occur, by class.

    Parameters
    ----------
    axes : Axes
        To draw on.
    classes : mapping
        Values of each class, (n,); at most `MOST_CLASSES`.
    words : str
        What the values are, with their unit.
    of : str
        What has them: targets, items.
    whole : bool
        Whether values are whole numbers: no bar then ends between two.

    Returns
    -------
    Axes
        Those given.
    """
    everything = np.concatenate([[], *classes.values()])
    there = everything[np.isfinite(everything)]
    low, high = (float(there.min()), float(there.max())) if there.size else (0.0, 1.0)
    if whole:
        step = max(1, int(np.ceil((high - low + 1) / _MOST_BINS)))
        edges = np.arange(low, high + 1 + step, step) - 0.5
    else:
        n_bins = int(np.clip(np.sqrt(there.size), 5, _MOST_BINS))
        edges = np.linspace(low, high if high > low else low + 1.0, n_bins + 1)
    for (name, values), color in zip(classes.items(), _COLORS, strict=False):
        heights, _ = np.histogram(values[np.isfinite(values)], edges)
        axes.stairs(heights, edges, fill=True, color=color, alpha=0.22)
        axes.stairs(heights, edges, color=color, label=name)
    axes.set_xlabel(words)
    axes.set_ylabel(f"number of {of}")
    axes.set_ylim(bottom=0)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.grid(axis="x", visible=False)
    _legend(axes, n=len(classes))
    axes.set_label(f"How often: {words}")
    return axes


def _legend(axes: Axes, *, n: int) -> None:
    made = legend(axes) if n > 1 else None
    for handle in made.legend_handles if made is not None else ():
        if handle is not None:
            handle.set_alpha(1.0)
