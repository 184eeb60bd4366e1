"""Style of the figures: theme, stable limits, and conversion of powers to image levels."""

import math

import numpy as np
from bokeh.models import ColorBar, Legend
from bokeh.plotting import figure

from dechirp.studio.theme import Theme

_STEP_DB = 10.0
_MAX_SPAN_DB = 100.0  # without noise, window sidelobes reach down 200 dB


def round_up_to_1_2_5(largest: float) -> float:
    """Round up to 1, 2 or 5 times a power of ten; 1 for zero."""
    if not largest > 0:
        return 1.0
    decade = 10.0 ** math.floor(math.log10(largest))
    return next(step * decade for step in (1, 2, 5, 10, 20) if step * decade >= largest)


def limits_rounded_to_10_db(lowest_db: float, highest_db: float) -> tuple[float, float]:
    """Return limits in multiples of 10 dB around both levels, at most 100 dB apart."""
    top_db = _STEP_DB * math.ceil((highest_db + 2) / _STEP_DB)
    bottom_db = _STEP_DB * math.floor(lowest_db / _STEP_DB)
    return min(max(bottom_db, top_db - _MAX_SPAN_DB), top_db - _STEP_DB), top_db


def level_12_db_below_median(level_db: np.ndarray) -> float:
    """Return the lower limit of a level axis: single noise cells reach down arbitrarily far."""
    return float(np.median(level_db)) - 12.0


SPAN_DB = 60.0
"""Largest dynamic range of a map, below the strongest cell."""
TEXT_SIZE = "12px"
"""Size of all text in figures, the smallest that is easily read."""
VELOCITY_TILE_LABEL = "Velocity (m/s, + receding)"
"""Label of a velocity axis that fits beside a tile of 160 pixels."""
STATIC_LEVEL = "overlay"
"""Paint level of static parts: text takes longer to paint than maps at 20 frames a second."""


def create_plain_figure(*, x: str, y: str) -> figure:
    """Create a figure without a toolbar that fills its tile; `x` and `y` are axis labels."""
    new_figure = figure(
        x_axis_label=x,
        y_axis_label=y,
        sizing_mode="stretch_both",
        toolbar_location=None,
        tools="",
        min_border=4,
        min_border_right=9,  # half of a number at the end of the axis
        output_backend="canvas",
    )
    # The browser fills: Bokeh does not clear the first half pixel, where a line of the other theme
    # would stay.
    new_figure.styles = {"background": "var(--tile)"}
    new_figure.background_fill_color = new_figure.border_fill_color = None
    new_figure.title.text_font_size = TEXT_SIZE
    new_figure.title.level = STATIC_LEVEL
    for axis in new_figure.axis:
        axis.level = STATIC_LEVEL
        axis.axis_label_text_font_size = axis.major_label_text_font_size = TEXT_SIZE
        axis.axis_label_text_font_style = "normal"
    return new_figure


def apply_figure_theme(target_figure: figure, theme: Theme) -> None:
    """Apply the colours of a theme to the axes and titles of a figure."""
    target_figure.outline_line_color = theme.rule
    target_figure.title.text_color = theme.ink
    for axis in target_figure.axis:
        axis.axis_line_color = axis.major_tick_line_color = theme.rule
        axis.minor_tick_line_color = None
        axis.axis_label_text_color = axis.major_label_text_color = theme.muted
    for grid in target_figure.grid:
        grid.grid_line_color = theme.rule
    for legend in target_figure.select(Legend):
        legend.background_fill_color, legend.border_line_color = theme.tile, theme.rule
        legend.label_text_color = theme.ink
    for bar in target_figure.select(ColorBar):
        bar.background_fill_color = theme.tile
        bar.major_label_text_color = bar.title_text_color = theme.muted
        bar.bar_line_color = bar.major_tick_line_color = None


def power_to_image_levels(
    power: np.ndarray, top_power: float, span_db: float = SPAN_DB
) -> np.ndarray:
    """Convert powers to uint8 levels: 255 at `top_power` and above, 0 at `span_db` below it.

    Zero power and NaN give 0, infinite power 255.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        levels = np.log10(np.asarray(power, np.float32) / np.float32(top_power))
        levels *= 10 * 255 / span_db
        levels += 255
    np.fmax(levels, 0, out=levels)  # 0 for zero power and NaN
    return np.minimum(levels, 255, out=levels).astype(np.uint8)


def join_lines_with_gaps(lines: list[np.ndarray]) -> np.ndarray:
    """Join lines (n, 2) to one with gaps: sending one array takes a tenth of the time."""
    gap = np.full((1, 2), np.nan)
    parts = [part for line in lines for part in (line, gap)]
    return np.concatenate([np.empty((0, 2)), *parts]).astype(np.float32)
