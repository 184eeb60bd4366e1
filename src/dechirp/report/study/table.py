"""Table of the points of a study: settings, trials, scores with intervals, and theory."""

from typing import Literal

import numpy as np

from dechirp.core.values import frozen_dataclass
from dechirp.experiments.study.results import StudyResult, label_of_swept_value
from dechirp.report.check_values import format_count
from dechirp.report.labels import (
    choose_display_scale,
    format_with_interval,
    label_with_unit,
    score_label,
    setting_label,
    value_label,
)

_MAX_ROWS = 200
_MAX_SUBJECTS = 6


@frozen_dataclass
class TableColumn:
    """Column of the table of points."""

    label: str
    kind: Literal["label", "count", "num", "interval", "theory"] = "num"


@frozen_dataclass
class PointTable:
    """Formatted table of points."""

    columns: tuple[TableColumn, ...]
    rows: tuple[tuple[str, ...], ...]
    n_more: int = 0


def build_point_table(result: StudyResult, *, max_rows: int = _MAX_ROWS) -> PointTable:
    """Return the table of points: settings, trials, and scores with intervals and theory.

    Scores of several targets have columns for each of the first six targets instead of the total.
    """
    n = min(result.n_points, max_rows)
    columns: list[TableColumn] = []
    cells: list[list[str]] = []
    for index, (path, _) in enumerate(result.settings[0] if result.settings else ()):
        columns.append(TableColumn(label=setting_label(path), kind="label"))
        texts = [result.settings[point][index] for point in range(n)]
        cells.append([value_label(label_of_swept_value(result.study, *value)) for value in texts])
    columns.append(TableColumn(label="trials", kind="count"))
    cells.append([format_count(int(trials)) for trials in result.trials[:n]])
    if result.failures:
        columns.append(TableColumn(label="failed", kind="count"))
        cells.append([format_count(int(failed)) for failed in result.n_failed_trials_per_point[:n]])
    for label, values in result.estimates.items():
        scale = choose_display_scale(result.score_by_label(label).unit, values[..., (0, 3)])
        names = result.scored_target_names(label)
        owners = [("", 0)]
        if len(names) > 1:
            owners = [(f" of {name}", 1 + index) for index, name in enumerate(names)][
                :_MAX_SUBJECTS
            ]
        for owner, index in owners:
            numbers = values[:n, index] * scale.factor
            words = label_with_unit(score_label(label) + owner, scale.unit)
            both = [format_with_interval(*(float(value) for value in row[:3])) for row in numbers]
            columns += [TableColumn(label=words), TableColumn(label="", kind="interval")]
            cells += [[value for value, _ in both], [interval for _, interval in both]]
            if np.isfinite(values[:, index, 3]).any():
                columns.append(TableColumn(label="theory", kind="theory"))
                cells.append([_format_theory(row) for row in numbers])
    return PointTable(
        columns=tuple(columns),
        rows=tuple(zip(*cells, strict=True)),
        n_more=result.n_points - n,
    )


def _format_theory(value_low_high_theory: np.ndarray) -> str:
    """Format theory with as many digits as the measured value."""
    measured, low, high, law = (float(value) for value in value_low_high_theory)
    half_interval = (high - low) / 2 if np.isfinite(low) and np.isfinite(high) else np.nan
    return (
        format_with_interval(law, law - half_interval, law + half_interval)[0]
        if np.isfinite(measured)
        else format_with_interval(law, law, law)[0]
    )
