"""Output of `dechirp verify --witnesses`: the board on the screen and in files."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dechirp.witnesses.board import Testimony

_FILES = ("witnesses.json", "witnesses.md", "witnesses.png")


def write_witness_board(out: Path, *, as_json: bool, quiet: bool) -> int:
    """Run all witnesses, write the board into a folder, and print it.

    Returns
    -------
    int
        Exit status: 1 if a comparison fails or none was possible.
    """
    import dechirp
    from dechirp.cli.console import progress_bar
    from dechirp.report.figures.style import render_png
    from dechirp.report.figures.witness_board import draw_witness_board
    from dechirp.results.text_files import (
        check_folder_replaceable,
        to_json_text,
        write_files_into_folder,
    )
    from dechirp.witnesses.board import (
        board_as_markdown,
        board_document,
        find_witness_data,
        run_witnesses,
    )

    data = find_witness_data()
    check_folder_replaceable(out, _FILES)
    with progress_bar("witnesses", quiet=quiet) as report:
        testimonies = run_witnesses(data, progress=report)
    document = {"version": dechirp.__version__, **board_document(testimonies)}
    text = to_json_text(document)
    ratios = {
        testimony.name: [comparison.excess for comparison in testimony.comparisons]
        for testimony in testimonies
        if testimony.comparisons
    }
    picture = render_png(
        lambda figure: draw_witness_board(figure, ratios), height_in=1.0 + 0.3 * max(len(ratios), 2)
    )
    contents = (text.encode(), board_as_markdown(testimonies).encode(), picture)
    write_files_into_folder(out, dict(zip(_FILES, contents, strict=True)))
    if as_json:
        print(text, end="")
    elif not quiet:
        _print_board(testimonies, out)
    return 0 if document["passed"] and document["n_numbers"] else 1


def _print_board(testimonies: "tuple[Testimony, ...]", out: Path) -> None:
    from dechirp.cli.console import new_table, open_stdout_console
    from dechirp.witnesses.board import format_comparison, summarise_board

    screen = open_stdout_console()
    for testimony in testimonies:
        screen.print(f"{testimony.source} ({testimony.licence})")
        if testimony.comparisons:
            table = new_table(
                "", text_columns=["quantity", "answer", ""], number_columns=["theirs", "ours"]
            )
            for comparison in testimony.comparisons:
                quantity, answer, theirs, ours, _, result = format_comparison(comparison)
                table.add_row(quantity, answer, result, theirs, ours)
            screen.print(table)
        if testimony.missing:
            screen.print(f"Missing: {testimony.missing}")
        if testimony.error:
            screen.print(f"Failed: {testimony.error}")
    screen.print(f"Board: {out / 'witnesses.md'}")
    screen.print(summarise_board(testimonies))
