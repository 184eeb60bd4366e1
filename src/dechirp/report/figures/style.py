"""How all figures look, and how they get into the page."""

import io
import re
from collections.abc import Callable
from typing import Any

import matplotlib as mpl
import numpy as np
from markupsafe import Markup, escape
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

# Okabe and Ito's colours, told apart by colour-blind readers, darkened for thin lines.
INK, MUTED, PALE = "#1d2733", "#66727f", "#c9d0d7"
BLUE, ORANGE, GREEN = "#0868ac", "#c8500a", "#00795a"

# Light to dark through blue: one hue, the same for colour-blind readers, and it prints.
COLORS = LinearSegmentedColormap.from_list(
    "noise-to-peak", ["#f6f9fb", "#d3e5f0", "#92c1dc", "#3f8fc0", "#155a96", "#072b55"], N=128
)

WIDTH_IN = 5.2  # 500 CSS pixels: two side by side at 1280, and 11 px letters stay legible at 400
_STYLE: dict[Any, Any] = {
    "font.size": 8.5,
    "axes.edgecolor": PALE,
    "axes.labelcolor": MUTED,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
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


def draw(paint: Callable[[Figure], None], *, label: str, height_in: float) -> Markup:
    """Return SVG of what `paint` draws; its letters are text, in the font of the page.

    Parameters
    ----------
    paint : function
        Draws on the figure that it is given.
    label : str
        What a reader who cannot see the figure is told.
    height_in : float
        Height at a width of `WIDTH_IN`.
    """
    text = io.StringIO()
    with mpl.rc_context(_STYLE):
        figure = _painted(paint, height_in)
        figure.savefig(text, format="svg", transparent=True, metadata={"Date": None})
    svg = text.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    # Names of groups would repeat from figure to figure, and nothing refers to them.
    svg = re.sub(r'<g id="[^"]*"', "<g", svg)
    box = re.search(r'viewBox="[^"]*"', svg)
    assert box is not None
    # Inside HTML no name spaces are declared.
    head = f'<svg {box[0]} role="img" aria-label="{escape(label)}">'
    return Markup(head + svg[svg.index(">") + 1 :])


def picture(paint: Callable[[Figure], None], *, height_in: float) -> bytes:
    """Return PNG of what `paint` draws, 1560 pixels wide, for those who have no page around it."""
    png = io.BytesIO()
    with mpl.rc_context(_STYLE):
        figure = _painted(paint, height_in)
        figure.savefig(png, format="png", dpi=300, facecolor="white")
    return png.getvalue()


def _painted(paint: Callable[[Figure], None], height_in: float) -> Figure:
    figure = Figure(figsize=(WIDTH_IN, height_in), layout="constrained")
    paint(figure)
    return figure


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
