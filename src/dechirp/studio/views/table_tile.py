"""Table tile: a title and rows that move the cursor."""

from collections.abc import Callable, Mapping, Sequence
from importlib import resources
from typing import NamedTuple

import numpy as np
from bokeh.layouts import column
from bokeh.models import (
    ColumnDataSource,
    DataTable,
    Div,
    InlineStyleSheet,
    NumberFormatter,
    StringFormatter,
    TableColumn,
    UIElement,
)

from dechirp.core.text import EN_DASH
from dechirp.report.figures.common import uniform_cell_width
from dechirp.scene.aliasing import RangeVelocity
from dechirp.studio.cursor import Cursor
from dechirp.studio.frame_state import FrameState

MAX_ROWS = 50
_ROW_PX = 22
_SHARE_OF_MIN_WIDTH = 0.85
"""Share of its usual width at which a column has room for its numbers; narrower tables scroll."""
_TITLE_PX = 78
"""Width of the longest title, "Velocity (m/s)", on one line; some tables have equal columns."""
_TWO_LINE_TITLES_CSS = """@container (max-width: %dpx) { /* the unit is below its quantity */
  .slick-header-column.ui-state-default { height: 2.7em; }
  .slick-column-name { white-space: normal; line-height: 1.3; }
}"""


class Heading(NamedTuple):
    """Heading of a column and format of its numbers."""

    title: str
    number_format: str = ""
    """Format of numbers, as 0.00; empty for a column of text."""
    width: int = 60
    """Share of the width of the table."""


class TableTile:
    """Title and table; selecting a row calls a function.

    Parameters
    ----------
    name : str
        Name of the tile.
    heads : mapping
        Headings of the columns by name.
    on_pick : callable
        Called with the cursor of a selected row.
    """

    def __init__(
        self, name: str, heads: Mapping[str, Heading], *, on_pick: Callable[[Cursor], None]
    ) -> None:
        self._on_pick = on_pick
        self._cursors: Sequence[Cursor] = ()
        self._selected: list[int] = []
        self.source = ColumnDataSource({key: [] for key in heads})
        self.source.selected.on_change("indices", self._move_cursor_to_selected_row)
        self.title = Div(
            text="", margin=(3, 8, 1, 8), sizing_mode="stretch_width", css_classes=["line"]
        )
        css = resources.files("dechirp.studio.views").joinpath("table.css").read_text("utf-8")
        css += _TWO_LINE_TITLES_CSS % (len(heads) * _TITLE_PX)
        self.table = DataTable(
            source=self.source,
            columns=[_create_table_column(key, head) for key, head in heads.items()],
            index_position=None,
            reorderable=False,
            row_height=_ROW_PX,
            autosize_mode="force_fit",
            margin=0,
            sizing_mode="stretch_both",
            stylesheets=[InlineStyleSheet(css=css)],
        )
        self.root_element: UIElement = column(self.title, self.table, name=name, margin=0)
        self.root_element.update(sizing_mode="stretch_both", styles={"overflow-x": "auto"})
        self._fit_min_width_to_visible_columns()

    def show_rows(
        self,
        title: str,
        columns: Mapping[str, np.ndarray],
        *,
        cursors: Sequence[Cursor],
        selected: int | None,
    ) -> None:
        """Show the first rows of the columns, with the cursor of each row and the selected row."""
        self.title.text = f"<b>{title}</b>"
        self._cursors = cursors[:MAX_ROWS]
        self._selected = [] if selected is None or selected >= MAX_ROWS else [selected]
        self.source.data = {key: column[:MAX_ROWS] for key, column in columns.items()}
        self.source.selected.indices = self._selected

    def set_column_visibility(self, visible: Mapping[str, bool]) -> None:
        """Show or hide columns."""
        for table_column in self.table.columns:
            shown = visible.get(table_column.field)
            if shown is not None and table_column.visible != shown:
                table_column.visible = shown
        self._fit_min_width_to_visible_columns()

    def _fit_min_width_to_visible_columns(self) -> None:
        width = sum(column.width for column in self.table.columns if column.visible)
        self.table.min_width = round(_SHARE_OF_MIN_WIDTH * width)

    def _move_cursor_to_selected_row(self, attr: str, old: list[int], new: list[int]) -> None:
        if new and new != self._selected and new[-1] < len(self._cursors):
            self._selected = new
            self._on_pick(self._cursors[new[-1]])


def row_at_cursor(positions: RangeVelocity, frame_state: FrameState) -> int | None:
    """Return the index of the position nearest to the cursor within a cell, else None."""
    distances = [
        abs(position - cursor_position) / uniform_cell_width(cells)
        for cells, position, cursor_position in zip(
            (frame_state.power.range.values, frame_state.power.velocity.values),
            positions,
            frame_state.cursor,
            strict=True,
        )
    ]
    farthest = np.fmax(*distances)  # one chirp gives no velocity
    if not np.any(farthest <= 1):
        return None
    return int(np.nanargmin(farthest))


def _create_table_column(key: str, head: Heading) -> TableColumn:
    formatter = (
        NumberFormatter(format=head.number_format, nan_format=EN_DASH, text_align="right")
        if head.number_format
        else StringFormatter(text_align="right")
    )
    return TableColumn(field=key, title=head.title, formatter=formatter, width=head.width)
