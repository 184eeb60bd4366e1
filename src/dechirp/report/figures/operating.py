"""Receiver operating characteristics: detection over false alarm, measured and by theory."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from dechirp.core.values import value
from dechirp.report.figures import parts
from dechirp.report.figures.parts import in_decades
from dechirp.report.figures.style import INK, LINE_COLORS


@value
class Operating:
    """Probability of detection over that of false alarm, by threshold, (n,) each."""

    name: str
    """Empty where there is one curve alone."""
    false_alarm: np.ndarray
    detection: np.ndarray
    low: np.ndarray
    high: np.ndarray
    """Ends of the interval of the detections."""
    theory_false_alarm: np.ndarray
    theory: np.ndarray


def operating(axes: Axes, curves: Sequence[Operating], *, x: str, y: str, legend: str = "") -> Axes:
    """Draw receiver operating characteristics; what no trial raised an alarm at is left out.

    Parameters
    ----------
    axes : Axes
        To draw on.
    curves : sequence of Operating
        At most `study.MOST_LINES`.
    x, y : str
        What stands at the axes.
    legend : str
        What the names of the curves are values of.

    Returns
    -------
    Axes
        Those given.
    """
    for curve, color in zip(curves, LINE_COLORS, strict=False):
        seen = curve.false_alarm > 0
        at = curve.false_alarm[seen]
        axes.fill_between(
            at, curve.low[seen], curve.high[seen], color=color, alpha=0.2, linewidth=0
        )
        axes.plot(
            at, curve.detection[seen], color=color, linewidth=1.2, label=curve.name or "measured"
        )
        told = curve.theory_false_alarm > 0
        axes.plot(
            curve.theory_false_alarm[told],
            curve.theory[told],
            color=color,
            linewidth=1.0,
            linestyle="--",
        )
    axes.set_xscale("log")
    in_decades(axes.xaxis)
    axes.set(ylim=(-0.02, 1.05), xlabel=x, ylabel=y)
    if any(np.isfinite(curve.theory).any() for curve in curves):
        axes.plot([], [], color=INK, linewidth=1.0, linestyle="--", label="theory")
    parts.legend(axes, title=legend)
    axes.set_label(f"{y} over {x}")
    return axes
