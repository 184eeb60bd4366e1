"""Scores over settings, measured with intervals and theoretical."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter, NullLocator

from dechirp.core.text import format_number
from dechirp.core.values import frozen_dataclass
from dechirp.report.figures import common
from dechirp.report.figures.common import set_decade_ticks
from dechirp.report.figures.style import INK, LINE_COLORS, LINE_MARKS, MUTED

MAX_LINES = len(LINE_COLORS)
"""Largest number of lines in a figure."""

_MAX_MARKS = 40
_MAX_POINTS = 3000
# Largest total number of letters of horizontal bar names; longer names are slanted.
_MAX_LETTERS = 60


@frozen_dataclass
class AxisLabel:
    """Label and scale of an axis."""

    text: str
    """Label with the unit."""
    logarithmic: bool = False


@frozen_dataclass
class ScoreLine:
    """Values of one score along a setting, (n,) each; NaN for missing values."""

    name: str
    """Name of the line; empty for a single one."""
    x: np.ndarray
    value: np.ndarray
    low: np.ndarray
    high: np.ndarray
    theory: np.ndarray


def choose_axis_scale(values: np.ndarray, *, is_ratio: bool) -> Literal["shares", "log", "linear"]:
    """Choose the scale of an axis of values.

    Ratios that reach 0.05 are proportions from 0 to 1. Other non-negative values that span more
    than a factor of three have a logarithmic axis.
    """
    finite_values = values[np.isfinite(values)]
    smallest, largest = (
        (finite_values.min(), finite_values.max()) if finite_values.size else (0.0, 1.0)
    )
    if is_ratio and smallest >= 0 and 0.05 <= largest <= 1:
        return "shares"
    positive = finite_values[finite_values > 0]
    spans = positive.size > 0 and largest > 3 * positive.min()
    return "log" if spans and smallest >= 0 else "linear"


def is_suited_to_log_axis(setting_values: Sequence[float]) -> bool:
    """Return whether the steps of setting values grow with them, as on a logarithmic axis."""
    ordered = np.unique(np.asarray(setting_values, dtype=float))
    if ordered.size < 3 or ordered[0] <= 0:
        return False
    steps = np.diff(ordered)
    return bool(steps.max() > 5 * steps.min() and ordered[-1] > 8 * ordered[0])


def draw_score_lines(
    axes: Axes,
    lines: Sequence[ScoreLine],
    *,
    x: AxisLabel,
    y: AxisLabel,
    is_ratio: bool,
    legend: str = "",
    limits: Sequence[float] = (),
) -> Axes:
    """Draw a score over one setting with interval bands and theoretical lines.

    Parameters
    ----------
    axes : Axes
        Axes to draw on.
    lines : sequence of ScoreLine
        At most `MAX_LINES` lines, with x in any order.
    x, y : AxisLabel
        Axis labels.
    is_ratio : bool
        Whether values are proportions or probabilities.
    legend : str
        Title of the legend: the setting that differs between the lines.
    limits : sequence of float
        Required values, drawn as lines.

    Returns
    -------
    Axes
        The given axes.
    """
    _set_value_axis(axes, lines, is_ratio=is_ratio, y_label=y.text)
    for line, color, mark in zip(lines, LINE_COLORS, LINE_MARKS, strict=False):
        _draw_score_line(axes, line, color=color, mark=mark)
    _draw_required_limits(axes, limits)
    axes.set_xlabel(x.text)
    if x.logarithmic:
        axes.set_xscale("log")
        set_decade_ticks(axes.xaxis)
        _set_ticks_at_settings(axes, lines)
    _add_legend_with_theory(axes, lines, title=legend)
    axes.set_label(f"{y.text} over {x.text}")
    return axes


def draw_score_scatter(
    axes: Axes, lines: Sequence[ScoreLine], *, x: AxisLabel, y: AxisLabel, is_ratio: bool
) -> Axes:
    """Draw a score over a random setting, with a mark and interval for each point.

    Parameters
    ----------
    axes, lines, x, y, is_ratio
        See `draw_score_lines`.

    Returns
    -------
    Axes
        The given axes.
    """
    _set_value_axis(axes, lines, is_ratio=is_ratio, y_label=y.text)
    for line, color, mark in zip(lines, LINE_COLORS, LINE_MARKS, strict=False):
        selection = slice(None, None, max(-(-line.x.size // _MAX_POINTS), 1))
        has_many_points = line.x.size > _MAX_MARKS
        _draw_error_bars(
            axes,
            line,
            selection=selection,
            color=color,
            mark=mark,
            size=2.2 if has_many_points else 3.6,
            alpha=0.35 if has_many_points else 1.0,
        )
        axes.plot(
            line.x[selection],
            line.theory[selection],
            linestyle="",
            marker="_",
            markersize=5,
            color=INK,
        )
    axes.set_xlabel(x.text)
    _add_legend_with_theory(axes, lines, title="", theory_mark="_")
    axes.set_label(f"{y.text} over {x.text}, drawn")
    return axes


def draw_score_bars(
    axes: Axes,
    lines: Sequence[ScoreLine],
    names: Sequence[str],
    *,
    x: AxisLabel,
    y: AxisLabel,
    is_ratio: bool,
    legend: str = "",
) -> Axes:
    """Draw a score as bars over categorical values, with a mark for theory.

    On a logarithmic axis there are marks without bars.

    Parameters
    ----------
    axes, y, is_ratio, legend
        See `draw_score_lines`.
    lines : sequence of ScoreLine
        Lines whose `x` are indices of the names.
    names : sequence of str
        Names of the bars.
    x : AxisLabel
        Label of the setting.

    Returns
    -------
    Axes
        The given axes.
    """
    is_slanted = sum(map(len, names)) > _MAX_LETTERS
    scale = _set_value_axis(axes, lines, is_ratio=is_ratio, y_label=y.text)
    width = 0.8 / len(lines)
    for line_index, (line, color, mark) in enumerate(
        zip(lines, LINE_COLORS, LINE_MARKS, strict=False)
    ):
        positions = line.x + (line_index - (len(lines) - 1) / 2) * width
        shifted_line = ScoreLine(
            name=line.name,
            x=positions,
            value=line.value,
            low=line.low,
            high=line.high,
            theory=line.theory,
        )
        if scale != "log":
            axes.bar(positions, np.nan_to_num(line.value), 0.85 * width, color=color, alpha=0.3)
        _draw_error_bars(axes, shifted_line, color=color, mark=mark, size=3.6)
        axes.hlines(
            line.theory,
            positions - 0.43 * width,
            positions + 0.43 * width,
            color=INK,
            linewidth=1.2,
        )
    axes.grid(visible=False, axis="x")
    axes.set_xlim(-0.6, len(names) - 0.4)
    axes.set_xticks(range(len(names)), names)
    if is_slanted:
        for tick_label in axes.get_xticklabels():
            tick_label.set(rotation=25, ha="right", rotation_mode="anchor")
    axes.set_xlabel(x.text)
    _add_legend_with_theory(axes, lines, title=legend)
    axes.set_label(f"{y.text} by {x.text}")
    return axes


def _set_value_axis(axes: Axes, lines: Sequence[ScoreLine], *, is_ratio: bool, y_label: str) -> str:
    """Set the scale, limits and label of the value axis."""
    arrays = [array for line in lines for array in (line.value, line.theory)]
    values = np.concatenate(arrays) if arrays else np.zeros(0)
    scale = choose_axis_scale(values, is_ratio=is_ratio)
    if scale == "shares":
        axes.set_ylim(-0.02, 1.05)
    elif scale == "log":
        axes.set_yscale("log", nonpositive="clip")
        axes.set_ylim(*_log_axis_limits(lines))
        set_decade_ticks(axes.yaxis)
    axes.set_ylabel(y_label)
    return scale


def _log_axis_limits(lines: Sequence[ScoreLine]) -> tuple[float, float]:
    """Return the limits of a logarithmic axis; intervals that reach 0 do not extend it."""
    values = np.concatenate(
        [array for line in lines for array in (line.value, line.theory, line.high)]
    )
    positive_values = values[np.isfinite(values) & (values > 0)]
    lows = np.concatenate([line.low for line in lines])
    near_lows = lows[np.isfinite(lows) & (lows > positive_values.min() / 10)]
    return float(np.concatenate([positive_values, near_lows]).min()) / 1.3, 1.3 * float(
        positive_values.max()
    )


def _draw_score_line(axes: Axes, line: ScoreLine, *, color: str, mark: str) -> None:
    order = np.argsort(line.x, kind="stable")
    x, middle, low, high = (array[order] for array in (line.x, line.value, line.low, line.high))
    axes.fill_between(x, low, high, color=color, alpha=0.16, linewidth=0)
    has_theory = bool(np.isfinite(line.theory).any())
    if has_theory:
        axes.plot(x, line.theory[order], color=color, linewidth=1.2)
    else:
        axes.plot(x, middle, color=color, linewidth=0.8, alpha=0.5)
    has_many_points = x.size > _MAX_MARKS
    _draw_error_bars(axes, line, color=color, mark=mark, size=2.0 if has_many_points else 3.6)


def _draw_error_bars(
    axes: Axes,
    line: ScoreLine,
    *,
    color: str,
    mark: str,
    size: float,
    alpha: float = 1.0,
    selection: slice = slice(None),
) -> None:
    is_finite = np.isfinite(line.value[selection])
    x, middle, low, high = (
        array[selection][is_finite] for array in (line.x, line.value, line.low, line.high)
    )
    errors = np.nan_to_num(np.maximum([middle - low, high - middle], 0.0))
    axes.errorbar(
        x,
        middle,
        yerr=errors,
        color=color,
        alpha=alpha,
        marker=mark,
        markersize=size,
        linestyle="",
        elinewidth=0.9,
        capsize=1.8 if x.size <= _MAX_MARKS else 0.0,
        label=line.name or "measured",
    )


def _draw_required_limits(axes: Axes, limits: Sequence[float]) -> None:
    for limit in limits:
        axes.axhline(limit, color=MUTED, linewidth=0.8, linestyle=":")
    if limits:
        axes.plot([], [], color=MUTED, linewidth=0.8, linestyle=":", label="required")


def _add_legend_with_theory(
    axes: Axes, lines: Sequence[ScoreLine], *, title: str, theory_mark: str = ""
) -> None:
    if any(np.isfinite(line.theory).any() for line in lines):
        look = {"linestyle": "", "marker": theory_mark} if theory_mark else {"linewidth": 1.2}
        axes.plot([], [], color=INK, label="theory", **look)
    common.add_legend(axes, title=title)


def _set_ticks_at_settings(axes: Axes, lines: Sequence[ScoreLine]) -> None:
    """Set the ticks of a logarithmic axis to the settings if there are at most eight."""
    settings = np.unique(np.concatenate([line.x for line in lines]))
    if settings.size <= 8:
        axes.xaxis.set_major_locator(FixedLocator(settings.tolist()))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda setting, _: format_number(setting)))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.xaxis.set_minor_formatter(NullFormatter())
