"""Figure of the witness board: the difference of every number over its tolerance."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dechirp.report.figures.common import set_decade_ticks
from dechirp.report.figures.style import BLUE, MUTED, ORANGE

# Ratios below or above are drawn there.
_LOWEST_RATIO, _HIGHEST_RATIO = 1e-6, 100.0


def draw_witness_board(figure: Figure, ratios: Mapping[str, Sequence[float]]) -> Axes:
    """Draw a row for each witness, and a point for each ratio of difference to tolerance.

    Numbers pass up to a ratio of 1; one that is not finite fails.
    """
    axes = figure.subplots()
    for row, values in enumerate(ratios.values()):
        drawn = np.clip(np.nan_to_num(values, nan=np.inf), _LOWEST_RATIO, _HIGHEST_RATIO)
        offsets = np.linspace(-0.25, 0.25, len(drawn)) if len(drawn) > 1 else np.zeros(1)
        passed = drawn <= 1
        axes.plot(drawn[passed], (row + offsets)[passed], "o", color=BLUE, markersize=3)
        axes.plot(drawn[~passed], (row + offsets)[~passed], "X", color=ORANGE, markersize=5)
    axes.axvline(1, color=MUTED, linestyle=":")
    axes.set_xscale("log")
    axes.set_xlim(_LOWEST_RATIO / 2, 2 * _HIGHEST_RATIO)
    set_decade_ticks(axes.xaxis)
    axes.set_yticks(range(len(ratios)), list(ratios))
    axes.invert_yaxis()
    axes.set_xlabel("Difference over tolerance (1)")
    axes.set_label("differences of all numbers over their tolerances")
    return axes
