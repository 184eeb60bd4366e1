"""Receiver operating characteristics, measured and theoretical."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from dechirp.core.values import frozen_dataclass
from dechirp.report.figures import common
from dechirp.report.figures.common import set_decade_ticks
from dechirp.report.figures.style import INK, LINE_COLORS


@frozen_dataclass
class RocCurve:
    """Detection probability over false-alarm probability, by threshold, (n,) each."""

    name: str
    """Name of the curve; empty for a single one."""
    false_alarm: np.ndarray
    detection: np.ndarray
    low: np.ndarray
    high: np.ndarray
    """Ends of the interval of the detection probability."""
    theory_false_alarm: np.ndarray
    theory: np.ndarray


def draw_roc(axes: Axes, curves: Sequence[RocCurve], *, x: str, y: str, legend: str = "") -> Axes:
    """Draw receiver operating characteristics, without points that have no false alarm.

    Parameters
    ----------
    axes : Axes
        Axes to draw on.
    curves : sequence of RocCurve
        At most `study.MAX_LINES` curves.
    x, y : str
        Axis labels.
    legend : str
        Title of the legend: the setting that differs between the curves.

    Returns
    -------
    Axes
        The given axes.
    """
    for curve, color in zip(curves, LINE_COLORS, strict=False):
        has_alarms = curve.false_alarm > 0
        false_alarm = curve.false_alarm[has_alarms]
        axes.fill_between(
            false_alarm,
            curve.low[has_alarms],
            curve.high[has_alarms],
            color=color,
            alpha=0.2,
            linewidth=0,
        )
        axes.plot(
            false_alarm,
            curve.detection[has_alarms],
            color=color,
            linewidth=1.2,
            label=curve.name or "measured",
        )
        is_drawn = curve.theory_false_alarm > 0
        axes.plot(
            curve.theory_false_alarm[is_drawn],
            curve.theory[is_drawn],
            color=color,
            linewidth=1.0,
            linestyle="--",
        )
    axes.set_xscale("log")
    set_decade_ticks(axes.xaxis)
    axes.set(ylim=(-0.02, 1.05), xlabel=x, ylabel=y)
    if any(np.isfinite(curve.theory).any() for curve in curves):
        axes.plot([], [], color=INK, linewidth=1.0, linestyle="--", label="theory")
    common.add_legend(axes, title=legend)
    axes.set_label(f"{y} over {x}")
    return axes
