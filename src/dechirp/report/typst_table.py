"""Layout of tables in the PDF: column widths follow the content, and the font size the width.

A table too wide for a portrait page at 5.2 points has its numbers broken, before ± and after "to".
A
table too wide for that at 5.0 points goes on a landscape page, without or with broken numbers. A
table too wide for that at 4.6 points is split by columns, with the first column repeated.
"""

from collections.abc import Iterator, Sequence

from dechirp.core.values import frozen_dataclass

_UPRIGHT_PT, _TURNED_PT = 516.0, 759.0  # within the margins of A4
_LARGEST_PT, _SMALLEST_PT, _BROKEN_SMALLEST_PT, _TURNED_SMALLEST_PT = 8.0, 5.2, 5.0, 4.6
# Width, smallest font size, and whether numbers are broken; the first fitting one is used.
_LAYOUTS = (
    (_UPRIGHT_PT, _SMALLEST_PT, False),
    (_UPRIGHT_PT, _BROKEN_SMALLEST_PT, True),
    (_TURNED_PT, _TURNED_SMALLEST_PT, False),
    (_TURNED_PT, _TURNED_SMALLEST_PT, True),
)
_PADDING_EM = 0.7
# Mean letter width of DejaVu Sans, and of STIX in papers.
_LETTER_EM, _PAPER_LETTER_EM = 0.65, 0.50
_NARROW = 16  # minimum number of letters of a text column
_WORD = 25  # longer words are broken
_ON_ONE_LINE = frozenset({"num", "count", "interval", "theory", "short", "decision"})
_RIGHT_ALIGNED = frozenset({"num", "count", "interval", "theory"})
_FIXED = {"bars": (24.0, 13.0, 36.0, 27.0), "shares": (50.0, 14.0, 36.0)}


@frozen_dataclass
class Cell:
    """Cell with its Typst source and the properties that determine its width."""

    source: str
    lines: tuple[str, ...]
    kinds: frozenset[str]
    n_columns: int = 1


Rows = Sequence[Sequence[Cell]]


def lay_out_table(
    rows: Rows,
    row_classes: Sequence[frozenset[str]],
    n_heads: int,
    table_classes: frozenset[str],
    *,
    is_paper: bool,
) -> tuple[str, bool]:
    """Return the Typst source of a table, and whether it needs a landscape page.

    Parameters
    ----------
    rows : sequence of sequence of Cell
        Rows, of which the first `n_heads` are the header, repeated on each page.
    row_classes : sequence of frozenset
        Classes of each row.
    table_classes : frozenset
        Classes of the table; `bars` and `plain` select special layouts.
    is_paper : bool
        Whether the page uses the font of papers.
    """
    if not rows:
        return "", False
    heads, body = rows[:n_heads], rows[n_heads:]
    n_columns = max(sum(cell.n_columns for cell in row) for row in rows)
    right = [
        _is_right_aligned(rows, column, table_classes, n_columns) for column in range(n_columns)
    ]
    if table_classes & {"bars", "plain"}:
        fixed = next((cells for name, cells in _FIXED.items() if name in table_classes), None)
        if "shares" in table_classes:
            fixed = _FIXED["shares"]
        columns = [f"{cells}fr" for cells in fixed] if fixed else ["auto", "1fr"]
        return _typst_table_source(columns, right, heads, body, row_classes[n_heads:], 7.5), False
    letter_em = _PAPER_LETTER_EM if is_paper else _LETTER_EM
    for room_pt, smallest_pt, is_broken in _LAYOUTS:
        letters = (
            _min_and_unbroken_width_in_letters(rows, column, n_heads, is_broken)
            for column in range(n_columns)
        )
        needs, wants = zip(*letters, strict=True)
        widths_em = [letter_em * need + _PADDING_EM for need in needs]
        size_pt = min(_LARGEST_PT, room_pt / sum(widths_em))
        if size_pt >= smallest_pt:
            more_em = [letter_em * (want - need) for need, want in zip(needs, wants, strict=True)]
            left_em = room_pt / size_pt - sum(widths_em)
            share = min(left_em / sum(more_em), 1.0) if sum(more_em) else 0.0
            columns = [
                f"{width + share * more:.2f}fr"
                for width, more in zip(widths_em, more_em, strict=True)
            ]
            source = _typst_table_source(
                columns, right, heads, body, row_classes[n_heads:], size_pt
            )
            return source, room_pt == _TURNED_PT
    parts = [
        lay_out_table(
            [[row[column] for column in group] for row in rows],
            row_classes,
            n_heads,
            table_classes,
            is_paper=is_paper,
        )
        for group in _split_columns_over_landscape_pages(widths_em)
    ]
    return "".join(source for source, _ in parts), True


def _split_columns_over_landscape_pages(widths_em: Sequence[float]) -> Iterator[list[int]]:
    """Yield groups of columns that fit a landscape page, each with the first column."""
    room_em = _TURNED_PT / _TURNED_SMALLEST_PT
    group = [0]
    for column in range(1, len(widths_em)):
        if len(group) > 1 and sum(widths_em[index] for index in [*group, column]) > room_em:
            yield group
            group = [0]
        group.append(column)
    yield group


def _min_and_unbroken_width_in_letters(
    rows: Rows, column: int, n_heads: int, is_broken: bool
) -> tuple[int, int]:
    """Return the minimum number of letters of a column, and the number without line breaks."""
    need = want = 1
    for number, row in enumerate(rows):
        cell = _single_column_cell_at(row, column)
        if cell is None:
            continue
        words = [word for line in cell.lines for word in line.split(" ")]
        longest = min(max(map(len, words)), _WORD)
        need = max(need, longest)
        if number >= n_heads:
            # The first line of a number is not broken; the small lines below it are text.
            first, *below = map(len, cell.lines)
            if cell.kinds & _ON_ONE_LINE:
                whole = 0 if is_broken else first
            else:
                whole = min(first, _NARROW)
            need = max(need, whole, *(min(index, _NARROW) for index in below))
        want = max(want, *map(len, cell.lines))
    return need, max(need, want)


def _single_column_cell_at(row: Sequence[Cell], column: int) -> Cell | None:
    """Return the cell that occupies exactly one column; None if it spans several."""
    start = 0
    for cell in row:
        if start == column and cell.n_columns == 1:
            return cell
        start += cell.n_columns
    return None


def _is_right_aligned(
    rows: Rows, column: int, table_classes: frozenset[str], n_columns: int
) -> bool:
    if "plain" in table_classes:
        return column == n_columns - 1 and "signed" not in table_classes
    cells = (_single_column_cell_at(row, column) for row in rows)
    return any(cell is not None and bool(cell.kinds & _RIGHT_ALIGNED) for cell in cells)


def _typst_table_source(
    columns: Sequence[str],
    is_right_aligned: Sequence[bool],
    heads: Rows,
    body: Rows,
    row_classes: Sequence[frozenset[str]],
    size_pt: float,
) -> str:
    head = "".join(f"[{cell.source}], " for row in heads for cell in row)
    cells = "".join(
        f"  {_typst_cell_source(cell, look)},\n"
        for row, look in zip(body, row_classes, strict=True)
        for cell in row
    )
    align = "".join(f"{'right' if index else 'left'}, " for index in is_right_aligned)
    return f"#rows({size_pt:.2f}pt, ({', '.join(columns)},), ({align}), ({head}),\n{cells})\n"


def _typst_cell_source(cell: Cell, row_classes: frozenset[str]) -> str:
    words = f"#strong[{cell.source}]" if "head" in row_classes else cell.source
    words = f"#quiet[{words}]" if "note" in row_classes else words
    arguments = [f"colspan: {cell.n_columns}"] if cell.n_columns > 1 else []
    arguments += ['fill: rgb("#fdeeea")'] if "bad" in row_classes else []
    return f"table.cell({', '.join(arguments)})[{words}]" if arguments else f"[{words}]"
