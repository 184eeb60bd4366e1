"""Figure of lines and marks, coloured by roles of the theme."""

from collections.abc import Sequence

import numpy as np
from bokeh.models import ColumnDataSource, GlyphRenderer, Legend, LegendItem, Range1d
from bokeh.plotting import figure

from dechirp.report.check_values import apply_typography
from dechirp.studio.theme import Theme
from dechirp.studio.views import figure_style


class LineFigure:
    """Figure with data sources by name and a theme role for each glyph."""

    def __init__(
        self,
        *,
        x: str,
        y: str,
        x_range: tuple[float, float],
        y_range: tuple[float, float],
        title: str = " ",
    ) -> None:
        self.figure: figure = figure_style.create_plain_figure(x=x, y=y)
        self.figure.title.text = title
        self.figure.x_range = Range1d(*x_range)
        self.figure.y_range = Range1d(*y_range)
        self._colour_roles: list[tuple[GlyphRenderer, str]] = []
        self._sources: dict[str, ColumnDataSource] = {}
        self._labels: dict[str, list[GlyphRenderer]] = {}

    def add_line(self, name: str, colour_role: str, *, label: str = "", **style: object) -> None:
        """Add a line over `x` and `y`."""
        self._register_glyph(
            name,
            colour_role,
            label,
            self.figure.line("x", "y", source=self._add_empty_data_source(name), **style),
        )

    def add_marks(self, name: str, colour_role: str, *, label: str = "", **style: object) -> None:
        """Add marks at `x` and `y`."""
        self._register_glyph(
            name,
            colour_role,
            label,
            self.figure.scatter("x", "y", source=self._add_empty_data_source(name), **style),
        )

    def add_vertical_lines(
        self, name: str, colour_role: str, *, label: str = "", **style: object
    ) -> None:
        """Add vertical lines from `low` to `high` at `x`."""
        source = self._add_empty_data_source(name, "x", "low", "high")
        renderer = self.figure.segment("x", "low", "x", "high", source=source, **style)
        self._register_glyph(name, colour_role, label, renderer)

    def add_vertical_bands(
        self, name: str, colour_role: str, *, label: str = "", alpha: float
    ) -> None:
        """Add vertical bands from `left` to `right`, behind everything else."""
        renderer = self.figure.vstrip(
            "left",
            "right",
            source=self._add_empty_data_source(name, "left", "right"),
            fill_alpha=alpha,
            line_alpha=0,
            level="underlay",
        )
        self._register_glyph(name, colour_role, label, renderer)

    def add_texts(self, name: str, colour_role: str, **style: object) -> None:
        """Add texts at `x` and `y`."""
        source = self._add_empty_data_source(name, "x", "y", "text")
        renderer = self.figure.text("x", "y", "text", source=source, text_font_size="12px", **style)
        self._register_glyph(name, colour_role, "", renderer)

    def set_data(self, name: str, **columns: Sequence[object] | np.ndarray) -> None:
        """Replace the data of a source; numbers are sent in single precision."""
        self._sources[name].data = {
            key: np.asarray(column, np.float32) if key != "text" else list(column)
            for key, column in columns.items()
        }

    def set_title(self, title: str) -> None:
        """Set the title."""
        self.figure.title.text = apply_typography(title)

    def set_axis_limits(
        self, *, x: tuple[float, float] | None = None, y: tuple[float, float]
    ) -> None:
        """Set the limits of the axes; unchanged limits are not sent."""
        for axis, ends in ((self.figure.x_range, x), (self.figure.y_range, y)):
            if ends is not None and (axis.start, axis.end) != ends:
                axis.update(start=ends[0], end=ends[1])

    def add_legend(self, place: str = "top_right", *, orientation: str = "vertical") -> None:
        """Add a legend in a corner."""
        self.figure.add_layout(
            Legend(
                items=[
                    LegendItem(label=label, renderers=renderers)
                    for label, renderers in self._labels.items()
                ],
                location=place,
                label_text_font_size=figure_style.TEXT_SIZE,
                glyph_height=14,
                label_height=14,
                padding=4,
                margin=4,
                spacing=0 if orientation == "vertical" else 8,
                orientation=orientation,
                background_fill_alpha=0.85,
            )
        )

    def apply_theme(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        figure_style.apply_figure_theme(self.figure, theme)
        for renderer, role in self._colour_roles:
            glyph, colour = renderer.glyph, getattr(theme, role)
            for part in ("line_color", "fill_color", "text_color"):
                if part in glyph.properties():
                    glyph.update(**{part: colour})

    def _add_empty_data_source(self, name: str, *columns: str) -> ColumnDataSource:
        self._sources[name] = ColumnDataSource({key: [] for key in columns or ("x", "y")})
        return self._sources[name]

    def _register_glyph(
        self, name: str, colour_role: str, label: str, renderer: GlyphRenderer
    ) -> None:
        renderer.name, renderer.tags = name, [label] if label else []  # tiles.js names values by it
        self._colour_roles.append((renderer, colour_role))
        if label:
            self._labels.setdefault(label, []).append(renderer)
