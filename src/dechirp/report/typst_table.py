"""Tables of a page on paper: columns as wide as what is in them, letters so small that all fit.

What does not fit a page at 5.2 points breaks its numbers, before ± and after "to". What does not
fit so at 5.0 goes on a page that is turned, whole or broken; what does not fit that at 4.6 is cut
into tables of some columns each, the first column in all of them.
"""

from collections.abc import Iterator, Sequence

from dechirp.core.values import value

_UPRIGHT_PT, _TURNED_PT = 516.0, 759.0  # within the margins of A4
_LARGEST_PT, _SMALLEST_PT, _BROKEN_SMALLEST_PT, _TURNED_SMALLEST_PT = 8.0, 5.2, 5.0, 4.6
# Room, least size, and whether numbers go over two lines: the first in which a table fits.
_TRIED = (
    (_UPRIGHT_PT, _SMALLEST_PT, False),
    (_UPRIGHT_PT, _BROKEN_SMALLEST_PT, True),
    (_TURNED_PT, _TURNED_SMALLEST_PT, False),
    (_TURNED_PT, _TURNED_SMALLEST_PT, True),
)
_PADDING_EM = 0.7
# Mean width of a letter: DejaVu Sans, and STIX in a paper.
_LETTER_EM, _PAPER_LETTER_EM = 0.65, 0.50
_NARROW = 16  # letters that a column of words has at least
_WORD = 25  # words that are longer are broken
_ON_ONE_LINE = frozenset({"num", "count", "interval", "theory", "short", "decision"})
_TO_THE_RIGHT = frozenset({"num", "count", "interval", "theory"})
_FIXED = {"bars": (24.0, 13.0, 36.0, 27.0), "shares": (50.0, 14.0, 36.0)}


@value
class Cell:
    """A cell: its Typst source, and what decides how wide it is."""

    words: str
    lines: tuple[str, ...]
    kinds: frozenset[str]
    n_columns: int = 1


Rows = Sequence[Sequence[Cell]]


def laid_out(
    rows: Rows,
    looks: Sequence[frozenset[str]],
    n_heads: int,
    kinds: frozenset[str],
    *,
    is_paper: bool,
) -> tuple[str, bool]:
    """Return the Typst source of a table, and whether it is for a page that is turned.

    Parameters
    ----------
    rows : sequence of sequence of Cell
        The first `n_heads` are its head, which every page repeats.
    looks : sequence of frozenset
        Classes of each row.
    kinds : frozenset
        Classes of the table; `bars` and `plain` ones are laid out as such.
    is_paper : bool
        Whether letters are those of a paper.
    """
    if not rows:
        return "", False
    heads, body = rows[:n_heads], rows[n_heads:]
    n_columns = max(sum(cell.n_columns for cell in row) for row in rows)
    right = [_is_right(rows, at, kinds, n_columns) for at in range(n_columns)]
    if kinds & {"bars", "plain"}:
        fixed = next((of for name, of in _FIXED.items() if name in kinds), None)
        if "shares" in kinds:
            fixed = _FIXED["shares"]
        columns = [f"{of}fr" for of in fixed] if fixed else ["auto", "1fr"]
        return _table(columns, right, heads, body, looks[n_heads:], 7.5), False
    letter_em = _PAPER_LETTER_EM if is_paper else _LETTER_EM
    for room_pt, smallest_pt, is_broken in _TRIED:
        letters = (_letters(rows, at, n_heads, is_broken) for at in range(n_columns))
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
            made = _table(columns, right, heads, body, looks[n_heads:], size_pt)
            return made, room_pt == _TURNED_PT
    parts = [
        laid_out(
            [[row[at] for at in some] for row in rows], looks, n_heads, kinds, is_paper=is_paper
        )
        for some in _cut(widths_em)
    ]
    return "".join(made for made, _ in parts), True


def _cut(widths_em: Sequence[float]) -> Iterator[list[int]]:
    """Columns of tables that each fit a turned page, the first column in all."""
    room_em = _TURNED_PT / _TURNED_SMALLEST_PT
    some = [0]
    for at in range(1, len(widths_em)):
        if len(some) > 1 and sum(widths_em[one] for one in [*some, at]) > room_em:
            yield some
            some = [0]
        some.append(at)
    yield some


def _letters(rows: Rows, at: int, n_heads: int, is_broken: bool) -> tuple[int, int]:
    """Letters that a column needs, and those with which no line of it is broken."""
    need = want = 1
    for number, row in enumerate(rows):
        cell = _cell_at(row, at)
        if cell is None:
            continue
        words = [word for line in cell.lines for word in line.split(" ")]
        longest = min(max(map(len, words)), _WORD)
        need = max(need, longest)
        if number >= n_heads:
            # Of a number its first line is whole; what stands small below it is words.
            first, *below = map(len, cell.lines)
            if cell.kinds & _ON_ONE_LINE:
                whole = 0 if is_broken else first
            else:
                whole = min(first, _NARROW)
            need = max(need, whole, *(min(one, _NARROW) for one in below))
        want = max(want, *map(len, cell.lines))
    return need, max(need, want)


def _cell_at(row: Sequence[Cell], at: int) -> Cell | None:
    """Cell of one column alone; none where one goes over several."""
    start = 0
    for cell in row:
        if start == at and cell.n_columns == 1:
            return cell
        start += cell.n_columns
    return None


def _is_right(rows: Rows, at: int, kinds: frozenset[str], n_columns: int) -> bool:
    if "plain" in kinds:
        return at == n_columns - 1 and "signed" not in kinds
    cells = (_cell_at(row, at) for row in rows)
    return any(cell is not None and bool(cell.kinds & _TO_THE_RIGHT) for cell in cells)


def _table(
    columns: Sequence[str],
    right: Sequence[bool],
    heads: Rows,
    body: Rows,
    looks: Sequence[frozenset[str]],
    size_pt: float,
) -> str:
    head = "".join(f"[{cell.words}], " for row in heads for cell in row)
    cells = "".join(
        f"  {_cell(cell, look)},\n" for row, look in zip(body, looks, strict=True) for cell in row
    )
    align = "".join(f"{'right' if one else 'left'}, " for one in right)
    return f"#rows({size_pt:.2f}pt, ({', '.join(columns)},), ({align}), ({head}),\n{cells})\n"


def _cell(cell: Cell, look: frozenset[str]) -> str:
    words = f"#strong[{cell.words}]" if "head" in look else cell.words
    words = f"#quiet[{words}]" if "note" in look else words
    told = [f"colspan: {cell.n_columns}"] if cell.n_columns > 1 else []
    told += ['fill: rgb("#fdeeea")'] if "bad" in look else []
    return f"table.cell({', '.join(told)})[{words}]" if told else f"[{words}]"
