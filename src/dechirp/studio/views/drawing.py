"""A figure of lines and marks, which take their colours from the theme by role."""

from collections.abc import Sequence

import numpy as np
from bokeh.models import ColumnDataSource, GlyphRenderer, Legend, LegendItem, Range1d
from bokeh.plotting import figure

from dechirp.report.amounts import typographic
from dechirp.studio.theme import Theme
from dechirp.studio.views import drawn


class Drawing:
    """A figure, its sources by name, and which colour of the theme each glyph has."""

    def __init__(
        self,
        *,
        x: str,
        y: str,
        x_range: tuple[float, float],
        y_range: tuple[float, float],
        title: str = "",
    ) -> None:
        self.figure: figure = drawn.plain_figure(title=title or " ", x=x, y=y)
        self.figure.x_range = Range1d(*x_range)
        self.figure.y_range = Range1d(*y_range)
        self._coloured: list[tuple[GlyphRenderer, str]] = []
        self._sources: dict[str, ColumnDataSource] = {}
        self._labels: dict[str, list[GlyphRenderer]] = {}

    def line(self, name: str, role: str, *, label: str = "", **style: object) -> None:
        """A line of that colour, drawn over `x` and `y`."""
        self._keep(name, role, label, self.figure.line("x", "y", source=self._new(name), **style))

    def marks(self, name: str, role: str, *, label: str = "", **style: object) -> None:
        """Marks of that colour at `x` and `y`."""
        self._keep(
            name, role, label, self.figure.scatter("x", "y", source=self._new(name), **style)
        )

    def bars(self, name: str, role: str, *, label: str = "", **style: object) -> None:
        """Upright lines of that colour from `low` to `high` at `x`."""
        source = self._new(name, "x", "low", "high")
        made = self.figure.segment("x", "low", "x", "high", source=source, **style)
        self._keep(name, role, label, made)

    def bands(self, name: str, role: str, *, label: str = "", alpha: float) -> None:
        """Upright bands of that colour from `left` to `right`, behind all else."""
        made = self.figure.vstrip(
            "left",
            "right",
            source=self._new(name, "left", "right"),
            fill_alpha=alpha,
            line_alpha=0,
            level="underlay",
        )
        self._keep(name, role, label, made)

    def texts(self, name: str, role: str, **style: object) -> None:
        """Words of that colour at `x` and `y`."""
        source = self._new(name, "x", "y", "text")
        made = self.figure.text("x", "y", "text", source=source, text_font_size="12px", **style)
        self._keep(name, role, "", made)

    def put(self, name: str, **columns: Sequence[object] | np.ndarray) -> None:
        """Draw other data; numbers are sent in single precision."""
        self._sources[name].data = {
            key: np.asarray(column, np.float32) if key != "text" else list(column)
            for key, column in columns.items()
        }

    def called(self, title: str) -> None:
        """Say what is seen."""
        self.figure.title.text = typographic(title)

    def spans(self, *, x: tuple[float, float] | None = None, y: tuple[float, float]) -> None:
        """Take other ends for the axes; ends that stay are not sent."""
        for axis, ends in ((self.figure.x_range, x), (self.figure.y_range, y)):
            if ends is not None and (axis.start, axis.end) != ends:
                axis.update(start=ends[0], end=ends[1])

    def explained(self, place: str = "top_right", *, orientation: str = "vertical") -> None:
        """Put labels into a legend in a corner."""
        self.figure.add_layout(
            Legend(
                items=[LegendItem(label=label, renderers=of) for label, of in self._labels.items()],
                location=place,
                label_text_font_size="11px",
                glyph_height=14,
                label_height=14,
                padding=4,
                margin=4,
                spacing=0 if orientation == "vertical" else 8,
                orientation=orientation,
                background_fill_alpha=0.85,
            )
        )

    def wear(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        drawn.wear(self.figure, theme)
        for renderer, role in self._coloured:
            glyph, colour = renderer.glyph, getattr(theme, role)
            for part in ("line_color", "fill_color", "text_color"):
                if part in glyph.properties():
                    glyph.update(**{part: colour})

    def _new(self, name: str, *columns: str) -> ColumnDataSource:
        self._sources[name] = ColumnDataSource({key: [] for key in columns or ("x", "y")})
        return self._sources[name]

    def _keep(self, name: str, role: str, label: str, renderer: GlyphRenderer) -> None:
        renderer.name = name
        self._coloured.append((renderer, role))
        if label:
            self._labels.setdefault(label, []).append(renderer)
