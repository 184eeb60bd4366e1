"""Figure of the board: the difference of every number over its tolerance."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dechirp.report.figures.common import set_decade_ticks
from dechirp.report.figures.style import BLUE, MUTED, ORANGE
from dechirp.witnesses.base import Comparison
from dechirp.witnesses.board import Testimony

# Differences below or above, and equal numbers, are drawn there.
_LOWEST_RATIO, _HIGHEST_RATIO = 1e-6, 100.0


def draw_board(figure: Figure, testimonies: Sequence[Testimony]) -> Axes:
    """Draw one row for each witness with results, and a point for each of its numbers."""
    axes = figure.subplots()
    rows = [testimony for testimony in testimonies if testimony.comparisons]
    for row, testimony in enumerate(rows):
        passed = np.array([comparison.passed for comparison in testimony.comparisons])
        ratios = np.array([_difference_over_tolerance(item) for item in testimony.comparisons])
        drawn = np.clip(np.nan_to_num(ratios, nan=np.inf), _LOWEST_RATIO, _HIGHEST_RATIO)
        offsets = np.linspace(-0.25, 0.25, len(drawn)) if len(drawn) > 1 else np.zeros(1)
        axes.plot(drawn[passed], (row + offsets)[passed], "o", color=BLUE, markersize=4)
        axes.plot(drawn[~passed], (row + offsets)[~passed], "X", color=ORANGE, markersize=6)
    axes.axvline(1, color=MUTED, linestyle=":")
    axes.set_xscale("log")
    axes.set_xlim(_LOWEST_RATIO / 2, 2 * _HIGHEST_RATIO)
    set_decade_ticks(axes.xaxis)
    axes.set_yticks(range(len(rows)), [testimony.name for testimony in rows])
    axes.invert_yaxis()
    axes.set_xlabel("Difference over tolerance; beyond the dotted line a number fails")
    axes.set_label("differences of all numbers over their tolerances")
    return axes


def _difference_over_tolerance(comparison: Comparison) -> float:
    if comparison.difference == 0 or (comparison.passed and comparison.relation != "equal"):
        return 0.0
    return abs(comparison.difference) / comparison.tolerance if comparison.tolerance else np.inf
