"""What the figures of the page share: how they are made, coloured, and their powers sent."""

import numpy as np
from bokeh.models import ColorBar, Legend, Title
from bokeh.plotting import figure

from dechirp.studio.theme import Theme

SPAN_DB = 60.0
"""The widest of a map, from the strongest cell down."""
SELDOM = "overlay"
"""Level of what is painted when it changes: words take longer than maps, 20 times a second."""


def plain_figure(*, title: str, x: str, y: str) -> figure:
    """A figure without a toolbar that fills its tile; `x` and `y` are its labels, with units."""
    made = figure(
        title=title,
        x_axis_label=x,
        y_axis_label=y,
        sizing_mode="stretch_both",
        toolbar_location=None,
        tools="",
        min_border=4,
        output_backend="canvas",
    )
    # Where a tile ends between two pixels the browser shows what is behind it, else white.
    made.styles = {"background": "var(--tile)"}
    made.title.text_font_size = "12px"
    made.title.level = SELDOM
    for axis in made.axis:
        axis.level = SELDOM
        axis.axis_label_text_font_size = "11px"
        axis.axis_label_text_font_style = "normal"
        axis.major_label_text_font_size = "10px"
    return made


def second_line(made: figure) -> Title:
    """A smaller line under the title of a figure: what its marks mean, and lesser numbers."""
    # Its room is what its first words need: figures are not laid out again for others.
    line = Title(text="The first frame is under way.", standoff=5)
    line.level = SELDOM
    line.text_font_size, line.text_font_style = "10px", "normal"
    # Both begin above the labels of the axis, not above the frame: small tiles need the room.
    made.title.offset = line.offset = -36
    made.title.standoff = 0
    made.add_layout(line, "above")
    return line


def wear(made: figure, theme: Theme) -> None:
    """Give a figure the colours of a theme, but for what it draws."""
    made.background_fill_color = made.border_fill_color = theme.tile
    made.outline_line_color = theme.rule
    for title in made.select(Title):
        title.text_color = theme.muted
    made.title.text_color = theme.ink
    for axis in made.axis:
        axis.axis_line_color = axis.major_tick_line_color = theme.rule
        axis.minor_tick_line_color = None
        axis.axis_label_text_color = axis.major_label_text_color = theme.muted
    for grid in made.grid:
        grid.grid_line_color = theme.rule
    for legend in made.select(Legend):
        legend.background_fill_color, legend.border_line_color = theme.tile, theme.rule
        legend.label_text_color = theme.ink
    for bar in made.select(ColorBar):
        bar.background_fill_color = theme.tile
        bar.major_label_text_color = bar.title_text_color = theme.muted
        bar.bar_line_color = bar.major_tick_line_color = None


def levels(power: np.ndarray, top: float, span_db: float = SPAN_DB) -> np.ndarray:
    """Powers as uint8: 255 at `top` and over it, 0 at `span_db` below and under.

    No power at all is 0, infinite power 255; what is no number is 0 too.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        shown = np.log10(np.asarray(power, np.float32) / np.float32(top))
        shown *= 10 * 255 / span_db
        shown += 255
    np.fmax(shown, 0, out=shown)  # of zero and what is no number, zero
    return np.minimum(shown, 255, out=shown).astype(np.uint8)


def joined(lines: list[np.ndarray]) -> np.ndarray:
    """Lines (n, 2) as one with gaps: it is sent as one array, which takes a tenth of the time."""
    gap = np.full((1, 2), np.nan)
    parts = [part for line in lines for part in (line, gap)]
    return np.concatenate([np.empty((0, 2)), *parts]).astype(np.float32)
