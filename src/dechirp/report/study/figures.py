"""Figures of the scores of a study."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np
import xarray as xr
from markupsafe import Markup

from dechirp.core.values import frozen_dataclass
from dechirp.evaluation.score.roc import Roc
from dechirp.experiments.study.plan import Plan
from dechirp.experiments.study.results import VALUE_SUFFIXES, StudyResult
from dechirp.experiments.study.study import RandomSetting, SweptSetting
from dechirp.experiments.study.trial_context import build_trial_context
from dechirp.report.figures import study as figures
from dechirp.report.figures.heatmap import draw_heatmap
from dechirp.report.figures.roc import RocCurve, draw_roc
from dechirp.report.figures.study import AxisLabel, ScoreLine
from dechirp.report.figures.style import FigureWithCaption, render_svg
from dechirp.report.labels import (
    DisplayScale,
    axis_label,
    choose_display_scale,
    score_label,
    setting_label,
    value_label,
)

DETECTIONS, ALARMS = "detection_probability", "false_alarm_probability"
_FALSE_ALARM = "chain.cfar.false_alarm_probability"
_MAX_FIGURES = 6
_MIN_CELLS = 3


@frozen_dataclass
class ScoreFigures:
    """Figures of one score."""

    label: str
    """Label of the score."""
    figures: tuple[FigureWithCaption, ...]
    n_more: int
    """Number of omitted figures for further values of the remaining settings."""


def draw_score_figures(result: StudyResult) -> list[ScoreFigures]:
    """Draw the scores of a study over its settings.

    Over numeric values: lines with interval bands and theory, one for each value of the next
    setting or for each target, and a heatmap over two such settings. Over categorical values:
    bars. Over random settings: marks. Further settings give one figure for each of their values,
    up to a limit.
    """
    figures_by_score = []
    for label in result.estimates:
        data = _ScoreData(result, label)
        wanted = [*data.plan_figures_over_settings(), *_plan_roc_figures(data)]
        drawn_figures = tuple(wanted[:_MAX_FIGURES])
        if drawn_figures:
            figures_by_score.append(
                ScoreFigures(
                    label=score_label(label),
                    figures=tuple(planned.draw() for planned in drawn_figures),
                    n_more=len(wanted) - len(drawn_figures),
                )
            )
    return figures_by_score


class _ScoreData:
    """Data of one score of a study, prepared for figures."""

    def __init__(self, result: StudyResult, label: str) -> None:
        self.result, self.label = result, label
        self._theory_curves: dict[int, np.ndarray] = {}
        unit = result.score_by_label(label).unit
        self.is_ratio = unit is None
        self.scale: DisplayScale = choose_display_scale(unit, result.estimates[label][..., (0, 3)])
        self.axis = AxisLabel(text=axis_label(score_label(label), self.scale.unit))
        names = result.scored_target_names(label)
        self.subjects: tuple[str, ...] = names if len(names) > 1 else ()
        varied = result.study.vary
        self.swept_settings = [
            setting
            for setting in varied
            if isinstance(setting, SweptSetting) and len(setting.texts) > 1
        ]
        paths = [path for path, _ in result.settings[0]] if result.settings else []
        self.random_settings = [
            setting
            for setting in varied
            if isinstance(setting, RandomSetting) and setting.path in paths
        ]

    def plan_figures_over_settings(self) -> Iterator["_PlannedFigure"]:
        if self.random_settings:
            yield from (_ScatterFigure(self, axis) for axis in self.random_settings)
            return
        if not self.swept_settings:
            return
        numeric = sorted(
            (setting for setting in self.swept_settings if setting.numbers is not None),
            key=lambda setting: -len(setting.texts),
        )
        worded = [setting for setting in self.swept_settings if setting.numbers is None]
        first, *others = [*numeric, *worded]
        line_setting, remaining = self.choose_line_setting(others)
        owners: Sequence[str | None] = (
            self.subjects if line_setting is not None and self.subjects else [None]
        )
        for fixed in self.combinations_of_fixed_values(remaining):
            for target in owners:
                yield _LineFigure(self, first, line_setting, target, fixed)
        x, y = (*numeric, None, None)[:2]
        if x is not None and y is not None and len(y.texts) >= _MIN_CELLS:
            for fixed in self.combinations_of_fixed_values(
                [setting for setting in self.swept_settings if setting not in (x, y)]
            ):
                for target in self.subjects or [None]:
                    yield _HeatmapFigure(self, x, y, target, fixed)

    def theoretical_roc_curves(self, roc: Roc, point: int) -> np.ndarray:
        """Return the theoretical curves of a point, (n_targets, n_thresholds), from a cache."""
        if point not in self._theory_curves:
            case = build_trial_context(Plan.from_study(self.result.study).scenario_of_point(point))
            self._theory_curves[point] = roc.theoretical_roc_probabilities(case)
        return self._theory_curves[point]

    def choose_line_setting(
        self, remaining: Sequence[SweptSetting]
    ) -> tuple[SweptSetting | None, list[SweptSetting]]:
        """Return the setting with one line per value, and the remaining ones.

        A few categorical values are preferred to many numbers.
        """
        ordered = sorted(
            remaining,
            key=lambda setting: (
                len(setting.texts) > figures.MAX_LINES,
                setting.numbers is not None,
            ),
        )
        return (ordered[0] if ordered else None), ordered[1:]

    def combinations_of_fixed_values(
        self, remaining: Sequence[SweptSetting]
    ) -> Iterator[dict[SweptSetting, int]]:
        """Iterate over all combinations of values of the settings without an axis."""
        for indices in product(*(range(len(setting.texts)) for setting in remaining)):
            yield dict(zip(remaining, indices, strict=True))

    def value_interval_and_theory(
        self, target: str | None, fixed: dict[SweptSetting, int]
    ) -> list[xr.DataArray]:
        """Return value, low, high and theory in display units, over the remaining settings."""
        middle = "" if target is None else "_by_target"
        single = [
            setting for setting in self.result.study.vary if isinstance(setting, SweptSetting)
        ]
        selection = {setting.path: 0 for setting in single if len(setting.texts) == 1}
        selection |= {setting.path: index for setting, index in fixed.items()}
        arrays = [self.result.dataset[f"{self.label}{middle}{end}"] for end in VALUE_SUFFIXES]
        selected_arrays = [
            setting if target is None else setting.sel(target=target) for setting in arrays
        ]
        return [setting.isel(selection) * self.scale.factor for setting in selected_arrays]

    def required_limits(self, target: str | None) -> list[float]:
        """Return the required limits of the score in display units."""
        limit_pairs = [
            (setting.at_least, setting.at_most)
            for setting in self.result.study.require
            if setting.score == self.label and (setting.target == target or not self.subjects)
        ]
        both = {limit for pair in limit_pairs for limit in pair if limit is not None}
        return [limit * self.scale.factor for limit in sorted(both)]


class _PlannedFigure(ABC):
    """Figure that can be drawn."""

    @abstractmethod
    def draw(self) -> FigureWithCaption:
        """Draw the figure, and return it with its caption."""


class _LineFigure(_PlannedFigure):
    """Score over one setting, a line for each value of another one or for each target."""

    def __init__(
        self,
        data: _ScoreData,
        x_setting: SweptSetting,
        line_setting: SweptSetting | None,
        target: str | None,
        fixed: dict[SweptSetting, int],
    ) -> None:
        self.data, self.x_setting, self.line_setting, self.target, self.fixed = (
            data,
            x_setting,
            line_setting,
            target,
            fixed,
        )

    def draw(self) -> FigureWithCaption:
        data, x_setting, line_setting = self.data, self.x_setting, self.line_setting
        lines = list(self._score_lines())
        x = _setting_axis_label_and_scale(x_setting)
        legend = "" if line_setting is None else _setting_axis_label_text(line_setting)
        if x_setting.numbers is None:
            figure = render_svg(
                lambda figure: figures.draw_score_bars(
                    figure.subplots(),
                    lines,
                    [value_label(label) for label in x_setting.labels],
                    x=x,
                    y=data.axis,
                    is_ratio=data.is_ratio,
                    legend=legend,
                )
            )
        else:
            figure = render_svg(
                lambda figure: figures.draw_score_lines(
                    figure.subplots(),
                    lines,
                    x=x,
                    y=data.axis,
                    is_ratio=data.is_ratio,
                    legend=legend,
                    limits=data.required_limits(self.target),
                )
            )
        subtitle = [f"over {setting_label(x_setting.path)}"]
        if line_setting is not None:
            left_out = len(line_setting.texts) - len(lines)
            value_note = (
                f", {len(lines)} of {len(line_setting.texts)} values" if left_out > 0 else ""
            )
            subtitle.append(f"by {setting_label(line_setting.path)}{value_note}")
        elif data.subjects:
            subtitle.append("of each target")
        has_theory = any(np.isfinite(line.theory).any() for line in lines)
        reading_hint = (
            "Measured values should lie on the theory, within their intervals."
            if has_theory
            else "Values whose intervals lie apart differ."
        )
        return _add_title_and_caption(
            data, self.target, self.fixed, ", ".join(subtitle), figure, reading_hint=reading_hint
        )

    def _score_lines(self) -> Iterator[ScoreLine]:
        data, x_setting, line_setting = self.data, self.x_setting, self.line_setting
        if line_setting is None:
            for name in data.subjects[: figures.MAX_LINES] or (None,):
                yield _score_line(
                    data.value_interval_and_theory(name, self.fixed), x_setting, name or ""
                )
            return
        for selection in _evenly_spaced_value_indices(line_setting):
            parts = data.value_interval_and_theory(
                self.target, {**self.fixed, line_setting: selection}
            )
            yield _score_line(parts, x_setting, value_label(line_setting.labels[selection]))


class _HeatmapFigure(_PlannedFigure):
    """Score over two numeric settings."""

    def __init__(
        self,
        data: _ScoreData,
        x: SweptSetting,
        y: SweptSetting,
        target: str | None,
        fixed: dict[SweptSetting, int],
    ) -> None:
        self.data, self.x, self.y, self.target, self.fixed = data, x, y, target, fixed

    def draw(self) -> FigureWithCaption:
        data = self.data
        measured = data.value_interval_and_theory(self.target, self.fixed)[0].transpose(
            self.y.path, self.x.path
        )
        ordered = measured.sortby([self.y.path, self.x.path])
        figure = render_svg(
            lambda figure: draw_heatmap(
                figure.subplots(),
                ordered[self.x.path].values,
                ordered[self.y.path].values,
                ordered.values,
                axis_labels=(
                    _setting_axis_label_and_scale(self.x),
                    _setting_axis_label_and_scale(self.y),
                ),
                label=data.axis.text,
                is_ratio=data.is_ratio,
            )
        )
        subtitle = f"over {setting_label(self.x.path)} and {setting_label(self.y.path)}"
        reading_hint = "Along one colour a change of one setting makes up for that of the other."
        return _add_title_and_caption(
            data, self.target, self.fixed, subtitle, figure, reading_hint=reading_hint
        )


class _ScatterFigure(_PlannedFigure):
    """Score over a random setting, for all points."""

    def __init__(self, data: _ScoreData, x_setting: RandomSetting) -> None:
        self.data, self.x_setting = data, x_setting

    def draw(self) -> FigureWithCaption:
        data = self.data
        names = data.subjects[: figures.MAX_LINES] or (None,)
        lines = [self._score_line_of_target(name) for name in names]
        subtitle = axis_label(setting_label(self.x_setting.path), self.x_setting.unit)
        figure = render_svg(
            lambda figure: figures.draw_score_scatter(
                figure.subplots(),
                lines,
                x=AxisLabel(text=subtitle),
                y=data.axis,
                is_ratio=data.is_ratio,
            )
        )
        subtitle = f"over {setting_label(self.x_setting.path)}, which was drawn"
        reading_hint = "A slope shows that the setting matters, a level cloud that it does not."
        return _add_title_and_caption(data, None, {}, subtitle, figure, reading_hint=reading_hint)

    def _score_line_of_target(self, target: str | None) -> ScoreLine:
        parts = self.data.value_interval_and_theory(target, {})
        x, *_ = xr.broadcast(self.data.result.dataset[self.x_setting.path], parts[0])
        arrays = [part.transpose(*x.dims).values.ravel() for part in parts]
        measured, low, high, theory = arrays
        return ScoreLine(
            name=target or "", x=x.values.ravel(), value=measured, low=low, high=high, theory=theory
        )


def _plan_roc_figures(data: _ScoreData) -> Iterator["_PlannedFigure"]:
    """Plan receiver operating characteristics, from curves or a swept false-alarm probability."""
    if data.random_settings:
        return
    if data.label in data.result.curves:
        line_setting, remaining = data.choose_line_setting(data.swept_settings)
        for fixed in data.combinations_of_fixed_values(remaining):
            for target in data.subjects or [None]:
                yield _RocFigure(data, line_setting, target, fixed)
        return
    x_setting = next(
        (setting for setting in data.swept_settings if setting.path == _FALSE_ALARM), None
    )
    if x_setting is None or x_setting.numbers is None or data.label != DETECTIONS:
        return
    if ALARMS in data.result.estimates:
        line_setting, remaining = data.choose_line_setting(
            [setting for setting in data.swept_settings if setting is not x_setting]
        )
        for fixed in data.combinations_of_fixed_values(remaining):
            for target in data.subjects or [None]:
                yield _RocFigure(data, line_setting, target, fixed, x_setting=x_setting)


class _RocFigure(_PlannedFigure):
    """Detection over false-alarm probability, a curve for each value of a setting."""

    def __init__(
        self,
        data: _ScoreData,
        line_setting: SweptSetting | None,
        target: str | None,
        fixed: dict[SweptSetting, int],
        x_setting: SweptSetting | None = None,
    ) -> None:
        self.data, self.line_setting, self.target, self.fixed = data, line_setting, target, fixed
        self.x_setting = x_setting

    def draw(self) -> FigureWithCaption:
        line_setting = self.line_setting
        selections = (
            [self.fixed]
            if line_setting is None
            else [
                {**self.fixed, line_setting: selection}
                for selection in _evenly_spaced_value_indices(line_setting)
            ]
        )
        names = [
            ""
            if line_setting is None
            else value_label(line_setting.labels[selection[line_setting]])
            for selection in selections
        ]
        curve = (
            self._roc_curve_over_points
            if self.x_setting is not None
            else self._roc_curve_over_thresholds
        )
        figure = render_svg(
            lambda figure: draw_roc(
                figure.subplots(),
                [curve(name, selection) for name, selection in zip(names, selections, strict=True)],
                x=axis_label(score_label(ALARMS), ""),
                y=axis_label(score_label(DETECTIONS), ""),
                legend="" if line_setting is None else _setting_axis_label_text(line_setting),
            )
        )
        subtitle = "detections over false alarms as the threshold moves, both measured"
        subtitle += "" if line_setting is None else f", by {setting_label(line_setting.path)}"
        heading = "receiver operating characteristic"
        reading_hint = "The nearer to the upper left corner, the better the detector."
        return _add_title_and_caption(
            self.data,
            self.target,
            self.fixed,
            subtitle,
            figure,
            reading_hint=reading_hint,
            heading=heading,
        )

    def _roc_curve_over_points(self, name: str, selection: dict[SweptSetting, int]) -> RocCurve:
        """Return the curve of points with different designed false-alarm probabilities."""
        assert self.x_setting is not None
        assert self.x_setting.numbers is not None
        alarms = _ScoreData(self.data.result, ALARMS).value_interval_and_theory(None, selection)
        measured, low, high, theory = (
            part.values for part in self.data.value_interval_and_theory(self.target, selection)
        )
        order = np.argsort(self.x_setting.numbers)
        return RocCurve(
            name=name,
            false_alarm=alarms[0].values[order],
            detection=measured[order],
            low=low[order],
            high=high[order],
            theory_false_alarm=alarms[3].values[order],
            theory=theory[order],
        )

    def _roc_curve_over_thresholds(self, name: str, selection: dict[SweptSetting, int]) -> RocCurve:
        """Return the curve of the maps of one point at several thresholds."""
        result, label = self.data.result, self.data.label
        wanted = {(setting.path, setting.texts[index]) for setting, index in selection.items()}
        point = next(p for p, settings in enumerate(result.settings) if wanted.issubset(settings))
        names = result.scored_target_names(label)
        fixed = names.index(self.target) if self.target else 0
        curve = result.curves[label][point][1 + fixed if self.target else 0]
        roc = result.score_by_label(label)
        assert isinstance(roc, Roc)
        laws = self.data.theoretical_roc_curves(roc, point)
        return RocCurve(
            name=name,
            false_alarm=curve.false_alarm_probability,
            detection=curve.detection_probability,
            low=curve.detection_low,
            high=curve.detection_high,
            theory_false_alarm=curve.designed,
            theory=laws[fixed] if self.target else laws.mean(axis=0),
        )


def _evenly_spaced_value_indices(setting: SweptSetting) -> list[int]:
    """Return the indices of as many values of a setting as a figure has lines."""
    n = min(len(setting.texts), figures.MAX_LINES)
    return [int(position) for position in np.linspace(0, len(setting.texts) - 1, n)]


def _score_line(
    value_interval_and_theory: Sequence[xr.DataArray], x_setting: SweptSetting, name: str
) -> ScoreLine:
    measured, low, high, theory = (part.values for part in value_interval_and_theory)
    x = np.arange(len(x_setting.texts)) if x_setting.numbers is None else x_setting.numbers
    return ScoreLine(
        name=name,
        x=np.asarray(x, dtype=float),
        value=measured,
        low=low,
        high=high,
        theory=theory,
    )


def _setting_axis_label_and_scale(setting: SweptSetting) -> AxisLabel:
    in_db = setting.unit.startswith("dB")
    return AxisLabel(
        text=_setting_axis_label_text(setting),
        logarithmic=not in_db and figures.is_suited_to_log_axis(setting.numbers or ()),
    )


def _setting_axis_label_text(setting: SweptSetting) -> str:
    # Categorical values contain their units.
    return axis_label(
        setting_label(setting.path), setting.unit if setting.numbers is not None else ""
    )


def _add_title_and_caption(
    data: _ScoreData,
    target: str | None,
    fixed: dict[SweptSetting, int],
    subtitle: str,
    figure: Markup,
    *,
    reading_hint: str,
    heading: str = "",
) -> FigureWithCaption:
    heading = heading or score_label(data.label)
    title = heading[:1].upper() + heading[1:] + (f" of {target}" if target else "")
    fixed_text = [
        f"{setting_label(setting.path)} {value_label(setting.labels[i])}"
        for setting, i in fixed.items()
    ]
    where = f", where {' and '.join(fixed_text)}" if fixed_text else ""
    return FigureWithCaption(
        title=title, caption=f"{subtitle}{where}. {reading_hint}", figure=figure
    )
