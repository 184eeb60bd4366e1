"""What a study has found: of each point its scores with intervals, as dataset, rows and tables."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np
import xarray as xr

from dechirp.core.displayed import Displayed, Table, cut, several
from dechirp.core.findings import Finding, findings
from dechirp.core.words import NONE, in_unit
from dechirp.evaluate.score.base import NOTHING, Estimate, Score
from dechirp.evaluate.score.roc import Curve, Roc
from dechirp.experiment.study.block import Failure
from dechirp.experiment.study.layout import Layout
from dechirp.experiment.study.study import Drawn, Listed, Study
from dechirp.store.parquet import Type, write_parquet

if TYPE_CHECKING:
    from dechirp.experiment.study.plan import Plan
    from dechirp.experiment.study.record import Record

ENDS = ("", "_low", "_high", "_theory")
"""What follows the label of a score in the dataset, in the order of `StudyResult.estimates`."""
_PARTS = ("value", "low", "high", "theory")
UNITS: Mapping[str | None, str] = MappingProxyType(
    {None: "1", "m": "m", "m_per_s": "m/s", "rad": "rad", "s": "s"}
)
"""Units attribute of a score's values by `Score.unit`."""

_EMPTY = np.empty((0, 0))
T = TypeVar("T")
# Numbers that the writer of a table is given at once: 8 MB.
_PIECE = 1_000_000


class Measured(NamedTuple):
    """All that was kept of one point."""

    settings: tuple[tuple[str, str], ...]
    """Path and text of each, as `--set` takes them."""
    numbers: tuple[float | None, ...]
    """Of the same settings, in the written unit; None for words."""
    sums: np.ndarray
    """(n_trials, n_columns), see `Layout`, trial by trial from 0; NaN in those that failed."""
    theory: np.ndarray
    """See `Layout.theory_of`."""
    failures: tuple[Failure, ...] = ()
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True, eq=False, repr=False)
class StudyResult(Displayed):
    """Estimates of all points, in the order of their numbers."""

    study: Study
    layout: Layout
    settings: tuple[tuple[tuple[str, str], ...], ...]
    """Of each point, path and text."""
    numbers: tuple[tuple[float | None, ...], ...]
    """The same as numbers in the written unit."""
    trials: np.ndarray
    """That were made of each point, those that failed among them, (n_points,)."""
    estimates: Mapping[str, np.ndarray]
    """Of each score by its label, (n_points, 1 + n_subjects, 4): value, low, high and theory,
    of all subjects together and then of each. NaN where there is nothing to tell."""
    curves: Mapping[str, tuple[tuple[Curve, ...], ...]] = field(default_factory=dict)
    """Of the score `roc`, by its label: of each point, of all subjects together and of each."""
    failures: tuple[tuple[int, Failure], ...] = ()
    """Number of the point, and what happened."""
    findings: tuple[tuple[int, Finding], ...] = ()

    @property
    def n_points(self) -> int:
        """Points, tried or not."""
        return len(self.settings)

    @property
    def n_failures(self) -> np.ndarray:
        """Trials of each point that raised, (n_points,)."""
        points = [point for point, _ in self.failures]
        return np.bincount(np.array(points, dtype=int), minlength=self.n_points)

    def subjects(self, label: str) -> tuple[str, ...]:
        """What a score has values of beside the whole; empty for the whole alone."""
        return self.layout.subjects[self.layout.index(label)]

    def score(self, label: str) -> Score:
        """The score of a label."""
        return self.layout.scores[self.layout.index(label)]

    @property
    def rows(self) -> list[dict[str, Any]]:
        """Of each point: settings, `trials`, `failures`, and value, low, high and theory of scores.

        Values are SI; None where there is nothing to tell. All targets together stand at the
        top: their sums added, and the mean of their theories. Where there is more than one,
        `targets` has each.
        """
        numbers = {label: _plain(values) for label, values in self.estimates.items()}
        both = zip(self.settings, self.trials.tolist(), self.n_failures.tolist(), strict=True)
        return [
            {
                **dict(settings),
                "trials": trials,
                "failures": failures,
                **{label: self._told(label, of[point]) for label, of in numbers.items()},
            }
            for point, (settings, trials, failures) in enumerate(both)
        ]

    def _told(self, label: str, numbers: Sequence[Sequence[float | None]]) -> dict[str, Any]:
        whole, *each = (dict(zip(_PARTS, one, strict=True)) for one in numbers)
        names = self.subjects(label)
        return {**whole, "targets": dict(zip(names, each, strict=True))} if each[1:] else whole

    def _line(self) -> str:
        parts = [several(self.n_points, "point"), several(int(self.trials.sum()), "trial")]
        parts += [f"{several(len(self.failures), 'trial')} failed"] if self.failures else []
        return f"{self.study.name}: {', '.join(parts)}"

    def _tables(self) -> Iterable[Table]:
        paths = [path for path, _ in self.settings[0]] if self.settings else []
        rows = (
            [
                *(shown(self.study, path, dict(settings)[path]) for path in paths),
                f"{int(self.trials[point]):,}",
                *(self._estimate(label, point) for label in self.estimates),
            ]
            for point, settings in enumerate(self.settings)
        )
        head = [*paths, "trials", *self.estimates]
        yield cut("Points: value, interval, theory", rows, self.n_points, head)
        yield findings(dict.fromkeys(finding for _, finding in self.findings))

    def _estimate(self, label: str, point: int) -> str:
        """Value of all targets together, its interval, and theory where there is a law."""
        unit = self.score(label).unit or "probability"
        value, low, high, theory = self.estimates[label][point, 0].tolist()
        if np.isnan(value):
            return NONE
        text = f"{in_unit(value, unit, 3)} ({in_unit(low, unit, 3)} to {in_unit(high, unit, 3)})"
        return text if np.isnan(theory) else f"{text}, {in_unit(theory, unit, 3)}"

    @cached_property
    def dataset(self) -> xr.Dataset:
        """All points as one labelled dataset.

        A dimension for each listed setting, called by its path, in the order of the study;
        `draw` where settings are drawn, with those as coordinates along it (along the lists
        too, where each point of them has draws of its own). Coordinates are numbers in the
        written unit, which their attribute `units` says, or labels.

        `<label>`, `<label>_low`, `<label>_high` and `<label>_theory` are of all targets
        together; `<label>_by_target` and so on of each, with `target` as last dimension, where
        there is more than one. `trials` and `failures` count. Values are SI.
        """
        return _labelled(self)


def collect(
    study: Study,
    layout: Layout,
    points: Iterable[Measured],
    *,
    progress: Callable[[int], None] | None = None,
) -> StudyResult:
    """Estimate all scores of all points; sums are held of one point at a time.

    `progress` is told how many points are done.
    """
    settings, numbers, trials = [], [], []
    failures: list[tuple[int, Failure]] = []
    findings: list[tuple[int, Finding]] = []
    estimates: dict[str, list[np.ndarray]] = {score.label(): [] for score in layout.scores}
    rocs = [score for score in layout.scores if isinstance(score, Roc)]
    curves: dict[str, list[tuple[Curve, ...]]] = {score.label(): [] for score in rocs}
    for point, of in enumerate(points):
        settings.append(of.settings)
        numbers.append(of.numbers)
        trials.append(len(of.sums))
        failures += [(point, failure) for failure in of.failures]
        findings += [(point, finding) for finding in of.findings]
        for label, values in estimates.items():
            values.append(estimated(layout, label, of.sums, of.theory, study.confidence))
        for roc in rocs:
            curves[roc.label()].append(_curves(layout, roc, of.sums, study.confidence))
        if progress is not None:
            progress(point + 1)
    return StudyResult(
        study=study,
        layout=layout,
        settings=tuple(settings),
        numbers=tuple(numbers),
        trials=np.array(trials, dtype=int),
        estimates={
            label: np.array(values).reshape(len(settings), -1, len(_PARTS))
            for label, values in estimates.items()
        },
        curves={label: tuple(of) for label, of in curves.items()},
        failures=tuple(failures),
        findings=tuple(findings),
    )


def _curves(layout: Layout, roc: Roc, sums: np.ndarray, confidence: float) -> tuple[Curve, ...]:
    label = roc.label()
    names = layout.subjects[layout.index(label)]
    if not worked(sums):
        unknown = np.full(len(roc.false_alarm_probabilities), np.nan)
        return (Curve(*[unknown] * len(Curve._fields)),) * (1 + len(names))
    chosen = [layout.sums_of(sums, label, name) for name in (None, *names)]
    return tuple(roc.curve(of, confidence=confidence) for of in chosen)


def measured(plan: "Plan", layout: Layout, record: "Record") -> Iterator[Measured]:
    """All that a record keeps, point by point; of points not tried yet, no trials."""
    failures, findings = _by_point(record.failures()), _by_point(record.findings())
    kept = record.all_sums()
    at, sums = next(kept, (plan.n_points, _EMPTY))
    untold = np.full(layout.n_laws, np.nan)
    for point in range(plan.n_points):
        theory = record.theory(point)
        yield Measured(
            settings=plan.settings(point),
            numbers=plan.numbers(point),
            sums=sums if at == point else np.empty((0, layout.n_columns)),
            theory=untold if theory is None else theory,
            failures=failures.get(point, ()),
            findings=findings.get(point, ()),
        )
        if at == point:
            at, sums = next(kept, (plan.n_points, _EMPTY))


def numbered(record: "Record") -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Of each point that was tried: its number, those of its trials, and their sums."""
    done = record.done()
    _, firsts = np.unique(done[:, 0], return_index=True)
    turns = np.arange(len(done)) - np.repeat(firsts, np.diff([*firsts, len(done)]))
    gaps = set(done[done[:, 1] != turns, 0].tolist())  # left by a study that was interrupted
    for point, sums in record.all_sums():
        yield point, record.trials(point) if point in gaps else np.arange(len(sums)), sums


def _by_point(told: Iterable[tuple[int, T]]) -> dict[int, tuple[T, ...]]:
    made: dict[int, list[T]] = {}
    for point, one in told:
        made.setdefault(point, []).append(one)
    return {point: tuple(of) for point, of in made.items()}


def estimated(
    layout: Layout, label: str, sums: np.ndarray, theory: np.ndarray, confidence: float
) -> np.ndarray:
    """Value, low, high and theory of a score, (1 + n_subjects, 4): together, and of each.

    `sums` (n_trials, n_columns) and `theory` are those of all scores, see `Layout`.
    """
    names = layout.subjects[layout.index(label)]
    # One subject is the whole.
    chosen = [None, *names] if len(names) > 1 else [None]
    told = [
        (*estimate(layout, label, subject, sums, confidence=confidence), law)
        for subject in chosen
        for law in [layout.theory_of(theory, label, subject)]
    ]
    return np.array(told if len(names) != 1 else told * 2, dtype=float)


def estimate(
    layout: Layout, label: str, subject: str | None, sums: np.ndarray, *, confidence: float
) -> Estimate:
    """Value of a score, with its interval, from the sums of all scores (n_trials, n_columns)."""
    if not worked(sums):
        return NOTHING
    chosen = layout.sums_of(sums, label, subject)
    return layout.scores[layout.index(label)].estimate(chosen, confidence=confidence)


def worked(sums: np.ndarray) -> bool:
    """Whether there is a trial that did not fail among sums (n_trials, n_columns)."""
    return bool(len(sums)) and not bool(np.isnan(sums).all())


def write_points(result: StudyResult, path: Path, *, about: Mapping[str, str]) -> None:
    """Write `points.parquet`, a row a point.

    Columns: `point`; settings, called by path and unit (`scene.targets.car.rcs_dBsm`, numbers;
    `chain.range_window`, labels); `trials`, `failures`; and the keys of `StudyResult.rows`
    joined by dots, as `range_rmse.high` and `range_rmse.targets.car.high`. SI; NaN where there
    is nothing to tell.

    Raises `DechirpError` if it cannot be written; what was there then stays.
    """
    table: dict[str, tuple[Type, np.ndarray]] = {"point": ("BIGINT", np.arange(result.n_points))}
    paths = [path for path, _ in result.settings[0]] if result.settings else []
    for at, setting in enumerate(paths):
        numbers = [of[at] for of in result.numbers]
        if None in numbers:
            words = np.array([shown(result.study, *of[at]) for of in result.settings], object)
            table[setting] = ("VARCHAR", words)
        else:
            name = _with_unit(setting, unit_of(result.study, setting))
            table[name] = ("DOUBLE", np.array(numbers, dtype=float))
    table["trials"] = ("BIGINT", result.trials)
    table["failures"] = ("BIGINT", result.n_failures)
    for label, values in result.estimates.items():
        names = result.subjects(label)
        owners = ["", *(f"targets.{name}." for name in names if len(names) > 1)]
        for place, owner in enumerate(owners):
            for at, part in enumerate(_PARTS):
                table[f"{label}.{owner}{part}"] = ("DOUBLE", values[:, place, at])
    columns = {name: kind for name, (kind, _) in table.items()}
    piece = {name: values for name, (_, values) in table.items()}
    write_parquet(path, columns, [piece] if result.n_points else [], about=about)


def write_trials(
    layout: Layout,
    points: Iterable[tuple[int, np.ndarray, np.ndarray]],
    path: Path,
    *,
    about: Mapping[str, str],
) -> None:
    """Write `trials.parquet`, a row a trial: what all estimates are made of.

    Columns: `point`, `trial`, `failed`, and the sums of each score and subject in the order of
    its formula, as `detection_probability.car.0`; NaN where the trial failed. The same numbers
    added over trials, and over targets, give the estimates.

    Parameters
    ----------
    layout : Layout
        What the columns are.
    points : iterable
        Number of a point, those of its trials (n_trials,) and their sums (n_trials, n_columns);
        some are held at a time. See `numbered`.
    path : Path
        The file.
    about : mapping
        Words that are kept beside the table.

    Raises
    ------
    DechirpError
        If it cannot be written; what was there then stays.
    """
    names = list(_sum_names(layout))
    kinds: dict[str, Type] = {"point": "BIGINT", "trial": "BIGINT", "failed": "BOOLEAN"}
    columns: dict[str, Type] = {**kinds, **dict.fromkeys(names, "DOUBLE")}
    write_parquet(path, columns, _pieces(points, names), about=about)


def shown(study: Study, path: str, text: str) -> str:
    """What tables and legends call the value of a setting: its label, or the text itself."""
    axis = next((one for one in study.vary if one.path == path), None)
    if isinstance(axis, Listed) and text in axis.texts:
        return axis.labels[axis.texts.index(text)]
    return text


def unit_of(study: Study, path: str) -> str:
    """Unit in which a study writes a setting; empty without one."""
    return next((axis.unit for axis in study.vary if axis.path == path), "")


def _pieces(
    points: Iterable[tuple[int, np.ndarray, np.ndarray]], names: list[str]
) -> Iterator[dict[str, np.ndarray]]:
    waiting: list[tuple[int, np.ndarray, np.ndarray]] = []
    n_numbers = 0
    for of_point in points:
        waiting.append(of_point)
        n_numbers += of_point[2].size
        if n_numbers >= _PIECE:
            yield _piece(waiting, names)
            waiting, n_numbers = [], 0
    if n_numbers:
        yield _piece(waiting, names)


def _piece(
    points: list[tuple[int, np.ndarray, np.ndarray]], names: list[str]
) -> dict[str, np.ndarray]:
    sums = np.concatenate([of for _, _, of in points])
    return {
        "point": np.repeat([point for point, _, _ in points], [len(of) for _, _, of in points]),
        "trial": np.concatenate([trials for _, trials, _ in points]),
        "failed": np.isnan(sums).all(axis=1),
        **{name: np.ascontiguousarray(sums[:, at]) for at, name in enumerate(names)},
    }


def _sum_names(layout: Layout) -> Iterator[str]:
    for score, names in zip(layout.scores, layout.subjects, strict=True):
        for owner in [f"{name}." for name in names] or [""]:
            yield from (f"{score.label()}.{owner}{at}" for at in range(score.n_sums))


def _with_unit(path: str, unit: str) -> str:
    """Path with its unit as fields have it: `ego.velocity_m_per_s`, `rcs_dBsm`."""
    return f"{path}_{unit.replace('/', '_per_').replace('^', '')}" if unit else path


def _plain(values: np.ndarray) -> Any:
    plain = values.astype(object)
    plain[~np.isfinite(values)] = None
    return plain.tolist()


def _labelled(result: StudyResult) -> xr.Dataset:
    listed = [axis for axis in result.study.vary if isinstance(axis, Listed)]
    drawn = [axis for axis in result.study.vary if isinstance(axis, Drawn)]
    paths = [path for path, _ in result.settings[0]] if result.settings else []
    drawn = [axis for axis in drawn if axis.path in paths]  # others are drawn in each trial
    cells = np.zeros((result.n_points, len(listed)), dtype=int)
    for column, axis in enumerate(listed):
        places = {text: place for place, text in enumerate(axis.texts)}
        at = paths.index(axis.path) if paths else 0
        cells[:, column] = [places[of[at][1]] for of in result.settings]
    shape = [len(axis.texts) for axis in listed]
    strides = np.cumprod([1, *shape[:0:-1]], dtype=int)[::-1][: len(shape)]
    flat = cells @ strides
    dims = [axis.path for axis in listed]
    index = flat
    if drawn:
        turns = _turns(flat)
        n_draws = int(turns.max()) + 1
        index = flat * n_draws + turns
        dims, shape = [*dims, "draw"], [*shape, n_draws]
    return _filled(result, listed, drawn, dims=dims, shape=shape, index=index)


def _turns(cells: np.ndarray) -> np.ndarray:
    """How many points of the same cell stand before each."""
    order = np.argsort(cells, kind="stable")
    ordered = cells[order]
    starts = np.flatnonzero(np.concatenate([[True], ordered[1:] != ordered[:-1]]))
    sizes = np.diff([*starts, len(cells)])
    turns = np.empty(len(cells), dtype=int)
    turns[order] = np.arange(len(cells)) - np.repeat(starts, sizes)
    return turns


def _filled(
    result: StudyResult,
    listed: list[Listed],
    drawn: list[Drawn],
    *,
    dims: list[str],
    shape: list[int],
    index: np.ndarray,
) -> xr.Dataset:
    size = int(np.prod(shape, dtype=int))

    def placed(values: np.ndarray, fill: float) -> np.ndarray:
        whole = np.full((size, *values.shape[1:]), fill, dtype=values.dtype)
        whole[index] = values
        return whole.reshape((*shape, *values.shape[1:]))

    coordinates: dict[str, Any] = {}
    for axis in listed:
        along = axis.labels if axis.numbers is None else axis.numbers
        coordinates[axis.path] = (axis.path, np.array(along), {"units": axis.unit or "1"})
    for one in drawn:
        at = [path for path, _ in result.settings[0]].index(one.path)
        numbers = placed(np.array([of[at] for of in result.numbers], dtype=float), np.nan)
        each = numbers.reshape(-1, shape[-1])
        about = {"units": one.unit or "1", "distribution": one.distribution}
        if (each == each[:1]).all():
            coordinates[one.path] = ("draw", each[0], about)
        else:
            coordinates[one.path] = (tuple(dims), numbers, about)
    variables: dict[str, Any] = {
        "trials": (dims, placed(result.trials, 0)),
        "failures": (dims, placed(result.n_failures, 0)),
    }
    several = [result.subjects(label) for label in result.estimates]
    names = tuple(dict.fromkeys(name for of in several if len(of) > 1 for name in of))
    if names:
        coordinates["target"] = ("target", np.array(names))
    for label, values in result.estimates.items():
        units = {"units": UNITS.get(result.score(label).unit, result.score(label).unit)}
        for at, end in enumerate(ENDS):
            variables[label + end] = (dims, placed(values[:, 0, at], np.nan), units)
            own = result.subjects(label)
            if len(own) > 1:
                each = np.full((result.n_points, len(names)), np.nan)
                each[:, [names.index(name) for name in own]] = values[:, 1:, at]
                variables[f"{label}_by_target{end}"] = (
                    [*dims, "target"],
                    placed(each, np.nan),
                    units,
                )
    study = result.study
    known = {"study": study.name, "seed": study.seed, "confidence": study.confidence}
    return xr.Dataset(variables, coordinates, known)
