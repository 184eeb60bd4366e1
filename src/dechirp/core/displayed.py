"""What a value shows of itself: one line in a terminal, tables in a notebook.

The page is one piece of HTML without colours, scripts or links, so that it looks right in light
and dark notebooks and wherever they are kept.
"""

from collections.abc import Iterable, Sequence
from dataclasses import fields, is_dataclass
from html import escape
from itertools import islice
from numbers import Integral, Real
from typing import Any, NamedTuple

from dechirp.core.kinds import split

MOST_ROWS = 20
_MOST_MEMBERS = 4

_SIDE_BY_SIDE = "display:flex;flex-wrap:wrap;column-gap:2.5em;align-items:flex-start"
_TABLE = "border-collapse:collapse;margin:0 0 0.8em 0"
_TITLE = "text-align:left;caption-side:top;font-style:italic"
_CELL = "text-align:left;padding:0.1em 0.8em 0.1em 0;vertical-align:top;max-width:28em"


class Table(NamedTuple):
    """Rows of texts, under names where there are any."""

    title: str
    rows: Sequence[Sequence[str]]
    head: Sequence[str] = ()
    n_more: int = 0
    """Rows that are left out."""


class Displayed:
    """A value with a line and tables of its own, in the units that people use."""

    def _line(self) -> str:
        """What stands between the brackets of its `repr`."""
        raise NotImplementedError

    def _tables(self) -> Iterable[Table]:
        """What a notebook shows below the line."""
        return (settings(self),)

    def __repr__(self) -> str:
        line = " ".join(self._line().split())  # a name may hold line breaks
        return f"{type(self).__name__}({line})"

    def _repr_html_(self) -> str:
        return html(type(self).__name__, self._line(), self._tables())


def html(name: str, line: str, tables: Iterable[Table]) -> str:
    """Name and line of a value, and its tables side by side where there is room."""
    shown = "".join(_table(table) for table in tables if table.rows)
    return (
        f"<div><p style='margin:0 0 0.5em 0'><b>{escape(name)}</b> {escape(line)}</p>"
        f"<div style='{_SIDE_BY_SIDE}'>{shown}</div></div>"
    )


def settings(value: Any, title: str = "Settings") -> Table:
    """Fields of a value with their units."""
    return Table(title, [_named(field.name, getattr(value, field.name)) for field in fields(value)])


def follows(value: object, *names: str) -> list[tuple[str, str, str]]:
    """Properties of a value with their units, and what their docstrings say they are."""
    return [
        (
            *_named(name, getattr(value, name)),
            (getattr(type(value), name).__doc__ or "").partition("\n")[0],
        )
        for name in names
    ]


def cut(title: str, rows: Iterable[Sequence[str]], n_rows: int, head: Sequence[str] = ()) -> Table:
    """A table of the first rows, which says how many more there are; those are never made."""
    return Table(title, list(islice(rows, MOST_ROWS)), head, max(n_rows - MOST_ROWS, 0))


def several(n: int, what: str) -> str:
    """Count things: 1 chirp, 128 chirps."""
    return f"{n:,} {what}{'s' if n != 1 else ''}"


def told(value: Any, unit: str | None = None) -> str:
    """Say what a setting is set to; of lists that are long, how many they hold."""
    from dechirp.core.families import Family  # every value is made beside this file, and
    from dechirp.core.words import in_unit  # `dechirp --help` has no time for NumPy

    if isinstance(value, Family | Displayed):
        return value._line() if isinstance(value, Displayed) else value.kind()
    if isinstance(value, Real) and not isinstance(value, bool):
        return f"{value:,}" if isinstance(value, Integral) else in_unit(float(value), unit)
    if isinstance(value, tuple | list):
        if len(value) > _MOST_MEMBERS or any(isinstance(one, tuple | list) for one in value):
            return f"{len(value)} of them"
        return ", ".join(told(one, unit) for one in value) or "none"
    if is_dataclass(value):
        members = (_named(field.name, getattr(value, field.name)) for field in fields(value))
        return ", ".join(f"{name} {text}" for name, text in members if text != "none")
    return {"None": "none", "True": "yes", "False": "no"}.get(text := str(value), text)


def _named(name: str, value: Any) -> tuple[str, str]:
    key, unit = split(name) if value is None or _is_number(value) else (name, None)
    return key.replace("_", " "), told(value, unit)


def _is_number(value: Any) -> bool:
    if isinstance(value, tuple | list):
        return bool(value) and all(map(_is_number, value))
    return isinstance(value, Real) and not isinstance(value, Integral)


def _table(table: Table) -> str:
    rows = [_row(row, "td") for row in table.rows]
    if table.n_more:
        rows.append(_row([f"and {table.n_more:,} more"], "td"))
    head = f"<thead>{_row(table.head, 'th')}</thead>" if table.head else ""
    return (
        f"<table style='{_TABLE}'>"
        f"<caption style='{_TITLE}'>{escape(table.title)}</caption>"
        f"{head}<tbody>{''.join(rows)}</tbody></table>"
    )


def _row(cells: Sequence[str], tag: str) -> str:
    return f"<tr>{''.join(f'<{tag} style={_CELL!r}>{escape(one)}</{tag}>' for one in cells)}</tr>"
