"""What the terminal shows: tables, findings, and how far a long run has come."""

import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Protocol

from rich import box
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from dechirp.core.findings import Finding

_STYLES = {"note": "cyan", "warning": "yellow", "error": "red"}


class _Console(Console):
    def on_broken_pipe(self) -> None:
        """Leave it to the end of the program."""
        raise BrokenPipeError


def console() -> Console:
    """Standard output, with colours where it is a terminal."""
    return _Console(highlight=False, markup=False, emoji=False)


def table(title: str, *, left: Iterable[str] = (), right: Iterable[str] = ()) -> Table:
    """Begin a table: columns of words, then columns of numbers."""
    made = Table(
        title=title,
        title_justify="left",
        box=box.SIMPLE_HEAD,
        padding=(0, 1, 0, 0),  # seven columns of numbers in 80 characters
        pad_edge=False,
    )
    for name in left:
        made.add_column(name)
    for name in right:
        made.add_column(name, justify="right", no_wrap=True)
    return made


def findings(found: Iterable[Finding]) -> Iterator[Text]:
    """One paragraph for each finding."""
    for finding in found:
        yield Text.assemble((finding.level, _STYLES[finding.level]), f": {finding}")


class Report(Protocol):
    """What a long run calls."""

    def __call__(self, done: int, total: int, /) -> None:
        """Say how many parts are done, and how many there are."""


@contextmanager
def progress(of: str, *, quiet: bool) -> Iterator[Report | None]:
    """Bar on standard error for work in several parts; none where nobody would see it."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    columns = (BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(of, *columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(of, visible=False)
        yield lambda done, total: bar.update(task, completed=done, total=total, visible=total > 1)
