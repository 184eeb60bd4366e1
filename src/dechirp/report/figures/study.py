"""Scores over settings: measured with intervals, beside theory."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter, NullLocator

from dechirp.core.values import value
from dechirp.core.words import number
from dechirp.report.figures import parts
from dechirp.report.figures.parts import in_decades
from dechirp.report.figures.style import INK, LINE_COLORS, LINE_MARKS, MUTED

MOST_LINES = len(LINE_COLORS)
"""Lines that one figure tells apart."""

_MOST_MARKS = 40
_MOST_DRAWN = 3000
# Bars beside each other whose names stand level; more, or longer ones, are written aslant.
_MOST_LETTERS = 60


@value
class Axis:
    """One axis of a figure."""

    words: str
    """With the unit."""
    logarithmic: bool = False


@value
class Line:
    """Values of one score along a setting, (n,) each; NaN where there is nothing to tell."""

    name: str
    """Empty where there is one line alone."""
    x: np.ndarray
    value: np.ndarray
    low: np.ndarray
    high: np.ndarray
    theory: np.ndarray


def spread_of(values: np.ndarray, *, is_ratio: bool) -> Literal["shares", "log", "linear"]:
    """How an axis of values is divided.

    Ratios that reach a twentieth are shares, from 0 to 1. Other values that are not negative,
    and go over more than a factor of three, stand on a logarithmic axis.
    """
    there = values[np.isfinite(values)]
    smallest, largest = (there.min(), there.max()) if there.size else (0.0, 1.0)
    if is_ratio and smallest >= 0 and 0.05 <= largest <= 1:
        return "shares"
    positive = there[there > 0]
    spans = positive.size > 0 and largest > 3 * positive.min()
    return "log" if spans and smallest >= 0 else "linear"


def evenly_in_ratio(x: Sequence[float]) -> bool:
    """Whether the values of a setting want a logarithmic axis: their steps grow with them."""
    ordered = np.unique(np.asarray(x, dtype=float))
    if ordered.size < 3 or ordered[0] <= 0:
        return False
    steps = np.diff(ordered)
    return bool(steps.max() > 5 * steps.min() and ordered[-1] > 8 * ordered[0])


def over(
    axes: Axes,
    lines: Sequence[Line],
    *,
    x: Axis,
    y: Axis,
    is_ratio: bool,
    legend: str = "",
    limits: Sequence[float] = (),
) -> Axes:
    """Draw a score over one setting: marks, bands of their intervals, and lines of theory.

    Parameters
    ----------
    axes : Axes
        To draw on.
    lines : sequence of Line
        At most `MOST_LINES`; x in any order.
    x, y : Axis
        What stands at the axes.
    is_ratio : bool
        Whether values are shares or probabilities.
    legend : str
        What the names of the lines are values of.
    limits : sequence of float
        What is required, drawn across.

    Returns
    -------
    Axes
        Those given.
    """
    _divide(axes, lines, is_ratio=is_ratio, y_words=y.words)
    for line, color, mark in zip(lines, LINE_COLORS, LINE_MARKS, strict=False):
        _measured(axes, line, color=color, mark=mark)
    _across(axes, limits)
    axes.set_xlabel(x.words)
    if x.logarithmic:
        axes.set_xscale("log")
        in_decades(axes.xaxis)
        _few_ticks(axes, lines)
    _legend(axes, lines, title=legend)
    axes.set_label(f"{y.words} over {x.words}")
    return axes


def scattered(axes: Axes, lines: Sequence[Line], *, x: Axis, y: Axis, is_ratio: bool) -> Axes:
    """Draw a score over a setting that was drawn: a mark with its interval for each point.

    Parameters
    ----------
    axes, lines, x, y, is_ratio
        See `over`.

    Returns
    -------
    Axes
        Those given.
    """
    _divide(axes, lines, is_ratio=is_ratio, y_words=y.words)
    for line, color, mark in zip(lines, LINE_COLORS, LINE_MARKS, strict=False):
        some = slice(None, None, max(-(-line.x.size // _MOST_DRAWN), 1))
        many = line.x.size > _MOST_MARKS
        _bars(
            axes,
            line,
            some=some,
            color=color,
            mark=mark,
            size=2.2 if many else 3.6,
            faint=0.35 if many else 1.0,
        )
        axes.plot(
            line.x[some], line.theory[some], linestyle="", marker="_", markersize=5, color=INK
        )
    axes.set_xlabel(x.words)
    _legend(axes, lines, title="", theory_mark="_")
    axes.set_label(f"{y.words} over {x.words}, drawn")
    return axes


def columns(
    axes: Axes,
    lines: Sequence[Line],
    names: Sequence[str],
    *,
    x: Axis,
    y: Axis,
    is_ratio: bool,
    legend: str = "",
) -> Axes:
    """Draw a score for each of some words, with a mark for what theory says.

    On a logarithmic axis marks stand without bars, which have no foot there.

    Parameters
    ----------
    axes, y, is_ratio, legend
        See `over`.
    lines : sequence of Line
        Their `x` counts the names from 0.
    names : sequence of str
        The words.
    x : Axis
        What they are values of.

    Returns
    -------
    Axes
        Those given.
    """
    aslant = sum(map(len, names)) > _MOST_LETTERS
    spread = _divide(axes, lines, is_ratio=is_ratio, y_words=y.words)
    width = 0.8 / len(lines)
    for turn, (line, color, mark) in enumerate(zip(lines, LINE_COLORS, LINE_MARKS, strict=False)):
        at = line.x + (turn - (len(lines) - 1) / 2) * width
        moved = Line(
            name=line.name,
            x=at,
            value=line.value,
            low=line.low,
            high=line.high,
            theory=line.theory,
        )
        if spread != "log":
            axes.bar(at, np.nan_to_num(line.value), 0.85 * width, color=color, alpha=0.3)
        _bars(axes, moved, color=color, mark=mark, size=3.6)
        axes.hlines(line.theory, at - 0.43 * width, at + 0.43 * width, color=INK, linewidth=1.2)
    axes.grid(visible=False, axis="x")
    axes.set_xlim(-0.6, len(names) - 0.4)
    axes.set_xticks(range(len(names)), names)
    if aslant:
        for letters in axes.get_xticklabels():
            letters.set(rotation=25, ha="right", rotation_mode="anchor")
    axes.set_xlabel(x.words)
    _legend(axes, lines, title=legend)
    axes.set_label(f"{y.words} by {x.words}")
    return axes


def _divide(axes: Axes, lines: Sequence[Line], *, is_ratio: bool, y_words: str) -> str:
    """Divide the axis of values, and name it."""
    told = [array for line in lines for array in (line.value, line.theory)]
    values = np.concatenate(told) if told else np.zeros(0)
    spread = spread_of(values, is_ratio=is_ratio)
    if spread == "shares":
        axes.set_ylim(-0.02, 1.05)
    elif spread == "log":
        axes.set_yscale("log", nonpositive="clip")
        axes.set_ylim(*_ends(lines))
        in_decades(axes.yaxis)
    axes.set_ylabel(y_words)
    return spread


def _ends(lines: Sequence[Line]) -> tuple[float, float]:
    """Ends of a logarithmic axis; an interval that reaches 0 does not stretch it by a decade."""
    all_of = np.concatenate([of for line in lines for of in (line.value, line.theory, line.high)])
    shown = all_of[np.isfinite(all_of) & (all_of > 0)]
    lows = np.concatenate([line.low for line in lines])
    near = lows[np.isfinite(lows) & (lows > shown.min() / 10)]
    return float(np.concatenate([shown, near]).min()) / 1.3, 1.3 * float(shown.max())


def _measured(axes: Axes, line: Line, *, color: str, mark: str) -> None:
    order = np.argsort(line.x, kind="stable")
    x, middle, low, high = (of[order] for of in (line.x, line.value, line.low, line.high))
    axes.fill_between(x, low, high, color=color, alpha=0.16, linewidth=0)
    has_theory = bool(np.isfinite(line.theory).any())
    if has_theory:
        axes.plot(x, line.theory[order], color=color, linewidth=1.2)
    else:
        axes.plot(x, middle, color=color, linewidth=0.8, alpha=0.5)
    many = x.size > _MOST_MARKS
    _bars(axes, line, color=color, mark=mark, size=2.0 if many else 3.6)


def _bars(
    axes: Axes,
    line: Line,
    *,
    color: str,
    mark: str,
    size: float,
    faint: float = 1.0,
    some: slice = slice(None),
) -> None:
    told = np.isfinite(line.value[some])
    x, middle, low, high = (of[some][told] for of in (line.x, line.value, line.low, line.high))
    reach = np.nan_to_num(np.maximum([middle - low, high - middle], 0.0))
    axes.errorbar(
        x,
        middle,
        yerr=reach,
        color=color,
        alpha=faint,
        marker=mark,
        markersize=size,
        linestyle="",
        elinewidth=0.9,
        capsize=1.8 if x.size <= _MOST_MARKS else 0.0,
        label=line.name or "measured",
    )


def _across(axes: Axes, limits: Sequence[float]) -> None:
    for limit in limits:
        axes.axhline(limit, color=MUTED, linewidth=0.8, linestyle=":")
    if limits:
        axes.plot([], [], color=MUTED, linewidth=0.8, linestyle=":", label="required")


def _legend(axes: Axes, lines: Sequence[Line], *, title: str, theory_mark: str = "") -> None:
    if any(np.isfinite(line.theory).any() for line in lines):
        look = {"linestyle": "", "marker": theory_mark} if theory_mark else {"linewidth": 1.2}
        axes.plot([], [], color=INK, label="theory", **look)
    parts.legend(axes, title=title)


def _few_ticks(axes: Axes, lines: Sequence[Line]) -> None:
    """Write the settings themselves at a logarithmic axis where they are few."""
    there = np.unique(np.concatenate([line.x for line in lines]))
    if there.size <= 8:
        axes.xaxis.set_major_locator(FixedLocator(there.tolist()))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda one, _: number(one)))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.xaxis.set_minor_formatter(NullFormatter())
