"""A table of the strip: a title, rows, and where the cursor goes from each of them."""

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

from dechirp.core.words import NONE
from dechirp.report.figures.parts import cell_width
from dechirp.scene.folding import Place
from dechirp.studio.moment import Moment
from dechirp.studio.pointing import Cursor

MOST_ROWS = 50
_ROW_PX = 22


class Head(NamedTuple):
    """What stands over a column, and how its numbers are written."""

    title: str
    form: str = ""
    """Of numbers, such as 0.00; none: the column holds words."""
    width: int = 60
    """Share of the width of the table."""


class Listed:
    """A title and columns by name; a row that is picked is told of.

    Parameters
    ----------
    name : str
        Of the tile.
    heads : mapping
        Of the columns.
    on_pick : callable
        Called with the cursor of a row that somebody picked.
    """

    def __init__(
        self, name: str, heads: Mapping[str, Head], *, on_pick: Callable[[Cursor], None]
    ) -> None:
        self._on_pick = on_pick
        self._cursors: Sequence[Cursor] = ()
        self._marked: list[int] = []
        self.source = ColumnDataSource({key: [] for key in heads})
        self.source.selected.on_change("indices", self._pick)
        self.title = Div(
            text="", margin=(3, 8, 1, 8), sizing_mode="stretch_width", css_classes=["line"]
        )
        css = resources.files("dechirp.studio.views").joinpath("table.css").read_text("utf-8")
        self.table = DataTable(
            source=self.source,
            columns=[_column(key, head) for key, head in heads.items()],
            index_position=None,
            reorderable=False,
            row_height=_ROW_PX,
            autosize_mode="force_fit",
            margin=0,
            sizing_mode="stretch_both",
            stylesheets=[InlineStyleSheet(css=css)],
        )
        self.root: UIElement = column(self.title, self.table, name=name, margin=0)
        self.root.sizing_mode = "stretch_both"

    def show(
        self,
        title: str,
        columns: Mapping[str, np.ndarray],
        *,
        cursors: Sequence[Cursor],
        marked: int | None,
    ) -> None:
        """Show the first rows of columns, where the cursor goes from each, and where it is."""
        self.title.text = f"<b>{title}</b>"
        self._cursors = cursors[:MOST_ROWS]
        self._marked = [] if marked is None or marked >= MOST_ROWS else [marked]
        self.source.data = {key: of[:MOST_ROWS] for key, of in columns.items()}
        self.source.selected.indices = self._marked

    def show_columns(self, shown: Mapping[str, bool]) -> None:
        """Show columns, or leave them out."""
        for one in self.table.columns:
            if one.field in shown and one.visible != shown[one.field]:
                one.visible = shown[one.field]

    def _pick(self, attr: str, old: list[int], new: list[int]) -> None:
        if new and new != self._marked and new[-1] < len(self._cursors):
            self._marked = new
            self._on_pick(self._cursors[new[-1]])


def at_cursor(places: Place, moment: Moment) -> int | None:
    """Which of places on the map is within a cell of the cursor: the nearest, if any is."""
    off = [
        abs(place - at) / cell_width(cells)
        for cells, place, at in zip(
            (moment.power.range.values, moment.power.velocity.values),
            places,
            moment.cursor,
            strict=True,
        )
    ]
    farthest = np.fmax(*off)  # one chirp tells no velocity
    if not np.any(farthest <= 1):
        return None
    return int(np.nanargmin(farthest))


def _column(key: str, head: Head) -> TableColumn:
    formatter = (
        NumberFormatter(format=head.form, nan_format=NONE, text_align="right")
        if head.form
        else StringFormatter(text_align="right")
    )
    return TableColumn(field=key, title=head.title, formatter=formatter, width=head.width)
