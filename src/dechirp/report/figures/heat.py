"""A score over two settings, as a map."""

import numpy as np
from matplotlib.axes import Axes

from dechirp.report.figures.parts import colour_bar, in_decades
from dechirp.report.figures.study import Axis, spread_of
from dechirp.report.figures.style import COLORS


def heat(
    axes: Axes,
    x: np.ndarray,
    y: np.ndarray,
    values: np.ndarray,
    *,
    axes_words: tuple[Axis, Axis],
    words: str,
    is_ratio: bool,
) -> Axes:
    """Draw a score over two settings as a map; cells without a value stay grey.

    Parameters
    ----------
    axes : Axes
        To draw on; a colour bar takes of their room.
    x, y : array (n_x,), (n_y,)
        Values of the settings, ascending.
    values : array (n_y, n_x)
        The score.
    axes_words : tuple of Axis
        Of x and y.
    words : str
        What the score is, with its unit.
    is_ratio : bool
        Whether values are shares or probabilities.

    Returns
    -------
    Axes
        Those given.
    """
    spread = spread_of(values, is_ratio=is_ratio)
    shown = np.where(values > 0, values, np.nan) if spread == "log" else values
    axes.grid(visible=False)
    axes.set_facecolor("#e3e6e9")
    made = axes.pcolormesh(
        _edges(x, logarithmic=axes_words[0].logarithmic),
        _edges(y, logarithmic=axes_words[1].logarithmic),
        np.ma.masked_invalid(shown),
        cmap=COLORS,
        norm="log" if spread == "log" else "linear",
        vmin=0.0 if spread == "shares" else None,
        vmax=1.0 if spread == "shares" else None,
        rasterized=values.size > 2000,
    )
    made.set_edgecolor("face")
    for scale, which in zip((axes.set_xscale, axes.set_yscale), axes_words, strict=True):
        if which.logarithmic:
            scale("log")
            in_decades(axes.xaxis if which is axes_words[0] else axes.yaxis)
    axes.set_xlabel(axes_words[0].words)
    axes.set_ylabel(axes_words[1].words)
    bar = colour_bar(axes, made, words)
    if spread == "log":
        in_decades(bar.ax.yaxis)
    axes.set_label(f"{words} over {axes_words[0].words} and {axes_words[1].words}")
    return axes


def _edges(centres: np.ndarray, *, logarithmic: bool) -> np.ndarray:
    """Edges of cells about values, (n + 1,)."""
    at = np.log(centres) if logarithmic else np.asarray(centres, dtype=float)
    if at.size == 1:
        inner = np.zeros(0)
        first, last = at[0] - 0.5, at[0] + 0.5
    else:
        inner = (at[1:] + at[:-1]) / 2
        first, last = at[0] - (at[1] - at[0]) / 2, at[-1] + (at[-1] - at[-2]) / 2
    edges = np.concatenate([[first], inner, [last]])
    return np.exp(edges) if logarithmic else edges
