"""A map of power over two axes with a colour bar, and what is marked on it."""

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
    UIElement,
)

from dechirp.core.units import from_decibels
from dechirp.core.words import power_db, power_unit
from dechirp.report.figures.range_doppler import reduced
from dechirp.studio.browser import on_place
from dechirp.studio.pointing import Cursor
from dechirp.studio.session import Session
from dechirp.studio.theme import Theme
from dechirp.studio.views.base import View
from dechirp.studio.views.drawn import SELDOM, SPAN_DB, levels, plain_figure, second_line, wear

_MOST_CELLS = (256, 384)  # sent along y and x: 96 KiB
_MOST_MARKS, _FEW_MARKS = 200, 40
_SIZE = 12.0  # of a mark in pixels, half of that where there are more than a few
# Told apart from all colours of a map by lightness: light, on a dark rim.
_LIGHT, _RIM = "#ffffff", "#101418"
_STEP_DB = 5.0  # of the ends of the colour bar, which stand still while noise moves the peak
_MANY = 4096  # cells, of which a twelfth tells the noise to 0.3 dB
_LEAST_DB = 30.0  # between them: noise alone reaches over 15 dB, and shall not look like echoes


class MapView(View):
    """Image, rings where something was found, crosses where it is; a tap or a drag points."""

    def __init__(self, session: Session, *, title: str, x: str, y: str) -> None:
        super().__init__(session)
        self.figure = plain_figure(title=title, x=x, y=y)
        self.figure.name = self.name
        self.figure.grid.visible = False
        self.figure.x_range, self.figure.y_range = Range1d(0, 1), Range1d(0, 1)
        self.note = second_line(self.figure)
        self.image = ColumnDataSource({"image": [np.zeros((1, 1), np.uint8)]})
        self.found, self.truth = (ColumnDataSource({"x": [], "y": []}) for _ in range(2))
        # What is sent are levels; the bar tells the powers that they stand for.
        self._of_levels = LinearColorMapper(low=0, high=255)
        self._of_powers = LinearColorMapper(low=-100 - SPAN_DB, high=-100)
        self._picture = self.figure.image(
            image="image", x=0, y=0, dw=1, dh=1, source=self.image, color_mapper=self._of_levels
        ).glyph
        self._bar = _bar(self._of_powers)
        self.figure.add_layout(self._bar, "right")
        self._marks = list(self._drawn_marks())
        self._upright, self._level = (
            Span(dimension=way, line_color=_LIGHT, line_dash="3 3", line_alpha=0.8)
            for way in ("height", "width")
        )
        self.figure.add_layout(self._upright)
        self.figure.add_layout(self._level)
        for event in (Tap, Pan):
            on_place(self.figure, event, self._point)
        self.figure.on_event(DoubleTap, lambda _: session.point(None))

    @property
    def root(self) -> UIElement:
        """What the page embeds."""
        return self.figure

    def wear(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        wear(self.figure, theme)
        self._of_levels.palette = self._of_powers.palette = theme.map

    @abstractmethod
    def cursor_at(self, x: float, y: float) -> Cursor:
        """Where all views look when somebody points here."""

    def put(self, x: tuple[float, float], y: tuple[float, float]) -> None:
        """Say from where to where the picture reaches: left, right, bottom, top."""
        if (self.figure.x_range.start, self.figure.x_range.end) != x:
            self.figure.x_range.update(start=x[0], end=x[1])
            self._picture.update(x=min(x), dw=abs(x[1] - x[0]))
        if (self.figure.y_range.start, self.figure.y_range.end) != y:
            self.figure.y_range.update(start=y[0], end=y[1])
            self._picture.update(y=min(y), dh=abs(y[1] - y[0]))

    def draw(self, power: np.ndarray, *, units: str) -> None:
        """Send powers, (y, x); `units` are those of the samples that they are of."""
        zero_db = float(power_db(np.ones(()), units))
        top_db, bottom_db = self._ends_db(power, units)
        top = float(from_decibels(top_db - zero_db))
        self.image.data = {"image": [levels(reduced(power, _MOST_CELLS), top, top_db - bottom_db)]}
        if (self._of_powers.low, self._of_powers.high) != (bottom_db, top_db):
            self._of_powers.update(low=bottom_db, high=top_db)
        self._bar.title = f"power, {power_unit(units)}"

    def _ends_db(self, power: np.ndarray, units: str) -> tuple[float, float]:
        """Top and bottom of the colours: over the strongest cell, and about the noise."""
        some = power if power.size < _MANY else power[::3, ::4]
        strongest_db, usual_db = (
            float(power_db(of, units)) for of in (power.max(), np.median(some))
        )
        top_db, bottom_db = self._of_powers.high, self._of_powers.low
        if not top_db - 3 * _STEP_DB <= strongest_db <= top_db:  # a body's echo varies so much
            top_db = _STEP_DB * math.ceil(strongest_db / _STEP_DB)
        if not bottom_db <= usual_db <= bottom_db + 1.5 * _STEP_DB:
            bottom_db = _STEP_DB * math.floor(usual_db / _STEP_DB)
        return top_db, min(max(bottom_db, top_db - SPAN_DB), top_db - _LEAST_DB)

    def mark(self, source: ColumnDataSource, x: np.ndarray, y: np.ndarray) -> None:
        """Set the places of rings or crosses; of many the first."""
        shown = np.flatnonzero(np.isfinite(x) & np.isfinite(y))[:_MOST_MARKS]
        source.data = {"x": x[shown], "y": y[shown]}
        size = _SIZE if len(shown) <= _FEW_MARKS else _SIZE / 2
        for marks in self._marks:
            if marks.data_source is source and marks.glyph.size != size:
                marks.glyph.size = size

    def point(self, x: float | None, y: float | None) -> None:
        """Draw the lines of the cursor."""
        self._upright.location, self._level.location = x, y

    @property
    def legend(self) -> str:
        """What the marks mean that there are."""
        words = [
            words
            for source, words in ((self.found, "○ detected"), (self.truth, "+ true"))
            if len(source.data["x"])
        ]
        return "   ".join(words)

    def _drawn_marks(self) -> Iterator[GlyphRenderer]:
        for color, width in ((_RIM, 3.2), (_LIGHT, 1.4)):
            for source, marker in ((self.truth, "cross"), (self.found, "circle")):
                yield self.figure.scatter(
                    "x",
                    "y",
                    source=source,
                    marker=marker,
                    size=_SIZE,
                    fill_color=None,
                    line_color=color,
                    line_width=width,
                )

    def _point(self, x: float, y: float) -> None:
        if self.session.moment is not None:
            self.session.point(self.cursor_at(x, y))


def _bar(mapper: LinearColorMapper) -> ColorBar:
    return ColorBar(
        title="power, dBm",
        level=SELDOM,
        color_mapper=mapper,
        ticker=BasicTicker(desired_num_ticks=4),
        width=8,
        padding=3,
        margin=0,
        label_standoff=3,
        title_standoff=4,
        title_text_font_size="10px",
        title_text_font_style="normal",
        title_text_align="center",
        major_label_text_font_size="10px",
    )
