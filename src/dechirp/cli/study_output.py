"""Terminal output and JSON document of a study: progress, points and requirements."""

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

from dechirp.cli.console import new_table

if TYPE_CHECKING:
    import numpy as np

    from dechirp.experiments.study.layout import ScoreColumnLayout
    from dechirp.experiments.study.ledger_reader import LedgerReader
    from dechirp.experiments.study.plan import Plan
    from dechirp.experiments.study.requirements import Verdict
    from dechirp.experiments.study.results import StudyResult
    from dechirp.experiments.study.scheduler import Progress

_MAX_LIVE_POINTS = 8
_MAX_ROWS = 40
_MAX_COLUMNS = 6
_RANGE_DASH = "\N{EN DASH}"
_STYLES = {"met": "green", "not met": "red", "undecided": "yellow"}
# Largest share of the time of a study that its live table may take.
_MAX_TIME_SHARE = 0.02


@contextmanager
def show_live_progress(
    plan: "Plan", layout: "ScoreColumnLayout", record: "LedgerReader", *, quiet: bool
) -> Iterator[Callable[["Progress"], None] | None]:
    """Show the progress and the latest points of a study on standard error, if a terminal.

    The first line has the progress, trials per second and time left. The table below has the
    points that were started last, with value and interval of the first scores. The points are
    estimated once a second, or less often if that would take more than 2 % of the time.
    """
    if quiet or not sys.stderr.isatty():
        yield None
        return
    screen = Console(stderr=True, highlight=False, markup=False, emoji=False)
    with Live(console=screen, transient=True, auto_refresh=False) as display:
        latest = _LatestPoints(plan, layout, record)

        def show_progress(progress: "Progress") -> None:
            display.update(
                Group(
                    study_progress_bar(progress),
                    *latest.cached_or_rebuilt_points_table(screen.width),
                ),
                refresh=True,
            )

        yield show_progress


def study_progress_bar(progress: "Progress") -> Table:
    """Return the progress of a study as a bar with numbers."""
    parts = [
        f"{progress.n_points_done} of {progress.n_points} points",
        f"{progress.n_trials_done} of {progress.n_trials} trials",
    ]
    if progress.trials_per_s > 0:
        parts += [
            f"{progress.trials_per_s:.3g} trials/s",
            f"{format_duration(progress.seconds_left)} left",
        ]
    if progress.n_failures:
        parts.append(f"{progress.n_failures} failed")
    grid = Table.grid(padding=(0, 1))
    bar = ProgressBar(total=max(progress.n_trials, 1), completed=progress.n_trials_done, width=20)
    grid.add_row(bar, ", ".join(parts))
    return grid


def format_duration(seconds: float) -> str:
    """Format a duration as 40 s, 12 min or 3.5 h."""
    if not seconds < 1e9:
        return "an unknown time"
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


class _LatestPoints:
    """Table of the points that were started last, rebuilt at limited cost."""

    def __init__(self, plan: "Plan", layout: "ScoreColumnLayout", record: "LedgerReader") -> None:
        self.plan, self.layout, self.record = plan, layout, record
        self._tables: list[Table] = []
        self._next_s = 0.0

    def cached_or_rebuilt_points_table(self, width: int) -> list[Table]:
        """Return the table, rebuilt if it is due; empty before the first block."""
        started_s = monotonic()
        if started_s >= self._next_s:
            self._tables = list(self.rebuild_points_table(width))
            took_s = monotonic() - started_s
            self._next_s = started_s + max(1.0, took_s / _MAX_TIME_SHARE)
        return self._tables

    def rebuild_points_table(self, width: int) -> Iterator[Table]:
        import numpy as np

        from dechirp.experiments.study.results import estimate_score

        latest_points = np.unique(self.record.saved_point_and_block_numbers()[:, 0])[
            -_MAX_LIVE_POINTS:
        ].tolist()
        if not latest_points:
            return
        columns = list(_iter_score_labels_and_targets(self.layout))[:_MAX_COLUMNS]
        rows, numbers = [], []
        confidence = self.plan.study.confidence
        for point in latest_points:
            sums = self.record.trial_sums_of_point(point)
            rows.append((self.plan.setting_labels_of_point(point), len(sums)))
            numbers.append(
                [
                    estimate_score(self.layout, *column, sums, confidence=confidence)
                    for column in columns
                ]
            )
        yield _settings_and_estimates_table(rows, columns, np.array(numbers), self.layout, width)


def study_points_table(result: "StudyResult", *, width: int) -> Table:
    """Return the final table of points: settings, trials, and scores with their intervals.

    It has the first 40 points and the scores that fit the width in characters, per target if
    there are several; the file of points has all.
    """
    import numpy as np

    from dechirp.experiments.study.results import label_of_swept_value

    columns = list(_iter_score_labels_and_targets(result.layout))
    rows = [
        (
            tuple(
                (path, label_of_swept_value(result.study, path, text)) for path, text in settings
            ),
            int(result.trials[point]),
        )
        for point, settings in enumerate(result.settings[:_MAX_ROWS])
    ]
    numbers = [
        result.estimates[label][:_MAX_ROWS, _score_target_index(result.layout, label, owner), :3]
        for label, owner in columns
    ]
    return _settings_and_estimates_table(
        rows, columns, np.stack(numbers, axis=1), result.layout, width
    )


def omitted_point_count_line(result: "StudyResult", points_file: str) -> Iterator[str]:
    """Yield a line with the number of points that the table omits, and the file with all."""
    n_omitted = result.n_points - _MAX_ROWS
    if n_omitted > 0:
        yield f"{n_omitted} more points are in {points_file}."


def requirement_paragraphs(verdicts: Sequence["Verdict"], result: "StudyResult") -> Iterator[Text]:
    """Yield a paragraph for each requirement: the decision and its certainty."""
    from dechirp.report.study.requirements import format_requirement_row

    for verdict in verdicts:
        row = format_requirement_row(verdict, result)
        where = f" ({row.where})" if row.where else ""
        bound = f"{row.measured}, bound {row.bound} ({row.bound_note}), {row.trials} trials"
        more_words = f", {row.more}" if row.more else ""
        yield Text.assemble(
            (verdict.decision, _STYLES[verdict.decision]),
            f": {row.required}{where}: {bound}{more_words}; certainty {row.certainty}.",
        )


def study_json_document(
    result: "StudyResult",
    verdicts: Sequence["Verdict"],
    *,
    version: str,
    n_done: int,
    n_total: int,
    files: Mapping[str, Path],
) -> dict[str, Any]:
    """Return the JSON document of a study, in plain values.

    `n_done` and `n_total` count trials. A row, a point: see `StudyResult.points_as_dicts`.
    """
    from dechirp.config.dumping import to_json_data

    return {
        "version": version,
        "seed": result.study.seed,
        "rows": result.points_as_dicts,
        "done": n_done,
        "total": n_total,
        "require": [_requirement_json_document(verdict, result) for verdict in verdicts],
        "findings": [
            {"point": point, **to_json_data(finding)} for point, finding in result.findings
        ],
        "failures": [
            {"point": point, "trial": failure.trial, "message": failure.message}
            for point, failure in result.failures
        ],
        "files": {name: str(path) for name, path in files.items()},
    }


def _requirement_json_document(verdict: "Verdict", result: "StudyResult") -> dict[str, Any]:
    requirement = verdict.requirement
    return {
        "score": requirement.score,
        "target": requirement.target,
        "point_settings": dict(requirement.points),
        verdict.side: verdict.limit,
        "confidence": requirement.confidence,
        "decision": verdict.decision,
        "certainty": verdict.certainty,
        "value": verdict.value,
        "bound": verdict.bound,
        "trials": verdict.trials,
        "more_trials": verdict.more_trials,
        "points": len(verdict.points),
        "points_met": verdict.n_met,
        "deciding": dict(result.settings[verdict.point]),
    }


_Column = tuple[str, str | None]


def _iter_score_labels_and_targets(layout: "ScoreColumnLayout") -> Iterator[_Column]:
    """Yield label and target of each score; the target is None if there is only one."""
    for score, names in zip(layout.scores, layout.scored_target_names, strict=True):
        for name in names if len(names) > 1 else (None,):
            yield score.kind(), name


def _score_target_index(layout: "ScoreColumnLayout", label: str, target: str | None) -> int:
    names = layout.scored_target_names[layout.index_of_score(label)]
    return 0 if target is None else 1 + names.index(target)


def _settings_and_estimates_table(
    rows: Sequence[tuple[Sequence[tuple[str, str]], int]],
    columns: Sequence[_Column],
    numbers: "np.ndarray",
    layout: "ScoreColumnLayout",
    width: int,
) -> Table:
    """Return a table of settings, trials and estimates.

    `numbers` (n_rows, n_columns, 3) holds value, low and high end of each interval.
    """
    from dechirp.report.labels import (
        choose_display_scale,
        format_with_interval,
        label_with_unit,
        score_label,
        setting_label,
        value_label,
    )

    paths = [setting_label(path) for path, _ in rows[0][0]] if rows else []
    settings = [[value_label(text) for _, text in estimates] for estimates, _ in rows]
    table_of_points = new_table("", text_columns=paths, number_columns=["trials"])
    used_width = 8 + sum(
        max(map(len, (path, *column))) + 1
        for path, column in zip(paths, zip(*settings, strict=True), strict=False)
    )
    cells: list[list[str]] = []
    for (label, owner), estimates in zip(columns, numbers.swapaxes(0, 1), strict=True):
        scale = choose_display_scale(
            layout.scores[layout.index_of_score(label)].unit, estimates[:, 0]
        )
        texts = [
            f"{value} ({interval.replace(' to ', _RANGE_DASH)})"
            for value, interval in (
                format_with_interval(*(estimate * scale.factor).tolist()) for estimate in estimates
            )
        ]
        widest = max(map(len, texts))
        used_width += widest + 1
        if cells and used_width > width:
            break
        words = score_label(label) + (f" of {owner}" if owner else "")
        table_of_points.add_column(
            label_with_unit(words, scale.unit), justify="right", min_width=widest
        )
        cells.append(texts)
    for row_index, (of_point, (_, trials)) in enumerate(zip(settings, rows, strict=True)):
        table_of_points.add_row(*of_point, str(trials), *(column[row_index] for column in cells))
    return table_of_points
