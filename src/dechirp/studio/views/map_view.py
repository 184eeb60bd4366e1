"""Base class of map views: an image of power with a colour bar and marks."""

import math
from abc import abstractmethod
from collections.abc import Iterator

import numpy as np
from bokeh.events import DoubleTap, Pan, Tap
from bokeh.models import (
    BasicTicker,
    ColorBar,
    ColumnDataSource,
    GlyphRenderer,
    LinearColorMapper,
    Range1d,
    Span,
    Toggle,
    UIElement,
)

from dechirp.core.text import power_level_unit, power_to_dbm_or_dbfs
from dechirp.core.units import from_decibels
from dechirp.report.figures.range_doppler import block_maxima
from dechirp.report.labels import power_label
from dechirp.studio.browser_events import register_position_callback
from dechirp.studio.cursor import Cursor
from dechirp.studio.session import Session
from dechirp.studio.theme import Theme
from dechirp.studio.views.base import View
from dechirp.studio.views.figure_style import (
    SPAN_DB,
    STATIC_LEVEL,
    TEXT_SIZE,
    apply_figure_theme,
    create_plain_figure,
    power_to_image_levels,
)

_MAX_CELLS = (256, 384)  # sent along y and x: 96 KiB
_MAX_MARKS, _MAX_LARGE_MARKS = 200, 40
_LARGE_MARK, _SMALL_MARK = (28, 14, 3), (16, 8, 2)  # pixels: width, height, feet of a bracket
_UPRIGHT, _TURNED = 0.0, math.pi / 2
# Distinguishable on all colours of a map: light with a dark rim.
_LIGHT, _RIM = "#ffffff", "#101418"
_STEP_DB = 5.0  # step of the colour limits, which stay constant while noise moves the peak
_SUBSAMPLED_CELLS = 4096  # a twelfth of these cells gives the noise to 0.3 dB
_MIN_TOP_OVER_NOISE_DB = 35.0  # cells of noise reach 12 dB over their median
_MIN_SPAN_DB = 30.0  # noise alone spans more than 15 dB and must not look like echoes


class MapView(View):
    """Image with brackets around detections and targets; a tap or drag moves the cursor."""

    def __init__(self, session: Session, *, x: str, y: str) -> None:
        super().__init__(session)
        self.figure = create_plain_figure(x=x, y=y)
        self.figure.name = self.name
        self.figure.grid.visible = False
        self.figure.x_range, self.figure.y_range = Range1d(0, 1), Range1d(0, 1)
        self.image = ColumnDataSource({"image": [np.zeros((1, 1), np.uint8)]})
        self.marks = ColumnDataSource({"x": [], "y": [], "angle": []})
        """Centres of brackets, and angles: `_UPRIGHT` of detections, `_TURNED` of targets."""
        # The image contains levels; the colour bar shows the powers they represent.
        self._level_mapper = LinearColorMapper(low=0, high=255)
        self._power_mapper = LinearColorMapper(low=-100 - SPAN_DB, high=-100)
        self._image_glyph = self.figure.image(
            image="image", x=0, y=0, dw=1, dh=1, source=self.image, color_mapper=self._level_mapper
        ).glyph
        self._colour_bar = _create_colour_bar(self._power_mapper)
        self.figure.add_layout(self._colour_bar, "right")
        self._marks = list(self._add_marks())
        self._vertical_line, self._horizontal_line = (
            Span(dimension=dimension, line_color=_LIGHT, line_dash="3 3", line_alpha=0.8)
            for dimension in ("height", "width")
        )
        self.figure.add_layout(self._vertical_line)
        self.figure.add_layout(self._horizontal_line)
        for event in (Tap, Pan):
            register_position_callback(self.figure, event, self._move_cursor)
        self.figure.on_event(DoubleTap, lambda _: session.move_cursor(None))

    @property
    def root_element(self) -> UIElement:
        return self.figure

    def apply_theme(self, theme: Theme) -> None:
        apply_figure_theme(self.figure, theme)
        self._level_mapper.palette = self._power_mapper.palette = theme.map

    @abstractmethod
    def cursor_at_position(self, x: float, y: float) -> Cursor:
        """Return the cursor for a position in the figure."""

    def set_image_extent(self, x: tuple[float, float], y: tuple[float, float]) -> None:
        """Set the extent of the image along x and y."""
        if (self.figure.x_range.start, self.figure.x_range.end) != x:
            self.figure.x_range.update(start=x[0], end=x[1])
            self._image_glyph.update(x=min(x), dw=abs(x[1] - x[0]))
        if (self.figure.y_range.start, self.figure.y_range.end) != y:
            self.figure.y_range.update(start=y[0], end=y[1])
            self._image_glyph.update(y=min(y), dh=abs(y[1] - y[0]))

    def draw_power(self, power: np.ndarray, *, units: str) -> None:
        """Draw powers (y, x) of samples with the given units."""
        zero_db = float(power_to_dbm_or_dbfs(np.ones(()), units))
        top_db, bottom_db = self._colour_limits_db(power, units)
        top = float(from_decibels(top_db - zero_db))
        self.image.data = {
            "image": [
                power_to_image_levels(block_maxima(power, _MAX_CELLS), top, top_db - bottom_db)
            ]
        }
        if (self._power_mapper.low, self._power_mapper.high) != (bottom_db, top_db):
            self._power_mapper.update(low=bottom_db, high=top_db)
        self._colour_bar.title = power_label(power_level_unit(units))

    def _colour_limits_db(self, power: np.ndarray, units: str) -> tuple[float, float]:
        """Return the colour limits: above the strongest cell and near the noise.

        Noise alone stays in the lower half of the colours.
        """
        sampled = power if power.size < _SUBSAMPLED_CELLS else power[::3, ::4]
        strongest_db, median_db = (
            float(power_to_dbm_or_dbfs(level, units)) for level in (power.max(), np.median(sampled))
        )
        strongest_db = max(strongest_db, median_db + _MIN_TOP_OVER_NOISE_DB)
        top_db, bottom_db = self._power_mapper.high, self._power_mapper.low
        # the echo of a body fluctuates by this much
        if not top_db - 3 * _STEP_DB <= strongest_db <= top_db:
            top_db = _STEP_DB * math.ceil(strongest_db / _STEP_DB)
        if not bottom_db <= median_db <= bottom_db + 1.5 * _STEP_DB:
            bottom_db = _STEP_DB * math.floor(median_db / _STEP_DB)
        return top_db, min(max(bottom_db, top_db - SPAN_DB), top_db - _MIN_SPAN_DB)

    def draw_marks(
        self, detections: tuple[np.ndarray, np.ndarray], targets: tuple[np.ndarray, np.ndarray]
    ) -> None:
        """Draw brackets around positions (x, y): at most 200 of a kind, all small above 40."""
        at_detections = _mark_columns(*detections, _UPRIGHT)
        at_targets = _mark_columns(*targets, _TURNED)
        self.marks.data = {
            name: np.concatenate([at_detections[name], at_targets[name]]) for name in at_targets
        }
        n_marks = max(at_detections["x"].size, at_targets["x"].size)
        shape = _bracket_properties(*(_LARGE_MARK if n_marks <= _MAX_LARGE_MARKS else _SMALL_MARK))
        for marks in self._marks:
            if marks.glyph.width != shape["width"]:
                marks.glyph.update(**shape)

    def draw_cursor(self, x: float | None, y: float | None) -> None:
        """Draw the cursor lines."""
        self._vertical_line.location, self._horizontal_line.location = x, y

    @property
    def legend_html(self) -> str:
        """Legend of the marks that are present."""
        texts = [
            text
            for angle_rad, text in (
                (_UPRIGHT, "[ ] detected"),
                (_TURNED, "<span class='turned'>[ ]</span> true"),
            )
            if angle_rad in self.marks.data["angle"] and self._marks[0].visible
        ]
        return "   ".join(texts)

    def add_switch_of_marks(self) -> None:
        """Add a switch that hides the marks."""
        switch = Toggle(label="Marks", active=True, margin=0)
        switch.on_change("active", lambda attr, old, new: self._show_or_hide_marks(bool(new)))
        self.controls = switch

    def _show_or_hide_marks(self, visible: bool) -> None:
        for marks in self._marks:
            marks.visible = visible
        if self.session.frame_state is not None:
            self.update_caption(self.session.frame_state)

    def _add_marks(self) -> Iterator[GlyphRenderer]:
        """Add brackets: left and right of detections, above and below targets.

        Unlike circles and crosses they leave the echo between them visible. Text would take six
        times as long: the browser measures it and draws its outlines.
        """
        for color, width in ((_RIM, 3.5), (_LIGHT, 1.5)):
            yield self.figure.rect(
                "x",
                "y",
                width_units="screen",
                height_units="screen",
                angle="angle",
                source=self.marks,
                fill_color=None,
                line_color=color,
                line_width=width,
                **_bracket_properties(*_LARGE_MARK),
            )

    def _move_cursor(self, x: float, y: float) -> None:
        if self.session.frame_state is not None:
            self.session.move_cursor(self.cursor_at_position(x, y))


def _mark_columns(x: np.ndarray, y: np.ndarray, angle_rad: float) -> dict[str, np.ndarray]:
    """Return the columns of marks at the first known positions."""
    rows = np.flatnonzero(np.isfinite(x) & np.isfinite(y))[:_MAX_MARKS]
    return {"x": x[rows], "y": y[rows], "angle": np.full(rows.size, angle_rad)}


def _bracket_properties(width: int, height: int, foot: int) -> dict[str, object]:
    """Return properties of a dashed rectangle, all in pixels, that looks like two brackets.

    The browser draws it clockwise from the upper left corner: a foot, the gap above, the right
    bracket, the gap below, and the rest of the left bracket.
    """
    gap = width - 2 * foot
    dashes = [foot, gap, height + 2 * foot, gap, height + foot, 0]
    return {"width": width, "height": height, "line_dash": dashes}


def _create_colour_bar(mapper: LinearColorMapper) -> ColorBar:
    return ColorBar(
        title=power_label("dBm"),
        level=STATIC_LEVEL,
        color_mapper=mapper,
        ticker=BasicTicker(desired_num_ticks=4),
        width=8,
        padding=3,
        margin=0,
        label_standoff=3,
        title_standoff=4,
        title_text_font_size=TEXT_SIZE,
        title_text_font_style="normal",
        title_text_align="center",
        major_label_text_font_size=TEXT_SIZE,
    )
