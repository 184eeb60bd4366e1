"""Top view: range rings, field of view and marks."""

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np
from bokeh.models import (
    Arrow,
    ColumnDataSource,
    DataRange1d,
    FixedTicker,
    GlyphRenderer,
    NoOverlap,
    NormalHead,
)

from dechirp.report.figures.top_view import round_down_to_1_2_5
from dechirp.report.labels import X_LABEL, Y_LABEL
from dechirp.studio.theme import Theme
from dechirp.studio.views.figure_style import (
    TEXT_SIZE,
    apply_figure_theme,
    create_plain_figure,
    join_lines_with_gaps,
)

# Fractions of the figure height, which is 170 pixels at 1280 x 720; larger pages have more space.
_LINE, _LETTER, _AWAY, _MARK = 0.084, 0.04, 0.065, 0.04
_LINE_PX, _AWAY_PX = 14, 11

Box = tuple[float, float, float, float]
"""Right, left, bottom, top."""


def choose_label_offsets(
    positions: np.ndarray, names: Sequence[str]
) -> dict[str, Sequence[object]]:
    """Return alignment and pixel offsets of labels beside their marks.

    Each label is on the outer side of its mark; if it would hide another label or mark, it moves a
    line up or down, or to the other side.

    Parameters
    ----------
    positions : ndarray
        (n, 2), left and forward, as fractions of the figure height.
    names : sequence of str
        Labels of the positions.
    """
    occupied: list[Box] = [
        (x - _MARK, x + _MARK, y - _MARK, y + _MARK) for x, y in positions.astype(float)
    ]
    choices: list[tuple[int, int]] = []
    for (x, y), name in zip(positions.astype(float), names, strict=True):
        outward = 1 if x > 0 else -1
        candidates = product((outward, -outward), (0, 1, -1))
        boxes = {
            (side, up): _box_of_offset_label(x, y, side, up, len(name)) for side, up in candidates
        }
        best = min(
            boxes,
            key=lambda candidate: sum(
                _boxes_overlap(boxes[candidate], other) for other in occupied
            ),
        )
        occupied.append(boxes[best])
        choices.append(best)
    return {
        "align": ["right" if side > 0 else "left" for side, _ in choices],
        "away": [-side * _AWAY_PX for side, _ in choices],
        "down": [-up * _LINE_PX for _, up in choices],
    }


def _box_of_offset_label(x: float, y: float, side_sign: int, lines_up: int, n_letters: int) -> Box:
    near, far = x + side_sign * _AWAY, x + side_sign * (_AWAY + n_letters * _LETTER)
    bottom = y + (lines_up - 0.5) * _LINE
    return min(near, far), max(near, far), bottom, bottom + _LINE


def _boxes_overlap(box: Box, other: Box) -> bool:
    # Boxes of consecutive lines touch without overlapping.
    return (
        box[0] < other[1]
        and other[0] < box[1]
        and box[2] < other[3] - 1e-9
        and other[2] < box[3] - 1e-9
    )


_MAX_NAMES = 12
_PICK_DISTANCE = 0.08  # of the largest range
_LABEL_OFFSETS = ("align", "away", "down")


class TopView:
    """Figure with a renderer for each kind of mark; positions are (n, 2), left and forward, m."""

    def __init__(self, name: str) -> None:
        self.figure = create_plain_figure(x=Y_LABEL, y=X_LABEL)
        self.figure.name = name
        self.figure.match_aspect = True
        self.figure.grid.visible = False
        for axis in (*self.figure.xaxis, *self.figure.yaxis):
            axis.update(ticker=FixedTicker(ticks=[]), major_label_policy=NoOverlap(min_distance=3))
        self.max_range_m = 0.0
        """Largest range shown ahead."""
        self._limits = self._add_marks("circle", size=0)
        # Equal scales: the browser widens the axis that has space.
        self.figure.x_range, self.figure.y_range = (
            DataRange1d(renderers=[self._limits], range_padding=0, flipped=flipped)
            for flipped in (True, False)
        )
        self._rings = self._add_empty_line(width=1)
        self._field_of_view = self._add_empty_line(width=1.2, dash="5 4")
        self.cursor = self._add_empty_line(width=1.2, dash="3 3")
        self.tails = self._add_empty_line(width=1.6)
        self.errors = self._add_empty_line(width=1.4)
        self.scatterers = self._add_marks("dot", size=6)
        self.targets = self._add_marks("circle", size=6)
        self.targets.name = "targets"  # dragging.js reads their positions
        self.detections = self._add_marks("circle", size=13)
        self.tracks = self._add_marks("diamond", size=18)
        self._radar = self._add_marks("triangle", size=11)
        self._names = self._add_empty_labels()
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
        move_marks(self._radar, np.zeros((1, 2)))
        self.set_max_range_and_field_of_view(100.0, np.pi / 2)  # until the first frame

    @property
    def pick_distance_m(self) -> float:
        """Largest distance at which a pointer picks a target."""
        return _PICK_DISTANCE * self.max_range_m

    def set_max_range_and_field_of_view(self, max_range_m: float, half_view_rad: float) -> None:
        """Set the largest range, with rings and ticks at round ranges, and the field of view."""
        self.max_range_m = max_range_m
        self.targets.tags = [self.pick_distance_m]
        move_marks(self._limits, max_range_m * np.array([[-0.5, -0.06], [0.5, 1.0]]))
        step_m = round_down_to_1_2_5(max_range_m / 2)
        radii_m = np.arange(step_m, 1.4 * max_range_m, step_m)
        move_marks(
            self._rings,
            join_lines_with_gaps([arc_positions_m(radius_m, np.pi) for radius_m in radii_m]),
        )
        # The axes name the rings where these end: labels among targets read as their ranges.
        self.figure.yaxis.ticker.ticks = [0.0, *radii_m.tolist()]
        self.figure.xaxis.ticker.ticks = [*(-radii_m[::-1]).tolist(), 0.0, *radii_m.tolist()]
        origin = np.zeros((1, 2))
        move_marks(
            self._field_of_view,
            np.concatenate([origin, arc_positions_m(1.5 * max_range_m, half_view_rad), origin]),
        )

    def draw_targets_with_arrows(
        self, names: Sequence[str], positions_m: np.ndarray, arrow_tips_m: np.ndarray
    ) -> None:
        """Draw targets with arrows along their velocity; only the first ones have names."""
        move_marks(self.targets, positions_m)
        shown_names, labels_m = names[:_MAX_NAMES], positions_m[:_MAX_NAMES]
        write_labels(
            self._names,
            labels_m,
            shown_names,
            choose_label_offsets(labels_m / self.max_range_m, shown_names),
        )
        moves = np.any(positions_m != arrow_tips_m, axis=1)
        self._arrows.source.data = {
            **_xy_columns(positions_m[moves]),
            **{
                f"to_{coordinate}": values
                for coordinate, values in _xy_columns(arrow_tips_m[moves]).items()
            },
        }

    def apply_theme(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        apply_figure_theme(self.figure, theme)
        for renderer, color in (
            (self._rings, theme.rule),
            (self._field_of_view, theme.muted),
            (self.cursor, theme.cursor),
            (self.tails, theme.track),
            (self.errors, theme.echo),
            (self.scatterers, theme.truth),
            (self.tracks, theme.track),
            (self.detections, theme.echo),
            (self.targets, theme.truth),
            (self._radar, theme.ink),
        ):
            renderer.glyph.line_color = color
        self.targets.glyph.fill_color, self._radar.glyph.fill_color = theme.truth, theme.ink
        self._names.glyph.text_color = theme.ink
        self._arrows.line_color = theme.truth
        self._arrows.end.line_color = self._arrows.end.fill_color = theme.truth

    def _add_empty_line(self, *, width: float, dash: str = "solid") -> GlyphRenderer:
        source = ColumnDataSource({"x": [], "y": []})
        return self.figure.line("x", "y", source=source, line_width=width, line_dash=dash)

    def _add_marks(self, marker: str, *, size: float) -> GlyphRenderer:
        return self.figure.scatter(
            "x",
            "y",
            source=ColumnDataSource({"x": [], "y": []}),
            marker=marker,
            size=size,
            fill_color=None,
            line_width=1.6,
        )

    def _add_empty_labels(self) -> GlyphRenderer:
        return self.figure.text(
            "x",
            "y",
            "text",
            source=ColumnDataSource({column: [] for column in ("x", "y", "text", *_LABEL_OFFSETS)}),
            x_offset="away",
            y_offset="down",
            text_align="align",
            text_baseline="middle",
            text_font_size=TEXT_SIZE,
        )


def move_marks(renderer: GlyphRenderer, positions_m: np.ndarray) -> None:
    """Move the marks of a renderer."""
    renderer.data_source.data = _xy_columns(positions_m)


def write_labels(
    renderer: GlyphRenderer,
    positions_m: np.ndarray,
    texts: Sequence[str],
    offsets: Mapping[str, Sequence[object]],
) -> None:
    """Write labels at positions, with the offsets of `choose_label_offsets`."""
    renderer.data_source.data = {**_xy_columns(positions_m), "text": list(texts), **offsets}


def arc_positions_m(radius_m: float, half_angle_rad: float) -> np.ndarray:
    """Return positions at one range within an angle to each side."""
    angle = np.linspace(-half_angle_rad, half_angle_rad, 91)
    return radius_m * np.stack([np.sin(angle), np.cos(angle)], axis=-1)


def _xy_columns(positions_m: np.ndarray) -> dict[str, np.ndarray]:
    return {"x": positions_m[:, 0].astype(np.float32), "y": positions_m[:, 1].astype(np.float32)}
