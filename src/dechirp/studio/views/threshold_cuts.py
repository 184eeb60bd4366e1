"""View of power and threshold along both map axes through the cursor."""

import numpy as np
from bokeh.events import DoubleTap, Tap
from bokeh.models import UIElement

from dechirp.core.text import format_fixed, format_number, power_level_unit, power_to_dbm_or_dbfs
from dechirp.core.units import to_decibels
from dechirp.report.figures.cfar import (
    edges_of_marked_runs,
    threshold_level_db,
    training_and_guard_masks,
)
from dechirp.report.figures.common import AXIS_LABELS, MapAxis, outer_cell_edges
from dechirp.report.figures.style import reduce_line_to_extremes
from dechirp.report.labels import power_label
from dechirp.studio.browser_events import register_position_callback
from dechirp.studio.cursor import MapCut as Line
from dechirp.studio.cursor import nearest_cell_indices
from dechirp.studio.frame_state import FrameState
from dechirp.studio.session import Session
from dechirp.studio.theme import Theme
from dechirp.studio.views.base import View
from dechirp.studio.views.figure_style import level_12_db_below_median, limits_rounded_to_10_db
from dechirp.studio.views.line_figure import LineFigure
from dechirp.studio.views.toggle_tile import ToggleTile, coloured_html

_MAX_BLOCKS = 300
_AXES: dict[str, MapAxis] = {"Range": "range", "Velocity": "velocity"}


class ThresholdCutView(View):
    """Cell at the cursor with its training cells and threshold."""

    name = "cut"

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self._caption = "", ""
        """Title and note of the last shown frame."""
        self.drawings = {axis: _create_cut_figure(AXIS_LABELS[axis]) for axis in _AXES.values()}
        for drawing in self.drawings.values():
            register_position_callback(drawing.figure, Tap, self._move_cursor)
            drawing.figure.on_event(DoubleTap, lambda _: session.move_cursor(None))
        figures = {words: self.drawings[axis].figure for words, axis in _AXES.items()}
        self.tile = ToggleTile(self.name, figures, on_switch=self._redraw_last_frame)
        self.controls = self.tile.switch

    @property
    def root_element(self) -> UIElement:
        return self.tile.root_element

    def show_frame(self, frame_state: FrameState) -> None:
        axis = self._active_axis
        drawing, line, index = self.drawings[axis], *_cut_and_cursor_index(frame_state, axis)
        units = str(frame_state.samples.attrs.get("units", ""))
        level_db, threshold_db = (
            power_to_dbm_or_dbfs(line.power, units),
            threshold_level_db(line.threshold, units),
        )
        drawing.set_data("power", **_thinned_line_columns(line.positions, level_db))
        drawing.set_data("threshold", **_thinned_line_columns(line.positions, threshold_db))
        drawing.set_data("cell", x=line.positions[[index]], y=level_db[[index]])
        training, guard = training_and_guard_masks(
            index, line.positions.size, frame_state.chain.cfar, along=axis
        )
        for name, cells in (("training", training), ("guard", guard)):
            ends = np.reshape(edges_of_marked_runs(line.positions, cells), (-1, 2))
            drawing.set_data(name, left=ends[:, 0], right=ends[:, 1])
        highest_db = max(float(level_db.max()), float(np.nanmax(threshold_db, initial=-np.inf)))
        # Strong echoes over most of a small map lift its median above the threshold.
        lowest_db = min(
            level_12_db_below_median(level_db), float(np.nanmin(threshold_db, initial=np.inf)) - 2
        )
        drawing.set_axis_limits(
            x=outer_cell_edges(line.positions),
            y=limits_rounded_to_10_db(lowest_db, highest_db),
        )
        drawing.figure.yaxis.axis_label = power_label(power_level_unit(units))
        range_m, velocity_m_per_s = frame_state.cursor
        self._caption = (
            _threshold_margin_text(line, index),
            f"at {format_number(range_m, 3)} m, {format_number(velocity_m_per_s, 3)} m/s:"
            f" {coloured_html('power', 'echo')}, {coloured_html('threshold', 'threshold')};"
            " shaded: training",
        )

    def update_caption(self, frame_state: FrameState) -> None:
        title, note = self._caption
        self.caption.update(title=title, note=note)

    def apply_theme(self, theme: Theme) -> None:
        for drawing in self.drawings.values():
            drawing.apply_theme(theme)

    @property
    def _active_axis(self) -> MapAxis:
        return _AXES[self.tile.active_label]

    def _redraw_last_frame(self) -> None:
        if self.session.frame_state is not None:
            self.show_frame(self.session.frame_state)
            self.update_caption(self.session.frame_state)

    def _move_cursor(self, x: float, _: float) -> None:
        frame_state = self.session.frame_state
        if frame_state is not None:
            cursor = frame_state.cursor
            self.session.move_cursor(
                cursor._replace(range_m=x)
                if self._active_axis == "range"
                else cursor._replace(velocity_m_per_s=x)
            )


def _create_cut_figure(x_label: str) -> LineFigure:
    line_figure = LineFigure(x=x_label, y="Power", x_range=(0, 1), y_range=(0, 1), title="")
    line_figure.add_vertical_bands("training", "echo", alpha=0.16)
    line_figure.add_vertical_bands("guard", "muted", alpha=0.12)
    line_figure.add_line("power", "echo", label="power", line_width=1.6)
    line_figure.add_line("threshold", "threshold", label="threshold", line_width=1.6)
    line_figure.add_marks("cell", "cursor", size=7)
    return line_figure


def _cut_and_cursor_index(frame_state: FrameState, axis: MapAxis) -> tuple[Line, int]:
    """Return the cut along an axis and the index of the cursor in it."""
    row, column = nearest_cell_indices(frame_state.power, frame_state.cursor)
    over_range, over_velocity = frame_state.cuts_through_cursor
    return (over_range, column) if axis == "range" else (over_velocity, row)


def _thinned_line_columns(positions: np.ndarray, level_db: np.ndarray) -> dict[str, np.ndarray]:
    x, y = reduce_line_to_extremes(positions, level_db, _MAX_BLOCKS)
    return {"x": x, "y": y}


def _threshold_margin_text(line: Line, index: int) -> str:
    power, threshold = float(line.power[index]), float(line.threshold[index])
    if not (power > 0 and 0 < threshold < np.inf):
        return "No detection is attempted here"
    margin_db = float(to_decibels(power / threshold))
    side = "over" if margin_db > 0 else "under"
    return f"{format_fixed(abs(margin_db), 1)} dB {side} the threshold"
