"""What is in a data set: where its targets are, how strong they are, how many are detected."""

from collections.abc import Mapping

import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from dechirp.report.figures.style import BLUE, GREEN, INK, ORANGE, draw

_COLORS = (BLUE, ORANGE, GREEN, "#a3487f", "#7a6a00", INK)
_MARKS = ("o", "s", "D", "^", "v", "P")
MOST_CLASSES = len(_COLORS)
"""That one figure tells apart."""

_MOST_BINS = 40
_HEIGHT_IN = 3.1


def places(of: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> Markup:
    """Draw range (m) and velocity (m/s) of targets, by class."""

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        for (name, (x, y)), color, mark in zip(of.items(), _COLORS, _MARKS, strict=False):
            axes.plot(x, y, mark, color=color, markersize=2.6, alpha=0.55, mew=0, label=name)
        axes.set_xlabel("range, m")
        axes.set_ylabel("velocity, m/s (receding positive)")
        _legend(figure, n=len(of))

    return draw(paint, label="Velocity over range of the targets", height_in=_HEIGHT_IN)


def spread(
    classes: Mapping[str, np.ndarray], *, words: str, of: str, whole: bool = False
) -> Markup:
    """Draw how often values occur, by class; `of` says what has them, `whole` that they count."""
    everything = np.concatenate([[], *classes.values()])
    there = everything[np.isfinite(everything)]
    low, high = (float(there.min()), float(there.max())) if there.size else (0.0, 1.0)
    if whole:
        step = max(1, int(np.ceil((high - low + 1) / _MOST_BINS)))
        edges = np.arange(low, high + 1 + step, step) - 0.5
    else:
        n_bins = int(np.clip(np.sqrt(there.size), 5, _MOST_BINS))
        edges = np.linspace(low, high if high > low else low + 1.0, n_bins + 1)

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        for (name, values), color in zip(classes.items(), _COLORS, strict=False):
            heights, _ = np.histogram(values[np.isfinite(values)], edges)
            axes.stairs(heights, edges, fill=True, color=color, alpha=0.22)
            axes.stairs(heights, edges, color=color, label=name)
        axes.set_xlabel(words)
        axes.set_ylabel(of)
        axes.set_ylim(bottom=0)
        axes.yaxis.set_major_locator(MaxNLocator(integer=True))
        axes.grid(axis="x", visible=False)
        _legend(figure, n=len(classes))

    return draw(paint, label=f"How often: {words}", height_in=_HEIGHT_IN)


def _legend(figure: Figure, *, n: int) -> None:
    if n < 2:
        return
    legend = figure.legend(loc="outside upper right", ncols=min(n, 4), handletextpad=0.4)
    for handle in legend.legend_handles:
        if handle is not None:
            handle.set_alpha(1.0)
