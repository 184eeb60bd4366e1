"""Which figures a study has: for each score those that its settings ask for."""

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np
import xarray as xr
from markupsafe import Markup

from dechirp.core.values import value
from dechirp.evaluate.score.roc import Roc
from dechirp.experiment.study.case import case_of
from dechirp.experiment.study.plan import Plan
from dechirp.experiment.study.results import ENDS, StudyResult
from dechirp.experiment.study.study import Drawn, Listed
from dechirp.report.figures import study as figures
from dechirp.report.figures.heat import heat
from dechirp.report.figures.operating import Operating, operating
from dechirp.report.figures.study import Axis, Line
from dechirp.report.figures.style import svg
from dechirp.report.settings_words import (
    Scale,
    scale_of,
    score_words,
    setting_words,
    value_words,
    with_unit,
)

DETECTIONS, ALARMS = "detection_probability", "false_alarm_probability"
_FALSE_ALARM = "chain.cfar.false_alarm_probability"
_MOST_FIGURES = 6
_LEAST_CELLS = 3


@value
class Plate:
    """A figure with its caption."""

    title: str
    words: str
    figure: Markup


@value
class Plates:
    """All figures of one score."""

    words: str
    """What it is called."""
    figures: tuple[Plate, ...]
    n_more: int
    """That there would be, of other values of the settings that are left."""


def plates(result: StudyResult) -> list[Plates]:
    """Draw the scores of a study over its settings.

    Over a list of numbers: a line with bands, beside theory, for each value of the next setting
    or for each target; over two such lists a map as well; over words bars; over what is drawn
    marks. Where more settings vary, one figure for each of their values, some of them.
    """
    made = []
    for label in result.estimates:
        shown = _Shown(result, label)
        wanted = [*shown.all_figures(), *_operating(shown)]
        kept = tuple(wanted[:_MOST_FIGURES])
        if kept:
            made.append(
                Plates(
                    words=score_words(label),
                    figures=tuple(one.plate() for one in kept),
                    n_more=len(wanted) - len(kept),
                )
            )
    return made


class _Shown:
    """One score of a study, ready to be drawn."""

    def __init__(self, result: StudyResult, label: str) -> None:
        self.result, self.label = result, label
        self._laws: dict[int, np.ndarray] = {}
        unit = result.score(label).unit
        self.is_ratio = unit is None
        self.scale: Scale = scale_of(unit, result.estimates[label][..., (0, 3)])
        self.axis = Axis(words=with_unit(score_words(label), self.scale.unit))
        names = result.subjects(label)
        self.subjects: tuple[str, ...] = names if len(names) > 1 else ()
        varied = result.study.vary
        self.listed = [one for one in varied if isinstance(one, Listed) and len(one.texts) > 1]
        paths = [path for path, _ in result.settings[0]] if result.settings else []
        self.drawn = [one for one in varied if isinstance(one, Drawn) and one.path in paths]

    def all_figures(self) -> Iterator["_Wanted"]:
        if self.drawn:
            yield from (_Scatter(self, axis) for axis in self.drawn)
            return
        if not self.listed:
            return
        numeric = sorted(
            (one for one in self.listed if one.numbers is not None),
            key=lambda one: -len(one.texts),
        )
        worded = [one for one in self.listed if one.numbers is None]
        first, *others = [*numeric, *worded]
        by, left = self.split(others)
        owners: Sequence[str | None] = self.subjects if by is not None and self.subjects else [None]
        for place in self.places(left):
            for owner in owners:
                yield _Over(self, first, by, owner, place)
        x, y = (*numeric, None, None)[:2]
        if x is not None and y is not None and len(y.texts) >= _LEAST_CELLS:
            for place in self.places([one for one in self.listed if one not in (x, y)]):
                for owner in self.subjects or [None]:
                    yield _Heat(self, x, y, owner, place)

    def laws(self, roc: Roc, point: int) -> np.ndarray:
        """Curves of theory at a point, (n_targets, n_thresholds), kept for the next figure."""
        if point not in self._laws:
            case = case_of(Plan.of(self.result.study).scenario(point))
            self._laws[point] = roc.theory_curve(case)
        return self._laws[point]

    def split(self, left: Sequence[Listed]) -> tuple[Listed | None, list[Listed]]:
        """The setting that lines differ in, and those that are left.

        A few words tell lines apart better than many numbers.
        """
        ordered = sorted(
            left, key=lambda one: (len(one.texts) > figures.MOST_LINES, one.numbers is not None)
        )
        return (ordered[0] if ordered else None), ordered[1:]

    def places(self, left: Sequence[Listed]) -> Iterator[dict[Listed, int]]:
        """One value of each setting that the figure has no axis for."""
        for chosen in product(*(range(len(one.texts)) for one in left)):
            yield dict(zip(left, chosen, strict=True))

    def parts(self, owner: str | None, place: dict[Listed, int]) -> list[xr.DataArray]:
        """Value, low, high and theory, in the unit shown, over the settings that are left."""
        middle = "" if owner is None else "_by_target"
        single = [one for one in self.result.study.vary if isinstance(one, Listed)]
        at = {one.path: 0 for one in single if len(one.texts) == 1}
        at |= {one.path: index for one, index in place.items()}
        told = [self.result.dataset[f"{self.label}{middle}{end}"] for end in ENDS]
        chosen = [one if owner is None else one.sel(target=owner) for one in told]
        return [one.isel(at) * self.scale.factor for one in chosen]

    def limits(self, owner: str | None) -> list[float]:
        """What requirements ask of it, in the unit shown."""
        asked = [
            (one.at_least, one.at_most)
            for one in self.result.study.require
            if one.score == self.label and (one.target == owner or not self.subjects)
        ]
        both = {limit for pair in asked for limit in pair if limit is not None}
        return [limit * self.scale.factor for limit in sorted(both)]


class _Wanted:
    """A figure that could be drawn."""

    def plate(self) -> Plate:
        raise NotImplementedError


class _Over(_Wanted):
    """Over one list, a line for each value of another, or for each target."""

    def __init__(
        self,
        shown: _Shown,
        along: Listed,
        by: Listed | None,
        owner: str | None,
        place: dict[Listed, int],
    ) -> None:
        self.shown, self.along, self.by, self.owner, self.place = shown, along, by, owner, place

    def plate(self) -> Plate:
        shown, along, by = self.shown, self.along, self.by
        lines = list(self._lines())
        x = _axis(along)
        legend = "" if by is None else _words(by)
        if along.numbers is None:
            figure = svg(
                lambda figure: figures.columns(
                    figure.subplots(),
                    lines,
                    [value_words(label) for label in along.labels],
                    x=x,
                    y=shown.axis,
                    is_ratio=shown.is_ratio,
                    legend=legend,
                )
            )
        else:
            figure = svg(
                lambda figure: figures.over(
                    figure.subplots(),
                    lines,
                    x=x,
                    y=shown.axis,
                    is_ratio=shown.is_ratio,
                    legend=legend,
                    limits=shown.limits(self.owner),
                )
            )
        words = [f"over {setting_words(along.path)}"]
        if by is not None:
            left_out = len(by.texts) - len(lines)
            some = f", {len(lines)} of {len(by.texts)} values" if left_out > 0 else ""
            words.append(f"by {setting_words(by.path)}{some}")
        elif shown.subjects:
            words.append("of each target")
        has_theory = any(np.isfinite(line.theory).any() for line in lines)
        sees = (
            "Measured values should lie on the theory, within their intervals."
            if has_theory
            else "Values whose intervals lie apart differ."
        )
        return _captioned(shown, self.owner, self.place, ", ".join(words), figure, sees=sees)

    def _lines(self) -> Iterator[Line]:
        shown, along, by = self.shown, self.along, self.by
        if by is None:
            for name in shown.subjects[: figures.MOST_LINES] or (None,):
                yield _line(shown.parts(name, self.place), along, name or "")
            return
        for at in _some(by):
            parts = shown.parts(self.owner, {**self.place, by: at})
            yield _line(parts, along, value_words(by.labels[at]))


class _Heat(_Wanted):
    """Over two lists of numbers."""

    def __init__(
        self, shown: _Shown, x: Listed, y: Listed, owner: str | None, place: dict[Listed, int]
    ) -> None:
        self.shown, self.x, self.y, self.owner, self.place = shown, x, y, owner, place

    def plate(self) -> Plate:
        shown = self.shown
        measured = shown.parts(self.owner, self.place)[0].transpose(self.y.path, self.x.path)
        ordered = measured.sortby([self.y.path, self.x.path])
        figure = svg(
            lambda figure: heat(
                figure.subplots(),
                ordered[self.x.path].values,
                ordered[self.y.path].values,
                ordered.values,
                axes_words=(_axis(self.x), _axis(self.y)),
                words=shown.axis.words,
                is_ratio=shown.is_ratio,
            )
        )
        words = f"over {setting_words(self.x.path)} and {setting_words(self.y.path)}"
        sees = "Along one colour a change of one setting makes up for that of the other."
        return _captioned(shown, self.owner, self.place, words, figure, sees=sees)


class _Scatter(_Wanted):
    """Over a setting that was drawn, of all points."""

    def __init__(self, shown: _Shown, along: Drawn) -> None:
        self.shown, self.along = shown, along

    def plate(self) -> Plate:
        shown = self.shown
        names = shown.subjects[: figures.MOST_LINES] or (None,)
        lines = [self._line(name) for name in names]
        words = with_unit(setting_words(self.along.path), self.along.unit)
        figure = svg(
            lambda figure: figures.scattered(
                figure.subplots(),
                lines,
                x=Axis(words=words),
                y=shown.axis,
                is_ratio=shown.is_ratio,
            )
        )
        over = f"over {setting_words(self.along.path)}, which was drawn"
        sees = "A slope says that the setting matters, a level cloud that it does not."
        return _captioned(shown, None, {}, over, figure, sees=sees)

    def _line(self, name: str | None) -> Line:
        parts = self.shown.parts(name, {})
        x, *_ = xr.broadcast(self.shown.result.dataset[self.along.path], parts[0])
        told = [part.transpose(*x.dims).values.ravel() for part in parts]
        measured, low, high, theory = told
        return Line(
            name=name or "", x=x.values.ravel(), value=measured, low=low, high=high, theory=theory
        )


def _operating(shown: _Shown) -> Iterator["_Wanted"]:
    """Receiver operating characteristics: measured as such, or by a varied false-alarm setting."""
    if shown.drawn:
        return
    if shown.label in shown.result.curves:
        by, left = shown.split(shown.listed)
        for place in shown.places(left):
            for owner in shown.subjects or [None]:
                yield _Roc(shown, by, owner, place)
        return
    along = next((one for one in shown.listed if one.path == _FALSE_ALARM), None)
    if along is None or along.numbers is None or shown.label != DETECTIONS:
        return
    if ALARMS in shown.result.estimates:
        by, left = shown.split([one for one in shown.listed if one is not along])
        for place in shown.places(left):
            for owner in shown.subjects or [None]:
                yield _Roc(shown, by, owner, place, along=along)


class _Roc(_Wanted):
    """Detections over false alarms, a curve for each value of a setting."""

    def __init__(
        self,
        shown: _Shown,
        by: Listed | None,
        owner: str | None,
        place: dict[Listed, int],
        along: Listed | None = None,
    ) -> None:
        self.shown, self.by, self.owner, self.place = shown, by, owner, place
        self.along = along

    def plate(self) -> Plate:
        by = self.by
        chosen = [self.place] if by is None else [{**self.place, by: at} for at in _some(by)]
        names = ["" if by is None else value_words(by.labels[at[by]]) for at in chosen]
        curve = self._varied if self.along is not None else self._measured
        figure = svg(
            lambda figure: operating(
                figure.subplots(),
                [curve(name, at) for name, at in zip(names, chosen, strict=True)],
                x=score_words(ALARMS),
                y=score_words(DETECTIONS),
                legend="" if by is None else _words(by),
            )
        )
        words = "detections over false alarms as the threshold moves, both measured"
        words += "" if by is None else f", by {setting_words(by.path)}"
        heading = "receiver operating characteristic"
        sees = "The nearer to the upper left corner, the better the detector."
        return _captioned(
            self.shown, self.owner, self.place, words, figure, sees=sees, heading=heading
        )

    def _varied(self, name: str, at: dict[Listed, int]) -> Operating:
        """Of points whose detectors are made for several probabilities."""
        assert self.along is not None
        assert self.along.numbers is not None
        alarms = _Shown(self.shown.result, ALARMS).parts(None, at)
        measured, low, high, theory = (part.values for part in self.shown.parts(self.owner, at))
        order = np.argsort(self.along.numbers)
        return Operating(
            name=name,
            false_alarm=alarms[0].values[order],
            detection=measured[order],
            low=low[order],
            high=high[order],
            theory_false_alarm=alarms[3].values[order],
            theory=theory[order],
        )

    def _measured(self, name: str, at: dict[Listed, int]) -> Operating:
        """Of the maps of one point, at several thresholds."""
        result, label = self.shown.result, self.shown.label
        wanted = {(one.path, one.texts[index]) for one, index in at.items()}
        point = next(p for p, of in enumerate(result.settings) if wanted.issubset(of))
        names = result.subjects(label)
        place = names.index(self.owner) if self.owner else 0
        curve = result.curves[label][point][1 + place if self.owner else 0]
        roc = result.score(label)
        assert isinstance(roc, Roc)
        laws = self.shown.laws(roc, point)
        return Operating(
            name=name,
            false_alarm=curve.false_alarm_probability,
            detection=curve.detection_probability,
            low=curve.detection_low,
            high=curve.detection_high,
            theory_false_alarm=curve.designed,
            theory=laws[place] if self.owner else laws.mean(axis=0),
        )


def _some(by: Listed) -> list[int]:
    """Places of as many values, evenly, as a figure tells apart."""
    n = min(len(by.texts), figures.MOST_LINES)
    return [int(at) for at in np.linspace(0, len(by.texts) - 1, n)]


def _line(parts: Sequence[xr.DataArray], along: Listed, name: str) -> Line:
    measured, low, high, theory = (part.values for part in parts)
    x = np.arange(len(along.texts)) if along.numbers is None else along.numbers
    return Line(
        name=name,
        x=np.asarray(x, dtype=float),
        value=measured,
        low=low,
        high=high,
        theory=theory,
    )


def _axis(axis: Listed) -> Axis:
    in_db = axis.unit.startswith("dB")
    return Axis(
        words=_words(axis),
        logarithmic=not in_db and figures.evenly_in_ratio(axis.numbers or ()),
    )


def _words(axis: Listed) -> str:
    # Words carry their units themselves.
    return with_unit(setting_words(axis.path), axis.unit if axis.numbers is not None else "")


def _captioned(
    shown: _Shown,
    owner: str | None,
    place: dict[Listed, int],
    words: str,
    figure: Markup,
    *,
    sees: str,
    heading: str = "",
) -> Plate:
    heading = heading or score_words(shown.label)
    title = heading[:1].upper() + heading[1:] + (f" of {owner}" if owner else "")
    at = [f"{setting_words(one.path)} {value_words(one.labels[i])}" for one, i in place.items()]
    where = f", where {' and '.join(at)}" if at else ""
    return Plate(title=title, words=f"{words}{where}. {sees}", figure=figure)
