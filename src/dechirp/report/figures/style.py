"""How all figures look, and how they get into the page."""

import io
import re
from collections.abc import Callable, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from markupsafe import Markup, escape
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

# Okabe and Ito's colours, told apart by colour-blind readers, darkened for thin lines.
INK, MUTED, PALE = "#1d2733", "#66727f", "#c9d0d7"
BLUE, ORANGE, GREEN = "#0868ac", "#c8500a", "#00795a"
LINE_COLORS = (BLUE, ORANGE, GREEN, "#a3487f", "#7a6a00", INK, "#4aa3d8", "#8b5a2b")
LINE_MARKS = ("o", "s", "D", "^", "v", "P", "X", "*")
"""Of lines beside each other; with marks of their own they need no colour."""

# Light to dark through blue: one hue, the same for colour-blind readers, and it prints.
COLORS = LinearSegmentedColormap.from_list(
    "noise-to-peak", ["#f6f9fb", "#d3e5f0", "#92c1dc", "#3f8fc0", "#155a96", "#072b55"], N=128
)

WIDTH_IN = 5.2  # 500 CSS pixels: two side by side at 1280, and 11 px letters stay legible at 400
HEIGHT_IN, TALL_IN = 3.2, 3.6  # of most figures; of maps and views from above
_ROW_IN = 0.25  # what a legend of one row takes

Paint = Callable[[Figure], Axes | Sequence[Axes]]

_STYLE: dict[Any, Any] = {
    "font.size": 8.5,
    "axes.edgecolor": PALE,
    "axes.labelcolor": MUTED,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.titlesize": "medium",
    "axes.formatter.useoffset": False,
    "figure.titlesize": 9,
    "figure.labelsize": "medium",
    "grid.color": "#e9edf0",
    "grid.linewidth": 0.7,
    "xtick.color": PALE,
    "ytick.color": PALE,
    "xtick.labelcolor": MUTED,
    "ytick.labelcolor": MUTED,
    "legend.frameon": False,
    "legend.labelcolor": INK,
    "text.color": INK,
    "text.parse_math": False,  # a target may be called $x$
    "svg.fonttype": "none",
    "svg.hashsalt": "dechirp",  # the same result, the same page
}


def svg(paint: Paint, *, height_in: float = HEIGHT_IN) -> Markup:
    """Return SVG of what `paint` draws; its letters are text, in the font of the page.

    Parameters
    ----------
    paint : function
        Draws on the figure that it is given and returns the axes, one or several. Their labels
        are what a reader who cannot see the figure is told.
    height_in : float
        Height at a width of `WIDTH_IN`, with one row of legend; more rows add to it.

    Examples
    --------
    >>> svg(lambda figure: beat.signal(figure.subplots(), cube))  # doctest: +SKIP
    """
    text = io.StringIO()
    with mpl.rc_context(_STYLE):
        figure, label = _painted(paint, height_in)
        figure.savefig(text, format="svg", transparent=True, metadata={"Date": None})
    made = text.getvalue()
    made = made[made.index("<svg") :]
    made = re.sub(r"<metadata>.*?</metadata>", "", made, flags=re.DOTALL)
    # Names of groups would repeat from figure to figure, and nothing refers to them.
    made = re.sub(r'<g id="[^"]*"', "<g", made)
    box = re.search(r'viewBox="[^"]*"', made)
    assert box is not None
    # Inside HTML no name spaces are declared.
    head = f'<svg {box[0]} role="img" aria-label="{escape(label)}">'
    return Markup(head + made[made.index(">") + 1 :])


def png(paint: Paint, *, title: str = "", height_in: float = HEIGHT_IN) -> bytes:
    """Return PNG of what `paint` draws, 1560 pixels wide, for those who have no page around it."""
    picture = io.BytesIO()
    with mpl.rc_context(_STYLE):
        figure, label = _painted(paint, height_in)
        if title:
            figure.suptitle(title)
        told = {"Software": None, "Description": label}
        figure.savefig(picture, format="png", dpi=300, facecolor="white", metadata=told)
    return picture.getvalue()


def _painted(paint: Paint, height_in: float) -> tuple[Figure, str]:
    """A figure of the page, and the labels of its axes."""
    figure = Figure(figsize=(WIDTH_IN, height_in), layout="constrained")
    made = paint(figure)
    panels = [made] if isinstance(made, Axes) else made
    rows_in = max(map(_legend_in, panels))
    figure.set_figheight(height_in + max(rows_in - _ROW_IN, 0.0))
    return figure, "; ".join(dict.fromkeys(str(axes.get_label()) for axes in panels))


def _legend_in(axes: Axes) -> float:
    """How far a legend reaches above the axes."""
    legend = axes.get_legend()
    if legend is None:
        return 0.0
    return float(legend.get_window_extent().y1 - axes.bbox.y1) / axes.figure.dpi


def thinned(x: np.ndarray, y: np.ndarray, n_blocks: int = 600) -> tuple[np.ndarray, np.ndarray]:
    """Thin a line to two points a pixel: the smallest and largest of each block survive."""
    if y.size <= 2 * n_blocks:
        return x, y
    starts = np.linspace(0, y.size, n_blocks, endpoint=False, dtype=int)
    ends = np.append(starts[1:], y.size)
    blocks = zip(starts, ends, strict=True)
    keep = np.array(
        sorted({start + at for start, end in blocks for at in _extremes(y[start:end])}), dtype=int
    )
    return x[keep], y[keep]


def _extremes(block: np.ndarray) -> tuple[int, int]:
    return int(block.argmin()), int(block.argmax())
