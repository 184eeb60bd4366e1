"""The table of points of a study: settings, trials, and scores with intervals and theory."""

from typing import Literal

import numpy as np

from dechirp.core.values import value
from dechirp.experiment.study.results import StudyResult, shown
from dechirp.report.amounts import counted
from dechirp.report.settings_words import (
    scale_of,
    score_words,
    setting_words,
    told,
    value_words,
    with_unit,
)

_MOST_ROWS = 200
_MOST_SUBJECTS = 6


@value
class Column:
    """One column of the table of points."""

    words: str
    kind: Literal["label", "count", "num", "interval", "theory"] = "num"


@value
class Table:
    """Points with their scores, in texts."""

    columns: tuple[Column, ...]
    rows: tuple[tuple[str, ...], ...]
    n_more: int = 0


def table(result: StudyResult, *, most_rows: int = _MOST_ROWS) -> Table:
    """List points: settings, trials, and each score with its interval and theory.

    Of scores of several targets each of the first six has columns of its own, instead of all
    together.
    """
    n = min(result.n_points, most_rows)
    columns: list[Column] = []
    cells: list[list[str]] = []
    for at, (path, _) in enumerate(result.settings[0] if result.settings else ()):
        columns.append(Column(words=setting_words(path), kind="label"))
        texts = [result.settings[point][at] for point in range(n)]
        cells.append([value_words(shown(result.study, *one)) for one in texts])
    columns.append(Column(words="trials", kind="count"))
    cells.append([counted(int(trials)) for trials in result.trials[:n]])
    if result.failures:
        columns.append(Column(words="failed", kind="count"))
        cells.append([counted(int(failed)) for failed in result.n_failures[:n]])
    for label, values in result.estimates.items():
        scale = scale_of(result.score(label).unit, values[..., (0, 3)])
        names = result.subjects(label)
        owners = [("", 0)]
        if len(names) > 1:
            owners = [(f" of {name}", 1 + at) for at, name in enumerate(names)][:_MOST_SUBJECTS]
        for owner, at in owners:
            numbers = values[:n, at] * scale.factor
            words = with_unit(score_words(label) + owner, scale.unit)
            both = [told(*(float(one) for one in row[:3])) for row in numbers]
            columns += [Column(words=words), Column(words="", kind="interval")]
            cells += [[one for one, _ in both], [interval for _, interval in both]]
            if np.isfinite(values[:, at, 3]).any():
                columns.append(Column(words="theory", kind="theory"))
                cells.append([_like(row) for row in numbers])
    return Table(
        columns=tuple(columns),
        rows=tuple(zip(*cells, strict=True)),
        n_more=result.n_points - n,
    )


def _like(row: np.ndarray) -> str:
    """Write theory with as many digits as the value that it stands beside."""
    measured, low, high, law = (float(one) for one in row)
    half = (high - low) / 2 if np.isfinite(low) and np.isfinite(high) else np.nan
    return told(law, law - half, law + half)[0] if np.isfinite(measured) else told(law, law, law)[0]
