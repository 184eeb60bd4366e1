"""Style of all figures, and their rendering to SVG and PNG."""

import io
import re
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from typing import Any

import matplotlib as mpl
import numpy as np
from markupsafe import Markup, escape
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from dechirp.core.values import frozen_dataclass

# Okabe and Ito's colours, which colour-blind readers can distinguish, darkened for thin lines.
INK, MUTED, PALE = "#1d2733", "#66727f", "#c9d0d7"
BLUE, ORANGE, GREEN = "#0868ac", "#c8500a", "#00795a"
LINE_COLORS = (BLUE, ORANGE, GREEN, "#a3487f", "#7a6a00", INK, "#4aa3d8", "#8b5a2b")
LINE_MARKS = ("o", "s", "D", "^", "v", "P", "X", "*")
"""Marks of the lines of a figure, which distinguish them without colour."""

# Light to dark blue: a single hue, suitable for colour-blind readers and for printing.
COLORS = LinearSegmentedColormap.from_list(
    "noise-to-peak", ["#f6f9fb", "#d3e5f0", "#92c1dc", "#3f8fc0", "#155a96", "#072b55"], N=128
)

WIDTH_IN = 5.2  # 500 CSS pixels: two side by side at 1280, and 11 px letters stay legible at 400
HEIGHT_IN, TALL_IN = 3.2, 3.6  # of most figures; of maps and top views
_PNG_DPI = 300
_ROW_IN = 0.25  # height of a legend of one row

Paint = Callable[[Figure], Axes | Sequence[Axes]]


@frozen_dataclass
class FigureWithCaption:
    """SVG figure with its title and caption."""

    title: str
    caption: str
    figure: Markup


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
    "svg.hashsalt": "dechirp",  # equal results give equal pages
}


def render_svg(paint: Paint, *, height_in: float = HEIGHT_IN) -> Markup:
    """Return the SVG of a figure; its letters are text in the font of the page.

    Parameters
    ----------
    paint : function
        Function that draws on the given figure and returns its axes, one or several. Their labels
        become the alternative text.
    height_in : float
        Height at a width of `WIDTH_IN`, with a legend of one row; further rows add to it.

    Examples
    --------
    >>> svg(lambda figure: beat.signal(figure.subplots(), cube))  # doctest: +SKIP
    """
    text = io.StringIO()
    with mpl.rc_context(_STYLE):
        figure, label = _paint_figure_with_description(paint, height_in)
        FigureCanvasSVG(figure)
        _lay_out_once(figure)
        figure.savefig(text, format="svg", transparent=True, metadata={"Date": None})
    markup = text.getvalue()
    markup = markup[markup.index("<svg") :]
    markup = re.sub(r"<metadata>.*?</metadata>", "", markup, flags=re.DOTALL)
    # Group ids would not be unique on a page, and nothing refers to them.
    markup = re.sub(r'<g id="[^"]*"', "<g", markup)
    box = re.search(r'viewBox="[^"]*"', markup)
    assert box is not None
    # SVG inside HTML needs no namespaces.
    head = f'<svg {box[0]} role="img" aria-label="{escape(label)}">'
    return Markup(head + markup[markup.index(">") + 1 :])


def render_png(paint: Paint, *, title: str = "", height_in: float = HEIGHT_IN) -> bytes:
    """Return a PNG of a figure on white ground, 1560 pixels wide."""
    picture = io.BytesIO()
    with mpl.rc_context(_STYLE):
        figure, label = _paint_figure_with_description(paint, height_in)
        if title:
            figure.suptitle(title)
        figure.set_dpi(_PNG_DPI)
        _lay_out_once(figure)
        metadata = {"Software": None, "Description": label}
        figure.savefig(picture, format="png", dpi=_PNG_DPI, facecolor="white", metadata=metadata)
    return picture.getvalue()


def report_style() -> AbstractContextManager[None]:
    """Return a context in which matplotlib draws in the style of the report."""
    return mpl.rc_context(_STYLE)


def _paint_figure_with_description(paint: Paint, height_in: float) -> tuple[Figure, str]:
    """Create a figure and return it with the labels of its axes."""
    figure = Figure(figsize=(WIDTH_IN, height_in), layout="constrained")
    painted = paint(figure)
    panels = [painted] if isinstance(painted, Axes) else painted
    rows_in = max(map(_legend_height_in, panels))
    figure.set_figheight(height_in + max(rows_in - _ROW_IN, 0.0))
    return figure, "; ".join(dict.fromkeys(str(axes.get_label()) for axes in panels))


def _lay_out_once(figure: Figure) -> None:
    """Place the axes now; `savefig` would first draw the whole figure invisibly to do so."""
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
        figure.set_layout_engine(None)  # after "none" `savefig` still draws twice


def _legend_height_in(axes: Axes) -> float:
    """Return the height (in) of a legend above the axes."""
    legend = axes.get_legend()
    if legend is None:
        return 0.0
    return float(legend.get_window_extent().y1 - axes.bbox.y1) / axes.figure.dpi


def reduce_line_to_extremes(
    x: np.ndarray, y: np.ndarray, n_blocks: int = 600
) -> tuple[np.ndarray, np.ndarray]:
    """Reduce a line to two points per pixel, the minimum and maximum of each block."""
    if y.size <= 2 * n_blocks:
        return x, y
    starts = np.linspace(0, y.size, n_blocks, endpoint=False, dtype=int)
    ends = np.append(starts[1:], y.size)
    blocks = zip(starts, ends, strict=True)
    keep = np.array(
        sorted(
            {
                start + offset
                for start, end in blocks
                for offset in _indices_of_minimum_and_maximum(y[start:end])
            }
        ),
        dtype=int,
    )
    return x[keep], y[keep]


def _indices_of_minimum_and_maximum(block: np.ndarray) -> tuple[int, int]:
    return int(block.argmin()), int(block.argmax())
