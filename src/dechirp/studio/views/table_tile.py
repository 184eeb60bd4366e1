"""Table tile: a title and rows that move the cursor."""

from collections.abc import Callable, Mapping, Sequence
from html import escape
from importlib import resources
from typing import NamedTuple

import numpy as np
from bokeh.core.properties import Int
from bokeh.layouts import column
from bokeh.model import DataModel
from bokeh.models import Div, InlineStyleSheet, UIElement

from dechirp.core.text import format_fixed
from dechirp.report.figures.common import uniform_cell_width
from dechirp.scene.aliasing import RangeVelocity
from dechirp.studio.cursor import Cursor, map_velocities_and_ranges
from dechirp.studio.frame_state import FrameState

MAX_ROWS = 50
_SHARE_OF_MIN_WIDTH = 0.9
"""Share of its usual width at which a column has room for its numbers; narrower tables scroll."""
_TITLE_PX = 78
"""Width of the longest title, "Velocity (m/s)", on one line; some tables have equal columns."""
_TWO_LINE_TITLES_CSS = """@container (max-width: %dpx) { /* the unit is below its quantity */
  th { white-space: normal; }
}"""


class Heading(NamedTuple):
    """Heading of a column and format of its numbers."""

    title: str
    decimals: int | None = None
    """Decimals of numbers; None for a column of text."""
    width: int = 60
    """Share of the width of the table."""


class PickedRow(DataModel):
    """Row that the user picked, counted from 0; page.js sets it."""

    row = Int(-1)


class TableTile:
    """Title and table; picking a row calls a function.

    Bokeh's own table takes scripts of 302 kB, and Bokeh 3.10 gives it a role that its children
    contradict. This one is HTML, which screen readers know.

    Parameters
    ----------
    name : str
        Name of the tile.
    headings : mapping
        Headings of the columns by name.
    on_pick : callable
        Called with the cursor of a picked row.
    """

    def __init__(
        self, name: str, headings: Mapping[str, Heading], *, on_pick: Callable[[Cursor], None]
    ) -> None:
        self.headings = headings
        self.columns: dict[str, np.ndarray] = {key: np.empty(0) for key in headings}
        """Shown rows of each column, before they are written as text."""
        self.selected: int | None = None
        """Marked row."""
        self._on_pick = on_pick
        self._cursors: Sequence[Cursor] = ()
        self._visible = dict.fromkeys(headings, True)
        self._decimals: Mapping[str, int] = {}
        self.picked = PickedRow()
        self.picked.on_change("row", self._move_cursor_to_picked_row)
        self.title = Div(
            text="",
            margin=(3, 8, 1, 8),
            sizing_mode="stretch_width",
            css_classes=["line"],
            disable_math=True,
        )
        css = resources.files("dechirp.studio.views").joinpath("table.css").read_text("utf-8")
        css += _TWO_LINE_TITLES_CSS % (len(headings) * _TITLE_PX)
        self.table = Div(
            name=f"{name}-rows",
            css_classes=["line"],
            tags=[self.picked],
            margin=0,
            sizing_mode="stretch_both",
            disable_math=True,
            stylesheets=[InlineStyleSheet(css=css)],
        )
        self.root_element: UIElement = column(self.title, self.table, name=name, margin=0)
        self.root_element.update(sizing_mode="stretch_both")
        self._write_table()

    @property
    def shown_headings(self) -> dict[str, Heading]:
        """Headings of the visible columns by name."""
        return {key: head for key, head in self.headings.items() if self._visible[key]}

    def show_rows(
        self,
        title: str,
        columns: Mapping[str, np.ndarray],
        *,
        cursors: Sequence[Cursor],
        selected: int | None,
        decimals: Mapping[str, int] | None = None,
    ) -> None:
        """Show the first rows of the columns, with the cursor of each row and the marked row.

        `decimals` replace those of the headings, by name.
        """
        self._decimals = decimals or {}
        self.title.text = f"<b>{title}</b>"
        self._cursors = cursors[:MAX_ROWS]
        self.selected = None if selected is None or selected >= MAX_ROWS else selected
        self.picked.row = -1 if self.selected is None else self.selected
        self.columns = {key: column[:MAX_ROWS] for key, column in columns.items()}
        self._write_table()

    def set_column_visibility(self, visible: Mapping[str, bool]) -> None:
        """Show or hide columns, from the next rows on."""
        self._visible |= visible

    def _write_table(self) -> None:
        shown = self.shown_headings
        total = sum(heading.width for heading in shown.values())
        columns = "".join(
            f'<col style="width:{100 * heading.width / total:.2f}%">' for heading in shown.values()
        )
        head = "".join(f'<th scope="col">{escape(head.title)}</th>' for head in shown.values())
        texts = [
            _format_cells(self.columns[key], self._decimals.get(key, heading.decimals))
            for key, heading in shown.items()
            if key in self.columns
        ]
        rows = "".join(
            f"<tr{' aria-current=true' if row == self.selected else ''}>"
            f"{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>"
            for row, cells in enumerate(zip(*texts, strict=True))
        )
        self.table.text = (
            f'<table style="min-width:{_SHARE_OF_MIN_WIDTH * total:.0f}px">'
            f"<colgroup>{columns}</colgroup>"
            f"<thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"
        )

    def _move_cursor_to_picked_row(self, attr: str, old: int, new: int) -> None:
        if new != self.selected and 0 <= new < len(self._cursors):
            self.selected = new
            self._write_table()
            self._on_pick(self._cursors[new])


def row_at_cursor(positions: RangeVelocity, frame_state: FrameState) -> int | None:
    """Return the index of the position nearest to the cursor within a cell, else None."""
    velocities, ranges_m = map_velocities_and_ranges(frame_state.power)
    distances = [
        abs(position - cursor_position) / uniform_cell_width(cells)
        for cells, position, cursor_position in zip(
            (ranges_m, velocities), positions, frame_state.cursor, strict=True
        )
    ]
    farthest = np.fmax(*distances)  # one chirp gives no velocity
    if not np.any(farthest <= 1):
        return None
    return int(np.nanargmin(farthest))


def _format_cells(cells: np.ndarray, decimals: int | None) -> list[str]:
    """Write the cells of a column as HTML; an unknown number is a dash."""
    if decimals is None:
        return [escape(str(cell)) for cell in cells]
    return [format_fixed(cell, decimals) for cell in cells.tolist()]
