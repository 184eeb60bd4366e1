"""Terminal output: tables, findings and progress bars."""

import shutil
import sys
import textwrap
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol

from rich import box
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from dechirp.core.findings import Finding

_STYLES = {"note": "cyan", "warning": "yellow", "error": "red"}


class _Console(Console):
    def print(self, *parts: Any, soft_wrap: bool | None = None, **options: Any) -> None:
        """Leave the wrapping of text to the terminal, so that options in it can be copied."""
        if all(isinstance(part, str | Text) for part in parts):
            soft_wrap = True
        super().print(*parts, soft_wrap=soft_wrap, **options)

    def on_broken_pipe(self) -> None:
        """Raise the error for `main` to handle."""
        raise BrokenPipeError


def open_stdout_console() -> Console:
    """Return a console on standard output, with colours on a terminal."""
    return _Console(highlight=False, markup=False, emoji=False)


def new_table(
    title: str, *, text_columns: Iterable[str] = (), number_columns: Iterable[str] = ()
) -> Table:
    """Create a table with left-aligned columns of text, then right-aligned columns of numbers."""
    table = Table(
        title=title,
        title_justify="left",
        box=box.SIMPLE_HEAD,
        padding=(0, 1, 0, 0),  # seven columns of numbers in 80 characters
        pad_edge=False,
    )
    for name in text_columns:
        table.add_column(name)
    for name in number_columns:
        table.add_column(name, justify="right", no_wrap=True)
    return table


def finding_paragraphs(findings: Iterable[Finding]) -> Iterator[Text]:
    """Yield a paragraph for each finding: on a terminal wrapped, else one line for `grep`.

    Warnings come first, then the options that were chosen, in a form that can be copied.
    """
    for finding in sorted(findings, key=_rank):
        is_option = _is_chosen_option(finding)
        text = f"{finding.level}: {finding.value if is_option else finding}"
        if sys.stdout.isatty():
            wrap = _wrap_chosen_option if is_option else _wrap_finding
            text = wrap(finding, width=shutil.get_terminal_size().columns)
        yield Text.assemble(
            (finding.level, _STYLES[finding.level]), text.removeprefix(finding.level)
        )


_MAX_SHORT_FIX = 80  # characters: a line of a terminal


def short_finding_paragraphs(findings: Iterable[Finding], *, report: Path) -> Iterator[Text]:
    """Yield paragraphs of findings for the end of a table: of notes, the setting and the value.

    Fixes of a line with an option follow their value. The last paragraph refers to the report,
    which contains the notes in full.
    """
    findings = tuple(findings)
    notes = [finding for finding in findings if _can_be_short(finding)]
    yield from finding_paragraphs(finding for finding in findings if finding not in notes)
    width = shutil.get_terminal_size().columns if sys.stdout.isatty() else sys.maxsize
    for note in notes:
        has_short_option = "--" in note.fix and len(note.fix) <= _MAX_SHORT_FIX
        fix = f"; {note.fix}" if has_short_option else ""
        text = _fill(f"note: {note.setting}: {note.value}{fix}", width=width)
        yield Text.assemble(("note", _STYLES["note"]), text.removeprefix("note"))
    if notes:
        count = "this note" if len(notes) == 1 else f"these {len(notes)} notes"
        yield Text(f"What {count} would expect, and how to change it: Findings in {report}")


def _can_be_short(finding: Finding) -> bool:
    return finding.level == "note" and not _is_chosen_option(finding)


def _fill(text: str, *, width: int) -> str:
    """Break a text at words, with the lines after the first indented."""
    return textwrap.fill(
        text,
        max(width, 20),
        subsequent_indent="  ",
        break_long_words=False,
        break_on_hyphens=False,
    )


def _rank(finding: Finding) -> tuple[int, bool]:
    return ("error", "warning", "note").index(finding.level), not _is_chosen_option(finding)


def _is_chosen_option(finding: Finding) -> bool:
    """Return whether a finding states an option: the option names its setting, and replaces it."""
    return finding.value.startswith("chosen --")


def _wrap_chosen_option(finding: Finding, *, width: int) -> str:
    """Return the option on a line of its own, and the reason below it."""
    option, because, reason = finding.value.partition(" because ")
    text = _fill(f"  {because.strip()} {reason}", width=width)
    return f"{finding.level}: {option}\n{text}"


def _wrap_finding(finding: Finding, *, width: int) -> str:
    """Break a finding at words, except its fix, so that options in it can be copied."""
    parts = (
        f"{finding.level}: {finding.setting}: {finding.value};",
        f"expected {finding.expected};",
    )
    lines = [
        line
        for number, part in enumerate(parts)
        for line in textwrap.wrap(
            part,
            max(width, 20),
            initial_indent="  " * (number > 0),
            subsequent_indent="  ",
            break_long_words=False,
            break_on_hyphens=False,
        )
    ]
    return "\n".join([*lines, f"  {finding.fix}"])


class ProgressCallback(Protocol):
    """Callback for the progress of a long run."""

    def __call__(self, done: int, total: int, /) -> None:
        """Report the number of finished parts and the total."""


@contextmanager
def progress_bar(label: str, *, quiet: bool) -> Iterator[ProgressCallback | None]:
    """Show a progress bar on standard error; None if quiet or not on a terminal."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    columns = (BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(label, *columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(label, visible=False)
        yield lambda n_done, total: bar.update(
            task, completed=n_done, total=total, visible=total > 1
        )
