"""Results of a study: estimates of each point with intervals, as dataset, rows and tables."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np
import xarray as xr

from dechirp.core.display import Displayable, Table, format_count_with_noun, truncated_display_table
from dechirp.core.findings import Finding, findings_display_table
from dechirp.core.text import EN_DASH, format_quantity
from dechirp.evaluation.score.base import NO_ESTIMATE, Estimate, Score
from dechirp.evaluation.score.roc import Roc, RocCurve
from dechirp.experiments.study.block import Failure
from dechirp.experiments.study.layout import ScoreColumnLayout
from dechirp.experiments.study.study import RandomSetting, Study, SweptSetting
from dechirp.results.parquet import ColumnType
from dechirp.results.table_files import write_table

if TYPE_CHECKING:
    from dechirp.experiments.study.ledger_reader import LedgerReader
    from dechirp.experiments.study.plan import Plan

VALUE_SUFFIXES = ("", "_low", "_high", "_theory")
"""Suffixes of a score's label in the dataset, in the order of `StudyResult.estimates`."""
_VALUE_PARTS = ("value", "low", "high", "theory")
SCORE_UNITS: Mapping[str | None, str] = MappingProxyType(
    {None: "1", "m": "m", "m_per_s": "m/s", "rad": "rad", "s": "s"}
)
"""Units attribute of a score's values, by `Score.unit`."""

_EMPTY = np.empty((0, 0))
T = TypeVar("T")
# Numbers per piece of a table: 8 MB.
_PIECE_SIZE = 1_000_000


class PointData(NamedTuple):
    """Settings, sums and findings of one point, as the ledger contains them."""

    settings: tuple[tuple[str, str], ...]
    """Path and text of each, as `--set` accepts them."""
    numbers: tuple[float | None, ...]
    """The same settings as numbers in the written unit; None for texts."""
    sums: np.ndarray
    """(n_trials, n_columns), see `ScoreColumnLayout`, from trial 0 on; NaN in failed trials."""
    theory: np.ndarray
    """See `ScoreColumnLayout.theoretical_score_value`."""
    failures: tuple[Failure, ...] = ()
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True, eq=False, repr=False)
class StudyResult(Displayable):
    """Estimates of all points, in the order of their numbers."""

    study: Study
    layout: ScoreColumnLayout
    settings: tuple[tuple[tuple[str, str], ...], ...]
    """Path and text of the settings of each point."""
    numbers: tuple[tuple[float | None, ...], ...]
    """The same settings as numbers in the written unit."""
    trials: np.ndarray
    """Number of trials of each point, including failed ones, (n_points,)."""
    estimates: Mapping[str, np.ndarray]
    """Estimates of each score by its label, (n_points, 1 + n_targets, 4): value, low, high and
    theory, of all targets together and then of each. NaN where there is no estimate."""
    curves: Mapping[str, tuple[tuple[RocCurve, ...], ...]] = field(default_factory=dict)
    """Curves of the score `roc`, by its label: of each point, of all targets together and each."""
    failures: tuple[tuple[int, Failure], ...] = ()
    """Number of the point, and the failure."""
    findings: tuple[tuple[int, Finding], ...] = ()

    @property
    def n_points(self) -> int:
        """Number of points, including points without trials."""
        return len(self.settings)

    @property
    def n_failed_trials_per_point(self) -> np.ndarray:
        """Number of failed trials of each point, (n_points,)."""
        points = [point for point, _ in self.failures]
        return np.bincount(np.array(points, dtype=int), minlength=self.n_points)

    def scored_target_names(self, label: str) -> tuple[str, ...]:
        """Return the targets for which a score has values besides the total; empty if none."""
        return self.layout.scored_target_names[self.layout.index_of_score(label)]

    def score_by_label(self, label: str) -> Score:
        """Return the score with a label."""
        return self.layout.scores[self.layout.index_of_score(label)]

    @property
    def points_as_dicts(self) -> list[dict[str, Any]]:
        """Settings, `trials`, `failures` and score values, one mapping a point.

        Value, low, high and theory of each score are SI; None where there is no estimate. The
        values of all targets together are at the top: from their summed sums, and the mean of their
        theories. Where there is more than one target, `targets` has the values of each.
        """
        numbers = {
            label: _to_nested_list_with_none_for_nan(values)
            for label, values in self.estimates.items()
        }
        both = zip(
            self.settings,
            self.trials.tolist(),
            self.n_failed_trials_per_point.tolist(),
            strict=True,
        )
        return [
            {
                **dict(settings),
                "trials": trials,
                "failures": failures,
                **{
                    label: self._score_values_as_dict(label, values[point])
                    for label, values in numbers.items()
                },
            }
            for point, (settings, trials, failures) in enumerate(both)
        ]

    def _score_values_as_dict(
        self, label: str, values_total_and_per_target: Sequence[Sequence[float | None]]
    ) -> dict[str, Any]:
        whole, *by_target = (
            dict(zip(_VALUE_PARTS, parts, strict=True)) for parts in values_total_and_per_target
        )
        names = self.scored_target_names(label)
        return (
            {**whole, "targets": dict(zip(names, by_target, strict=True))}
            if by_target[1:]
            else whole
        )

    def _display_line(self) -> str:
        parts = [
            format_count_with_noun(self.n_points, "point"),
            format_count_with_noun(int(self.trials.sum()), "trial"),
        ]
        parts += (
            [f"{format_count_with_noun(len(self.failures), 'trial')} failed"]
            if self.failures
            else []
        )
        return f"{self.study.name}: {', '.join(parts)}"

    def _display_tables(self) -> Iterable[Table]:
        paths = [path for path, _ in self.settings[0]] if self.settings else []
        rows = (
            [
                *(label_of_swept_value(self.study, path, dict(settings)[path]) for path in paths),
                f"{int(self.trials[point]):,}",
                *(self._estimate_with_interval_as_text(label, point) for label in self.estimates),
            ]
            for point, settings in enumerate(self.settings)
        )
        head = [*paths, "trials", *self.estimates]
        yield truncated_display_table("Points: value, interval, theory", rows, self.n_points, head)
        yield findings_display_table(dict.fromkeys(finding for _, finding in self.findings))

    def _estimate_with_interval_as_text(self, label: str, point: int) -> str:
        """Format the value of all targets together, its interval, and theory if there is a law."""
        unit = self.score_by_label(label).unit or "probability"
        value, low, high, theory = self.estimates[label][point, 0].tolist()
        if np.isnan(value):
            return EN_DASH
        value_text, low_text, high_text = (
            format_quantity(number, unit, 3) for number in (value, low, high)
        )
        text = f"{value_text} ({low_text} to {high_text})"
        return text if np.isnan(theory) else f"{text}, {format_quantity(theory, unit, 3)}"

    @cached_property
    def dataset(self) -> xr.Dataset:
        """All points as one labelled dataset.

        Each swept setting is a dimension named after its path, in the order of the study. Random
        settings add the dimension `draw`, with their values as coordinates along it (along the
        swept settings too, where each of their points has draws of its own). Coordinates are
        numbers in the written unit, which their attribute `units` contains, or labels.

        `<label>`, `<label>_low`, `<label>_high` and `<label>_theory` refer to all targets together;
        `<label>_by_target` and so on to each, with `target` as last dimension, where there is more
        than one. `trials` and `failures` are counts. Values are SI.
        """
        return _build_study_dataset(self)


def estimate_scores_of_points(
    study: Study,
    layout: ScoreColumnLayout,
    points: Iterable[PointData],
    *,
    progress: Callable[[int], None] | None = None,
) -> StudyResult:
    """Estimate all scores of all points, holding the sums of one point at a time.

    `progress` is called with the number of finished points.
    """
    settings, numbers, trials = [], [], []
    failures: list[tuple[int, Failure]] = []
    findings: list[tuple[int, Finding]] = []
    estimates: dict[str, list[np.ndarray]] = {score.kind(): [] for score in layout.scores}
    rocs = [score for score in layout.scores if isinstance(score, Roc)]
    curves: dict[str, list[tuple[RocCurve, ...]]] = {score.kind(): [] for score in rocs}
    for point, data in enumerate(points):
        settings.append(data.settings)
        numbers.append(data.numbers)
        trials.append(len(data.sums))
        failures += [(point, failure) for failure in data.failures]
        findings += [(point, finding) for finding in data.findings]
        for label, values in estimates.items():
            values.append(
                estimate_score_total_and_per_target(
                    layout, label, data.sums, data.theory, study.confidence
                )
            )
        for roc in rocs:
            curves[roc.kind()].append(
                _roc_curves_total_and_per_target(layout, roc, data.sums, study.confidence)
            )
        if progress is not None:
            progress(point + 1)
    return StudyResult(
        study=study,
        layout=layout,
        settings=tuple(settings),
        numbers=tuple(numbers),
        trials=np.array(trials, dtype=int),
        estimates={
            label: np.array(values).reshape(len(settings), -1, len(_VALUE_PARTS))
            for label, values in estimates.items()
        },
        curves={label: tuple(data) for label, data in curves.items()},
        failures=tuple(failures),
        findings=tuple(findings),
    )


def _roc_curves_total_and_per_target(
    layout: ScoreColumnLayout, roc: Roc, sums: np.ndarray, confidence: float
) -> tuple[RocCurve, ...]:
    label = roc.kind()
    names = layout.scored_target_names[layout.index_of_score(label)]
    if not has_valid_trials(sums):
        unknown = np.full(len(roc.false_alarm_probabilities), np.nan)
        return (RocCurve(*[unknown] * len(RocCurve._fields)),) * (1 + len(names))
    subject_sums = [layout.select_score_sums(sums, label, name) for name in (None, *names)]
    return tuple(
        roc.estimate_roc_curve(sums_of_subject, confidence=confidence)
        for sums_of_subject in subject_sums
    )


def iter_point_data_from_ledger(
    plan: "Plan", layout: ScoreColumnLayout, ledger: "LedgerReader"
) -> Iterator[PointData]:
    """Yield the data of each point from a ledger; points without trials have no rows."""
    failures, findings = (
        _group_by_point(ledger.failed_trials_with_points()),
        _group_by_point(ledger.findings_with_points()),
    )
    saved = ledger.iter_trial_sums_by_point()
    saved_point, sums = next(saved, (plan.n_points, _EMPTY))
    no_theory = np.full(layout.n_theoretical_values, np.nan)
    for point in range(plan.n_points):
        theory = ledger.theoretical_values_of_point(point)
        yield PointData(
            settings=plan.setting_texts_of_point(point),
            numbers=plan.numeric_settings_of_point(point),
            sums=sums if saved_point == point else np.empty((0, layout.n_columns)),
            theory=no_theory if theory is None else theory,
            failures=failures.get(point, ()),
            findings=findings.get(point, ()),
        )
        if saved_point == point:
            saved_point, sums = next(saved, (plan.n_points, _EMPTY))


def iter_trial_numbers_and_sums(
    ledger: "LedgerReader",
) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Yield point number, trial numbers and sums of each point that has trials."""
    blocks = ledger.saved_point_and_block_numbers()
    _, firsts = np.unique(blocks[:, 0], return_index=True)
    expected_numbers = np.arange(len(blocks)) - np.repeat(firsts, np.diff([*firsts, len(blocks)]))
    gaps = set(blocks[blocks[:, 1] != expected_numbers, 0].tolist())  # gaps of an interrupted study
    for point, sums in ledger.iter_trial_sums_by_point():
        yield (
            point,
            ledger.trial_numbers_of_point(point) if point in gaps else np.arange(len(sums)),
            sums,
        )


def _group_by_point(pairs: Iterable[tuple[int, T]]) -> dict[int, tuple[T, ...]]:
    groups: dict[int, list[T]] = {}
    for point, item in pairs:
        groups.setdefault(point, []).append(item)
    return {point: tuple(items) for point, items in groups.items()}


def estimate_score_total_and_per_target(
    layout: ScoreColumnLayout, label: str, sums: np.ndarray, theory: np.ndarray, confidence: float
) -> np.ndarray:
    """Return value, low, high and theory of a score, (1 + n_targets, 4): together, and of each.

    `sums` (n_trials, n_columns) and `theory` are those of all scores, see `ScoreColumnLayout`.
    """
    names = layout.scored_target_names[layout.index_of_score(label)]
    # A single target equals the total.
    targets = [None, *names] if len(names) > 1 else [None]
    rows = [
        (*estimate_score(layout, label, target, sums, confidence=confidence), theory_value)
        for target in targets
        for theory_value in [layout.theoretical_score_value(theory, label, target)]
    ]
    return np.array(rows if len(names) != 1 else rows * 2, dtype=float)


def estimate_score(
    layout: ScoreColumnLayout,
    label: str,
    target: str | None,
    sums: np.ndarray,
    *,
    confidence: float,
) -> Estimate:
    """Estimate a score, with its interval, from the sums of all scores (n_trials, n_columns)."""
    if not has_valid_trials(sums):
        return NO_ESTIMATE
    columns = layout.select_score_sums(sums, label, target)
    score = layout.scores[layout.index_of_score(label)]
    return score.estimate_with_interval(columns, confidence=confidence)


def has_valid_trials(sums: np.ndarray) -> bool:
    """Return whether any trial succeeded, from sums (n_trials, n_columns)."""
    return bool(len(sums)) and not bool(np.isnan(sums).all())


def write_points_table(result: StudyResult, path: Path, *, metadata: Mapping[str, str]) -> None:
    """Write the table of points as `.parquet` or `.csv`, one row a point.

    Columns: `point`; settings, named by path and unit (`scene.targets.car.rcs_dBsm`, numbers;
    `chain.range_window`, labels); `trials`, `failures`; and the keys of
    `StudyResult.points_as_dicts` joined by dots, as `range_rmse.high` and
    `range_rmse.targets.car.high`. SI; NaN where there is no estimate.

    Raises `DechirpError` if the file cannot be written; an existing file then stays.
    """
    table: dict[str, tuple[ColumnType, np.ndarray]] = {
        "point": ("BIGINT", np.arange(result.n_points))
    }
    paths = [path for path, _ in result.settings[0]] if result.settings else []
    for index, setting in enumerate(paths):
        numbers = [row[index] for row in result.numbers]
        if None in numbers:
            words = np.array(
                [label_of_swept_value(result.study, *row[index]) for row in result.settings], object
            )
            table[setting] = ("VARCHAR", words)
        else:
            name = _setting_column_name_with_unit(
                setting, unit_of_varied_setting(result.study, setting)
            )
            table[name] = ("DOUBLE", np.array(numbers, dtype=float))
    table["trials"] = ("BIGINT", result.trials)
    table["failures"] = ("BIGINT", result.n_failed_trials_per_point)
    for label, values in result.estimates.items():
        names = result.scored_target_names(label)
        owners = ["", *(f"targets.{name}." for name in names if len(names) > 1)]
        for column, owner in enumerate(owners):
            for index, part in enumerate(_VALUE_PARTS):
                table[f"{label}.{owner}{part}"] = ("DOUBLE", values[:, column, index])
    columns = {name: kind for name, (kind, _) in table.items()}
    piece = {name: values for name, (_, values) in table.items()}
    write_table(path, columns, [piece] if result.n_points else [], metadata=metadata)


def write_trials_table(
    layout: ScoreColumnLayout,
    points: Iterable[tuple[int, np.ndarray, np.ndarray]],
    path: Path,
    *,
    metadata: Mapping[str, str],
) -> None:
    """Write the table of trials, one row a trial: the sums from which all estimates follow.

    Columns: `point`, `trial`, `failed`, and the sums of each score and target in the order of
    its formula, as `detection_probability.car.0`; NaN where the trial failed. These numbers
    added over trials, and over targets, give the estimates.

    Parameters
    ----------
    layout : ScoreColumnLayout
        Layout of the columns.
    points : iterable
        Number of each point, numbers of its trials and their sums (n_trials, n_columns);
        several points are held at a time. See `iter_trial_numbers_and_sums`.
    path : Path
        File to write, `.parquet` or `.csv`.
    metadata : mapping
        Text metadata stored in a Parquet file.

    Raises
    ------
    DechirpError
        If the file cannot be written; an existing file then stays.
    """
    names = list(_sum_column_names(layout))
    kinds: dict[str, ColumnType] = {"point": "BIGINT", "trial": "BIGINT", "failed": "BOOLEAN"}
    columns: dict[str, ColumnType] = {**kinds, **dict.fromkeys(names, "DOUBLE")}
    write_table(path, columns, _iter_trial_table_chunks(points, names), metadata=metadata)


def label_of_swept_value(study: Study, path: str, value_text: str) -> str:
    """Return the label of a setting's value in tables and legends, or the text itself."""
    axis = next((setting for setting in study.vary if setting.path == path), None)
    if isinstance(axis, SweptSetting) and value_text in axis.texts:
        return axis.labels[axis.texts.index(value_text)]
    return value_text


def unit_of_varied_setting(study: Study, path: str) -> str:
    """Return the unit in which a study writes a setting; empty without one."""
    return next((axis.unit for axis in study.vary if axis.path == path), "")


def _iter_trial_table_chunks(
    points: Iterable[tuple[int, np.ndarray, np.ndarray]], sum_column_names: list[str]
) -> Iterator[dict[str, np.ndarray]]:
    waiting: list[tuple[int, np.ndarray, np.ndarray]] = []
    n_numbers = 0
    for point_data in points:
        waiting.append(point_data)
        n_numbers += point_data[2].size
        if n_numbers >= _PIECE_SIZE:
            yield _trial_table_of_points(waiting, sum_column_names)
            waiting, n_numbers = [], 0
    if n_numbers:
        yield _trial_table_of_points(waiting, sum_column_names)


def _trial_table_of_points(
    points: list[tuple[int, np.ndarray, np.ndarray]], sum_column_names: list[str]
) -> dict[str, np.ndarray]:
    sums = np.concatenate([values for _, _, values in points])
    return {
        "point": np.repeat(
            [point for point, _, _ in points], [len(values) for _, _, values in points]
        ),
        "trial": np.concatenate([trials for _, trials, _ in points]),
        "failed": np.isnan(sums).all(axis=1),
        **{
            name: np.ascontiguousarray(sums[:, column])
            for column, name in enumerate(sum_column_names)
        },
    }


def _sum_column_names(layout: ScoreColumnLayout) -> Iterator[str]:
    for score, names in zip(layout.scores, layout.scored_target_names, strict=True):
        for owner in [f"{name}." for name in names] or [""]:
            yield from (f"{score.kind()}.{owner}{index}" for index in range(score.n_sums))


def _setting_column_name_with_unit(path: str, unit: str) -> str:
    """Append the unit to a path as fields do: `ego.velocity_m_per_s`, `rcs_dBsm`."""
    return f"{path}_{unit.replace('/', '_per_').replace('^', '')}" if unit else path


def _to_nested_list_with_none_for_nan(values: np.ndarray) -> Any:
    plain = values.astype(object)
    plain[~np.isfinite(values)] = None
    return plain.tolist()


def _build_study_dataset(result: StudyResult) -> xr.Dataset:
    listed = [axis for axis in result.study.vary if isinstance(axis, SweptSetting)]
    random_settings = [axis for axis in result.study.vary if isinstance(axis, RandomSetting)]
    paths = [path for path, _ in result.settings[0]] if result.settings else []
    # Without settings drawn in each trial.
    random_settings = [axis for axis in random_settings if axis.path in paths]
    cells = np.zeros((result.n_points, len(listed)), dtype=int)
    for dimension, axis in enumerate(listed):
        indices = {text: index for index, text in enumerate(axis.texts)}
        column = paths.index(axis.path) if paths else 0
        cells[:, dimension] = [indices[row[column][1]] for row in result.settings]
    shape = [len(axis.texts) for axis in listed]
    strides = np.cumprod([1, *shape[:0:-1]], dtype=int)[::-1][: len(shape)]
    flat = cells @ strides
    dims = [axis.path for axis in listed]
    index = flat
    if random_settings:
        draw_numbers = _count_earlier_points_in_same_cell(flat)
        n_draws = int(draw_numbers.max()) + 1
        index = flat * n_draws + draw_numbers
        dims, shape = [*dims, "draw"], [*shape, n_draws]
    return _place_points_on_dataset_grid(
        result, listed, random_settings, dims=dims, shape=shape, index=index
    )


def _count_earlier_points_in_same_cell(cell_of_point: np.ndarray) -> np.ndarray:
    """Count the earlier points of the same cell for each point."""
    order = np.argsort(cell_of_point, kind="stable")
    ordered = cell_of_point[order]
    starts = np.flatnonzero(np.concatenate([[True], ordered[1:] != ordered[:-1]]))
    sizes = np.diff([*starts, len(cell_of_point)])
    repeats = np.empty(len(cell_of_point), dtype=int)
    repeats[order] = np.arange(len(cell_of_point)) - np.repeat(starts, sizes)
    return repeats


def _place_points_on_dataset_grid(
    result: StudyResult,
    swept_settings: list[SweptSetting],
    random_settings: list[RandomSetting],
    *,
    dims: list[str],
    shape: list[int],
    index: np.ndarray,
) -> xr.Dataset:
    size = int(np.prod(shape, dtype=int))

    def place_on_grid(values: np.ndarray, fill: float) -> np.ndarray:
        whole = np.full((size, *values.shape[1:]), fill, dtype=values.dtype)
        whole[index] = values
        return whole.reshape((*shape, *values.shape[1:]))

    coordinates: dict[str, Any] = {}
    for axis in swept_settings:
        axis_values = axis.labels if axis.numbers is None else axis.numbers
        coordinates[axis.path] = (axis.path, np.array(axis_values), {"units": axis.unit or "1"})
    for setting in random_settings:
        column = [path for path, _ in result.settings[0]].index(setting.path)
        numbers = place_on_grid(
            np.array([row[column] for row in result.numbers], dtype=float), np.nan
        )
        draws = numbers.reshape(-1, shape[-1])
        setting_attributes = {"units": setting.unit or "1", "distribution": setting.distribution}
        if (draws == draws[:1]).all():
            coordinates[setting.path] = ("draw", draws[0], setting_attributes)
        else:
            coordinates[setting.path] = (tuple(dims), numbers, setting_attributes)
    variables: dict[str, Any] = {
        "trials": (dims, place_on_grid(result.trials, 0)),
        "failures": (dims, place_on_grid(result.n_failed_trials_per_point, 0)),
    }
    subjects_by_score = [result.scored_target_names(label) for label in result.estimates]
    names = tuple(
        dict.fromkeys(name for names in subjects_by_score if len(names) > 1 for name in names)
    )
    if names:
        coordinates["target"] = ("target", np.array(names))
    for label, values in result.estimates.items():
        units = {
            "units": SCORE_UNITS.get(
                result.score_by_label(label).unit, result.score_by_label(label).unit
            )
        }
        for column, end in enumerate(VALUE_SUFFIXES):
            variables[label + end] = (dims, place_on_grid(values[:, 0, column], np.nan), units)
            target_names = result.scored_target_names(label)
            if len(target_names) > 1:
                by_target = np.full((result.n_points, len(names)), np.nan)
                by_target[:, [names.index(name) for name in target_names]] = values[:, 1:, column]
                variables[f"{label}_by_target{end}"] = (
                    [*dims, "target"],
                    place_on_grid(by_target, np.nan),
                    units,
                )
    study = result.study
    attributes = {"study": study.name, "seed": study.seed, "confidence": study.confidence}
    return xr.Dataset(variables, coordinates, attributes)
