"""The picture from above: rings, the field of view, and room for all that stands on them."""

from collections.abc import Sequence

import numpy as np
from bokeh.models import Arrow, ColumnDataSource, DataRange1d, GlyphRenderer, NormalHead

from dechirp.core.words import number
from dechirp.report.figures.ground import round_down
from dechirp.studio.theme import Theme
from dechirp.studio.views.drawn import joined, plain_figure, second_line, wear
from dechirp.studio.views.names import Box, beside, in_middle

_MOST_NAMES = 12
_CENTRED = {"align": "center", "away": 0, "down": 0}  # a text, and pixels from its place
_ASIDE_RAD = np.radians(35)  # to the right: where rings are named, for little is there


class Ground:
    """A figure, and a renderer for each thing on it; places are (n, 2), left and forward, m."""

    def __init__(self, name: str) -> None:
        self.figure = plain_figure(title="From above", x="y, m (left +)", y="x, m (forward)")
        self.figure.name = name
        self.figure.match_aspect = True
        self.figure.grid.visible = False
        self.note = second_line(self.figure)
        self.reach_m = 0.0
        """How far ahead it shows."""
        self._words: Sequence[Box] = ()
        """Where rings are named."""
        self._corners = self._marks("circle", size=0)
        # Both axes in one scale: the browser widens the one that has room.
        self.figure.x_range, self.figure.y_range = (
            DataRange1d(renderers=[self._corners], range_padding=0, flipped=flipped)
            for flipped in (True, False)
        )
        self._rings = self._line(width=1)
        self._view = self._line(width=1.2, dash="5 4")
        self.cursor = self._line(width=1.2, dash="3 3")
        self.tails = self._line(width=1.6)
        self.errors = self._line(width=1.4)
        self.points = self._marks("dot", size=6)
        self.targets = self._marks("circle", size=6)
        self.found = self._marks("circle", size=13)
        self.tracks = self._marks("diamond", size=18)
        self._radar = self._marks("triangle", size=11)
        self._ring_names = self._texts()
        self._names = self._texts()
        self._arrows = Arrow(
            source=ColumnDataSource({"x": [], "y": [], "to_x": [], "to_y": []}),
            x_start="x",
            y_start="y",
            x_end="to_x",
            y_end="to_y",
            end=NormalHead(size=6),
            line_width=1.6,
        )
        self.figure.add_layout(self._arrows)
        put(self._radar, np.zeros((1, 2)))
        self.fit(100.0, np.pi / 2)  # until something is there

    def fit(self, reach_m: float, half_rad: float) -> None:
        """Show so far ahead, with rings at round ranges and the field of view."""
        self.reach_m = reach_m
        put(self._corners, reach_m * np.array([[-0.5, -0.06], [0.5, 1.0]]))
        step_m = round_down(reach_m / 2)
        radii_m = np.arange(step_m, 1.4 * reach_m, step_m)
        put(self._rings, joined([arc_m(one, np.pi) for one in radii_m]))
        named_m = radii_m[radii_m * np.cos(_ASIDE_RAD) < 0.95 * reach_m]
        at_m = named_m[:, None] * (-np.sin(_ASIDE_RAD), np.cos(_ASIDE_RAD))
        names = [f"{number(one)} m" for one in named_m]
        write(self._ring_names, at_m, names)
        self._words = in_middle(at_m / reach_m, names)
        origin = np.zeros((1, 2))
        put(self._view, np.concatenate([origin, arc_m(1.5 * reach_m, half_rad), origin]))

    def stand(self, names: Sequence[str], places_m: np.ndarray, ends_m: np.ndarray) -> None:
        """Draw targets with arrows to the ends of their ways; of many without names."""
        put(self.targets, places_m)
        named, at_m = names[:_MOST_NAMES], places_m[:_MOST_NAMES]
        write(self._names, at_m, named, **beside(at_m / self.reach_m, named, self._words))
        moves = np.any(places_m != ends_m, axis=1)
        self._arrows.source.data = {
            **_columns(places_m[moves]),
            **{f"to_{of}": at for of, at in _columns(ends_m[moves]).items()},
        }

    def wear(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        wear(self.figure, theme)
        for of, color in (
            (self._rings, theme.rule),
            (self._view, theme.muted),
            (self.cursor, theme.cursor),
            (self.tails, theme.track),
            (self.errors, theme.echo),
            (self.points, theme.truth),
            (self.tracks, theme.track),
            (self.found, theme.echo),
            (self.targets, theme.truth),
            (self._radar, theme.ink),
        ):
            of.glyph.line_color = color
        self.targets.glyph.fill_color, self._radar.glyph.fill_color = theme.truth, theme.ink
        self._names.glyph.text_color, self._ring_names.glyph.text_color = theme.ink, theme.muted
        self._arrows.line_color = theme.truth
        self._arrows.end.line_color = self._arrows.end.fill_color = theme.truth

    def _line(self, *, width: float, dash: str = "solid") -> GlyphRenderer:
        source = ColumnDataSource({"x": [], "y": []})
        return self.figure.line("x", "y", source=source, line_width=width, line_dash=dash)

    def _marks(self, marker: str, *, size: float) -> GlyphRenderer:
        return self.figure.scatter(
            "x",
            "y",
            source=ColumnDataSource({"x": [], "y": []}),
            marker=marker,
            size=size,
            fill_color=None,
            line_width=1.6,
        )

    def _texts(self) -> GlyphRenderer:
        return self.figure.text(
            "x",
            "y",
            "text",
            source=ColumnDataSource({of: [] for of in ("x", "y", "text", *_CENTRED)}),
            x_offset="away",
            y_offset="down",
            text_align="align",
            text_baseline="middle",
            text_font_size="10px",
        )


def put(drawn: GlyphRenderer, places_m: np.ndarray) -> None:
    """Draw something at other places."""
    drawn.data_source.data = _columns(places_m)


def write(
    drawn: GlyphRenderer, places_m: np.ndarray, words: Sequence[str], **aside: Sequence[object]
) -> None:
    """Write words at places, in their middle or aside."""
    columns = {of: aside.get(of, [at] * len(words)) for of, at in _CENTRED.items()}
    drawn.data_source.data = {**_columns(places_m), "text": list(words), **columns}


def arc_m(radius_m: float, half_rad: float) -> np.ndarray:
    """Places at one range, so far to each side."""
    angle = np.linspace(-half_rad, half_rad, 91)
    return radius_m * np.stack([np.sin(angle), np.cos(angle)], axis=-1)


def _columns(places_m: np.ndarray) -> dict[str, np.ndarray]:
    return {"x": places_m[:, 0].astype(np.float32), "y": places_m[:, 1].astype(np.float32)}
