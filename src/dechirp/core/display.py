"""Display of values: one line in a terminal, tables in a notebook.

The HTML has no colours, scripts or links, so it suits light and dark notebooks and static copies.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import fields, is_dataclass
from html import escape
from itertools import islice
from numbers import Integral, Real
from typing import Any, NamedTuple

from dechirp.core.dimensions import split_unit_suffix

MAX_ROWS = 20
_MOST_MEMBERS = 4

_SIDE_BY_SIDE = "display:flex;flex-wrap:wrap;column-gap:2.5em;align-items:flex-start"
_TABLE = "border-collapse:collapse;margin:0 0 0.8em 0"
_TITLE = "text-align:left;caption-side:top;font-style:italic"
_CELL = "text-align:left;padding:0.1em 0.8em 0.1em 0;vertical-align:top;max-width:28em"


class Table(NamedTuple):
    """Rows of text with an optional head."""

    title: str
    rows: Sequence[Sequence[str]]
    head: Sequence[str] = ()
    n_more: int = 0
    """Number of further rows that are not shown."""


class Displayable(ABC):
    """Value with its own summary line and tables, in everyday units."""

    @abstractmethod
    def _display_line(self) -> str:
        """Return the text between the parentheses of the `repr`."""

    def _display_tables(self) -> Iterable[Table]:
        """Return the tables that a notebook shows below the summary line."""
        return (settings_display_table(self),)

    def __repr__(self) -> str:
        line = " ".join(self._display_line().split())  # names may contain line breaks
        return f"{type(self).__name__}({line})"

    def _repr_html_(self) -> str:
        return render_display_html(
            type(self).__name__, self._display_line(), self._display_tables()
        )


def render_display_html(name: str, line: str, tables: Iterable[Table]) -> str:
    """Render the name and summary line of a value, and its tables side by side if they fit."""
    table_html = "".join(_render_html_table(table) for table in tables if table.rows)
    return (
        f"<div><p style='margin:0 0 0.5em 0'><b>{escape(name)}</b> {escape(line)}</p>"
        f"<div style='{_SIDE_BY_SIDE}'>{table_html}</div></div>"
    )


def settings_display_table(value: Any, title: str = "Settings") -> Table:
    """Return the table of the fields of a value with their units."""
    return Table(
        title,
        [
            _format_label_and_value(field.name, getattr(value, field.name))
            for field in fields(value)
        ],
    )


def property_display_rows(value: object, *properties: str) -> list[tuple[str, str, str]]:
    """Return a row for each property: name, value with unit, first line of its docstring."""
    return [
        (
            *_format_label_and_value(name, getattr(value, name)),
            (getattr(type(value), name).__doc__ or "").partition("\n")[0],
        )
        for name in properties
    ]


def truncated_display_table(
    title: str, rows: Iterable[Sequence[str]], n_total_rows: int, head: Sequence[str] = ()
) -> Table:
    """Return a table of the first rows and the number of further rows, which are not computed."""
    return Table(title, list(islice(rows, MAX_ROWS)), head, max(n_total_rows - MAX_ROWS, 0))


def format_count_with_noun(n: int, noun: str) -> str:
    """Write a count with its noun: 1 chirp, 128 chirps, 2 switches."""
    ending = "es" if noun.endswith(("ch", "sh", "s", "x")) else "s"
    return f"{n:,} {noun}{ending if n != 1 else ''}"


def describe_class(kind: type) -> str:
    """Write the name of a class with its article: a Radar, an int, an ndarray; None as itself."""
    if kind is type(None):
        return "None"
    name = kind.__name__
    return f"{'an' if name.startswith(tuple('AEIOaeio')) or name == 'ndarray' else 'a'} {name}"


def format_setting_value(value: Any, unit: str | None = None) -> str:
    """Write the value of a setting; of long lists only their length."""
    # Imported here: every value class imports this module, and `dechirp --help` avoids NumPy.
    from dechirp.core.families import Family
    from dechirp.core.text import format_quantity

    if isinstance(value, Family | Displayable):
        return value._display_line() if isinstance(value, Displayable) else value.kind()
    if isinstance(value, Real) and not isinstance(value, bool):
        return f"{value:,}" if isinstance(value, Integral) else format_quantity(float(value), unit)
    if isinstance(value, tuple | list):
        if len(value) > _MOST_MEMBERS or any(isinstance(member, tuple | list) for member in value):
            return f"{len(value)} of them"
        return ", ".join(format_setting_value(member, unit) for member in value) or "none"
    if is_dataclass(value):
        members = (
            _format_label_and_value(field.name, getattr(value, field.name))
            for field in fields(value)
        )
        return ", ".join(f"{name} {text}" for name, text in members if text != "none")
    return {"None": "none", "True": "yes", "False": "no"}.get(text := str(value), text)


def _format_label_and_value(name: str, value: Any) -> tuple[str, str]:
    key, unit = (
        split_unit_suffix(name) if value is None or _contains_only_floats(value) else (name, None)
    )
    return key.replace("_", " "), format_setting_value(value, unit)


def _contains_only_floats(value: Any) -> bool:
    if isinstance(value, tuple | list):
        return bool(value) and all(map(_contains_only_floats, value))
    return isinstance(value, Real) and not isinstance(value, Integral)


def _render_html_table(table: Table) -> str:
    rows = [_render_html_row(row, "td") for row in table.rows]
    if table.n_more:
        rows.append(_render_html_row([f"and {table.n_more:,} more"], "td"))
    head = f"<thead>{_render_html_row(table.head, 'th')}</thead>" if table.head else ""
    return (
        f"<table style='{_TABLE}'>"
        f"<caption style='{_TITLE}'>{escape(table.title)}</caption>"
        f"{head}<tbody>{''.join(rows)}</tbody></table>"
    )


def _render_html_row(cells: Sequence[str], tag: str) -> str:
    return f"<tr>{''.join(f'<{tag} style={_CELL!r}>{escape(cell)}</{tag}>' for cell in cells)}</tr>"
