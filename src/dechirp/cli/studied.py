"""What the terminal shows of a study: how far it is, its points, and its requirements."""

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any

from rich.console import Console, Group
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from dechirp.cli.show import table

if TYPE_CHECKING:
    import numpy as np

    from dechirp.experiment.study.layout import Layout
    from dechirp.experiment.study.plan import Plan
    from dechirp.experiment.study.record import Record
    from dechirp.experiment.study.require import Judged
    from dechirp.experiment.study.results import StudyResult
    from dechirp.experiment.study.running import Progress

_MOST_LIVE = 8
_MOST_ROWS = 40
_MOST_COLUMNS = 6
_TO = "\N{EN DASH}"
_STYLES = {"met": "green", "not met": "red", "undecided": "yellow"}
# Of the time of a study that its table may take.
_SHARE = 0.02


@contextmanager
def live(
    plan: "Plan", layout: "Layout", record: "Record", *, quiet: bool
) -> Iterator[Callable[["Progress"], None] | None]:
    """Show on standard error how far a study is, and its latest points; none where nobody looks.

    A line of progress, trials a second and time left; below it the points that were begun last,
    with the value and interval of the first scores so far. Points are estimated again once a
    second, and less often where that would take more than 2 % of the time.
    """
    if quiet or not sys.stderr.isatty():
        yield None
        return
    screen = Console(stderr=True, highlight=False, markup=False, emoji=False)
    with Live(console=screen, transient=True, auto_refresh=False) as shown:
        latest = _Latest(plan, layout, record)

        def tell(progress: "Progress") -> None:
            shown.update(Group(line(progress), *latest.table(screen.width)), refresh=True)

        yield tell


def line(progress: "Progress") -> Table:
    """How far a study is: a bar, and beside it numbers."""
    words = [
        f"{progress.points_done} of {progress.n_points} points",
        f"{progress.trials_done} of {progress.n_trials} trials",
    ]
    if progress.trials_per_s > 0:
        words += [
            f"{progress.trials_per_s:.3g} trials/s",
            f"{duration(progress.seconds_left)} left",
        ]
    if progress.n_failures:
        words.append(f"{progress.n_failures} failed")
    made = Table.grid(padding=(0, 1))
    bar = ProgressBar(total=max(progress.n_trials, 1), completed=progress.trials_done, width=20)
    made.add_row(bar, ", ".join(words))
    return made


def duration(seconds: float) -> str:
    """Write a time as 40 s, 12 min or 3.5 h."""
    if not seconds < 1e9:
        return "an unknown time"
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


class _Latest:
    """The points that were begun last, as a table that is made anew when it is worth it."""

    def __init__(self, plan: "Plan", layout: "Layout", record: "Record") -> None:
        self.plan, self.layout, self.record = plan, layout, record
        self._made: list[Table] = []
        self._next_s = 0.0

    def table(self, width: int) -> list[Table]:
        """The table; none before the first block."""
        started_s = monotonic()
        if started_s >= self._next_s:
            self._made = list(self._fresh(width))
            took_s = monotonic() - started_s
            self._next_s = started_s + max(1.0, took_s / _SHARE)
        return self._made

    def _fresh(self, width: int) -> Iterator[Table]:
        import numpy as np

        from dechirp.experiment.study.results import estimate

        begun = np.unique(self.record.done()[:, 0])[-_MOST_LIVE:].tolist()
        if not begun:
            return
        columns = list(_columns(self.layout))[:_MOST_COLUMNS]
        rows, numbers = [], []
        confidence = self.plan.study.confidence
        for point in begun:
            sums = self.record.sums(point)
            rows.append((self.plan.labels(point), len(sums)))
            numbers.append(
                [estimate(self.layout, *one, sums, confidence=confidence) for one in columns]
            )
        yield _table(rows, columns, np.array(numbers), self.layout, width)


def points(result: "StudyResult", *, width: int) -> Table:
    """Make the table of points at the end: settings, trials, and scores with their intervals.

    The first 40 points, and as many scores as the width in letters has room for, of each target
    where there are several; `points.parquet` has all.
    """
    import numpy as np

    from dechirp.experiment.study.results import shown

    columns = list(_columns(result.layout))
    rows = [
        (
            tuple((path, shown(result.study, path, text)) for path, text in settings),
            int(result.trials[point]),
        )
        for point, settings in enumerate(result.settings[:_MOST_ROWS])
    ]
    numbers = [
        result.estimates[label][:_MOST_ROWS, _place(result.layout, label, owner), :3]
        for label, owner in columns
    ]
    return _table(rows, columns, np.stack(numbers, axis=1), result.layout, width)


def more(result: "StudyResult") -> Iterator[str]:
    """Say how many points the table leaves out."""
    left = result.n_points - _MOST_ROWS
    if left > 0:
        yield f"{left} more points are in points.parquet."


def requirements(judged: Sequence["Judged"], result: "StudyResult") -> Iterator[Text]:
    """One paragraph for each limit that is required: whether it is met, and how certain."""
    from dechirp.report.study_required import required

    for one in judged:
        told = required(one, result)
        where = f" ({told.where})" if told.where else ""
        bound = f"{told.measured}, bound {told.bound} ({told.at}), {told.trials} trials"
        more_words = f", {told.more}" if told.more else ""
        yield Text.assemble(
            (one.decision, _STYLES[one.decision]),
            f": {told.required}{where}: {bound}{more_words}; certainty {told.certainty}.",
        )


def document(
    result: "StudyResult",
    judged: Sequence["Judged"],
    *,
    version: str,
    done: int,
    total: int,
    files: Mapping[str, Path],
) -> dict[str, Any]:
    """Make the JSON document of a study, in plain values.

    `done` and `total` count trials. A row, a point: see `StudyResult.rows`.
    """
    from dechirp.config.texts import plain

    return {
        "version": version,
        "seed": result.study.seed,
        "rows": result.rows,
        "done": done,
        "total": total,
        "require": [_requirement(one, result) for one in judged],
        "findings": [{"point": point, **plain(finding)} for point, finding in result.findings],
        "failures": [
            {"point": point, "trial": failure.trial, "message": failure.message}
            for point, failure in result.failures
        ],
        "files": {name: str(path) for name, path in files.items()},
    }


def _requirement(one: "Judged", result: "StudyResult") -> dict[str, Any]:
    asked = one.requirement
    return {
        "score": asked.score,
        "target": asked.target,
        "at": dict(asked.at),
        one.side: one.limit,
        "confidence": asked.confidence,
        "decision": one.decision,
        "certainty": one.certainty,
        "value": one.value,
        "bound": one.bound,
        "trials": one.trials,
        "more_trials": one.more_trials,
        "points": len(one.points),
        "points_met": one.n_met,
        "deciding": dict(result.settings[one.point]),
    }


_Column = tuple[str, str | None]


def _columns(layout: "Layout") -> Iterator[_Column]:
    """Label and target of all scores; None where there is only one, or the whole."""
    for score, names in zip(layout.scores, layout.subjects, strict=True):
        for name in names if len(names) > 1 else (None,):
            yield score.label(), name


def _place(layout: "Layout", label: str, owner: str | None) -> int:
    names = layout.subjects[layout.index(label)]
    return 0 if owner is None else 1 + names.index(owner)


def _table(
    rows: Sequence[tuple[Sequence[tuple[str, str]], int]],
    columns: Sequence[_Column],
    numbers: "np.ndarray",
    layout: "Layout",
    width: int,
) -> Table:
    """Rows of settings and trials, with numbers (n_rows, n_columns, 3): value, low and high."""
    from dechirp.report.settings_words import (
        scale_of,
        score_words,
        setting_words,
        told,
        value_words,
        with_unit,
    )

    paths = [setting_words(path) for path, _ in rows[0][0]] if rows else []
    settings = [[value_words(text) for _, text in of] for of, _ in rows]
    made = table("", left=paths, right=["trials"])
    taken = 8 + sum(
        max(map(len, (path, *column))) + 1
        for path, column in zip(paths, zip(*settings, strict=True), strict=False)
    )
    cells: list[list[str]] = []
    for (label, owner), of in zip(columns, numbers.swapaxes(0, 1), strict=True):
        scale = scale_of(layout.scores[layout.index(label)].unit, of[:, 0])
        texts = [
            f"{value} ({interval.replace(' to ', _TO)})"
            for value, interval in (told(*(one * scale.factor).tolist()) for one in of)
        ]
        widest = max(map(len, texts))
        taken += widest + 1
        if cells and taken > width:
            break
        words = score_words(label) + (f" of {owner}" if owner else "")
        made.add_column(with_unit(words, scale.unit), justify="right", min_width=widest)
        cells.append(texts)
    for at, (of_point, (_, trials)) in enumerate(zip(settings, rows, strict=True)):
        made.add_row(*of_point, str(trials), *(column[at] for column in cells))
    return made
